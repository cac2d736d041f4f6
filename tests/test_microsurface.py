"""Explicit surfaces: their slopes, their files, light on them, and what Smith's model says of the same."""

from __future__ import annotations

import dataclasses
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
import sgtd
from sgtd.errors import UserError
from sgtd.microsurface import Surface, generate, ks_distance, read_heights

STUDENT = dict(distribution="student", gamma=1.7, alpha_u=0.4, alpha_v=0.1)
FORMATS = ("npy", "ply", "obj", "exr", "gsf")


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("scalar_rgb")


@pytest.fixture(scope="module")
def student() -> Surface:
    return generate(sgtd.Ndf(**STUDENT), n=128, tolerance=2e-3)


@pytest.fixture(scope="module")
def beckmann() -> Surface:
    return generate(sgtd.Ndf(distribution="beckmann", alpha=0.3), n=256)


def test_slopes_are_as_asked_for(student, beckmann):
    for surface, ndf in ((student, sgtd.Ndf(**STUDENT)), (beckmann, beckmann.ndf)):
        found = surface.agreement(ndf)
        assert found.ks <= surface.info["tolerance"] and found.tv <= found.tv_independent and not surface.notes
        assert surface.info["reached"]["ks"] == found.ks
        # the same statistic, by the definition
        slopes = surface.slopes() / (ndf.alpha_u, ndf.alpha_v)
        shares = ndf.cdf(np.sort(np.hypot(*slopes.T)))
        edges = np.arange(shares.size + 1) / shares.size
        assert np.maximum(shares - edges[:-1], edges[1:] - shares).max() == pytest.approx(found.ks, abs=1e-12)


def test_a_seed_says_everything(student):
    again = generate(sgtd.Ndf(**STUDENT), n=128, tolerance=2e-3)
    assert np.array_equal(again.heights, student.heights)
    assert np.array_equal(generate("student:gamma=1.7", alpha=(0.4, 0.1), n=128, tolerance=2e-3).heights, again.heights)
    other = generate(sgtd.Ndf(**STUDENT), n=128, tolerance=2e-3, seed=1)
    assert np.abs(other.heights - student.heights).max() > 0.1


def test_what_was_not_reached_is_said():
    ring = generate(sgtd.Ndf(distribution="gnd", p=1, shift=5, alpha=0.1), n=128, steps=10)
    assert ring.info["reached"]["ks"] > 2e-3 and "twice the correlation length" in ring.notes[0]


def test_mean_masking_is_smiths(student):
    ndf = sgtd.Ndf(distribution="gtd", gamma=3, p=1.2, alpha=0.4)
    surface = generate(ndf, n=256)
    for theta in np.radians([30, 60, 85]):
        w = np.array([np.sin(theta), 0.0, np.cos(theta)])
        slopes = surface.slopes()
        hidden = np.maximum(slopes[:, 0] * w[0] - w[2], 0.0).mean() / w[2]
        assert surface.g1(w) == pytest.approx(1.0 / (1.0 + hidden), rel=1e-12)
        assert surface.g1(w) == pytest.approx(ndf.g1(w), rel=4e-3)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("sidecar", [True, False])
def test_files_hold_single_precision(student, tmp_path, kind, sidecar):
    path = tmp_path / f"S.{kind}"
    student.save(path)
    if not sidecar:
        path.with_suffix(".json").unlink()
        if kind == "npy":
            with pytest.raises(UserError, match="--spacing"):
                Surface.load(path)
            assert read_heights(path, spacing=(1, 4)).spacing == (1, 4)
            return
    found = Surface.load(path)
    assert found.periodic and found.spacing == pytest.approx(student.spacing, rel=1e-7)
    if kind == "npy":
        assert np.array_equal(found.heights, student.heights)
    else:
        assert np.array_equal(found.heights.astype(np.float32), student.heights.astype(np.float32))
    assert ks_distance(found.slopes(), student.slopes()) < 2e-4
    if sidecar:
        assert found.ndf is not None and found.ndf.gamma == 1.7 and found.info["reached"] == student.info["reached"]


