"""``sgtd accuracy``, run for real at a small size: its files, its numbers against independent ones, its refusals."""

from __future__ import annotations

import csv
import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from scipy import integrate, special
from sgtd import cli
from sgtd.accuracy import QUICK_SETTINGS, advice, function_errors, output, published
from sgtd.accuracy.function_timing import Timing
from sgtd.accuracy.images import ImageRow
from sgtd.errors import UserError
from sgtd.named_shape import make_shape, parse_shape

# whole reports, if small ones; made once, by one of the workers
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("accuracy report")]

SHAPE = "student:gamma=2.5"
SCENE = """
<scene version="3.0.0">
    <default name="metal" value=""/>
    <integrator type="path"><integer name="max_depth" value="2"/></integrator>
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, -5, 1" target="0, 0, 0" up="0, 0, 1"/></transform>
        <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{width}"/></film>
        <sampler type="independent"><integer name="sample_count" value="8"/></sampler>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
    <shape type="sphere">{material}</shape>
</scene>
"""
ROUGH = '<bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf>'
OWN = """<bsdf type="sgtdconductor"><float name="alpha" value="0.3"/>
    <string name="distribution" value="gnd"/><float name="p" value="1.5"/></bsdf>"""


def write_scene(folder: Path, material: str, width: int = 400) -> Path:
    path = folder / "scene.xml"
    path.write_text(SCENE.format(material=material, width=width))
    return path


def run(*arguments: object) -> int:
    """The command; returns its status."""
    before = mi.variant()
    try:
        with pytest.raises(SystemExit) as end:
            cli.main(["accuracy", "--quick", *map(str, arguments)])
    finally:
        if before:
            mi.set_variant(before)
    return end.value.code or 0


# What the run below measured
STUDIES: list = []


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    """One quick run, shared by the tests."""
    folder = tmp_path_factory.mktemp("accuracy")
    scene = write_scene(folder, ROUGH)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(output, "print_tables", lambda study, _: STUDIES.append(study))
        status = run("--shape", SHAPE, "--scene", scene, "--variant", "scalar_rgb", "-o", folder / "out", "--seed", 5)
    assert status == 0
    return folder / "out"


@pytest.fixture(scope="module")
def numbers(report) -> dict:
    return json.loads((report / "accuracy.json").read_text())


def exact_lambda(a: float, gamma: float) -> float:
    """Smith's Lambda of Student's distribution from its definition, by SciPy's quadrature over slopes along the view."""
    k = (gamma - 1) ** (gamma - 1) * special.gamma(gamma - 0.5) / (special.gamma(gamma - 1) * math.sqrt(math.pi))

    def visible(q: float) -> float:
        return (q - a) * k * (gamma - 1 + q * q) ** (0.5 - gamma)

    value, _ = integrate.quad(visible, a, math.inf, epsabs=0, epsrel=1e-12, limit=400)
    return value / a


def test_all_files_are_there(report):
    names = {path.name for path in report.iterdir()}
    assert {"report.html", "accuracy.json", "functions.csv", "images.csv", "accuracy.png", "accuracy.svg"} <= names
    assert not [name for name in names if name.startswith(".")]
    assert {f"{kind}-student-gamma-2.5.{end}" for kind in ("functions", "images") for end in ("png", "svg")} <= names


def test_says_from_what_it_was_made(numbers):
    assert numbers["seed"] == 5
    for name in ("processor", "cores", "mitsuba", "sgtd", "numpy", "python", "date"):
        assert numbers["machine"][name]


def lambda_rows(numbers: dict) -> dict:
    return {
        row["setting"] if row["way"] == "core" else row["way"]: row
        for row in numbers["functions"]
        if row["function"] == "lambda"
    }


def test_errors_of_tables_agree_with_closed_form(numbers):
    """The same arguments, but the reference by the incomplete beta function, which the report's reference does not use."""
    rows = lambda_rows(numbers)
    shape = parse_shape(SHAPE)
    for setting in QUICK_SETTINGS[:-1]:
        worst = {"random": 0.0, "hard": 0.0}
        for batch in function_errors.directions(shape, 5, 3_000):
            exact = published.over_directions(
                lambda a: published.student_lambda(a, 2.5), batch.alpha_u, batch.alpha_v, batch.w
            )
            found = shape.ndf(batch.alpha_u, batch.alpha_v, setting).g1(batch.w)
            finite = np.isfinite(exact)
            worst[batch.kind] = max(worst[batch.kind], float(np.abs(found * (1 + exact) - 1)[finite].max()))
        for kind, value in worst.items():
            assert rows[setting][f"worst_{kind}"] == pytest.approx(value, rel=1e-4, abs=1e-13)


