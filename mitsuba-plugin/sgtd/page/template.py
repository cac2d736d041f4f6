"""A template made into one file that needs nothing else."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import require
from .plot_style import Plot

if TYPE_CHECKING:
    from jinja2 import Template


def load_template(path: Path, **filters: Any) -> Template:
    """A template that may include ``style.css`` of this folder and its own neighbors; ``svg``, ``number`` and ``error`` are filters of it."""
    require("report")
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader([str(path.parent), str(Path(__file__).parent)])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update({"svg": svg, "number": number, "error": scientific, **filters})
    return environment.get_template(path.name)


def svg(plot: Plot) -> str:
    """A plot as the source of an image."""
    return data("svg+xml", plot.svg)


def data(kind: str, content: bytes) -> str:
    """An image as the source of an image."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def scientific(value: float | None) -> str:
    """ "1.2e-5"."""
    if value is None or math.isnan(value):
        return "–"
    if value == 0.0:
        return "0"
    if math.isinf(value):
        return "∞"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def number(value: float | None, digits: int = 3) -> str:
    """So many digits, without an exponent where that is short."""
    if value is None or math.isnan(value):
        return "–"
    if value and not 1e-3 <= abs(value) < 1e5:
        return scientific(value)
    return f"{value:.{digits}g}" if abs(value) < 1000 else f"{value:.0f}"
