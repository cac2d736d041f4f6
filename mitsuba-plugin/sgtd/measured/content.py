"""The bytes of a file: how many there are, and no more of them in memory than they are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UserError, os_reason

if TYPE_CHECKING:
    from numpy.typing import DTypeLike, NDArray

#: Bytes of numbers that are read from one file at the most: an anisotropic RGL file has a tenth of that
MOST = 1 << 31


def size(path: Path) -> int:
    """In bytes; refuses what is no file, and an empty one."""
    if path.is_dir():
        raise UserError(f"{path} is a folder: name the files in it")
    try:
        count = path.stat().st_size
    except FileNotFoundError:
        raise UserError(f"{path}: there is no such file") from None
    except OSError as error:
        raise UserError(f"{path}: {os_reason(error)}") from error
    if count == 0:
        raise UserError(f"{path} is empty: copy it again")
    return count


def head(path: Path, count: int) -> bytes:
    """The first bytes."""
    try:
        with path.open("rb") as file:
            return file.read(count)
    except OSError as error:
        raise UserError(f"{path}: {os_reason(error)}") from error


def numbers(path: Path, dtype: DTypeLike, offset: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """An array that starts at a byte, in double precision; the caller has made sure that the file is long enough."""
    try:
        found = np.fromfile(path, dtype=dtype, count=int(np.prod(shape)), offset=offset)
    except OSError as error:
        raise UserError(f"{path}: {os_reason(error)}") from error
    return np.asarray(found.reshape(shape), dtype=np.float64)


def refuse_nan(path: Path, values: NDArray[np.float64], offset: int, width: int, what: str) -> None:
    """Values that stand behind one another, ``width`` bytes each: the first that is no finite number is named."""
    bad = ~np.isfinite(values).ravel()
    if bad.any():
        first = int(np.argmax(bad))
        raise UserError(
            f"{path}: {int(bad.sum())} of {bad.size} {what} are no finite numbers, the first at byte {offset + width * first}: "
            "the file is damaged or was written by another program; get it again"
        )
