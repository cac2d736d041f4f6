"""Distributions that are given by numbers, as the plugins read them: tables, and mixtures of rows and tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from .._core import Radial, TableSource

# The rows that are none of the family.
ROWS = ("tabulated", "mixture")

# Their properties: texts and numbers.
WORDS = ("filename", "angles", "slopes", "values", "quantity", "tail", "members")
NUMBERS = ("tail_exponent", "knee")
PROPERTIES = WORDS + NUMBERS


def radial_of(properties: Mapping[str, Any], folder: Path) -> Radial:
    """The distribution of a material, whose files are relative to ``folder``; ``ValueError`` where the plugin would refuse it."""
    if str(properties.get("distribution", "")).lower() == "mixture":
        return _mixture(str(properties["members"]), folder)
    return _table(properties, folder)


def _table(properties: Mapping[str, Any], folder: Path) -> Radial:
    exponent, knee = (None if name not in properties else float(properties[name]) for name in NUMBERS)
    quantity, tail = str(properties.get("quantity", "")), str(properties.get("tail", "")).lower()
    if "filename" in properties:
        path = Path(str(properties["filename"]))
        found = TableSource.read(
            str(path if path.is_absolute() or path.exists() else folder / path), quantity, tail, exponent
        )
        if knee is None:
            return Radial.table(found)
        return Radial.table(
            TableSource(
                found.places,
                found.by_angles,
                found.values,
                found.quantity,
                found.tail,
                found.tail_exponent,
                knee,
                found.path,
            )
        )
    by_angles = "angles" in properties
    places, values = (_list(properties[name]) for name in ("angles" if by_angles else "slopes", "values"))
    return Radial.table(TableSource(places, by_angles, values, quantity or "D", tail or "power", exponent, knee))


def _list(value: Any) -> Any:
    if isinstance(value, str):
        return np.array([float(token) for token in value.replace(",", " ").replace(";", " ").split()])
    return np.ascontiguousarray(np.asarray(value, dtype=np.float64).ravel())


def _mixture(text: str, folder: Path) -> Radial:
    parts = []
    for member in text.split(";"):
        pairs = dict(token.split("=", 1) for token in member.split())
        if not pairs:
            continue
        weight, row = float(pairs.get("weight", 1.0)), pairs.get("distribution", "sgtd").lower()
        if row == "tabulated":
            radial, scale = _table(pairs, folder), 1.0
            alpha = float(pairs.get("alpha", radial.width))
        else:
            numbers = (float(pairs[name]) if name in pairs else None for name in ("gamma", "p", "lambda", "shift"))
            shape, scale = _core.shape_of_row(row, *numbers)
            radial, alpha = Radial.family(shape), float(pairs.get("alpha", 0.1))
        parts.append((weight, alpha * scale, radial))
    return Radial.mixture(parts)
