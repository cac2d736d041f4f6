"""Slopes as weighted points: a million facets are counted in a few thousand cells of length and direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..microsurface import SlopeDistribution

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Cells by length, of equal shares in the middle and finer towards both ends, and by direction over half a turn; fewer slopes than that are
# taken as they are
_RADII, _AZIMUTHS = 160, 30
_FEW = 5000


@dataclass(frozen=True)
class Cells:
    """Points of length ``radius`` and direction ``azimuth`` (n,), and how many slopes of each block are there: ``counts`` (blocks, n).

    A distribution of normals is even: opposite slopes count as one.
    """

    radius: Array
    azimuth: Array
    counts: Array

    def weights(self, blocks: NDArray[np.bool_] | None = None) -> Array:
        """Shares of the points in all blocks or in some of them."""
        counts = (self.counts if blocks is None else self.counts[blocks]).sum(axis=0)
        return counts / counts.sum()


def cells_of(slopes: Array, block: NDArray[np.int64], axes: SlopeDistribution) -> Cells:
    """Of slopes (n, 2), each in a block. Cells are those of slopes over roughness along ``axes``, where the density hardly depends on direction."""
    blocks = int(block.max()) + 1
    if len(slopes) <= _FEW:
        counts = np.zeros((blocks, len(slopes)))
        counts[block, np.arange(len(slopes))] = 1.0
        return Cells(np.hypot(*slopes.T), np.arctan2(slopes[:, 1], slopes[:, 0]), counts)
    turn = math.radians(axes.rotation)
    c, s = math.cos(turn), math.sin(turn)
    u = (c * slopes[:, 0] + s * slopes[:, 1]) / axes.alpha_u
    v = (c * slopes[:, 1] - s * slopes[:, 0]) / axes.alpha_v
    radius, azimuth = np.hypot(u, v), np.arctan2(v, u) % np.pi
    shares = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, _RADII + 1))
    edges = np.unique(np.quantile(radius, shares))
    row = np.clip(np.searchsorted(edges, radius, side="right") - 1, 0, len(edges) - 2)
    column = np.minimum((azimuth * (_AZIMUTHS / np.pi)).astype(np.int64), _AZIMUTHS - 1)
    _, cell = np.unique(row * _AZIMUTHS + column, return_inverse=True)
    n = int(cell.max()) + 1
    total = np.bincount(cell, minlength=n)
    r, phi = (np.bincount(cell, weights=values, minlength=n) / total for values in (radius, azimuth))
    counts = np.bincount(block * n + cell, minlength=blocks * n).reshape(blocks, n).astype(np.float64)
    u, v = axes.alpha_u * r * np.cos(phi), axes.alpha_v * r * np.sin(phi)
    x, y = c * u - s * v, s * u + c * v
    return Cells(np.hypot(x, y), np.arctan2(y, x), counts)