def test_sixteen_bits_are_for_light_tails(student, beckmann, tmp_path):
    with pytest.raises(UserError, match="16 bits would move the distribution of slopes by"):
        student.save(tmp_path / "S.png", tolerance=1e-3)
    assert not list(tmp_path.iterdir())
    beckmann.save(tmp_path / "B.png")
    found = Surface.load(tmp_path / "B.png")
    assert ks_distance(found.slopes(), beckmann.slopes()) == pytest.approx(found.info["png"]["loss"], abs=1e-12)
    assert "65535 steps" in found.notes[0]
    (tmp_path / "B.json").unlink()
    with pytest.raises(UserError, match="--gray LOW HIGH"):
        Surface.load(tmp_path / "B.png")
    told = found.info["png"]["low"], found.info["png"]["high"]
    again = read_heights(tmp_path / "B.png", spacing=(1.0, 1.0), gray=told)
    assert np.array_equal(again.heights, found.heights) and not again.periodic


def test_meshes_have_no_vertex_normals(student, tmp_path):
    student.save(tmp_path / "S.ply", tmp_path / "S.obj")
    assert b"nx" not in (tmp_path / "S.ply").read_bytes()[:400]
    assert "vn" not in (tmp_path / "S.obj").read_text()


def independent_mesh(heights: np.ndarray, dx: float, dy: float, other_diagonals: bool, shuffle: bool) -> str:
    """OBJ text of a patch, by loops, vertices and faces in any order."""
    ny, nx = heights.shape
    order = np.random.default_rng(0).permutation(nx * ny) if shuffle else np.arange(nx * ny)
    number = np.empty(nx * ny, int)
    lines = []
    for count, k in enumerate(order):
        number[k] = count + 1
        lines.append(f"v {k % nx * dx - 3} {k // nx * dy + 7} {heights.flat[k]:.9g}")
    triangles = []
    for j in range(ny - 1):
        for i in range(nx - 1):
            a, b, c, d = j * nx + i, j * nx + i + 1, (j + 1) * nx + i, (j + 1) * nx + i + 1
            triangles += [(a, b, d), (a, d, c)] if other_diagonals else [(b, c, a), (c, b, d)]
    if shuffle:
        triangles = [triangles[k] for k in np.random.default_rng(1).permutation(len(triangles))]
    return "\n".join(lines + ["f {} {} {}".format(*number[list(t)]) for t in triangles]) + "\n"


@pytest.mark.parametrize("other_diagonals", [False, True])
def test_meshes_of_other_programs(tmp_path, other_diagonals):
    heights = np.random.default_rng(5).normal(size=(12, 9)).astype(np.float32)
    path = tmp_path / "other.obj"
    path.write_text(independent_mesh(heights, 0.3, 0.2, other_diagonals, shuffle=True))
    found = read_heights(path)
    assert not found.periodic and found.spacing == pytest.approx((0.3, 0.2), rel=1e-5)
    assert np.array_equal(found.heights.astype(np.float32), heights[:, ::-1] if other_diagonals else heights)
    assert ("mirrored along x" in " ".join(found.notes)) == other_diagonals
    # the facets of the mesh itself, by their corners
    shape = mi.load_dict({"type": "obj", "filename": str(path), "face_normals": True})
    parameters = mi.traverse(shape)
    corners = np.array(parameters["vertex_positions"]).reshape(-1, 3)[np.array(parameters["faces"]).reshape(-1, 3)]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slopes = -n[:, :2] / n[:, 2:]
    assert ks_distance(slopes, found.slopes()) < 1.5 / len(slopes)


def test_meshes_that_are_no_height_map_are_refused(tmp_path):
    path = tmp_path / "cube.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    with pytest.raises(UserError, match="no grid in x and y"):
        read_heights(path)
    heights = np.zeros((6, 6))
    text = independent_mesh(heights, 1, 1, False, False).replace("v -1.0 9.0 0", "v -0.8 9.0 0")
    text = text.replace("v -1 9 0", "v -0.8 9 0")
    path.write_text(text)
    with pytest.raises(UserError, match="not evenly spaced along x"):
        read_heights(path)


def test_a_tilt_is_taken_off_if_asked(tmp_path):
    ndf = sgtd.Ndf(distribution="beckmann", alpha=0.3)
    surface = generate(ndf, n=512)
    tilted = surface.heights + 0.02 * np.arange(512) - 0.01 * np.arange(512)[:, None]
    np.save(tmp_path / "tilted.npy", tilted)
    raw = read_heights(tmp_path / "tilted.npy", spacing=(1.0, 1.0))
    level = read_heights(tmp_path / "tilted.npy", spacing=(1.0, 1.0), level=True)
    assert raw.agreement(ndf).ks > 2e-3 and level.agreement(ndf).ks < 1e-3
    assert level.notes[-1].startswith("levelled: a tilt of 0.019") and len(raw.notes) == 1


