"""CSV: a line that names the columns, then a line for each pair of directions.

Columns are separated by commas, semicolons, tabs or spaces; ``#`` starts a comment, and ``# theta_i: 45`` or ``# unit: radians`` says of all lines what
no column does.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import UserError, os_reason
from .columns import from_columns, looks_like_header, normal_name
from .content import size
from .source import Source
from .thinning import thinned

_TOLD = re.compile(r"#\s*([A-Za-z_ ]+?)\s*[:=]\s*(.+?)\s*$")
_UNITS = {
    "deg": 1.0,
    "degree": 1.0,
    "degrees": 1.0,
    "rad": 180.0 / np.pi,
    "radian": 180.0 / np.pi,
    "radians": 180.0 / np.pi,
}
_NAMES = "theta_i,phi_i,theta_o,phi_o,R,G,B"
# Characters of a line that an error shows
_SHOWN = 40


def header_of(text: str) -> str | None:
    """The line that names columns, if a text begins like such a table."""
    for line in text.splitlines():
        plain = line.strip().lstrip("\ufeff")
        if not plain or plain.startswith("#"):
            continue
        return plain if looks_like_header(_split(plain, _separator(plain))) else None
    return None


def _separator(line: str) -> str | None:
    return next((mark for mark in (",", ";", "\t") if mark in line), None)


def _split(line: str, separator: str | None) -> list[str]:
    return [part.strip() for part in line.split(separator)]


def read(path: Path) -> Source:
    size(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: byte {error.start} is no text: is it another format?") from None
    except OSError as error:
        raise UserError(f"{path}: {os_reason(error)}") from error
    told: dict[str, float] = {}
    names: list[str] = []
    separator: str | None = None
    rows: list[list[float]] = []
    numbers: list[int] = []
    for number, line in enumerate(lines, 1):
        plain = line.strip()
        if not plain:
            continue
        if plain.startswith("#"):
            _remember(path, number, plain, told)
            continue
        if not names:
            separator = _separator(plain)
            names = _split(plain, separator)
            if not looks_like_header(names):
                raise UserError(
                    f'{path}: line {number}: "{plain[:_SHOWN]}" names no columns: the first line must be like "{_NAMES}"'
                )
            if len(set(names)) != len(names):
                raise UserError(f"{path}: line {number}: two columns have the same name: name each column once")
            continue
        rows.append(_row(path, number, plain, separator, names))
        numbers.append(number)
    if not names:
        raise UserError(f'{path}: no line names the columns: the first line must be like "{_NAMES}"')
    if not rows:
        raise UserError(f"{path}: no line of numbers behind the names of the columns")
    table = np.array(rows)
    data = from_columns(path, dict(zip(names, table.T)), told, lambda row: f"line {numbers[row]}")
    return Source("CSV", thinned(data))


def _remember(path: Path, number: int, line: str, told: dict[str, float]) -> None:
    found = _TOLD.fullmatch(line)
    if not found:
        return
    name, text = normal_name(found[1]), found[2]
    if name in ("unit", "units", "angles"):
        if text.lower() not in _UNITS:
            raise UserError(f'{path}: line {number}: the unit "{text}" is unknown: write degrees or radians')
        told["unit"] = _UNITS[text.lower()]
    elif name in ("theta_i", "phi_i", "phi_o"):
        try:
            told[name] = float(text.split()[0])
        except ValueError:
            raise UserError(f'{path}: line {number}: "{text}" is not a number') from None


def _row(path: Path, number: int, line: str, separator: str | None, names: list[str]) -> list[float]:
    parts = _split(line, separator)
    if len(parts) != len(names):
        raise UserError(
            f"{path}: line {number}: {len(parts)} numbers for {len(names)} columns ({', '.join(names)}): is the line cut off?"
        )
    row = []
    for part, name in zip(parts, names):
        try:
            value = float(part)
        except ValueError:
            raise UserError(f'{path}: line {number}: {name} is "{part[:_SHOWN]}", which is not a number') from None
        if not np.isfinite(value):
            raise UserError(f"{path}: line {number}: {name} is {part}: leave lines out that have no value")
        row.append(value)
    return row
