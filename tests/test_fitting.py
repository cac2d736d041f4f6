"""From reflectance to a material: members come back, rows are never worse than those below them, the XML is what was predicted."""

from __future__ import annotations

import json

import mitsuba as mi
import numpy as np
import pytest
import sgtd
from sgtd.errors import UserError
from sgtd.fitting import fit_measurement, measurement
from sgtd.fitting.problem import Model
from sgtd.fitting.rows import ROWS

METAL = {"distribution": "gtd", "gamma": 2.2, "p": 1.3, "alpha": 0.22}


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def pairs(count, seed=1):
    """Light in a plane up to 78 degrees, views along reflections by facets of a wide lobe."""
    rng = np.random.default_rng(seed)
    theta = np.radians(rng.uniform(0.0, 78.0, 3 * count))
    wi = np.stack([np.sin(theta), 0.0 * theta, np.cos(theta)], axis=1)
    slope, phi = 0.25 * np.abs(rng.standard_cauchy(3 * count)), rng.uniform(0.0, 2.0 * np.pi, 3 * count)
    h = np.stack([slope * np.cos(phi), slope * np.sin(phi), np.ones_like(phi)], axis=1)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    wo = 2.0 * np.sum(wi * h, axis=1)[:, None] * h - wi
    keep = np.flatnonzero(wo[:, 2] > np.cos(np.radians(79.0)))[:count]
    return wi[keep], wo[keep]


def evaluate(material, wi, wo):
    """What Mitsuba says of a material, without the cosine."""
    bsdf, si = mi.load_dict(material) if isinstance(material, dict) else material, mi.SurfaceInteraction3f()
    found = []
    for light, view in zip(wi, wo):
        si.wi = mi.Vector3f(*light)
        found.append(np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*view))) / view[2])
    return np.array(found)


def measured(material, count=500, noise=0.03):
    wi, wo = pairs(count)
    value = evaluate(material, wi, wo)
    return wi, wo, value * (1.0 + noise * np.random.default_rng(2).standard_normal(value.shape))


def metal(**shape):
    eta = {"type": "rgb", "value": [4.0, 3.0, 6.0]}
    return {"type": "sgtdconductor", "eta": eta, "k": {"type": "rgb", "value": [0.0] * 3}, **shape}


def lobe_error(found, truth):
    """Root mean square of ln D down to a thousandth of the peak."""
    theta = np.radians(np.linspace(0.0, 80.0, 400))
    w = np.stack([np.sin(theta), 0.0 * theta, np.cos(theta)], axis=1)
    expected = truth.d(w)
    return float(np.sqrt(np.mean(np.log(found.d(w) / expected)[expected > 1e-3 * expected.max()] ** 2)))


@pytest.fixture(scope="module")
def gtd():
    mi.set_variant("scalar_rgb")
    return sgtd.fit(*measured(metal(**METAL)), model="gtd", base="none")


def test_a_member_comes_back(gtd):
    truth = sgtd.Ndf(gamma=2.2, p=1.3, alpha=0.22)
    exact = sgtd.fit(*measured(metal(**METAL), noise=0.0), model="gtd", base="none")
    assert lobe_error(exact.ndf, truth) < 1e-3
    assert lobe_error(gtd.ndf, truth) < 0.05
    assert gtd.parameters["alpha"] == pytest.approx(0.22, rel=0.05)
    eta = np.array(gtd.properties["eta"])
    assert eta == pytest.approx([4.0, 3.0, 6.0], rel=0.05)


def test_no_row_is_worse_than_one_below_it(gtd):
    for name, fitted in gtd.fitted.items():
        for child in ROWS[name].children:
            assert fitted.cost <= gtd.fitted[child].cost * (1.0 + 1e-6), (name, child)


