"""``report.html``: one file that needs nothing else, for a desk and for a phone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..compare.difference import to_display
from ..page.plot_style import Plot, picture_png
from ..page.template import data, load_template, number, scientific
from . import DEFAULT_SETTING, advice, findings, setting_text
from .function_errors import Spread
from .function_timing import Timing
from .images import ImageRow, ImageStudy
from .study import FunctionStudy, Study

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
