"""``sgtd fit``: what it writes for one file and for many, and what it refuses."""

from __future__ import annotations

import csv
import json
import os
import re
import xml.etree.ElementTree as ET

import mitsuba as mi
import numpy as np
import pytest
import sgtd
from measured_files import write_utia
from sgtd.cli.entry import main
from sgtd.fit_report import Options, fit_files
from sgtd.fit_report.many import is_there, tasks
from sgtd.fitting.problem import lobe_of

FILES = {"material.xml", "fit.json", "scores.csv", "report.html"}


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def scan(path, gamma=1.8, alpha=0.15, seed=0):
    """Four scans in the plane of incidence, with 2 % of noise."""
    ndf, rng = sgtd.Ndf(gamma=gamma, alpha=alpha), np.random.default_rng(seed)
    lines = ["theta_i,theta_o,value"]
    for theta in (10, 30, 45, 60):
        for view in range(-78, 79, 3):
            t, o = np.radians(theta), np.radians(view)
            wi, wo = np.array([[np.sin(t), 0.0, np.cos(t)]]), np.array([[-np.sin(o), 0.0, np.cos(o)]])
            h = (wi + wo) / np.linalg.norm(wi + wo)
            value = 0.8 * lobe_of(ndf, 0.0, wi, wo, h, "separable")[0] * (1.0 + 0.02 * rng.standard_normal())
            lines.append(f"{theta},{view},{value:.7g}")
    path.write_text("\n".join(lines) + "\n")
    return path


def run(*arguments) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(a) for a in arguments])
    return int(caught.value.code or 0)


def test_one_file(tmp_path, capsys):
    folder = tmp_path / "out"
    assert run("fit", scan(tmp_path / "a.csv"), "--model", "student", "--base", "none", "-o", folder) == 0
    assert {path.name for path in folder.iterdir()} == FILES
    said = json.loads((folder / "fit.json").read_text())
    gamma = said["parameters"]["gamma"]
    assert said["model"] == "student" and said["format"] == "CSV" and said["options"]["base"] == "none"
    # facets were made with a reflectance that is the same at all angles, which no index has
    assert gamma["low"] < gamma["value"] < gamma["high"] and gamma["value"] == pytest.approx(1.8, rel=0.1)
    rows = list(csv.DictReader((folder / "scores.csv").open()))
    assert [row["chosen"] for row in rows if row["model"] == "student"] == ["yes"]
    assert {row["model"] for row in rows} == {"student", "ggx", "beckmann"}
    assert ET.parse(folder / "material.xml").find("bsdf").get("type") == "sgtdconductor"
    page = (folder / "report.html").read_text()
    # nothing is loaded from elsewhere
    assert not re.search(r"(?:src|href)=\"(?!data:)", page) and page.count("<img") == 5
    shown = capsys.readouterr()
    assert "student ←" in shown.out and "gamma = 1." in shown.out and "degrees" in shown.err
    scene = tmp_path / "scene.xml"
    scene.write_text(
        f'<scene version="3.0.0"><include filename="{folder / "material.xml"}"/><shape type="sphere"><ref id="material"/></shape></scene>'
    )
    assert mi.load_file(str(scene)).shapes()[0].bsdf() is not None


def test_anisotropic_data_with_their_sphere(tmp_path):
    ndf = sgtd.Ndf(distribution="ggx", alpha_u=0.5, alpha_v=0.2)

    def reflectance(wi, wo):
        h = wi + wo
        h = h / np.linalg.norm(h, axis=1, keepdims=True)
        return lobe_of(ndf, np.radians(25.0), wi, wo, h, "separable")[:, None] * np.array([0.9, 0.6, 0.3])

    write_utia(tmp_path / "a.bin", reflectance)
    folder = tmp_path / "out"
    assert run("fit", tmp_path / "a.bin", "--model", "ggx", "--base", "none", "-o", folder) == 0
    found = json.loads((folder / "fit.json").read_text())["parameters"]
    assert found["rotation"]["value"] == pytest.approx(25.0, abs=0.5)
    assert found["alpha_u"]["value"] == pytest.approx(0.5, rel=0.02)
    picture = np.array(mi.Bitmap(str(folder / "sphere.png")))[:, :, :3].astype(float)
    left, right = np.split(picture, 2, axis=1)
    # drawn lines between a grid of 15 degrees: the same highlight, if not the same pixels
    assert np.abs(left - right).mean() < 12.0 and left.std() > 20.0


