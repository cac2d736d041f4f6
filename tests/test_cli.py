"""The command line, run for real at small sizes: what it writes, what it says, and how it fails.

The law for failures: a status that is not 0, one line on the error stream, and not a file more than before.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from sgtd import cli
from sgtd.compare import FILES, difference
from sgtd.scene import variants

SCENES = sorted((Path(__file__).parents[1] / "scenes").glob("*.xml"))

HEAD = """
    <default name="res" value="24"/>
    <integrator type="path"><integer name="max_depth" value="3"/></integrator>
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, -5, 1" target="0, 0, 0" up="0, 0, 1"/></transform>
        <film type="hdrfilm"><integer name="width" value="$res"/><integer name="height" value="$res"/></film>
        <sampler type="independent"><integer name="sample_count" value="8"/></sampler>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>
    <shape type="sphere">
        <point name="center" x="2" y="-3" z="3"/><float name="radius" value="0.3"/>
        <emitter type="area"><rgb name="radiance" value="30"/></emitter>
    </shape>
"""

GOLD = """
    <shape type="sphere">
        <bsdf type="twosided"><bsdf type="roughconductor">
            <string name="material" value="Au"/><float name="alpha" value="0.3"/>
            <string name="distribution" value="ggx"/>
        </bsdf></bsdf>
    </shape>
