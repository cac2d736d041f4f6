"""What is written: the numbers as JSON, CSV and a short table on the terminal; ``report.html``, one file that needs nothing else, for
a desk and for a phone; all files or none.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..atomic_output import AtomicOutput
from ..compare.difference import to_display
from ..errors import UserError
from ..page.plot_style import Plot, picture_png
from ..page.template import data, load_template, number, scientific
from . import DEFAULT_SETTING, advice, conclusions, figures, setting_text
from .function_errors import MaskingErrors, Spread
from .function_timing import Timing
from .images import ImageRow, ImageStudy
from .study import FunctionStudy, Steps, Study, run

FUNCTIONS_CSV = "functions.csv"
IMAGES_CSV = "images.csv"
JSON = "accuracy.json"

# A narrower terminal gets tables without rules.
_WIDE = 76

_FUNCTION_COLUMNS = (
    *("shape", "function", "way", "setting", "worst_random", "worst_hard", "rms_random", "rms_hard"),
    *("ns_one_core", "ns_one_core_low", "ns_one_core_high", "ns_all_cores", "ns_all_cores_low", "ns_all_cores_high"),
    *("table_bytes", "build_ms", "build_ms_low", "build_ms_high", "accuracy_reported", "within_setting"),
)


def function_rows(study: Study) -> list[dict[str, Any]]:
    """One row per shape, function and way to compute it."""
    rows = []
    for functions in study.functions:
        for way, errors in functions.masking.items():
            rows.append(_row(study, functions, "lambda", way, errors.g1, errors))
        for way, spread in functions.density.items():
            rows.append(_row(study, functions, "d", way, spread, None))
        for way, sampling in functions.sampling.items():
            rows.append(_row(study, functions, "sample", way, sampling.weight, None))
    return rows


def _row(
    study: Study, functions: FunctionStudy, function: str, way: str, errors: Spread, masking: MaskingErrors | None
) -> dict[str, Any]:
    text = functions.shape.text
    setting = _setting(way)
    row: dict[str, Any] = dict.fromkeys(_FUNCTION_COLUMNS)
    row.update(shape=text, function=function, way="core" if setting is not None else way, setting=setting)
    for kind in ("random", "hard"):
        row[f"worst_{kind}"] = errors.worst.get(kind)
        row[f"rms_{kind}"] = errors.rms.get(kind)
    for label, clock in (("ns_one_core", study.one), ("ns_all_cores", study.all)):
        _put(row, label, clock.nanoseconds.get((text, function, way)))
    if setting is not None:
        row["table_bytes"] = study.one.table_bytes[text, way]
        row["accuracy_reported"] = study.one.accuracy_reached[text, way]
        _put(row, "build_ms", study.one.build_seconds.get((text, way)), 1e3)
        if masking is not None and setting:
            row["within_setting"] = errors.largest <= setting
    return row


def image_rows(study: Study) -> list[dict[str, Any]]:
    """One row per scene, shape, variant and setting."""
    rows = []
    for images in study.images:
        for row in [*images.rows, images.dcos]:
            rows.append(_image_row(images, row))
    return rows


def _image_row(images: ImageStudy, row: ImageRow) -> dict[str, Any]:
    result: dict[str, Any] = {
        "scene": images.scene,
        "shape": images.shape,
        "variant": images.variant,
        "setting": row.setting,
        "sampling": "visible" if row.visible else "D cos",
        "bias": row.bias if row.visible else None,
        "bias_floor": row.floor if row.visible else None,
        "steps_8bit": _plain(row.steps_8bit),
        "flip": _plain(row.flip),
        "flip_noise": row.flip_noise,
    }
    for spp in advice.SAMPLES:
        result[f"noise_{spp}spp"] = row.noise(spp)
    result["spp"] = images.spp
    _put(result, "rmse_equal_spp", row.rmse_equal_spp)
    _put(result, "seconds_per_spp", row.seconds_per_spp)
    result["equal_time_seconds"] = images.equal_time_seconds
    result["equal_time_spp"] = row.equal_time_spp
    _put(result, "rmse_equal_time", row.rmse_equal_time)
    return result


def write(study: Study, path_of: Any) -> None:
    """Writes the three files; ``path_of(name)`` says where."""
    _write_csv(path_of(FUNCTIONS_CSV), function_rows(study))
    _write_csv(path_of(IMAGES_CSV), image_rows(study))
    text = json.dumps(as_dict(study), indent=1, allow_nan=False)
    Path(path_of(JSON)).write_text(text + "\n", encoding="utf-8")


def as_dict(study: Study) -> dict[str, Any]:
    """The whole study in plain values; infinities as text."""
    values = {
        "machine": study.machine,
        "seed": study.seed,
        "quick": study.quick,
        "seconds": study.seconds,
        "settings": list(study.settings),
        "functions": function_rows(study),
        "sampling": [_sampling(functions) for functions in study.functions],
        "single_precision": _precision(study),
        "images": image_rows(study),
        "image_studies": [_image_study(images) for images in study.images],
        "recommendation": [{"shape": one.shape, **one.settings, "all": one.all_of_them} for one in study.advice],
        "text": study.text,
    }
    return _finite(values)


def _sampling(functions: FunctionStudy) -> dict[str, Any]:
    def of(errors: Any) -> dict[str, Any]:
        return {"mean_weight": errors.mean, "variance": errors.variance, "lost": errors.lost}

    settings = {way: of(errors) for way, errors in functions.sampling.items()}
    return {"shape": functions.shape.text, "visible": settings, "d_cos": of(functions.dcos)}


def _precision(study: Study) -> list[dict[str, Any]]:
    return [
        {
            "shape": functions.shape.text,
            "variant": variant,
            "setting": setting,
            "pairs": errors.count,
            "worst": errors.value.worst.get("random"),
            "rms": errors.value.rms.get("random"),
        }
        for functions in study.functions
        for variant, settings in functions.precision.items()
        for setting, errors in settings.items()
    ]


def _image_study(images: ImageStudy) -> dict[str, Any]:
    names = ("scene", "shape", "variant", "size", "batches", "spp", "equal_time_seconds", "exposure")
    return {name: getattr(images, name) for name in names}


def print_tables(study: Study, console: Any) -> None:
    """A short table per shape, and the recommendation."""
    from rich.box import HEAVY_HEAD
    from rich.table import Table

    for functions in study.functions:
        text = functions.shape.text
        images = [one for one in study.images if one.shape in (text, "as in the file")]
        wide = console.width >= _WIDE
        table = Table(
            title=functions.shape.title, title_justify="left", box=HEAVY_HEAD if wide else None, pad_edge=wide
        )
        columns = _columns(study, functions, images)
        names = list(columns) if images else list(columns)[:-2]
        if not wide:  # what matters least
            names = [name for name in names if name not in ("ms to build", f"ns, {study.all.threads} cores")]
        for name in names:
            table.add_column(name, justify="right", min_width=min(map(len, name.split())))
        for setting in study.settings:
            table.add_row(*(columns[name](setting) for name in names))
        console.print(table)
    for one in study.advice:
        parts = [f"{name}: {'none' if k is None else setting_text(k)}" for name, k in one.settings.items()]
        console.print(
            f"{one.shape}: coarsest setting that {'passed' if study.quick else 'suffices'}: {'; '.join(parts)}",
            highlight=False,
            soft_wrap=True,
        )
    console.print(study.text, highlight=False, soft_wrap=True)


def _columns(study: Study, functions: FunctionStudy, images: list[ImageStudy]) -> dict[str, Callable[[float], str]]:
    """The columns of the short table: the text of each setting."""
    text = functions.shape.text
    return {
        "accuracy": setting_text,
        "worst error of G1": lambda k: "reference" if k == 0.0 else f"{functions.masking[str(k)].g1.largest:.1e}",
        "ns, 1 core": lambda k: f"{study.one.nanoseconds[text, 'lambda', str(k)].median:.3g}",
        f"ns, {study.all.threads} cores": lambda k: f"{study.all.nanoseconds[text, 'lambda', str(k)].median:.3g}",
        "bytes": lambda k: str(study.one.table_bytes[text, str(k)]),
        "ms to build": lambda k: f"{1e3 * study.one.build_seconds[text, str(k)].median:.2g}",
        "8-bit steps": lambda k: f"{max(one.row(k).steps_8bit for one in images):.1g}",
        "bias / noise at 1024 spp": lambda k: f"{max(_part_of_noise(one.row(k)) for one in images):.1g}",
    }


def _part_of_noise(row: ImageRow) -> float:
    return row.bias / max(row.noise(1024), 1e-300)


def _setting(way: str) -> float | None:
    """The setting that a key names, or None for a formula."""
    try:
        return float(way)
    except ValueError:
        return None


def _put(row: dict[str, Any], name: str, timing: Timing | None, factor: float = 1.0) -> None:
    """Median and quartiles under three names."""
    if timing is None:
        return
    row[name] = factor * timing.median
    row[f"{name}_low"], row[f"{name}_high"] = factor * timing.low, factor * timing.high


def _plain(value: float) -> float | None:
    return None if math.isnan(value) else value


def _finite(value: Any) -> Any:
    """JSON has no infinity and no NaN."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, columns)
        table.writeheader()
        for row in rows:
            cells = {name: f"{value:.9g}" if isinstance(value, float) else value for name, value in row.items()}
            table.writerow(cells)


