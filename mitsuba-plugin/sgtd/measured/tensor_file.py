"""Tensor files, Mitsuba's container of named arrays: every claim of the header is held against the length of the file before an array is made."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UserError, os_reason
from .content import MOST, numbers, refuse_nan, size

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MAGIC = b"tensor_file\0"
_TYPES = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<u8", 8: "<i8", 9: "<f2", 10: "<f4", 11: "<f8"}
_MOST_FIELDS, _MOST_AXES = 1000, 16
_AGAIN = "get the file again"


@dataclass(frozen=True)
class _Field:
    dtype: str
    offset: int
    shape: tuple[int, ...]


class TensorFile:
    """The fields of a file, read when they are asked for."""

    def __init__(self, path: Path) -> None:
        self.path, self.length = path, size(path)
        self.fields = self._fields()

    def _fields(self) -> dict[str, _Field]:
        try:
            with self.path.open("rb") as file:
                content = file.read(1 << 20)
        except OSError as error:
            raise UserError(f"{self.path}: {os_reason(error)}") from error
        if not content.startswith(MAGIC):
            raise UserError(f'{self.path}: byte 0: a tensor file begins with "tensor_file"; {_AGAIN}')
        self.at = len(MAGIC)

        def take(kind: str) -> tuple[int, ...]:
            end = self.at + struct.calcsize("<" + kind)
            if end > len(content):
                raise UserError(f"{self.path}: truncated at byte {self.length}, inside the list of fields; {_AGAIN}")
            found = struct.unpack("<" + kind, content[self.at : end])
            self.at = end
            return found

        major, _minor, count = take("BBI")
        if major != 1 or count > _MOST_FIELDS:
            raise UserError(
                f"{self.path}: byte 12: version {major} with {count} fields, but version 1 with a dozen fields is read; {_AGAIN}"
            )
        fields = {}
        for _ in range(count):
            start = self.at
            (letters,) = take("H")
            name = bytes(take("B" * letters)).decode("ascii", "replace")
            axes, kind = take("HB")
            (offset,) = take("Q")
            if axes > _MOST_AXES or kind not in _TYPES:
                raise UserError(
                    f'{self.path}: byte {start}: field "{name}" has {axes} axes and type {kind}: the header is damaged; {_AGAIN}'
                )
            shape = take("Q" * axes)
            field = _Field(_TYPES[kind], offset, shape)
            self._check(name, field, start)
            fields[name] = field
        return fields

    def _check(self, name: str, field: _Field, start: int) -> None:
        count = np.dtype(field.dtype).itemsize
        for length in field.shape:
            count *= length
        if field.offset + count > self.length or count > MOST:
            shape = " × ".join(map(str, field.shape))
            raise UserError(
                f'{self.path}: byte {start}: field "{name}" ({shape}) takes {count} bytes from byte {field.offset}, but the file ends at byte '
                f"{self.length}: it is truncated or damaged; {_AGAIN}"
            )

    def __contains__(self, name: str) -> bool:
        return name in self.fields

    def read(self, name: str, axes: int) -> Array:
        """A field with so many axes, all of its numbers finite."""
        if name not in self.fields:
            raise UserError(
                f'{self.path}: no field "{name}" among {", ".join(self.fields) or "none"}: is it a measurement for Mitsuba\'s "measured"?'
            )
        field = self.fields[name]
        if len(field.shape) != axes or 0 in field.shape:
            raise UserError(
                f'{self.path}: field "{name}" has the shape {" × ".join(map(str, field.shape)) or "of a number"}, but needs {axes} axes that are not empty; {_AGAIN}'
            )
        found = numbers(self.path, field.dtype, field.offset, field.shape)
        refuse_nan(self.path, found, field.offset, np.dtype(field.dtype).itemsize, f'numbers of the field "{name}"')
        return found
