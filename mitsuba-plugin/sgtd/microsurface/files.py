"""Files of height maps: nothing is filtered, scaled or filled in silence.

=======================  ============================================================================================
``.npy``                 heights, a two-dimensional array
``.exr``                 heights as floats (one channel, or the first of several)
``.png``, ``.tif``       gray values; the sidecar says what heights black and white are
``.gsf``                 Gwyddion's simple field
``.txt``, ``.asc``       Gwyddion's ASCII matrix (read only)
``.ply``, ``.obj``       a mesh over a regular grid of x and y
all others               what the package SurfaceTopography reads (``pip install sgtd[heights]``)
=======================  ============================================================================================

``NAME.json`` beside the file, its sidecar, says more: the spacing of points, whether the map repeats, what it was made for.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..atomic_output import AtomicOutput
from ..errors import UserError
from .gwyddion import read_gsf, read_text, write_gsf
from .height_map import HeightMap
from .images import read_image, write_exr, write_png
from .mesh import read_mesh, write_obj, write_ply

if TYPE_CHECKING:
    from numpy.typing import NDArray


def sidecar_path(path: Path) -> Path:
    """``NAME.json``, for all files of one surface."""
    return path.with_suffix(".json")


def read_sidecar(path: Path) -> dict[str, Any]:
    """What stands beside a file; nothing if that is some other program's."""
    beside = sidecar_path(path)
    if not beside.is_file():
        return {}
    try:
        found = json.loads(beside.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"{beside}: {error}") from error
    return found if isinstance(found, dict) and "spacing" in found else {}


def read(path: Path, sidecar: dict[str, Any]) -> HeightMap:
    """What the file itself says, by its ending."""
    kind = path.suffix.lower()
    if kind == ".npy":
        return HeightMap(_read_npy(path))
    if kind in (".exr", ".png", ".tif", ".tiff"):
        return read_image(path, sidecar)
    if kind == ".gsf":
        return read_gsf(path)
    if kind in (".txt", ".asc"):
        return read_text(path)
    if kind in (".ply", ".obj"):
        return read_mesh(path)
    return _read_topography(path)


def _read_npy(path: Path) -> NDArray[np.float64]:
    try:
        heights = np.load(path, allow_pickle=False)
    except ValueError as error:
        raise UserError(f"{path}: {error}") from error
    if heights.ndim != 2 or heights.dtype.kind not in "fiu":
        raise UserError(
            f"{path}: an array of shape {heights.shape} and type {heights.dtype}; heights are a grid of numbers"
        )
    return heights.astype(np.float64)


def _read_topography(path: Path) -> HeightMap:
    try:
        import SurfaceTopography
    except ImportError as error:
        raise UserError(
            f'{path}: "{path.suffix}" is read by the package SurfaceTopography, which is missing: pip install sgtd[heights]'
        ) from error
    try:
        with SurfaceTopography.open_topography(str(path)) as reader:
            channel = reader.default_channel
            topography = reader.topography()
            names = [one.name for one in reader.channels]
            if topography.dim != 2:
                raise UserError(f"{path}: a line, not a map")
            heights = np.ma.filled(np.ma.asarray(topography.heights(), dtype=np.float64), np.nan).T
            spacing = tuple(
                float(size) / count for size, count in zip(topography.physical_sizes, topography.nb_grid_pts)
            )
            periodic = bool(topography.is_periodic)
    except UserError:
        raise
    except Exception as error:
        raise UserError(f"{path}: {error}") from error
    notes = (f'channel "{channel.name}" of {", ".join(names)}',) if len(names) > 1 else ()
    return HeightMap(heights, (spacing[0], spacing[1]), periodic, notes)


def _write_npy(path: Path, surface: HeightMap) -> None:
    np.save(path, surface.heights)


WRITERS: dict[str, Callable[[Path, HeightMap], None]] = {
    ".npy": _write_npy,
    ".ply": write_ply,
    ".obj": write_obj,
    ".exr": write_exr,
    ".gsf": write_gsf,
    ".png": write_png,
}


def check_endings(paths: list[Path]) -> None:
    """Raises an error if one of the files has no writer."""
    for path in paths:
        if path.suffix.lower() not in WRITERS:
            raise UserError(f'{path}: surfaces are written as {", ".join(WRITERS)}, not as "{path.suffix}"')


def write(surface: HeightMap, sidecar: dict[str, Any], paths: list[Path]) -> None:
    """Each path by its ending, and one sidecar for all that differ in the ending alone; whole or not at all."""
    check_endings(paths)
    text = json.dumps(sidecar, indent=1, allow_nan=False) + "\n"
    for folder in dict.fromkeys(path.parent for path in paths):
        here = [path for path in paths if path.parent == folder]
        with AtomicOutput(folder) as files:
            for path in dict.fromkeys(here):
                WRITERS[path.suffix.lower()](files.path(path.name), surface)
            for beside in dict.fromkeys(map(sidecar_path, here)):
                files.path(beside.name).write_text(text, encoding="utf-8")
