"""numpy's ``.npz``: ``wi``, ``wo`` (n, 3) and ``value`` (n,) or (n, channels); or the columns of a table, each an array (n,)."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib import format as npy

from ..errors import UserError
from ..fitting.measurement import measurement
from .columns import from_columns, looks_like_header
from .content import MOST, size
from .source import Source
from .thinning import thinned

if TYPE_CHECKING:
    from numpy.typing import NDArray

_WANTED = "arrays wi, wo (n, 3) and value (n, channels); or theta_i, phi_i, theta_o, phi_o and channels, each (n,)"


def read(path: Path) -> Source:
    size(path)
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = {name[:-4]: _array(path, archive, name) for name in archive.namelist() if name.endswith(".npy")}
    except zipfile.BadZipFile as error:
        raise UserError(f"{path}: damaged: {error}; get the file again") from None
    except (OSError, EOFError, NotImplementedError, RuntimeError) as error:
        raise UserError(f"{path}: {error}") from error
    for name, array in arrays.items():
        if array.dtype.kind in "fiu" and not np.isfinite(array).all():
            first = np.argwhere(~np.isfinite(array))[0]
            raise UserError(
                f"{path}: {name}[{', '.join(map(str, first))}] is no finite number: leave rows out that have no value"
            )
    if {"wi", "wo", "value"} <= set(arrays):
        names = tuple(str(k) for k in arrays["channels"].ravel()) if "channels" in arrays else ()
        data = measurement(arrays["wi"], arrays["wo"], arrays["value"], title=path.name, channels=names)
        return Source("npz", thinned(data))
    columns = {name: array for name, array in arrays.items() if array.ndim == 1 and array.dtype.kind in "fiu"}
    if not looks_like_header(list(columns)):
        raise UserError(f"{path}: it has {', '.join(arrays) or 'no arrays'}: give {_WANTED}")
    if len({len(array) for array in columns.values()}) != 1:
        sizes = ", ".join(f"{name} ({len(array)})" for name, array in columns.items())
        raise UserError(f"{path}: the arrays have different lengths: {sizes}")
    if not len(next(iter(columns.values()))):
        raise UserError(f"{path}: the arrays are empty")
    plain = {name: array.astype(np.float64) for name, array in columns.items()}
    return Source("npz", thinned(from_columns(path, plain, {}, lambda row: f"row {row}")))


def _array(path: Path, archive: zipfile.ZipFile, name: str) -> NDArray[np.generic]:
    """One array; its header is believed only if the archive holds as many bytes as it says."""
    entry = archive.getinfo(name)
    with archive.open(entry) as file:
        try:
            version = npy.read_magic(file)
            read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, _, dtype = read_header(file)
        except ValueError as error:
            raise UserError(f"{path}: {name}: {error}") from None
        if dtype.hasobject:
            raise UserError(f"{path}: {name} holds Python's objects, which are not read: save numbers")
        count = dtype.itemsize
        for length in shape:
            count *= length
        if count > MOST or count > entry.file_size:
            raise UserError(
                f"{path}: {name} says that it has the shape {shape}, {count} bytes, but it holds {entry.file_size} (and {MOST} are read at the most): the file is damaged"
            )
    with archive.open(entry) as file:
        try:
            return np.asarray(npy.read_array(file, allow_pickle=False))
        except ValueError as error:
            raise UserError(f"{path}: {name}: {error}") from None