"""


@pytest.fixture(autouse=True)
def _variant_is_restored():
    before = mi.variant()
    yield
    if before:
        mi.set_variant(before)


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "gold.xml"
    file.write_text(f'<scene version="3.0.0">{HEAD}{GOLD}</scene>')
    return file


@pytest.fixture
def sgtd(capsys):
    """Runs the command line in this process: (status, standard output, error output)."""

    def run(*arguments):
        capsys.readouterr()
        with pytest.raises(SystemExit) as exit_:
            cli.main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return exit_.value.code, captured.out, captured.err

    return run


def tree(folder):
    """All paths below a folder with their contents."""
    return {path: path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))}


def read_exr(path):
    return np.array(mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))


def table(folder):
    with (folder / "comparison.csv").open(newline="") as file:
        return {row["quantity"]: row for row in csv.DictReader(file)}


# --- help


@pytest.mark.parametrize("command", [[], ["render"], ["compare"], ["explain"], ["doctor"]])
def test_help_has_examples(sgtd, command):
    status, out, err = sgtd(*command, "--help")
    assert (status, err) == (0, "")
    assert "Example" in out
    assert f"sgtd {' '.join(command)}" in out


def test_without_a_command_the_help_is_shown(sgtd):
    assert sgtd()[0] == 0


# --- render


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb"])
def test_render_writes_the_image_of_all_passes(sgtd, scene, tmp_path, variant):
    if variant != "scalar_rgb" and not variants.probe(variant).usable:
        pytest.skip(f"{variant} does not run here")
    output = tmp_path / "new folder" / "image.exr"
    status, out, err = sgtd("render", scene, "-o", output, "--variant", variant, "--spp", 64)
    assert (status, err) == (0, "")
    assert "64 samples per pixel" in out
    bitmap = mi.Bitmap(str(output))
    assert bitmap.component_format() == mi.Struct.Type.Float32
    assert [path.name for path in output.parent.iterdir()] == ["image.exr"]
    reference = np.array(mi.render(mi.load_file(str(scene)), spp=1024))
    assert np.mean(read_exr(output)) == pytest.approx(np.mean(reference), rel=0.05)


def test_render_png_and_parameters(sgtd, scene, tmp_path):
    output = tmp_path / "image.png"
    status, _, _ = sgtd("render", scene, "-o", output, "--variant", "scalar_rgb", "-D", "res=10", "--spp", 2)
    bitmap = mi.Bitmap(str(output))
    assert status == 0
    assert list(bitmap.size()) == [10, 10]
    assert bitmap.component_format() == mi.Struct.Type.UInt8


def test_render_replaces_an_image(sgtd, scene, tmp_path):
    output = tmp_path / "image.png"
    output.write_text("something else")
    status, _, _ = sgtd("render", scene, "-o", output, "--variant", "scalar_rgb", "--spp", 1)
    assert status == 0
    assert output.read_bytes().startswith(b"\x89PNG")


# --- compare


def test_compare_writes_everything_and_a_second_run_replaces_it(sgtd, scene, tmp_path):
    folder = tmp_path / "out" / "demo"
    arguments = ("compare", scene, "-o", folder, "--variant", "scalar_rgb", "--spp", 16)
    settings = ("--set", "distribution=student", "--set", "gamma=1.6")
    for extra in (("-D", "res=16"), ()):
        status, out, err = sgtd(*arguments, *settings, *extra)
        assert (status, err) == (0, "")
        assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    assert "roughconductor, ggx" in out
    assert "sgtdconductor, student, gamma = 1.6" in out

    left, right = read_exr(folder / "left.exr"), read_exr(folder / "right.exr")
    assert left.shape == right.shape == (24, 24, 3)
    rows = table(folder)
    assert float(rows["mean luminance"]["left"]) == pytest.approx(difference.luminance(left).mean(), rel=1e-5)
    assert float(rows["mean luminance"]["right"]) == pytest.approx(difference.luminance(right).mean(), rel=1e-5)
    assert float(rows["RMSE"]["between"]) == pytest.approx(np.sqrt(np.mean((right - left) ** 2)), rel=1e-4)
    assert 0 < float(rows["FLIP"]["between"]) < 1
    assert float(rows["time"]["ratio"]) > 0

    report = json.loads((folder / "comparison.json").read_text())
    assert report["set"] == {"distribution": "student", "gamma": 1.6}
    assert report["samples_per_pixel"] == 16
    assert [row["quantity"] for row in report["rows"]] == list(rows)
    assert min(mi.Bitmap(str(folder / "comparison.png")).size()) > 500


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_compare_without_a_shape_shows_no_difference(sgtd, scene, tmp_path, distribution):
    scene.write_text(scene.read_text().replace('"ggx"', f'"{distribution}"'))
    status, out, _ = sgtd("compare", scene, "-o", tmp_path / "out", "--variant", "scalar_rgb", "--spp", 4)
    assert status == 0
    assert "No difference" in out
    report = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert report["equal"]
    assert report["largest_difference"] < 1e-6


def test_compare_the_other_way_round(sgtd, scene, tmp_path):
    text = scene.read_text().replace("roughconductor", "sgtdconductor")
    scene.write_text(text.replace('<string name="distribution" value="ggx"/>', '<float name="gamma" value="1.7"/>'))
    status, out, _ = sgtd("compare", scene, "-o", tmp_path / "out", "--variant", "scalar_rgb", "--spp", 4)
    assert status == 0
    assert "roughconductor, ggx" in out
    assert "sgtdconductor, sgtd, gamma = 1.7" in out


def test_compare_in_log_scale_and_infinite_gamma(sgtd, scene, tmp_path):
    arguments = ("--set", "gamma=inf", "--set", "shift=1", "--log", "--spp", 4, "--variant", "scalar_rgb")
    status, _, _ = sgtd("compare", scene, "-o", tmp_path / "out", *arguments)
    assert status == 0
    assert json.loads((tmp_path / "out" / "comparison.json").read_text())["set"] == {"gamma": "inf", "shift": 1.0}


def test_compare_with_one_sample_has_no_estimate_of_the_noise(sgtd, scene, tmp_path):
    folder = tmp_path / "out"
    status, _, _ = sgtd("compare", scene, "-o", folder, "-s", "gamma=3", "--spp", 1, "--variant", "scalar_rgb")
    assert status == 0
    assert table(folder)["RMSE, noise alone"]["between"] == ""


def test_compare_a_black_scene(sgtd, scene, tmp_path):
    scene.write_text(scene.read_text().replace('value="0.2"', 'value="0"').replace('value="30"', 'value="0"'))
    status, out, _ = sgtd("compare", scene, "-o", tmp_path / "out", "--spp", 2, "--variant", "scalar_rgb")
    assert status == 0
    assert "Both images are black: no light reaches the camera." in out


def third_party(folder):
    """A scene as exporters write them: many materials with ids and references, an include, an old version, a mesh
    and a texture in folders beside the scene file."""
    (folder / "meshes").mkdir()
    (folder / "textures").mkdir()
    (folder / "meshes" / "quad.obj").write_text(
        "v -3 -3 -1\nv 3 -3 -1\nv 3 3 -1\nv -3 3 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    )
    pixels = np.linspace(0.1, 0.9, 16, dtype=np.float32).reshape(4, 4, 1)
    mi.Bitmap(pixels).write(str(folder / "textures" / "rough.exr"))
    metals = ("Ag", "Al", "Au", "Cr", "Cu", "W")
    materials, shapes = [], []
    for i in range(24):
        distribution = ("ggx", "beckmann")[i % 2]
        materials.append(
            f'<bsdf type="twosided" id="Metal_{i}"><bsdf type="roughconductor">'
            f'<string name="material" value="{metals[i % 6]}"/><string name="distribution" value="{distribution}"/>'
            f'<float name="alpha" value="{0.05 + 0.02 * i:.2f}"/></bsdf></bsdf>'
        )
        x, y = i % 6 - 2.5, i // 6 - 1.5
        shapes.append(
            f'<shape type="sphere"><float name="radius" value="0.4"/><point name="center" x="{x}" y="{y}" z="-0.5"/>'
            f'<ref id="Metal_{i}"/></shape>'
        )
    (folder / "materials.xml").write_text(f'<scene version="2.0.0">{"".join(materials)}</scene>')
    file = folder / "exported.xml"
    file.write_text(
        f"""<?xml version="1.0" encoding="utf-8"?>
        <scene version="2.0.0">{HEAD}<include filename="materials.xml"/>{"".join(shapes)}
        <shape type="obj"><string name="filename" value="meshes/quad.obj"/>
            <bsdf type="bumpmap"><texture type="bitmap"><string name="filename" value="textures/rough.exr"/>
                <boolean name="raw" value="true"/></texture>
                <bsdf type="roughconductor"><texture name="alpha" type="bitmap">
                    <string name="filename" value="textures/rough.exr"/><boolean name="raw" value="true"/>
                </texture></bsdf></bsdf></shape>
        </scene>"""
    )
    return file


@pytest.mark.slow
def test_compare_a_third_party_scene_from_another_folder(sgtd, tmp_path, monkeypatch):
    (tmp_path / "export").mkdir()
    file = third_party(tmp_path / "export")
    monkeypatch.chdir(tmp_path)
    variant = "llvm_ad_rgb" if variants.probe("llvm_ad_rgb").usable else "scalar_rgb"
    arguments = ("-o", "out", "--spp", 8, "--variant", variant, "-s", "gamma=1.8", "-s", "lambda=0.2")
    status, out, err = sgtd("compare", file.relative_to(tmp_path), *arguments)
    assert (status, err) == (0, "")
    report = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert len(report["materials"]) == 25
    assert "12 × roughconductor, ggx" in out
    assert report["largest_difference"] > 0
    assert next(row for row in report["rows"] if row["quantity"] == "RMSE, noise alone")["between"] > 0


@pytest.mark.parametrize("scene_file", SCENES, ids=[path.stem for path in SCENES])
def test_the_scenes_render_with_either_material(sgtd, scene_file, tmp_path):
    assert len(SCENES) >= 5
    assert scene_file.read_text().startswith("<!--"), "a scene opens with its question"
    small = ("-D", "width=16", "-D", "height=9", "--spp", 2, "--variant", "scalar_rgb")
    assert sgtd("compare", scene_file, "-o", tmp_path / "out", "-s", "gamma=1.7", *small)[0] == 0
    ours = "sgtddielectric" if 'value="roughdielectric"' in scene_file.read_text() else "sgtdconductor"
    direct = ("-D", f"bsdf={ours}", "-D", "distribution=student")
    assert sgtd("render", scene_file, "-o", tmp_path / "direct.exr", *direct, *small)[0] == 0
    assert np.isfinite(read_exr(tmp_path / "direct.exr")).all()


# --- options

SCALAR = ("--variant", "scalar_rgb", "--spp", "2")


def test_the_version_is_said(sgtd):
    import sgtd as package

    status, out, _ = sgtd("--version")
    assert (status, out.strip()) == (
        0,
        f"sgtd {package.__version__}, for Mitsuba {', '.join(package.MITSUBA_RELEASES)}",
    )


@pytest.mark.parametrize("name", ["a.PNG", "a.Png", "a.EXR"])
def test_endings_in_capitals(sgtd, scene, tmp_path, name):
    """-o x.PNG rendered all and then failed with "Unsupported component type!"."""
    assert sgtd("render", scene, "-o", tmp_path / name, *SCALAR)[0] == 0
    assert (tmp_path / name).read_bytes()[:4] in (b"\x89PNG", b"\x76\x2f\x31\x01")


def test_an_integrator_in_place_of_the_scene_s_own(sgtd, scene, tmp_path):
    text = scene.read_text()
    own = '<integrator type="path"><integer name="max_depth" value="3"/></integrator>'
    nested = f'<integrator type="aov"><string name="aovs" value="d:depth"/>{own}</integrator>'
    images = []
    for number, (replacement, extra) in enumerate(
        ((own, ()), ("", ("path:max_depth=3",)), (nested, ("path:max_depth=3",)), (own, ("path:max_depth=1",)))
    ):
        scene.write_text(text.replace(own, replacement))
        output = tmp_path / f"{number}.exr"
        arguments = ("--integrator", *extra) if extra else ()
        assert sgtd("render", scene, "-o", output, *arguments, *SCALAR)[0] == 0
        images.append(read_exr(output))
    assert images[1] == pytest.approx(images[0], rel=1e-5)
    assert images[2] == pytest.approx(images[0], rel=1e-5)
    assert np.abs(images[3] - images[0]).max() > 0.1  # the sphere is black


def test_old_scenes_with_lenience(sgtd, scene, tmp_path):
    """Properties that no plugin asks for any more end Mitsuba; with --lenient they are warned of, once, and without color."""
    scene.write_text(scene.read_text().replace('name="alpha"', 'name="sharpness" value="3"/><float name="alpha"'))
    status, out, err = sgtd("compare", scene, "-o", tmp_path / "out", "--lenient", "-s", "gamma=3", *SCALAR)
    assert status == 0
    assert [line.startswith("sgtd: warning: ") for line in err.splitlines()] == [True, True]  # one for either plugin
    assert "sharpness" in err and "\x1b" not in err + out and "sharpness" not in out


def test_warnings_of_mitsuba_stay_out_of_the_output(scene, tmp_path):
    scene.write_text(scene.read_text().replace('value="30"', 'value="1e39"'))
    command = [sys.executable, "-m", "sgtd", "render", scene, "-o", tmp_path / "a.exr", *SCALAR]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.count("\n"), "\x1b" in done.stderr) == (0, 1, False)
    assert "sgtd: warning: Invalid sample value" in done.stderr


def test_a_limit_of_time_takes_no_samples(sgtd, scene, tmp_path):
    scene.write_text(
        scene.read_text().replace(
            '<integer name="max_depth"', '<float name="timeout" value="0.001"/><integer name="max_depth"'
        )
    )
    status, out, err = sgtd("render", scene, "-o", tmp_path / "a.exr", "--variant", "scalar_rgb", "--spp", 256)
    assert (status, "256 samples" in out, "timeout is not kept" in err) == (0, True, True)


def test_parameters_of_included_files_are_known(sgtd, scene, tmp_path):
    (tmp_path / "inner.xml").write_text('<scene version="3.0.0"><default name="metal" value="Au"/></scene>')
    scene.write_text(scene.read_text().replace("</scene>", '<include filename="inner.xml"/></scene>'))
    err = sgtd("render", scene, "-o", tmp_path / "a.exr", "-D", "mettal=Ag", *SCALAR)[2]
    assert 'did you mean "metal"?); it has res=24, metal=Au' in err


# --- failures

FAILURES = {
    "no such scene": ("render", "none.xml", "-o", "a.png", *SCALAR),
    "scene is a folder": ("render", ".", "-o", "a.png", *SCALAR),
    "broken XML": ("render", "broken.xml", "-o", "a.png", *SCALAR),
    "typo in the scene": ("compare", "typo.xml", "-o", "out", *SCALAR),
    "no scene in the file": ("render", "bsdf.xml", "-o", "a.png", *SCALAR),
    "missing include": ("render", "include.xml", "-o", "a.png", *SCALAR),
    "no rough conductor": ("compare", "plain.xml", "-o", "out", *SCALAR),
    "image format": ("render", "gold.xml", "-o", "a.tiff", *SCALAR),
    "image is a folder": ("render", "gold.xml", "-o", "folder.exr", *SCALAR),
    "folder is a file": ("compare", "gold.xml", "-o", "plain.xml", *SCALAR),
    "folder below a file": ("compare", "gold.xml", "-o", "plain.xml/out", *SCALAR),
    "unknown variant": ("render", "gold.xml", "-o", "a.png", "--variant", "scalar_rbg"),
    "unknown command": ("rendre", "gold.xml"),
    "unknown option": ("render", "gold.xml", "--samples", "4"),
    "no output": ("compare", "gold.xml"),
    "samples": ("render", "gold.xml", "-o", "a.png", "--spp", "0"),
    "sensor": ("render", "gold.xml", "-o", "a.png", "--sensor", "3", *SCALAR),
    "unknown parameter": ("render", "gold.xml", "-o", "a.png", "-D", "rse=3", *SCALAR),
    "parameter without value": ("render", "gold.xml", "-o", "a.png", "-D", "res", *SCALAR),
    "parameter of the parser": ("render", "gold.xml", "-o", "a.png", "-D", "filename=x", *SCALAR),
    "typo in a setting": ("compare", "gold.xml", "-o", "out", "-s", "gama=2", *SCALAR),
    "no number": ("compare", "gold.xml", "-o", "out", "-s", "gamma=two", *SCALAR),
    "gamma = 1": ("compare", "gold.xml", "-o", "out", "-s", "gamma=1", *SCALAR),
    "2 p gamma too small": ("compare", "gold.xml", "-o", "out", "-s", "gamma=1.5", "-s", "p=0.9", *SCALAR),
    "lambda = 1": ("compare", "gold.xml", "-o", "out", "-s", "lambda=1", *SCALAR),
    "negative shift": ("compare", "gold.xml", "-o", "out", "-s", "shift=-1", *SCALAR),
    "not a number": ("compare", "gold.xml", "-o", "out", "-s", "gamma=nan", *SCALAR),
    "unknown distribution": ("compare", "gold.xml", "-o", "out", "-s", "distribution=gxx", *SCALAR),
    "unknown masking": ("compare", "gold.xml", "-o", "out", "-s", "masking=none", *SCALAR),
    "shift and mu": ("compare", "gold.xml", "-o", "out", "-s", "shift=1", "-s", "mu=0.1", *SCALAR),
    "fixed by the row": ("compare", "gold.xml", "-o", "out", "-s", "distribution=student", "-s", "p=2", *SCALAR),
    "too many samples": ("render", "gold.xml", "-o", "a.png", "--variant", "scalar_rgb", "--spp", "100000000000"),
    "samples as 1e11": ("render", "gold.xml", "-o", "a.png", "--variant", "scalar_rgb", "--spp", "1e11"),
    "exposure nan": ("compare", "gold.xml", "-o", "out", "--exposure", "nan", *SCALAR),
    "exposure inf": ("compare", "gold.xml", "-o", "out", "--exposure", "inf", *SCALAR),
    "exposure 5000": ("compare", "gold.xml", "-o", "out", "--exposure", "5000", *SCALAR),
    "set twice": ("compare", "gold.xml", "-o", "out", "-s", "gamma=2", "-s", "gamma=3", *SCALAR),
    "parameter twice": ("render", "gold.xml", "-o", "a.png", "-D", "res=3", "-D", "res=4", *SCALAR),
    "parameter like another": ("render", "gold.xml", "-o", "a.png", "-D", "rss=4", *SCALAR),
    "no integrator": ("render", "empty.xml", "-o", "a.png", *SCALAR),
    "no integrator to compare": ("compare", "empty.xml", "-o", "out", *SCALAR),
    "unknown integrator": ("render", "gold.xml", "-o", "a.png", "--integrator", "paht", *SCALAR),
    "integrator without value": ("render", "gold.xml", "-o", "a.png", "--integrator", "path:max_depth", *SCALAR),
    "a picture is a folder": ("compare", "gold.xml", "-o", "taken", *SCALAR),
    "integrator for JIT variants": ("render", "gold.xml", "-o", "a.png", "--integrator", "prb", *SCALAR),
    "old property": ("compare", "old.xml", "-o", "out", *SCALAR),
}

# A word that the line must have, where the cause could be mistaken for another.
SAYS = {
    "no such scene": "none.xml",
    "broken XML": "line 2",
    "typo in the scene": "alhpa",
    "missing include": "nowhere.xml",
    "unknown variant": "scalar_rbg",
    "unknown parameter": "rse",
    "typo in a setting": 'did you mean "gamma"',
    "gamma = 1": "gamma",
    "2 p gamma too small": "gamma",
    "lambda = 1": "lambda",
    "negative shift": "shift",
    "not a number": "gamma",
    "unknown distribution": "gxx",
    "shift and mu": "mu",
    "fixed by the row": "p",
    "exposure nan": "--exposure",
    "exposure 5000": "between -100 and 100",
    "set twice": "gamma is given twice",
    "parameter twice": "res is given twice",
    "parameter like another": 'did you mean "res"?); it has res=24',
    "no integrator": "empty.xml: the scene has no integrator; add",
    "no integrator to compare": "--integrator path",
    "unknown integrator": "paht",
    "integrator without value": "path:max_depth=8",
    "a picture is a folder": "comparison.png: it is a folder",
    "old property": "--lenient only warns",
    "integrator for JIT variants": "this is scalar_rgb",
}


@pytest.mark.parametrize("case", FAILURES)
def test_failures_are_one_line_and_leave_nothing(sgtd, scene, tmp_path, monkeypatch, case):
    text = scene.read_text()
    (tmp_path / "broken.xml").write_text('<scene version="3.0.0">\n<bsdf></scene>')
    (tmp_path / "typo.xml").write_text(text.replace('name="alpha"', 'name="alhpa"'))
    (tmp_path / "bsdf.xml").write_text('<bsdf version="3.0.0" type="diffuse"/>')
    (tmp_path / "include.xml").write_text('<scene version="3.0.0"><include filename="nowhere.xml"/></scene>')
    (tmp_path / "plain.xml").write_text(f'<scene version="3.0.0">{HEAD}</scene>')
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "taken" / "comparison.png").mkdir(parents=True)
    (tmp_path / "empty.xml").write_text(
        text.replace('<integrator type="path"><integer name="max_depth" value="3"/></integrator>', "")
    )
    (tmp_path / "old.xml").write_text(text.replace('name="alpha"', 'name="sharpness" value="3"/><float name="alpha"'))
    monkeypatch.chdir(tmp_path)
    before = tree(tmp_path)
    status, _, err = sgtd(*FAILURES[case])
    assert status not in (0, None)
    assert err.startswith("sgtd: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert ".cpp:" not in err
    assert SAYS.get(case, "") in err
    assert tree(tmp_path) == before


def test_a_failure_leaves_an_older_result_as_it_was(sgtd, scene, tmp_path):
    folder = tmp_path / "out"
    arguments = ("compare", scene, "-o", folder, *SCALAR)
    assert sgtd(*arguments, "-s", "gamma=3")[0] == 0
    before = tree(tmp_path)
    assert sgtd(*arguments, "-s", "gamma=1")[0] != 0
    assert tree(tmp_path) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into a read-only folder")
def test_a_read_only_folder(sgtd, scene, tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o555)
    status, _, err = sgtd("compare", scene, "-o", folder, *SCALAR)
    assert status != 0
    assert "Permission denied" in err
    assert not list(folder.iterdir())


def test_a_folder_that_nobody_can_write(sgtd, scene):
    """The same for root: the kernel's own file system has no new folders."""
    status, _, err = sgtd("compare", scene, "-o", "/proc/sgtd", *SCALAR)
    assert status != 0
    assert err.startswith("sgtd: cannot write into /proc/sgtd")


