"""The shapes that are measured: rows of the family with their parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from . import _core
from ._core import Shape
from .errors import UserError
from .ndf import Ndf
from .page.plot_style import file_part
from .scene.exchange import parse_settings

_PARAMETERS = ("gamma", "p", "lambda", "shift")

# A heavy tail; all four parameters at work; a ring with a cusp and an exponential tail.
DEFAULT_SHAPES = ("student:gamma=1.6", "sgtd:gamma=2.7,p=1.3,lambda=0.3,shift=0.4", "gnd:p=0.5,shift=2")
QUICK_SHAPES = ("student:gamma=1.6",)

# The homes of the published closed forms; measured as functions only.
CLASSICS = ("ggx", "beckmann")


@dataclass(frozen=True)
class NamedShape:
    """One shape: ``text`` as the user would write it, ``settings`` as the plugin reads them, and its numbers."""

    text: str
    settings: tuple[tuple[str, Any], ...]
    numbers: Shape
    alpha_scale: float

    def ndf(self, alpha_u: float, alpha_v: float, accuracy: float) -> Ndf:
        """The array interface at a roughness of the plugin's ``alpha``."""
        arguments = {"lam" if name == "lambda" else name: value for name, value in self.settings}
        return Ndf(**arguments, alpha_u=alpha_u, alpha_v=alpha_v, accuracy=accuracy)

    @property
    def is_student(self) -> bool:
        """Student's distribution: where closed forms and the fit of 2017 hold."""
        return self.numbers.numbers()[1:] == (1.0, 0.0, 0.0) and math.isfinite(self.numbers.gamma)

    @property
    def is_ggx(self) -> bool:
        return self.numbers == Shape(2.0, 1.0, 0.0, 0.0)

    @property
    def is_beckmann(self) -> bool:
        return self.numbers == Shape(math.inf, 1.0, 0.0, 0.0)

    @property
    def slug(self) -> str:
        """A name for files."""
        return file_part(self.text)

    @property
    def title(self) -> str:
        """For people: "student, gamma = 1.6"."""
        row, _, rest = self.text.partition(":")
        names = {"ggx": "GGX", "beckmann": "Beckmann", "student": "Student"}
        head = names.get(row, row.upper())
        return ", ".join([head, *(part.replace("=", " = ") for part in rest.split(",") if part)])


def parse_shape(text: str) -> NamedShape:
    """Reads ``row`` or ``row:gamma=1.6,p=1``; a value out of range is refused in the core's words."""
    row, colon, rest = text.partition(":")
    if not row or (colon and not rest):
        raise UserError(f'--shape {text}: expected ROW or ROW:NAME=VALUE,..., as in "--shape student:gamma=1.6"')
    settings = parse_settings([part for part in rest.split(",") if part])
    for name in settings:
        if name not in _PARAMETERS:
            raise UserError(f"--shape {text}: {name} is no shape parameter; those are {', '.join(_PARAMETERS)}")
    return make_shape(row.strip().lower(), settings)


def make_shape(row: str, settings: dict[str, Any]) -> NamedShape:
    """A row with parameters by their names in the plugin."""
    values = [settings.get(name) for name in _PARAMETERS]
    listing = ",".join(f"{name}={value:g}" for name, value in zip(_PARAMETERS, values) if value is not None)
    text = f"{row}:{listing}" if listing else row
    try:
        numbers, alpha_scale = _core.shape_of_row(row, *values)
    except ValueError as error:
        raise UserError(f"--shape {text}: {error}") from error
    given = tuple((name, value) for name, value in zip(_PARAMETERS, values) if value is not None)
    return NamedShape(text, (("distribution", row), *given), numbers, alpha_scale)