_TEMPLATE = "report.html.j2"

# Differences are shown so much enlarged.
_MAGNIFIED = 100


def render(study: Study, main: list[Plot], functions: list[Plot], pictures: list[list[Plot]]) -> str:
    """The page as text."""
    template = load_template(
        Path(__file__).with_name(_TEMPLATE),
        error=_error,
        timing=_timing,
        setting=setting_text,
        share=_share,
        bias=_bias,
    )
    shapes = {one.shape.text: one.shape.title for one in study.functions}
    return template.render(
        study=study,
        main=main,
        functions=[(one, plot, _function_table(study, one)) for one, plot in zip(study.functions, functions)],
        pictures=pictures,
        studies=[(images, _thumbnails(images)) for images in study.images],
        titles=shapes,
        criteria=advice.criteria(),
        samples=advice.SAMPLES,
        default=DEFAULT_SETTING,
        hidden=advice.HIDDEN,
        magnified=_MAGNIFIED,
        about_dial=conclusions.about_dial(study),
        about_reference=conclusions.about_reference(study),
        about_precision=conclusions.about_precision(study),
        tables=[setting for setting in study.settings if setting],
    )


def _function_table(study: Study, functions: FunctionStudy) -> list[dict[str, Any]]:
    """Lambda: settings first, then formulas."""
    rows = []
    text = functions.shape.text
    for way, errors in functions.masking.items():
        key = (text, "lambda", way)
        setting = next((k for k in study.settings if str(k) == way), None)
        rows.append(
            {
                "name": way if setting is None else setting_text(setting),
                "formula": setting is None,
                "reference": setting == 0.0,
                "exceeded": bool(setting) and errors.g1.largest > setting,
                "g1": errors.g1,
                "own": errors.lambda_itself.largest,
                "one": study.one.nanoseconds[key],
                "all": study.all.nanoseconds.get(key),
                "bytes": study.one.table_bytes.get((text, way)),
                "build": study.one.build_seconds.get((text, way)),
            }
        )
    return rows


