"""What a comparison says and shows: exposure, pixels that are not finite, times, and what is kept when drawing fails."""

from __future__ import annotations

import json
import math

import mitsuba as mi
import numpy as np
import pytest
from conftest import use
from sgtd import cli
from sgtd.compare import FILES, difference, figure
from sgtd.compare.difference import compare_images, exposure_for
from sgtd.scene.render import Rendering
from sgtd.scene.timing import Timing, decimals, seconds_text

SCENE = """<scene version="3.0.0">
    <default name="radiance" value="30"/>
    <integrator type="path"><integer name="max_depth" value="3"/></integrator>
    <sensor type="perspective"><transform name="to_world"><lookat origin="0,-5,1" target="0,0,0" up="0,0,1"/></transform>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film>
        <sampler type="independent"><integer name="sample_count" value="8"/></sampler></sensor>
    <emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>
    <shape type="sphere"><point name="center" x="2" y="-3" z="3"/><float name="radius" value="0.3"/>
        <emitter type="area"><rgb name="radiance" value="$radiance"/></emitter></shape>
    <shape type="sphere"><bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf></shape>
</scene>"""


@pytest.fixture
def scene(tmp_path):
    use("scalar_rgb")
    file = tmp_path / "gold.xml"
    file.write_text(SCENE)
    return file


@pytest.fixture
def compare(capsys, tmp_path):
    """Runs the command in this process: (status, standard output, error output, the report or None)."""

    def run(*arguments):
        folder = tmp_path / "out"
        command = ["compare", *arguments, "-o", folder, "--variant", "scalar_rgb"]
        capsys.readouterr()
        with pytest.raises(SystemExit) as exit_:
            cli.main([str(argument) for argument in command])
        captured = capsys.readouterr()
        report = folder / "comparison.json"
        return exit_.value.code, captured.out, captured.err, json.loads(report.read_text()) if report.exists() else None

    return run


def rendering(image, passes=((1.0, 4), (1.0, 4)), halves=True, structure=""):
    image = np.asarray(image, dtype=np.float32)
    return Rendering(
        bitmap=mi.Bitmap(image),
        spp=8,
        passes=len(passes),
        timing=Timing(tuple(passes), compiles=False),
        structure=structure,
        halves=((image.astype(float), 4), (image.astype(float), 4)) if halves else None,
    )


# --- exposure


def room(window: float, part: float, seed: int = 0) -> np.ndarray:
    """The inside of a room, of luminances around 0.1, with a window that covers this part of the image."""
    generator = np.random.default_rng(seed)
    values = 0.1 * np.exp(0.7 * generator.standard_normal((40, 60)))
    values[:, : round(60 * part)] = window
    return np.repeat(values[..., None], 3, axis=2)


@pytest.mark.parametrize("part", [0.0, 0.05, 0.12, 0.25, 0.45])
@pytest.mark.parametrize("window", [1.0, 10.0, 100.0, 1e4])
def test_a_room_with_a_window_is_not_black(window, part):
    """By the mean, clipped at white, 70 % of such a room was below 2 % of white."""
    image = room(window, part)
    shown = difference.luminance(image) * 2.0 ** exposure_for(image).stops
    assert np.mean(shown < 0.02) < 0.4
    assert np.mean(shown[:, round(60 * part) :] > 1.0) < 0.05


def test_one_pixel_decides_nothing():
    """Where less than 8 % of an image was lit, its brightest pixel was made white and the rest was black."""
    image = np.zeros((50, 50, 3))
    image[20:25, 20:30] = 0.05 * np.linspace(0.2, 2.0, 10)[None, :, None]
    exposure = exposure_for(image).stops
    assert 0.1 < np.quantile(image[20:25, 20:30] * 2.0**exposure, 0.5) < 1.0
    for firefly in (1e3, 1e30):
        image[0, 0] = firefly
        assert exposure_for(image).stops == pytest.approx(exposure, abs=0.5)


def test_the_rule_says_what_it_does():
    gray = np.full((8, 8, 3), 0.1)
    exposure = exposure_for(gray)
    assert exposure.stops == pytest.approx(1.0)  # 0.1 becomes 0.2
    assert exposure.rule == "the log-average of its lit pixels is at about 18 % of white"
    assert exposure_for(room(100.0, 0.25)).rule == "the median of its lit pixels is at about 4 % of white"
    highlights = np.full((10, 10, 3), 0.1)
    highlights[:, 0] = 0.3
    highlights[0, :3] = 2.0
    highlights[1:4, 5:] = 0.0
    assert exposure_for(highlights).rule == "about 2 % of its lit pixels (85 % of all) are clipped"
    assert exposure_for(gray * 0) == difference.Exposure(0.0, "no pixel of it is lit")


