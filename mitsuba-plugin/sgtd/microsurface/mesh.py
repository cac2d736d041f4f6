"""Meshes of height maps: PLY and OBJ without vertex normals, so that a renderer shades facets."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UserError, mitsuba_errors
from .height_map import HeightMap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Indices = NDArray[np.integer[Any]]

# A coordinate is on the grid if it is so near to a line of it, in units of the spacing: single precision at 4096 lines.
_OFF_GRID = 5e-3


def vertices(surface: HeightMap) -> Array:
    """Points (n, 3), x first; a periodic tile is closed by its first row and column."""
    h = np.pad(surface.heights, ((0, 1), (0, 1)), mode="wrap") if surface.periodic else surface.heights
    y, x = np.indices(h.shape, dtype=np.float64)
    dx, dy = surface.spacing or (1.0, 1.0)
    return np.stack([x * dx, y * dy, h], axis=-1).reshape(-1, 3)


def faces(nx: int, ny: int) -> Indices:
    """Triangles (n, 3) of ``nx × ny`` points: lower and upper of each cell in turn, seen from above counterclockwise."""
    j, i = np.indices((ny - 1, nx - 1), dtype=np.int32)
    a = j * nx + i
    b, c, d = a + 1, a + nx, a + nx + 1
    return np.stack([a, b, c, d, c, b], axis=-1).reshape(-1, 3)


def write_ply(path: Path, surface: HeightMap) -> None:
    """Binary, little-endian."""
    points = vertices(surface)
    corners = faces(*_points(surface))
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"comment a height map{', one period of it' if surface.periodic else ''}; shade it with face normals\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(corners)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(corners), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, corners
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(points.astype("<f4").tobytes())
        file.write(rows.tobytes())


def write_obj(path: Path, surface: HeightMap) -> None:
    """Nine digits give single precision back."""
    with path.open("w", encoding="ascii") as file:
        file.write("# a height map; shade it with face normals\n")
        np.savetxt(file, vertices(surface).astype(np.float32), fmt="v %.9g %.9g %.9g")
        np.savetxt(file, faces(*_points(surface)) + 1, fmt="f %d %d %d")


def _points(surface: HeightMap) -> tuple[int, int]:
    ny, nx = surface.heights.shape
    more = int(bool(surface.periodic))
    return nx + more, ny + more


def read_mesh(path: Path) -> HeightMap:
    """Heights of a mesh whose vertices are a regular grid in x and y; a tile whose sides are alike is one period."""
    points, corners = (_read_ply if path.suffix.lower() == ".ply" else _read_obj)(path)
    i, dx = _grid_lines(path, "x", points[:, 0])
    j, dy = _grid_lines(path, "y", points[:, 1])
    nx, ny = int(i.max()) + 1, int(j.max()) + 1
    heights = np.full((ny, nx), np.nan)
    heights[j, i] = points[:, 2]
    if (heights[j, i] != points[:, 2]).any():
        raise UserError(f"{path}: two vertices have the same x and y, and different heights")
    if not np.isfinite(heights).all():
        raise UserError(f"{path}: {np.count_nonzero(np.isnan(heights))} points of its {nx} × {ny} grid have no vertex")
    mirrored = _diagonals_run_the_other_way(path, i[corners], j[corners], (nx - 1) * (ny - 1))
    notes: tuple[str, ...] = ()
    if mirrored:
        heights = heights[:, ::-1]
        notes = ("mirrored along x: the diagonals of its cells run the other way",)
    repeats = np.array_equal(heights[0], heights[-1]) and np.array_equal(heights[:, 0], heights[:, -1])
    return HeightMap(heights[:-1, :-1] if repeats else heights, (dx, dy), bool(repeats), notes)


def _read_ply(path: Path) -> tuple[Array, Indices]:
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    with mitsuba_errors(str(path)):
        shape = mi.load_dict({"type": "ply", "filename": str(path.resolve()), "face_normals": True})
        parameters = mi.traverse(shape)
        points = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
        return points, np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3)


def _read_obj(path: Path) -> tuple[Array, Indices]:
    """Vertices and faces alone; Mitsuba's reader rounds decimal numbers by up to two steps of single precision."""
    points: list[list[float]] = []
    corners: list[list[int]] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            kind, *values = line.split(maxsplit=4) or [""]
            try:
                if kind == "v":
                    points.append([float(x) for x in values[:3]])
                elif kind == "f":
                    index = [int(value.split("/")[0]) for value in line.split()[1:]]
                    corners.append([k - 1 if k > 0 else len(points) + k for k in index])
            except ValueError as error:
                raise UserError(f"{path}, line {number}: {error}") from error
    if not points or not corners or {len(p) for p in points} | {len(c) for c in corners} != {3}:
        raise UserError(f"{path}: it has no vertices, no faces, or faces that are no triangles")
    triangles = np.array(corners)
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise UserError(f"{path}: a face has a corner that is not there")
    return np.array(points), triangles


def _grid_lines(path: Path, axis: str, values: Array) -> tuple[Indices, float]:
    """The line of a regular grid that each coordinate is on, and the distance of lines."""
    ordered = np.sort(values)
    gaps = np.diff(ordered)
    wide = gaps[gaps > 0.5 * gaps.max(initial=0.0)]
    if wide.size < 3 or not wide.max() > 0.0:
        raise UserError(f"{path}: its vertices are no grid in x and y: a height map has z upwards")
    lines = wide.size
    distance = float((ordered[-1] - ordered[0]) / lines)
    place = (values - ordered[0]) / distance
    index = np.rint(place).astype(np.int64)
    if np.abs(place - index).max() > _OFF_GRID:
        raise UserError(f"{path}: its vertices are not evenly spaced along {axis}: a height map is a regular grid")
    return index, distance


def _diagonals_run_the_other_way(path: Path, i: Indices, j: Indices, cells: int) -> bool:
    """Three corners of a cell, counted from its lower left one, have 2 steps, or 4, along the diagonal of this package, and 3 along the other."""
    di, dj = i - i.min(axis=1, keepdims=True), j - j.min(axis=1, keepdims=True)
    steps = (di + dj).sum(axis=1)
    if len(i) != 2 * cells or max(di.max(), dj.max()) != 1:
        raise UserError(
            f"{path}: a height map has two triangles in each of its {cells} cells, this mesh has {len(i)} in all"
        )
    if (steps == 3).all():
        return True
    if ((steps == 2) | (steps == 4)).all():
        return False
    raise UserError(f"{path}: the diagonals of its cells run both ways: make them alike, their facets are the surface")