def test_an_interrupted_write_leaves_nothing(sgtd, scene, tmp_path, monkeypatch):
    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("sgtd.compare.comparison.draw", fail)
    status, _, err = sgtd("compare", scene, "-o", tmp_path / "a" / "b", *SCALAR)
    assert (status, err.strip()) == (130, "sgtd: interrupted")
    assert not (tmp_path / "a").exists()


# --- doctor


@pytest.mark.slow
def test_doctor_reports_the_variants(sgtd):
    status, out, _ = sgtd("doctor")
    assert status == 0
    for variant in mi.variants():
        assert variant in out
    assert out.splitlines()[-1].startswith("Usable")


def test_doctor_finds_another_mitsuba(sgtd, monkeypatch):
    monkeypatch.setattr("sgtd.MITSUBA_RELEASES", ("3.0.0",))
    status, out, _ = sgtd("doctor")
    assert status == 1
    assert "bad  Mitsuba" in out
    assert "pip install mitsuba==3.0.0" in out
    assert out.splitlines()[-1].startswith("Not usable")


def test_another_mitsuba_is_refused_in_one_line(sgtd, scene, tmp_path, monkeypatch):
    monkeypatch.setattr("sgtd.MITSUBA_RELEASES", ("3.0.0",))
    status, _, err = sgtd("render", scene, "-o", tmp_path / "a.png", *SCALAR)
    assert status != 0
    assert err.count("\n") == 1
    assert "3.0.0" in err