def test_points_that_were_not_measured_are_left_out(tmp_path):
    heights = np.random.default_rng(2).normal(size=(8, 9))
    heights[3, 4] = np.nan
    np.save(tmp_path / "h.npy", heights)
    found = read_heights(tmp_path / "h.npy", spacing=(1.0, 1.0))
    # six triangles meet in a point
    assert len(found.slopes()) == 2 * 7 * 8 - 6 and "1 of 72 heights were not measured" in found.notes[-1]
    with pytest.raises(UserError, match="mirror it"):
        found.g1([0.0, 0.0, 1.0])
    with pytest.raises(UserError, match="were not measured: fill them"):
        found.mirrored().g1([0.0, 0.0, 1.0])


def test_a_mirrored_patch_repeats():
    patch = Surface(np.random.default_rng(3).normal(size=(6, 5)), (1.0, 2.0), periodic=False)
    tile = patch.mirrored()
    assert tile.periodic and tile.heights.shape == (10, 8)
    assert np.array_equal(tile.heights[:6, :5], patch.heights)
    # level, and of as many facets of each mirror image
    assert np.abs(tile.slopes().mean(axis=0)).max() < 1e-12


def test_gwyddions_formats(tmp_path):
    heights = np.random.default_rng(4).normal(size=(5, 7))
    text = "# Channel: Z\n# Width: 7.0 µm\n# Height: 10.0 µm\n# Value units: nm\n"
    path = tmp_path / "map.txt"
    path.write_text(text + "\n".join("\t".join(f"{h:.12g}" for h in row) for row in heights), encoding="utf-8")
    found = read_heights(path)
    assert found.spacing == (1.0, 2.0) and found.heights == pytest.approx(1e-3 * heights, rel=1e-11)
    assert "heights in nm were converted to µm" in found.notes[0]
    gsffile = pytest.importorskip("gsffile")
    gsffile.write_gsf(
        tmp_path / "map.gsf", heights.astype(np.float32), {"XReal": 7e-6, "YReal": 10e-6, "XYUnits": "m", "ZUnits": "m"}
    )
    found = read_heights(tmp_path / "map.gsf")
    assert found.spacing == pytest.approx((1e-6, 2e-6)) and np.array_equal(found.heights, heights.astype(np.float32))
    Surface(heights, (1.0, 2.0)).save(tmp_path / "ours.gsf")
    data, fields = gsffile.read_gsf(tmp_path / "ours.gsf")
    assert np.array_equal(data, heights.astype(np.float32)) and fields["YReal"] == 10.0


def test_other_formats_need_a_package(tmp_path, monkeypatch):
    path = tmp_path / "map.nms"
    path.write_bytes(b"")
    monkeypatch.setitem(__import__("sys").modules, "SurfaceTopography", None)
    with pytest.raises(UserError, match=r"pip install sgtd\[heights\]"):
        read_heights(path)


def test_topography_of_other_programs(tmp_path):
    pytest.importorskip("SurfaceTopography")
    heights = np.random.default_rng(4).normal(size=(5, 7))
    path = tmp_path / "map.xyz"
    path.write_text("\n".join(f"{0.5 * i} {2.0 * j} {heights[j, i]}" for i in range(7) for j in range(5)))
    found = read_heights(path)
    assert found.heights == pytest.approx(heights) and found.spacing == pytest.approx((0.5, 2.0))


def test_sidecars_of_others_say_nothing(tmp_path):
    np.save(tmp_path / "h.npy", np.zeros((4, 4)))
    (tmp_path / "h.json").write_text(json.dumps({"something": 1}))
    with pytest.raises(UserError, match="--spacing"):
        read_heights(tmp_path / "h.npy")
    (tmp_path / "h.json").write_text(json.dumps({"spacing": [1, 2]}))
    assert read_heights(tmp_path / "h.npy").spacing == (1, 2)


def test_paths_are_replaced_whole_or_not_at_all(student, tmp_path):
    with pytest.raises(UserError, match='not as ".stl"'):
        student.save(tmp_path / "S.npy", tmp_path / "S.stl")
    assert not list(Path(tmp_path).iterdir())
    assert dataclasses.replace(student, info={}).ndf is None


