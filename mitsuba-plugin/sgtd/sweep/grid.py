"""The axes of a sweep: which setting takes which values."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Union

from ..errors import UserError
from ..scene.exchange import SETTINGS, WORDS

#: Roughness, which is a setting of a sweep though the two sides of a comparison share it.
ROUGHNESS = ("alpha", "alpha_u", "alpha_v")

# More values of one setting are a slip of the keyboard.
_MOST_VALUES = 1000

Value = Union[str, float]


@dataclass(frozen=True)
class Axis:
    """A setting with its values, in the order given. ``of_scene`` says that it is a ``$name`` of the scene file, not a property of materials."""

    name: str
    values: tuple[Value, ...]
    of_scene: bool = False

    def texts(self) -> list[str]:
        """Each value as it is written."""
        return [value if isinstance(value, str) else f"{value:.6g}" for value in self.values]


def is_number(name: str) -> bool:
    """Whether a property of materials is a number; the ``$names`` of a scene are texts."""
    return name in ROUGHNESS or (name in SETTINGS and name not in WORDS)


def parse_axis(text: str, scene_defaults: Collection[str]) -> Axis:
    """Reads ``name=1,2,5`` (a list), ``name=0.1:0.5:5`` (five values at equal distances) or ``name=0.01:1:5:log`` (at equal ratios).

    The name is a property of the materials, or else one of ``scene_defaults``, the ``$names`` of the scene file.

    Raises :class:`UserError` for an unknown name, and for values that cannot be read or are given twice.
    """
    name, equals, rest = (part.strip() for part in text.partition("="))
    if not equals or not name or not rest:
        raise UserError(f'--set {text}: expected name=values, as in "--set gamma=1.6,2,4" or "--set alpha=0.1:0.5:5"')
    of_materials = name in SETTINGS or name in ROUGHNESS
    if not of_materials and name not in scene_defaults:
        of_scene = f", or of the scene: {', '.join(sorted(scene_defaults))}" if scene_defaults else ""
        known = ", ".join((*ROUGHNESS, *SETTINGS))
        raise UserError(f"--set {name}: unknown; it can be a property of the materials: {known}{of_scene}")
    numeric = is_number(name)
    values: list[Value] = []
    for part in rest.split(","):
        values += _range(name, part.strip()) if ":" in part else [_value(name, part.strip(), numeric)]
    if len(set(values)) != len(values):
        raise UserError(f"--set {name}={rest}: a value is given twice")
    return Axis(name, tuple(values), of_scene=not of_materials)


def combinations(axes: Sequence[Axis]) -> list[dict[str, Value]]:
    """Every combination of values; the last axis runs fastest."""
    names = [axis.name for axis in axes]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"--set {name} is given twice")
    return [dict(zip(names, values)) for values in itertools.product(*(axis.values for axis in axes))]


def _value(name: str, text: str, numeric: bool) -> Value:
    if not text:
        raise UserError(f"--set {name}: a value is missing between two commas")
    try:
        value = float(text)
    except ValueError:
        if numeric:
            raise UserError(f'--set {name}: "{text}" is not a number') from None
        return text
    # words of a scene ("true", "16") stay as they are written
    return value if numeric else text


def _range(name: str, text: str) -> list[Value]:
    """``first:last:count``, with ``:log`` for equal ratios."""
    parts = text.split(":")
    log = len(parts) == 4 and parts[3] == "log"
    try:
        if len(parts) != 3 + log:
            raise ValueError
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise UserError(
            f'--set {name}={text}: expected first:last:count, as in "0.1:0.5:5", or "0.01:1:5:log"'
        ) from None
    if not (math.isfinite(first) and math.isfinite(last)):
        raise UserError(f"--set {name}={text}: a range has finite ends")
    if not 2 <= count <= _MOST_VALUES:
        raise UserError(f"--set {name}={text}: the count is {count}, but must lie between 2 and {_MOST_VALUES}")
    if log and not (first > 0.0 and last > 0.0):
        raise UserError(f"--set {name}={text}: the ends of a logarithmic range must be above 0")
    steps = [k / (count - 1) for k in range(count)]
    if log:
        made = [first * (last / first) ** t for t in steps]
    else:
        made = [first + t * (last - first) for t in steps]
    return [float(f"{value:.9g}") for value in made]