@pytest.mark.parametrize(
    "content, message",
    [
        (b"", "is empty"),
        (b"theta_i,theta_o,R\n1,2\n", "line 2"),
        (b"nonsense\n", "names no columns"),
        (b"theta_i,theta_o,R\n1,2,0\n", "too few for a fit"),
    ],
)
def test_bad_files_leave_nothing(tmp_path, capsys, content, message):
    (tmp_path / "a.csv").write_bytes(content)
    assert run("fit", tmp_path / "a.csv", "-o", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert re.search(message, error) and error.count("\n") == 1 and "a.csv" in error
    assert not (tmp_path / "out").exists()


def test_options_that_do_not_go_together(tmp_path, capsys):
    assert run("fit", scan(tmp_path / "a.csv"), "--fresnel", "conductor", "-o", tmp_path / "out") == 1
    assert "conductor has no diffuse base" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_many_files_and_once_more(tmp_path):
    """Results are kept, failures named, a file that has changed or lost its folder is fitted again."""
    (tmp_path / "other").mkdir()
    paths = [scan(tmp_path / "a.csv", alpha=0.1), tmp_path / "bad.csv", scan(tmp_path / "other" / "a.csv", alpha=0.2)]
    paths[1].write_text("theta_i,theta_o,R\n1,2\n")
    options, folder = Options(model=("ggx",), base="none"), tmp_path / "out"
    seen = []
    outcomes = fit_files(paths, folder, options, workers=2, progress=lambda _name, _length: seen.append)
    assert [outcome.task.key for outcome in outcomes] == ["a", "bad", "a-2"] and sum(seen) == 3
    assert [bool(outcome.error) for outcome in outcomes] == [False, True, False]
    assert "bad.csv: line 2" in outcomes[1].error
    assert {path.name for path in folder.iterdir()} == {"a", "a-2", "fits.jsonl", "summary.html", "summary.csv"}
    rows = list(csv.DictReader((folder / "summary.csv").open()))
    assert [row["name"] for row in rows] == ["a", "a-2"]
    # twice as wide, and so are the fits
    assert float(rows[1]["alpha"]) / float(rows[0]["alpha"]) == pytest.approx(2.0, rel=0.2)
    page = (folder / "summary.html").read_text()
    assert 'href="a-2/report.html"' in page and "bad.csv: line 2" in page
    assert [task.key for task in tasks(paths[::2], folder, options)] == ["a", "a-2"]
    # nothing to do: what is there counts
    written = (folder / "fits.jsonl").stat().st_size
    fit_files(paths[::2], folder, options)
    assert (folder / "fits.jsonl").stat().st_size == written
    first, second = (outcome for outcome in outcomes if not outcome.error)
    assert is_there(first) and is_there(second)
    (folder / "a" / "material.xml").unlink()
    os.utime(paths[2])
    changed = tasks(paths[::2], folder, options)
    assert not is_there(first) and not second.task.is_in(line_of(changed[1])) and first.task.is_in(line_of(changed[0]))


def line_of(task):
    return {"key": task.key, "function": task.function, "arguments": task.arguments}


def test_many_files_on_dask(tmp_path):
    distributed = pytest.importorskip("distributed")
    paths = [scan(tmp_path / f"{name}.csv", alpha=0.2) for name in "ab"]
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        arguments = (
            "--model",
            "ggx",
            "--base",
            "none",
            "--scheduler",
            cluster.scheduler_address,
            "-o",
            tmp_path / "out",
        )
        assert run("fit", *paths, *arguments) == 0
    assert all(FILES <= {path.name for path in (tmp_path / "out" / name).iterdir()} for name in "ab")