def run(*arguments: object) -> str:
    """Of the command line, in this process."""
    from click.testing import CliRunner
    from sgtd.cli.entry import cli

    done = CliRunner().invoke(cli, [str(argument) for argument in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_command_surface_and_command_ndf(tmp_path):
    shape = ("--shape", "student:gamma=1.7", "--alpha", "0.4", "0.1")
    files = ("-o", tmp_path / "S.npy", "-o", tmp_path / "S.gsf", "--normals", tmp_path / "N.exr")
    said = run("surface", *shape, "-n", 64, "--correlation", 4, "--seed", 3, "--tolerance", 5e-3, *files)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"S.npy", "S.gsf", "S.json", "S-picture.png", "N.exr"}
    sidecar = json.loads((tmp_path / "S.json").read_text())
    assert sidecar["seed"] == 3 and sidecar["correlation"] == 4 and sidecar["spacing"] == [1, 4]
    assert f"KS {sidecar['reached']['ks']:.2g}" in said
    surface = Surface.load(tmp_path / "S.npy")
    # texels of the map of normals are facets
    n = 2 * np.array(mi.Bitmap(str(tmp_path / "N.exr"))) - 1
    assert ks_distance((-n[..., :2] / n[..., 2:]).reshape(-1, 2), surface.slopes()) < 3e-3
    run("ndf", tmp_path / "S.gsf", "-o", tmp_path / "ndf")
    found = json.loads((tmp_path / "ndf" / "ndf.json").read_text())
    assert found["facets"] == 2 * 64 * 64 and found["alpha_u"] / found["alpha_v"] == pytest.approx(4, rel=0.05)
    table = np.genfromtxt(tmp_path / "ndf" / "ndf.csv", delimiter=",", names=True)
    assert table["share"].sum() == pytest.approx(1)
    # the profile, up to its scale
    ndf = surface.ndf
    scale = np.linalg.norm(surface.slopes() / (0.4, 0.1), axis=1).mean()
    body = (table["slope"] * scale < ndf.quantile(0.8)) & (np.arange(len(table)) > 2)
    expected = ndf.normalization / np.pi * ndf.profile(table["slope"] * scale) * scale**2
    assert np.median(np.abs(table["density"] / expected - 1)[body]) < 0.1


def test_an_interrupt_ends_a_long_call(tmp_path):
    command = [
        sys.executable,
        "-m",
        "sgtd",
        "surface",
        "--shape",
        "gnd:shift=5",
        "-n",
        "1024",
        "--tolerance",
        "1e-9",
    ]
    with subprocess.Popen([*command, "-o", str(tmp_path / "S.npy")], stderr=subprocess.PIPE, text=True) as process:
        time.sleep(2.5)
        assert process.poll() is None, "it had not begun"
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=20)
    assert process.returncode == 130 and said.strip().endswith("interrupted")
    assert not list(tmp_path.iterdir())


def test_a_measured_map_becomes_a_material(tmp_path):
    """Heights, their slopes as a table, a distribution, and a surface of it again."""
    ndf = sgtd.Ndf(distribution="gtd", gamma=3, p=1.2, alpha=0.4)
    generate(ndf, n=256).save(tmp_path / "S.gsf")
    (tmp_path / "S.json").unlink()
    run("ndf", tmp_path / "S.gsf", "-o", tmp_path / "ndf")
    table = sgtd.Ndf.from_file(tmp_path / "ndf" / "table.csv")
    theta = np.radians([0, 30, 60, 80])
    w = np.stack([np.sin(theta), np.zeros(4), np.cos(theta)], axis=-1)
    assert table.g1(w) == pytest.approx(ndf.g1(w), rel=0.02)
    assert table.d(w[:3]) == pytest.approx(ndf.d(w[:3]), rel=0.1)
    run(
        "surface",
        "--shape",
        tmp_path / "ndf" / "table.csv",
        "-n",
        64,
        "--tolerance",
        0.01,
        "-o",
        tmp_path / "again.npy",
    )
    again = Surface.load(tmp_path / "again.npy")
    assert (
        again.ndf.distribution == "tabulated" and again.agreement(again.ndf).ks == again.info["reached"]["ks"] <= 0.01
    )
    # a mixture is kept too
    both = sgtd.Ndf.mixture([(0.8, sgtd.Ndf(distribution="ggx", alpha=0.2)), (0.2, table)])
    generate(both, n=64, tolerance=0.02).save(tmp_path / "both.npy")
    assert Surface.load(tmp_path / "both.npy").ndf.g1(w) == pytest.approx(both.g1(w), rel=1e-9)