def test_a_picture_is_scaled_by_what_differs():
    """A difference of 2 stops in few pixels was cut off at 0.05 where the rest was black on both sides."""
    stops = np.zeros((100, 100))
    stops[40, 40:45] = -2.0
    assert figure.difference_scale(stops) == 2.0
    assert figure.difference_scale(stops * 0) == 0.05


# --- pixels that are not finite


@pytest.mark.parametrize("log", [False, True])
def test_pixels_that_are_not_finite(scalar, tmp_path, log):
    left = np.full((20, 30, 3), 0.5)
    right = left.copy()
    left[3, 4] = np.nan
    right[3, 4], right[10, 10:12] = 0.1, (np.inf, 0.0, 0.0)
    result = compare_images(rendering(left), rendering(right), None, log)
    assert (result.not_finite, result.equal) == ((1, 2), False)
    assert result.mean_left == pytest.approx(0.5)  # they are in no number
    assert result.mean_right == pytest.approx(0.5)
    assert (result.rmse, result.flip) == (0.0, 0.0)
    path = tmp_path / "picture.png"
    figure.draw(path, left, right, result, figure.Labels("", ("", ""), ("", ""), ()))
    magenta = (np.array(mi.Bitmap(str(path)))[..., :3] == (255, 0, 255)).all(axis=2)
    size = (720 // 30) ** 2
    assert magenta.sum() == pytest.approx((1 + 2 + 3 + 3) * size, rel=0.1)  # left, right, and both on the maps
    assert any("not finite, 1 pixels left and 2 right" in line for line in figure.explain(result))


def test_one_bad_pixel_is_seen_in_a_large_image(scalar, tmp_path):
    left = np.full((100, 3000, 3), 0.5)
    left[50, 1500] = np.nan
    result = compare_images(rendering(left), rendering(left), 0.0)
    path = tmp_path / "picture.png"
    figure.draw(path, left, left, result, figure.Labels("", ("", ""), ("", ""), ()))
    assert (np.array(mi.Bitmap(str(path)))[..., :3] == (255, 0, 255)).all(axis=2).any()


def test_infinities_do_not_break_the_report(compare, scene):
    """It ended in "Out of range float values are not JSON compliant" after the render."""
    status, out, err, report = compare(scene, "-D", "radiance=1e39", "-s", "gamma=3")
    assert status == 0
    assert "within the noise" not in out and "No difference" not in out
    assert min(report["not_finite"]) > 0
    assert "Not finite" in out
    assert err.splitlines()[0].startswith("sgtd: warning: Invalid sample value")


@pytest.mark.parametrize("size", [(1, 1), (1, 700), (700, 1), (9, 2)])
def test_images_of_any_shape_are_drawn(scalar, tmp_path, size):
    image = np.random.default_rng(1).random((*size, 3))
    result = compare_images(rendering(image), rendering(image * 1.1))
    figure.draw(tmp_path / "p.png", image, image * 1.1, result, figure.Labels("t", ("", ""), ("", ""), ()))
    assert max(mi.Bitmap(str(tmp_path / "p.png")).size()) < 8000


# --- what is kept


def test_what_cannot_be_drawn_is_still_saved(compare, scene, tmp_path, monkeypatch):
    assert compare(scene, "-s", "gamma=3")[0] == 0

    def fail(*_):
        raise MemoryError("no room for a picture")

    monkeypatch.setattr("sgtd.compare.comparison.draw", fail)
    status, _, err, report = compare(scene, "-s", "gamma=2")
    assert (status, report) == (1, None)
    assert "no room for a picture" in err and "left.exr" in err and err.count("\n") == 1
    # nothing that the earlier run said of other images is left beside them
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["left.exr", "right.exr"]


def test_an_image_that_is_no_png_is_saved_as_exr(capsys, scene, tmp_path, monkeypatch):
    (tmp_path / "x.exr").write_text("something of the user")
    bands = '<spectrum name="a" value="500:1, 600:2"/><spectrum name="b" value="450:1, 600:2"/>'
    scene.write_text(SCENE.replace('type="hdrfilm">', f'type="specfilm">{bands}'))
    capsys.readouterr()
    with pytest.raises(SystemExit) as exit_:
        cli.main(["render", str(scene), "-o", str(tmp_path / "x.png"), "--variant", "scalar_spectral"])
    assert exit_.value.code == 1
    assert "it is saved as" in capsys.readouterr().err
    assert mi.Bitmap(str(tmp_path / "x.png.exr")).channel_count() == 2
    assert (tmp_path / "x.exr").read_text() == "something of the user"
    assert not (tmp_path / "x.png").exists()


# --- words


def test_a_black_scene_without_color(compare, scene):
    scene.write_text(
        SCENE.replace('type="path"', 'type="aov"')
        .replace("max_depth", "x")
        .replace('integer name="x" value="3"', 'string name="aovs" value="d:depth"')
    )
    status, out, _, _ = compare(scene, "-s", "gamma=3")
    assert (status, "or the integrator renders no color" in out) == (0, True)


@pytest.mark.parametrize("sampler", ["stratified", "ldsampler"])
def test_a_sampler_with_structure_is_said(compare, scene, sampler):
    scene.write_text(SCENE.replace('type="independent"', f'type="{sampler}"'))
    status, out, _, report = compare(scene, "-s", "gamma=3", "--spp", 16)
    assert (status, report["passes"], report["samples_per_pixel"]) == (0, 1, 16)
    assert "keeps its structure in one pass" in out
    assert "RMSE, noise alone" in out


def test_the_title_of_a_scene_xml_has_its_folder(compare, tmp_path):
    use("scalar_rgb")
    folder = tmp_path / "kitchen"
    folder.mkdir()
    (folder / "scene.xml").write_text(SCENE)
    assert "kitchen/scene.xml: right against left" in compare(folder / "scene.xml", "--spp", 1)[1]


def test_with_nothing_to_exchange_the_materials_are_listed(compare, scene):
    scene.write_text(SCENE.replace("roughconductor", "principled").replace('<float name="alpha" value="0.3"/>', ""))
    status, _, err, _ = compare(scene)
    assert status == 1
    assert "the scene has 1 × principled" in err
    assert "never exchanged: principled" in err


@pytest.mark.parametrize("columns", [60, 100])
def test_the_table_fits_the_terminal(columns, scalar):
    from rich.console import Console
    from sgtd.compare.table import Report
    from sgtd.scene.exchange import Pair

    image = np.random.default_rng(2).random((8, 8, 3))
    left, right = (rendering(image * scale, passes=((1.25, 2), (1.27, 2), (1.31, 2))) for scale in (1e-6, 1.234e-6))
    report = Report("", "s", {}, {}, "v", "m", 8, 8, Pair(None, None, ()), left, right, compare_images(left, right))
    console = Console(width=columns, record=True, force_terminal=False)
    report.print(console)
    text = console.export_text()
    assert max(map(len, text.splitlines())) <= columns
    assert "…" not in text
    for row in report.rows():
        for number in (row.left, row.right, row.between, row.ratio):
            assert number is None or f"{number:.4g}" in text


# --- times


def test_times_have_no_more_digits_than_their_spread():
    assert seconds_text(Timing(((1.2345, 4),), compiles=False)) == "1.2 s"
    passes = ((9.0, 1), (1.2345, 1), (1.25, 1), (1.31, 1))
    traced = Timing(passes, compiles=True)
    assert seconds_text(traced) == "5.0 s (5.0 to 5.1)"
    assert traced.compiling == pytest.approx(9.0 - 1.25)
    assert decimals(123.4, (100.0, 150.0)) == -1
    assert decimals(0.0, None) == 0
    assert not math.isnan(decimals(1e-9, (1e-9, 2e-9)))


def test_compilation_that_cannot_be_told_apart_is_not_claimed():
    assert Timing(((1.3, 1), (1.2, 1), (1.0, 1), (1.25, 1)), compiles=True).compiling is None
    assert Timing(((5.0, 1),), compiles=True).compiling is None
    assert Timing(((5.0, 1),), compiles=True).compiling_is_included
    assert Timing(((5.0, 1), (1.0, 1), (1.0, 1)), compiles=False).compiling is None


def test_every_file_is_written(compare, scene, tmp_path):
    assert compare(scene, "-s", "gamma=3")[0] == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(FILES)