@pytest.mark.parametrize("a", [1e-3, 0.07, 0.9, 4.0, 60.0])
def test_closed_forms_agree_with_definition(a):
    """The comparison lines themselves, from the definition of Lambda as an integral over slopes."""
    here = np.array([a])
    assert published.student_lambda(here, 2.5)[0] == pytest.approx(exact_lambda(a, 2.5), rel=1e-9)
    assert published.ggx_lambda(here)[0] == pytest.approx(exact_lambda(a, 2.0), rel=1e-9)
    g1 = 1 / (1 + published.student_fit(here, 2.5)[0])
    assert g1 * (1 + exact_lambda(a, 2.5)) == pytest.approx(1, abs=8e-3)
    beckmann = 1 / (1 + published.beckmann_lambda(here)[0])
    assert 1 / (1 + published.beckmann_fit(here)[0]) == pytest.approx(beckmann, rel=4e-3)


def test_order_of_the_ways(numbers):
    """Finer settings have smaller errors; the published fit stands where its authors say."""
    rows = lambda_rows(numbers)
    errors = [max(rows[k]["worst_random"], rows[k]["worst_hard"]) for k in QUICK_SETTINGS[:-1]]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 2e-7
    assert 3e-3 < rows["fit of 2017"]["worst_hard"] < 8e-3
    assert rows["closed form, incomplete beta"]["worst_hard"] < 1e-13
    assert rows["Gauss-Legendre, 64 nodes"]["worst_hard"] < rows["Gauss-Legendre, 16 nodes"]["worst_hard"]
    for row in rows.values():
        assert row["ns_one_core_low"] <= row["ns_one_core"] <= row["ns_one_core_high"]


def test_sampling_is_unbiased_and_visible_beats_d_cos(numbers):
    (sampling,) = numbers["sampling"]
    for one in sampling["visible"].values():
        assert one["mean_weight"] == pytest.approx(1, abs=0.02)
    assert sampling["d_cos"]["variance"] > 20 * sampling["visible"]["1e-05"]["variance"]


def test_images_and_advice_agree(numbers):
    rows = [row for row in numbers["images"] if row["sampling"] == "visible"]
    assert [row["setting"] for row in rows] == list(QUICK_SETTINGS)
    biases = [row["bias"] for row in rows]
    assert biases[0] > 30 * biases[1] > 0
    assert rows[-1]["bias"] == 0 and rows[-1]["steps_8bit"] == 0
    for row in rows:
        assert row["noise_64spp"] == pytest.approx(16 * row["noise_16384spp"])
    (own,) = numbers["recommendation"]
    for spp in advice.SAMPLES:
        enough = [row["setting"] for row in rows if row["bias"] <= advice.HIDDEN * row[f"noise_{spp}spp"]]
        assert own[f"{spp} spp"] == max(enough)


def test_csv_holds_the_same_numbers(report, numbers):
    for name, key in (("functions.csv", "functions"), ("images.csv", "images")):
        with (report / name).open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == len(numbers[key])
        for text, value in zip(rows, numbers[key]):
            for column, cell in value.items():
                if isinstance(cell, float):
                    assert float(text[column]) == pytest.approx(cell, rel=1e-8)


class _Page(HTMLParser):
    """Balanced tags, and everything that a browser would load."""

    EMPTY = frozenset(("meta", "img", "br", "link", "input", "hr"))

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loaded: list[str] = []
        self.viewport = False

    def handle_starttag(self, tag, attrs):
        if tag not in self.EMPTY:
            self.open.append(tag)
        values = dict(attrs)
        self.viewport |= values.get("name") == "viewport"
        self.loaded += [values[name] for name in ("src", "href", "srcset", "data", "poster") if name in values]

    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag


def test_page_stands_alone(report):
    text = (report / "report.html").read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    page.close()
    assert not page.open
    assert page.viewport
    assert page.loaded and all(value.startswith("data:image/") for value in page.loaded)
    assert not re.search(r"https?:|@import|url\(|<script", text)


class _Tables(HTMLParser):
    """The tables of the page as rows of (text, bold, columns)."""

    def __init__(self):
        super().__init__()
        self.tables, self.cell, self.bold = [], None, False

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
            self.bold = "default" in (values.get("class") or "")
        if tag in ("td", "th"):
            self.cell = ["", tag == "th" or self.bold, int(values.get("colspan", 1))]
        if tag == "br" and self.cell:
            self.cell[0] += "\n"

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.tables[-1][-1].append(self.cell)
            self.cell = None

    def handle_data(self, data):
        if self.cell:
            self.cell[0] += data


