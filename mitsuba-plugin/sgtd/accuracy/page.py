"""``report.html``: one file that needs nothing else, for a desk and for a phone."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import Any

import numpy as np

from ..compare.difference import to_display
from . import DEFAULT_SETTING, advice, findings, setting_text
from .function_errors import Spread
from .function_timing import Timing
from .images import ImageRow, ImageStudy
from .plot_style import Plot, picture_png
from .study import FunctionStudy, Study

_TEMPLATE = "report.html.j2"

# Differences are shown so much enlarged.
_MAGNIFIED = 100


def render(study: Study, main: list[Plot], functions: list[Plot], pictures: list[list[Plot]]) -> str:
    """The page as text."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader(str(Path(__file__).parent))
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update(
        error=_error, timing=_timing, number=_number, setting=setting_text, svg=_svg, share=_share, bias=_bias
    )
    shapes = {one.shape.text: one.shape.title for one in study.functions}
    return environment.get_template(_TEMPLATE).render(
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
        about_dial=findings.about_dial(study),
        about_reference=findings.about_reference(study),
        about_precision=findings.about_precision(study),
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
    return _data("png", picture_png(shown)), _data("png", picture_png(difference))


def _svg(plot: Plot) -> str:
    return _data("svg+xml", plot.svg)


def _data(kind: str, content: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _error(value: float | Spread | None) -> str:
    if isinstance(value, Spread):
        value = value.largest
    if value is None or math.isnan(value):
        return "–"
    if value == 0.0:
        return "0"
    if math.isinf(value):
        return "∞"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def _timing(value: Timing | None, factor: float = 1.0, digits: int = 3) -> str:
    """ "7.6 (7.5–7.7)": the median and the quartiles."""
    if value is None:
        return "–"
    median, low, high = (_number(factor * x, digits) for x in (value.median, value.low, value.high))
    return f"{median} ({low}–{high})"


def _number(value: float | None, digits: int = 3) -> str:
    if value is None or math.isnan(value):
        return "–"
    if value and not 1e-3 <= abs(value) < 1e5:
        return _error(value)
    return f"{value:.{digits}g}" if abs(value) < 1000 else f"{value:.0f}"


def _bias(row: ImageRow) -> str:
    """The bias where the renders can tell it from zero, else a bound."""
    bound = 2.0 * row.floor
    return _error(row.bias) if row.bias >= bound else f"< {_error(bound)}"


def _share(value: float) -> str:
    return f"{value:.2%}"
