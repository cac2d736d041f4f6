"""Gwyddion's two open formats: simple fields (``.gsf``) and ASCII matrices.

Both state sizes; units of heights and of lengths are brought together where both are powers of a metre.
Format: Gwyddion user guide, "Gwyddion Simple Field Format" and "ASCII data matrix".
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import UserError
from .height_map import HeightMap

_MAGIC = b"Gwyddion Simple Field 1.0\n"
_METRES = {
    "": 1.0,
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "µm": 1e-6,
    "μm": 1e-6,
    "nm": 1e-9,
    "Å": 1e-10,
    "pm": 1e-12,
}


def read_gsf(path: Path) -> HeightMap:
    """A header of text, zeros up to a multiple of four bytes, and little-endian single precision."""
    content = path.read_bytes()
    end = content.find(b"\0")
    if not content.startswith(_MAGIC) or end < 0:
        raise UserError(f"{path}: no Gwyddion Simple Field 1.0")
    fields = {}
    for line in content[len(_MAGIC) : end].decode("utf-8", "replace").splitlines():
        name, _, value = line.partition("=")
        fields[name.strip()] = value.strip()
    try:
        nx, ny = int(fields["XRes"]), int(fields["YRes"])
        sizes = [float(fields[name]) if name in fields else None for name in ("XReal", "YReal")]
    except (KeyError, ValueError) as error:
        raise UserError(f"{path}: its header has no usable XRes, YRes, XReal, YReal ({error})") from error
    start = 4 * (end // 4 + 1)
    data = np.frombuffer(content, "<f4", offset=start, count=-1) if (len(content) - start) % 4 == 0 else np.empty(0)
    if data.size != nx * ny:
        raise UserError(f"{path}: {data.size} heights follow its header, which says {nx} × {ny}")
    scale, notes = _scale(fields.get("XYUnits", ""), fields.get("ZUnits", ""))
    periodic = {"true": True, "false": False}.get(fields.get("Periodic", ""))
    spacing = None if sizes[0] is None or sizes[1] is None else (sizes[0] / nx, sizes[1] / ny)
    return HeightMap(scale * data.reshape(ny, nx).astype(np.float64), spacing, periodic, notes)


def write_gsf(path: Path, surface: HeightMap) -> None:
    """The same, without units."""
    ny, nx = surface.heights.shape
    fields = {"XRes": str(nx), "YRes": str(ny)}
    if surface.spacing:
        fields.update(XReal=repr(nx * surface.spacing[0]), YReal=repr(ny * surface.spacing[1]))
    fields["Periodic"] = str(bool(surface.periodic)).lower()
    header = _MAGIC + "".join(f"{name} = {value}\n" for name, value in fields.items()).encode()
    padding = b"\0" * (4 - len(header) % 4)
    path.write_bytes(header + padding + surface.heights.astype("<f4").tobytes())


def read_text(path: Path) -> HeightMap:
    """Lines of numbers, below comments such as ``# Width: 10.0 µm``."""
    try:
        heights = np.loadtxt(path, ndmin=2, encoding="utf-8")
    except ValueError as error:
        raise UserError(f"{path}: {error}") from error
    fields = {}
    with path.open(encoding="utf-8") as file:
        for line in file:
            if not line.startswith("#"):
                break
            name, _, value = line[1:].partition(":")
            fields[name.strip().lower()] = value.strip()
    if "width" not in fields or "height" not in fields:
        return HeightMap(heights)
    (width, unit), (height, other) = (_quantity(path, fields[name]) for name in ("width", "height"))
    if unit != other:
        height *= _metres(other) / _metres(unit)
    scale, notes = _scale(unit, fields.get("value units", ""))
    ny, nx = heights.shape
    return HeightMap(scale * heights, (width / nx, height / ny), None, notes)


def _quantity(path: Path, text: str) -> tuple[float, str]:
    found = re.match(r"([-+0-9.eE]+)\s*(\S*)", text)
    if not found:
        raise UserError(f'{path}: "{text}" is no length')
    return float(found[1]), found[2]


def _metres(unit: str) -> float:
    if unit not in _METRES:
        raise UserError(f'the unit "{unit}" is not known: it must be one of {", ".join(filter(None, _METRES))}')
    return _METRES[unit]


def _scale(lengths: str, heights: str) -> tuple[float, tuple[str, ...]]:
    """The factor on heights that gives them the unit of lengths."""
    if lengths == heights:
        return 1.0, ()
    if not lengths or not heights:
        return 1.0, (f'heights are taken in the unit of lengths, "{lengths or heights}"',)
    return _metres(heights) / _metres(lengths), (f"heights in {heights} were converted to {lengths}",)