def test_tables_fit_a_desk_of_1280_pixels(report):
    """In DejaVu Sans, the widest of the page's fonts; at 1280 pixels the last column was cut off."""
    import matplotlib
    from PIL import ImageFont

    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    widths = [ImageFont.truetype(str(fonts / f"DejaVuSans{kind}.ttf"), 14).getlength for kind in ("", "-Bold")]
    text = (report / "report.html").read_text(encoding="utf-8")
    padding = 16 * float(re.search(r"th, td { padding: [\d.]+rem ([\d.]+)rem", text)[1])
    assert 16 * float(re.search(r"max-width: ([\d.]+)rem; background", text)[1]) >= 1280
    page = _Tables()
    page.feed(text)
    for table in page.tables:
        columns = [0.0] * max(sum(span for *_, span in row) for row in table)
        for row in table:
            place = 0
            for words, bold, span in row:
                if span == 1:
                    lines = [widths[bold](line.strip()) for line in words.split("\n")]
                    columns[place] = max(columns[place], *lines)
                place += span
        assert sum(columns) + 2 * padding * len(columns) < 1280 - 2 * 16 - 17  # margins and a scroll bar


def test_no_plot_is_shown_twice(report):
    text = (report / "report.html").read_text(encoding="utf-8")
    plots = re.findall(r'src="(data:image/svg[^"]+)"', text)
    assert len(plots) == len(set(plots)) >= 3


def test_a_quick_run_recommends_nothing(report, numbers):
    assert numbers["text"].startswith("A quick run shows that everything works here, and measures too little")
    assert "should be" not in numbers["text"]


@pytest.mark.parametrize("columns", [60, 100])
def test_tables_fit_the_terminal(report, columns):
    from rich.console import Console

    console = Console(width=columns, record=True)
    output.print_tables(STUDIES[0], console)
    table = console.export_text().split(f"{SHAPE}:")[0]
    assert "…" not in table
    assert max(map(len, table.splitlines())) <= columns


def test_scene_keeps_its_own_shapes(tmp_path):
    scene = write_scene(tmp_path, OWN, width=24)
    assert run("--scene", scene, "--variant", "scalar_rgb", "-o", tmp_path / "out") == 0
    numbers = json.loads((tmp_path / "out" / "accuracy.json").read_text())
    assert {row["shape"] for row in numbers["functions"]} == {"gnd:p=1.5"}
    assert {row["shape"] for row in numbers["images"]} == {"as in the file"}
    assert numbers["image_studies"][0]["size"] == [24, 24]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--shape", "student:gamma=1.4"], "gamma"),
        (["--shape", "nobody"], "nobody"),
        (["--shape", "student:gamm=2"], "gamma"),
        (["--shape", "ggx:gamma=3"], "gamma"),
        (["--shape", "sgtd:masking=separable"], "masking"),
        (["--shape", "student:"], "student:gamma=1.6"),
        (["--scene", "missing.xml"], "missing.xml"),
        (["--variant", "scalar_rbg"], "scalar_rbg"),
        (["--seed", "-1"], "seed"),
    ],
)
def test_mistakes_are_one_line(arguments, words, tmp_path, capsys):
    variant = [] if "--variant" in arguments else ["--variant", "scalar_rgb"]
    status = run(*arguments, *variant, "-o", tmp_path / "out")
    said = capsys.readouterr().err.strip().splitlines()
    assert status != 0
    assert len(said) == 1 and words in said[0]
    assert not (tmp_path / "out").exists()


def test_scene_without_metal_is_refused_before_measuring(tmp_path, capsys):
    scene = write_scene(tmp_path, '<bsdf type="diffuse"/>')
    assert run("--scene", scene, "--variant", "scalar_rgb", "-o", tmp_path / "out") != 0
    assert "roughconductor" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_shapes_are_read_as_the_plugin_reads_them():
    shape = parse_shape("hyper_cauchy:gamma=1.8")
    assert shape.alpha_scale == pytest.approx(math.sqrt(2 / 0.8))
    assert dict(shape.settings) == {"distribution": "hyper_cauchy", "gamma": 1.8}
    assert parse_shape("ggx").is_ggx and not parse_shape("ggx:shift=1").is_ggx
    with pytest.raises(UserError, match="gamma"):
        make_shape("student", {"gamma": 1.0})


def test_advice_takes_the_coarsest_setting_from_which_on_all_pass():
    def row(setting: float, bias: float, steps: float) -> ImageRow:
        timing = Timing(1.0, 1.0, 1.0)
        return ImageRow(setting, True, bias, 0.0, steps, 0.0, 0.0, 1.0, timing, timing)

    # noise at 64 spp is 1/8: hidden below 1/80
    assert advice.meets(row(1e-3, 0.0124, 0.9), "64 spp") and not advice.meets(row(1e-3, 0.0126, 0.9), "64 spp")
    assert advice.meets(row(1e-3, 1.0, 0.99), "8-bit") and not advice.meets(row(1e-3, 0.0, 1.0), "8-bit")
