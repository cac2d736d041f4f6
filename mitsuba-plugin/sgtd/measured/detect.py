"""Which format a file has, by its content."""

from __future__ import annotations

from pathlib import Path

from ..errors import UserError
from . import merl, npz, rgl, table, utia
from .content import head, size
from .source import Source

#: A map of heights, for the readers of ``sgtd.microsurface``
HEIGHTS = "heights"

# First bytes of pictures, arrays and fields: heights
_HEIGHT_MAGIC = (
    b"\x93NUMPY",
    b"\x89PNG",
    b"\x76\x2f\x31\x01",
    b"II*\0",
    b"MM\0*",
    b"Gwyddion Simple Field",
    b"ply\n",
    b"ply\r",
)
_START = 8192
# Endings of reflectance: a file that has one of them and is none is damaged, not a map of heights
_REFLECTANCE = (".binary", ".bsdf", ".bin", ".csv", ".npz", ".brdf")
_FORMATS = "MERL .binary, RGL .bsdf, UTIA .bin, CSV, npz, or a map of heights"

READERS = {"merl": merl.read, "rgl": rgl.read, "utia": utia.read, "table": table.read, "npz": npz.read}


def kind_of(path: Path) -> str:
    """A key of ``READERS``, or ``HEIGHTS``."""
    length = size(path)
    start = head(path, _START)
    if start.startswith(rgl.MAGIC):
        return "rgl"
    if start.startswith(b"PK\x03\x04") or start.startswith(b"PK\x05\x06"):
        return "npz"
    if start.startswith(_HEIGHT_MAGIC):
        return HEIGHTS
    if merl.is_merl(start, length):
        return "merl"
    text = _text(start)
    if text is not None and table.header_of(text) is not None:
        return "table"
    if length == utia.BYTES and text is None:
        return "utia"
    return _by_name(path, length, text)


def _text(start: bytes) -> str | None:
    """The beginning as text, if it is one."""
    if b"\0" in start:
        return None
    for trimmed in range(4):  # the last character may be cut off
        try:
            return start[: len(start) - trimmed].decode("utf-8")
        except UnicodeDecodeError:
            continue
    return None


def _by_name(path: Path, length: int, text: str | None) -> str:
    """Nothing in it says what it is: by the name, what is wrong with it."""
    ending = path.suffix.lower()
    if ending == ".csv":
        return "table" if text is not None else _refuse(path, "no text, as a CSV is")
    if ending in _REFLECTANCE:
        known = {".binary": "merl", ".bin": "utia"}.get(ending)
        if text is not None:
            first = text.strip().splitlines()[0] if text.strip() else ""
            return _refuse(
                path, f'text ("{first[:40]}"), whose first line names no columns like theta_i,phi_i,theta_o,phi_o,R,G,B'
            )
        return known or _refuse(path, "nothing that is known by its first bytes")
    if text is not None and ending not in (".txt", ".asc", ".obj"):
        first = text.strip().splitlines()[0] if text.strip() else ""
        return _refuse(
            path, f'text, and line 1 ("{first[:40]}") names no columns like theta_i,phi_i,theta_o,phi_o,R,G,B'
        )
    return HEIGHTS


def _refuse(path: Path, what: str) -> str:
    raise UserError(f"{path}: {what}: it can be {_FORMATS}")


def read(path: Path) -> Source:
    """Reflectance of any format; ``UserError`` for what is none."""
    kind = kind_of(path)
    if kind == HEIGHTS:
        raise UserError(f"{path} is a map of heights, not reflectance")
    return READERS[kind](path)
