"""From slopes to a distribution: members come back with their axes, rows are never worse than those below them, on what was left out either."""

from __future__ import annotations

import json
import math

import mitsuba as mi
import numpy as np
import pytest
import sgtd
from sgtd.cli.entry import main
from sgtd.errors import UserError
from sgtd.fitting.rows import ROWS
from sgtd.slope_fitting.likelihood import log_density, log_profile


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def slopes_of(ndf, rotation, shape, seed=0):
    """Independent slopes with the density D cos^4, their axes turned."""
    rng = np.random.default_rng(seed)
    x, phi = ndf.quantile(rng.uniform(size=shape)), rng.uniform(0.0, 2.0 * math.pi, shape)
    u, v = ndf.stretch[0] * x * np.cos(phi), ndf.stretch[1] * x * np.sin(phi)
    c, s = math.cos(math.radians(rotation)), math.sin(math.radians(rotation))
    return c * u - s * v, s * u + c * v


GTD = {"gamma": 2.6, "p": 1.3, "alpha_u": 0.4, "alpha_v": 0.15}


@pytest.fixture(scope="module")
def found():
    return sgtd.fit_slopes(*slopes_of(sgtd.Ndf(**GTD), 25.0, (300, 300)))


def test_a_member_comes_back(found):
    assert found.model == "gtd" and found.ks < 0.005
    for parameter in found.parameters:
        if parameter.name in GTD:
            width = parameter.high - parameter.low
            assert 0.0 < width < 0.2 * GTD[parameter.name]
            assert abs(parameter.value - GTD[parameter.name]) < width
    assert found.rotation == pytest.approx(25.0, abs=0.5)


def test_no_row_is_worse_than_one_below_it(found):
    assert {score.model for score in found.scores} == set(ROWS)
    for name, fitted in found.fitted.items():
        for child in ROWS[name].children:
            assert fitted.value >= found.fitted[child].value - 1e-9


def test_the_likelihood_is_that_of_the_slopes(found):
    """Cells of slopes instead of slopes, and the density integrates to 1."""
    sx, sy = slopes_of(sgtd.Ndf(**GTD), 25.0, (300, 300))
    assert found.log_density(sx, sy).mean() == pytest.approx(found.log_likelihood, abs=3e-4)
    x, y = np.meshgrid(*[np.linspace(-6.0, 6.0, 1201)] * 2)
    assert np.exp(found.log_density(x, y)).sum() * 0.01**2 == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize(
    "shape", [{"gamma": 1.8}, {"gamma": math.inf, "p": 0.7}, {"gamma": 3.0, "p": 1.2, "shift": 1.5}]
)
def test_rows_on_the_half_that_was_left_out(shape):
    """Not below the best child by more than .001 a sample."""
    ndf = sgtd.Ndf(alpha=0.3, **shape)
    fitted = sgtd.fit_slopes(*slopes_of(ndf, 0.0, (200, 100), seed=3), model="sgtd").fitted
    x, y = slopes_of(ndf, 0.0, (20000,), seed=4)
    values = {}
    for name, one in fitted.items():
        space = one.likelihood.space
        values[name] = log_density(
            space.ndf(one.v, 1e-2), space.rotation(one.v), np.hypot(x, y), np.arctan2(y, x)
        ).mean()
    assert set(values) == set(ROWS)
    for name in ROWS:
        assert all(values[name] >= values[child] - 1e-3 for child in ROWS[name].children)


def test_the_tail_beyond_doubles():
    x = np.array([1.0, 20.0, 40.0, 300.0])
    assert log_profile(sgtd.Ndf(gamma=math.inf, alpha=1.0), x) == pytest.approx(-(x**2), rel=1e-9)
    gamma, p, shift = 400.0, 1.5, 0.5
    z = (x - shift) ** (2.0 * p)
    expected = -gamma * np.log1p(z / (gamma - 1.0))
    assert log_profile(sgtd.Ndf(gamma=gamma, p=p, shift=shift, alpha=1.0), x) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("gamma", [math.inf, 900.0])
def test_both_sides_of_a_thin_ring(gamma):
    """Where doubles still hold f, the continuation is what it says."""
    ndf = sgtd.Ndf(gamma=gamma, p=1.5, lam=0.3, shift=12.0, alpha=1.0)
    x = np.linspace(0.0, 26.0, 400)
    f = ndf.profile(x)
    kept = (f > 1e-300) & (f < 1e-200)
    assert (x[kept] < 12.0).any() and (x[kept] > 12.0).any()
    assert log_profile(ndf, x)[kept] == pytest.approx(np.log(f[kept]), rel=1e-9)


def test_heights_and_what_is_written(tmp_path, capsys):
    from sgtd.microsurface import generate

    made = generate(sgtd.Ndf(gamma=2.0, alpha=0.3), n=128, tolerance=3e-3)
    found = sgtd.fit_heights(made.heights, made.spacing, periodic=True, model=("student", "gtd"))
    values = {p.name: p.value for p in found.parameters}
    assert values["alpha_u"] == pytest.approx(0.3, rel=0.1) and values["alpha_v"] == pytest.approx(0.3, rel=0.1)
    assert found.count == 2 * 128 * 128 and mi.load_dict(found.to_dict()) is not None
    np.save(tmp_path / "map.npy", made.heights)
    arguments = ["fit", str(tmp_path / "map.npy"), "--model", "student", "-o", str(tmp_path / "out")]
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 1 and "give --spacing DX DY" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    with pytest.raises(SystemExit) as caught:
        main([*arguments, "--spacing", "1", "1", "--level"])
    assert not caught.value.code and "student ←" in capsys.readouterr().out
    content = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert content["format"] == "heights" and content["model"] == "student"
    assert content["parameters"]["gamma"]["low"] < content["parameters"]["gamma"]["high"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "material.xml",
        "fit.json",
        "scores.csv",
        "report.html",
    }
    assert "<img" in (tmp_path / "out" / "report.html").read_text()
    assert mi.load_file(str(tmp_path / "out" / "material.xml")) is not None


def test_missing_slopes_and_tilt():
    sx, sy = slopes_of(sgtd.Ndf(gamma=2.0, alpha=0.2), 0.0, (4000,))
    sx[:10] = np.nan
    found = sgtd.fit_slopes(sx + 0.1, sy, model="ggx")
    assert found.count == 3990 and "10 of 4000" in found.notes[0] and "level the map first" in found.notes[1]


@pytest.mark.parametrize(
    "sx, sy, model, message",
    [
        (np.zeros(5), np.zeros(6), "auto", "must be"),
        (np.ones(50), np.ones(50), "auto", "needs at least 200"),
        (np.ones(500), np.ones(500), "tabulated", "choose auto, beckmann"),
        (np.zeros(500), np.zeros(500), "ggx", "too few for a distribution"),
    ],
)
def test_refusals(sx, sy, model, message):
    with pytest.raises(UserError, match=message):
        sgtd.fit_slopes(sx, sy, model=model)