def _thumbnails(images: ImageStudy) -> tuple[str, str]:
    """The reference, and what the coarsest setting changes, much enlarged around gray."""
    shown = to_display(images.reference, images.exposure)
    other = to_display(images.coarsest, images.exposure)
    difference = 0.5 + 0.5 * np.clip(_MAGNIFIED * (other - shown), -1.0, 1.0)
    return data("png", picture_png(shown)), data("png", picture_png(difference))


def _error(value: float | Spread | None) -> str:
    return scientific(value.largest if isinstance(value, Spread) else value)


def _timing(value: Timing | None, factor: float = 1.0, digits: int = 3) -> str:
    """ "7.6 (7.5–7.7)": the median and the quartiles."""
    if value is None:
        return "–"
    median, low, high = (number(factor * x, digits) for x in (value.median, value.low, value.high))
    return f"{median} ({low}–{high})"


def _bias(row: ImageRow) -> str:
    """The bias where the renders can tell it from zero, else a bound."""
    bound = 2.0 * row.floor
    return scientific(row.bias) if row.bias >= bound else f"< {scientific(bound)}"


def _share(value: float) -> str:
    return f"{value:.2%}"


REPORT = "report.html"


def make(
    folder: Path,
    shapes: tuple[str, ...],
    scenes: tuple[Path, ...],
    variants: tuple[str, ...],
    parameters: dict[str, str],
    seed: int,
    quick: bool,
    steps: Steps,
    lenient: bool = False,
) -> Study:
    """Measures and writes ``report.html``, the plots, and the numbers as JSON and CSV into the folder."""
    _check_imports()
    with AtomicOutput(folder) as files:
        result = run(shapes, scenes, variants, parameters, seed, quick, steps, lenient)
        done = steps("writing", 1)
        main, functions, pictures = figures.draw_all(result)
        for plot in (main, *functions, *(plot for pair in pictures for plot in pair)):
            files.path(f"{plot.name}.png").write_bytes(plot.png)
            files.path(f"{plot.name}.svg").write_bytes(plot.svg)
        top = [functions[0], *(pair[0] for pair in pictures[:1])]
        files.path(REPORT).write_text(render(result, top, functions, pictures), encoding="utf-8")
        write(result, files.path)
        done(1)
    return result


def _check_imports() -> None:
    """What the report needs beyond rendering, before anything is measured."""
    for module, package in (("scipy", "scipy"), ("jinja2", "jinja2"), ("matplotlib", "matplotlib")):
        try:
            __import__(module)
        except ImportError as error:
            raise UserError(f"the package {package} is missing: pip install {package}") from error
