"""Densities on the unit square that are bilinear between points of a grid, for each direction of light, and their map to uniform numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    #: weights of the neighbors of each point, and their places along all axes
    Corners = list[tuple[Array, tuple[NDArray[np.int64], ...]]]


def bilinear(table: Array, at: tuple[NDArray[np.int64], ...] | None, u: Array) -> Array:
    """A table (..., ny, nx) at points ``u`` (2, n), x and y in [0, 1]; ``at`` selects one table for each point. A (..., channels, ny, nx) table
    has channels last in the result."""
    ny, nx = table.shape[-2:]
    (x0, fx), (y0, fy) = _cell(u[0], nx), _cell(u[1], ny)
    where = () if at is None else at
    # the axis of channels goes behind that of points
    channels = table.ndim - 2 - len(where)
    if channels and not where:
        raise ValueError("one table for all points has no channels")
    if channels:
        fx, fy = fx[:, None], fy[:, None]

    def pick(y: NDArray[np.int64], x: NDArray[np.int64]) -> Array:
        place: tuple[Any, ...] = (*where, *(slice(None),) * channels, y, x)
        return np.asarray(table[place])

    low = pick(y0, x0) * (1.0 - fx) + pick(y0, x0 + 1) * fx
    high = pick(y0 + 1, x0) * (1.0 - fx) + pick(y0 + 1, x0 + 1) * fx
    return np.asarray(low * (1.0 - fy) + high * fy)


def _cell(u: Array, count: int) -> tuple[NDArray[np.int64], Array]:
    x = np.clip(u, 0.0, 1.0) * (count - 1)
    low = np.minimum(x.astype(np.int64), count - 2)
    return low, x - low


class Marginal:
    """``values`` (phi, theta, ny, nx): densities for each direction of light, each scaled to an integral of 1; between directions they are mixed."""

    def __init__(self, values: Array) -> None:
        values = np.maximum(values, 0.0)
        rows = 0.5 * (values[..., 1:] + values[..., :-1])
        #: integrals along x up to each point, of each row
        along = np.concatenate([np.zeros((*rows.shape[:-1], 1)), np.cumsum(rows, axis=-1)], axis=-1)
        whole = along[..., -1]
        steps = 0.5 * (whole[..., 1:] + whole[..., :-1])
        up = np.concatenate([np.zeros((*steps.shape[:-1], 1)), np.cumsum(steps, axis=-1)], axis=-1)
        total = np.maximum(up[..., -1], 1e-300)
        self.values = values / total[..., None, None]
        self.along = along / total[..., None, None]
        self.up = up / total[..., None]

    def invert(self, u: Array, corners: Corners) -> Array:
        """The uniform numbers (2, n) that the sampling of this density takes to points ``u``."""
        ny, nx = self.values.shape[-2:]
        (x0, fx), (y0, fy) = _cell(u[0], nx), _cell(u[1], ny)

        def mixed(table: Array, *place: NDArray[np.int64]) -> Array:
            return np.asarray(sum(weight * table[(*at, *place)] for weight, at in corners))

        left = (1.0 - fy) * mixed(self.values, y0, x0) + fy * mixed(self.values, y0 + 1, x0)
        right = (1.0 - fy) * mixed(self.values, y0, x0 + 1) + fy * mixed(self.values, y0 + 1, x0 + 1)
        before = (1.0 - fy) * mixed(self.along, y0, x0) + fy * mixed(self.along, y0 + 1, x0)
        end = np.full_like(x0, nx - 1)
        row, next_row = mixed(self.along, y0, end), mixed(self.along, y0 + 1, end)
        x = before + fx * (left + 0.5 * fx * (right - left))
        x = x / np.maximum((1.0 - fy) * row + fy * next_row, 1e-300)
        y = mixed(self.up, y0) + fy * (row + 0.5 * fy * (next_row - row))
        return np.clip(np.stack([x, y]), 0.0, 1.0)