@pytest.mark.parametrize("model", ["beckmann", "student", "gtd", "tabulated", "mixture"])
@pytest.mark.parametrize("masking", ["separable", "height_correlated"])
def test_the_material_is_the_prediction(tmp_path, model, masking):
    wi, wo, value = measured(metal(**METAL), 200)
    found = fit_measurement(measurement(wi, wo, value), model=model, setting=Model("none", "schlick", "log", masking))
    file = tmp_path / "material.xml"
    file.write_text(found.to_xml(), encoding="utf-8")
    other, views = pairs(60, seed=7)
    expected = found.predict(other, views)
    assert evaluate(found.to_dict(), other, views) == pytest.approx(expected, rel=1e-4)
    scene = tmp_path / "scene.xml"
    scene.write_text(
        '<scene version="3.0.0"><include filename="material.xml"/><shape type="sphere"><ref id="material"/></shape></scene>'
    )
    included = mi.load_file(str(scene)).shapes()[0].bsdf()
    assert evaluate(included, other, views) == pytest.approx(expected, rel=1e-4)


def test_a_plastic_has_its_base():
    start = {"type": "sgtdplastic", **METAL, "int_ior": 1.5, "ext_ior": 1.0}
    color = [0.1, 0.3, 0.05]
    wi, wo, value = measured({**start, "diffuse_reflectance": {"type": "rgb", "value": color}})
    found = sgtd.fit(wi, wo, value, model="gtd", base="diffuse", fresnel="dielectric")
    assert found.properties["diffuse_reflectance"] == pytest.approx(color, rel=0.05)
    other, views = pairs(60, seed=7)
    # transmission is an average over 576 facets here, and a table there
    assert evaluate(found.to_dict(), other, views) == pytest.approx(found.predict(other, views), rel=1.5e-2)


def test_what_data_do_not_tell_is_named():
    """Beckmann's lobe does not tell an infinite gamma from a great one; what is written down is JSON."""
    wi, wo, value = measured(metal(distribution="beckmann", alpha=0.2), 300)
    found = sgtd.fit(wi, wo, value, model="student", base="none")
    content = json.loads(found.as_json())
    assert content["parameters"]["gamma"]["status"] != "known"
    assert {score["model"] for score in content["scores"]} == {"student", "ggx", "beckmann"}


@pytest.mark.parametrize(
    "changed, message",
    [
        ({"model": "gxx"}, "gxx.*choose"),
        ({"loss": "huber"}, "huber.*log, cbrt, l2"),
        ({"base": "diffuse", "fresnel": "conductor"}, "conductor has no diffuse base"),
        ({"max_angle": 95.0}, "95.*between 5 and 90"),
        ({"value": np.full(20, np.nan)}, "not numbers.*leave these rows out"),
        ({"value": np.zeros(20)}, "too few"),
        ({"value": np.ones(19)}, r"\(19,\)"),
        ({"value": np.ones((20, 5))}, "5 channels"),
        ({"wi": np.full((20, 3), 2.0)}, "length 1"),
    ],
)
def test_refusals_name_what_is_wrong(changed, message):
    wi, wo = pairs(20)
    given = {"wi": wi, "wo": wo, "value": np.ones(20), "base": "none", **changed}
    with pytest.raises(UserError, match=message):
        sgtd.fit(given.pop("wi"), given.pop("wo"), given.pop("value"), **given)


def test_retro_reflection_is_said():
    """A bump towards the light, which no facets make."""
    rng = np.random.default_rng(3)
    wi, wo = pairs(600)
    theta, turn = np.radians(rng.uniform(25.0, 70.0, 200)), np.radians(rng.uniform(-6.0, 6.0, (2, 200)))
    back_i = np.stack([np.sin(theta), 0.0 * theta, np.cos(theta)], axis=1)
    back_o = np.stack([np.sin(theta + turn[0]), np.sin(turn[1]), np.cos(theta + turn[0])], axis=1)
    back_o /= np.linalg.norm(back_o, axis=1, keepdims=True)
    wi, wo = np.vstack([wi, back_i]), np.vstack([wo, back_o])
    plain = evaluate(metal(distribution="ggx", alpha=0.1), wi, wo).mean(axis=1) + 0.1
    bump = 1.5 * np.exp(-((np.arccos(np.clip(np.sum(wi * wo, axis=1), -1.0, 1.0)) / 0.15) ** 2))
    said = [
        any("retro-reflective" in warning for warning in sgtd.fit(wi, wo, value, model="ggx").warnings)
        for value in (plain, plain + bump)
    ]
    assert said == [False, True]