@pytest.mark.parametrize("library", ["/nonexistent/libLLVM.so", __file__])
def test_doctor_without_llvm_says_how_to_mend_it(sgtd, monkeypatch, library):
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", library)
    monkeypatch.setattr("sgtd.doctor.known_variants", lambda: ["scalar_rgb", "llvm_ad_rgb"])
    status, out, _ = sgtd("doctor")
    assert status == 0
    assert "bad  LLVM" in out
    assert "libllvm" in out
    assert "scalar variants only" in out


def test_without_llvm_the_scalar_variant_is_used_and_said(scene, tmp_path):
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": "/nonexistent/libLLVM.so", "CUDA_VISIBLE_DEVICES": ""}
    command = [sys.executable, "-m", "sgtd", "render", scene, "-o", tmp_path / "a.png", "--spp", "1"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "scalar_rgb is used" in done.stderr
    assert (tmp_path / "a.png").exists()


# --- measurements


def test_the_noise_free_rmse_finds_a_difference_below_the_noise(sgtd, scene, tmp_path):
    """Between gamma = 2 and 2.2 the difference is small; RMSE² is noise² + (beyond noise)² to a few percent."""
    folder = tmp_path / "out"
    assert sgtd("compare", scene, "-o", folder, "-s", "gamma=2.2", "--spp", 32, "--variant", "scalar_rgb")[0] == 0
    rows = table(folder)
    total, noise, beyond = (
        float(rows[name]["between"]) for name in ("RMSE", "RMSE, noise alone", "RMSE, beyond noise")
    )
    assert total**2 == pytest.approx(noise**2 + beyond**2, rel=0.2)


def test_stops():
    image = np.full((8, 8, 3), 0.1)
    floor, decades = difference.floor_for(image, image, 3.0, log=False)
    assert (floor, decades) == (0.01 / 8, 0)
    assert difference.stops_between(image, image * 2, floor).mean() == pytest.approx(1.0, abs=0.02)
    assert difference.stops_between(image * 0, image * 0, floor).max() == 0.0
