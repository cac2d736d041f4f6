"""A grid of settings: values as they are read, images once for each combination and seed, and what is written of them."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import conftest
import mitsuba as mi
import numpy as np
import pytest
from sgtd import PACKAGE_DIR, sweep
from sgtd.errors import UserError

SCENE = PACKAGE_DIR / "scenes" / "spheres.xml"


@pytest.fixture(autouse=True)
def _scalar():
    conftest.use("scalar_rgb")


def values(text: str):
    return sweep.parse_axis(text, ["width", "quality"]).values


def test_values_are_lists_and_ranges():
    assert values("gamma=1.6, 2,inf") == (1.6, 2.0, math.inf)
    assert values("alpha=.1:.5:5") == (0.1, 0.2, 0.3, 0.4, 0.5)
    assert values("alpha=.01:1:3:log") == (0.01, 0.1, 1.0)
    assert values("alpha=.5:.1:2,1") == (0.5, 0.1, 1.0)
    assert values("distribution=ggx,beckmann") == ("ggx", "beckmann")
    # of the scene: as written
    assert values("width=16,32") == ("16", "32")
    assert sweep.parse_axis("width=16", ["width"]).of_scene
    axes = [sweep.parse_axis(text, ()) for text in ("gamma=2,3", "p=1,2,4")]
    assert [tuple(c.values()) for c in sweep.combinations(axes)] == [(g, p) for g in (2, 3) for p in (1, 2, 4)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("gamma", "expected name=values"),
        ("gama=2", "--set gama: unknown; .*gamma.*of the scene: quality, width"),
        ("gamma=1,,2", "a value is missing"),
        ("gamma=two", '"two" is not a number'),
        ("gamma=2,2.0", "given twice"),
        ("alpha=0:1", "expected first:last:count"),
        ("alpha=0:1:3:log", "must be above 0"),
        ("alpha=0:1:1", "between 2 and 1000"),
        ("alpha=0:inf:3", "finite"),
        ("alpha=0:1:x", "expected first:last:count"),
    ],
)
def test_bad_values_are_named(text, says):
    with pytest.raises(UserError, match=says):
        values(text)


def test_a_setting_is_given_once():
    axes = [sweep.parse_axis(text, ()) for text in ("gamma=2,3", "gamma=4")]
    with pytest.raises(UserError, match="--set gamma is given twice"):
        sweep.combinations(axes)


def run(folder: Path, *settings: str, seeds: int = 1, **more):
    axes = [sweep.parse_axis(text, ["width", "height"]) for text in settings]
    parameters = {"width": "24", "height": "16"}
    given = dict(variant="scalar_rgb", sensor=0, spp=4, integrator=None, lenient=False, parameters=parameters)
    todo = sweep.tasks(folder, SCENE, axes, seeds, **given)
    advanced = []
    made, failed = sweep.make(
        folder, SCENE, "scalar_rgb", axes, seeds, todo, progress=lambda *_: advanced.append, **more
    )
    return made, failed, advanced


def test_images_are_those_of_the_settings_and_are_made_once(tmp_path):
    made, failed, advanced = run(tmp_path, "gamma=1.6,inf", "alpha=0.2,0.4", seeds=2)
    assert not failed and advanced == [1] * 8
    assert [tuple(cell.settings.values()) for cell in made.cells] == [
        (1.6, 0.2),
        (1.6, 0.4),
        (math.inf, 0.2),
        (math.inf, 0.4),
    ]
    means = [cell.luminance for cell in made.cells]
    assert len(set(means)) == 4 and all(cell.noise > 0.0 and cell.spp == 8 for cell in made.cells)
    # what the scene itself gives with that material: the same numbers, seed for seed
    import sgtd
    from sgtd.scene.exchange import exchange
    from sgtd.scene.graph import read_scene
    from sgtd.scene.render import render, to_rgb

    sgtd.register()
    graph = read_scene(SCENE, {"width": "24", "height": "16"})
    scene = exchange(graph, {"gamma": math.inf}, {"alpha": 0.4}).right.build()
    images = [to_rgb(render([scene], 0, 4, lambda _: None, seed=seed)[0].bitmap) for seed in (0, 1)]
    assert np.abs(images[0] - images[1]).max() > 0.0
    np.testing.assert_allclose(made.cells[3].image, np.mean(images, axis=0), rtol=1e-5, atol=1e-7)

    with (tmp_path / "sweep.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["mean_luminance"]) for row in rows] == pytest.approx(means, rel=1e-5)
    assert all((tmp_path / name).is_file() for row in rows for name in row["images"].split(", "))
    page = (tmp_path / "sweep.html").read_text(encoding="utf-8")
    assert "data:image/png;base64" in page and page.count("<tr>") == 5
    assert np.array(mi.Bitmap(str(tmp_path / "sheet.png"))).std() > 10.0

    # one value more: two seeds of it are rendered, the rest is there
    more, failed, advanced = run(tmp_path, "gamma=1.6,3,inf", "alpha=0.2", seeds=2)
    assert not failed and advanced == [4, 1, 1]
    assert more.cells[0].luminance == means[0] and more.cells[2].luminance == means[2]


def test_what_fails_is_told_and_the_rest_is_there(tmp_path):
    made, failed, _ = run(tmp_path, "gamma=0.5,2")
    assert len(failed) == 1 and "gamma" in failed[0].error
    assert made.cells[0].image is None and made.cells[1].image is not None
    assert "gamma" in (tmp_path / "sweep.csv").read_text(encoding="utf-8")


def test_settings_of_the_scene_and_a_dask_cluster(tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        made, failed, _ = run(tmp_path, "height=8,16", scheduler=cluster.scheduler_address)
    assert not failed and [cell.image.shape[0] for cell in made.cells] == [8, 16]
