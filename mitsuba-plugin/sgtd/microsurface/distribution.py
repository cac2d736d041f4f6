"""The distribution of the slopes of a surface: its axes, its roughness, its profile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UserError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Bins of equal probability in the body; in the tail each bin has half of what is left, down to so many facets.
_BODY = 64
_FEWEST = 32

_ITERATIONS = 200


@dataclass(frozen=True)
class SlopeDistribution:
    """Slopes as an elliptical distribution: ``x`` is the length of a slope after it was turned by ``-rotation`` and divided by the two
    roughnesses, whose scale is such that the mean of x is 1.

    ``edges`` (n + 1) bound bins of x that have ``shares`` (n); ``density`` is ``share / (pi (x1^2 - x0^2))``, the profile A f(x) / pi under
    which ``D cos(theta)`` integrates to 1.
    """

    facets: int
    tilt: tuple[float, float]
    rotation: float
    alpha_u: float
    alpha_v: float
    edges: Array
    shares: Array

    @property
    def density(self) -> Array:
        return self.shares / (math.pi * np.diff(self.edges**2))

    @property
    def middles(self) -> Array:
        """Radii that halve the area of each bin."""
        return np.sqrt(0.5 * (self.edges[1:] ** 2 + self.edges[:-1] ** 2))


def distribution(slopes: Array) -> SlopeDistribution:
    """Of slopes (n, 2), one per facet; the tilt is reported, not taken off.

    The axes are those of Tyler's estimate of shape (1987), which is the same for every elliptical distribution, however heavy its tails.
    """
    lengths = np.linalg.norm(slopes, axis=1)
    known = slopes[lengths > 0.0]
    if len(known) < 100:
        raise UserError(f"{len(known)} of {len(slopes)} facets have a slope: too few for a distribution")
    shape = _tyler(known)
    widths, axes = np.linalg.eigh(shape)
    # u is the axis nearer to x
    u = int(abs(axes[0, 1]) >= abs(axes[0, 0]))
    axes = axes[:, [u, 1 - u]]
    widths = np.sqrt(widths[[u, 1 - u]])
    rotation = math.degrees(math.atan(axes[1, 0] / axes[0, 0])) if axes[0, 0] else 90.0
    x = np.linalg.norm(slopes @ axes / widths, axis=1)
    scale = float(x.mean())
    x = np.sort(x / scale)
    edges, shares = _bins(x)
    tilt = slopes.mean(axis=0)
    return SlopeDistribution(
        len(slopes), (float(tilt[0]), float(tilt[1])), rotation, scale * widths[0], scale * widths[1], edges, shares
    )


def _tyler(slopes: Array) -> Array:
    """The matrix V of determinant 1 with ``V = 2 mean(s s^T / (s^T V^-1 s))``."""
    directions = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)
    shape = np.eye(2)
    for _ in range(_ITERATIONS):
        weights = 1.0 / np.einsum("ni,ij,nj->n", directions, np.linalg.inv(shape), directions)
        new = np.einsum("n,ni,nj->ij", weights, directions, directions)
        new /= math.sqrt(np.linalg.det(new))
        done = np.abs(new - shape).max() < 1e-9 * np.abs(new).max()
        shape = new
        if done:
            break
    return shape


def _bins(x: Array) -> tuple[Array, Array]:
    """Edges and shares of sorted radii."""
    count = len(x)
    body = _BODY if count >= 4 * _BODY * _FEWEST else max(4, count // (4 * _FEWEST))
    ranks = [round(count * k / body) for k in range(1, body)]
    rest = count - ranks[-1]
    while rest >= 2 * _FEWEST:
        rest //= 2
        ranks.append(count - rest)
    inner = np.array([0.5 * (x[k - 1] + x[k]) for k in ranks])
    edges = np.concatenate([[0.0], inner, [x[-1]]])
    keep = np.concatenate([[True], np.diff(edges) > 0.0])  # heights in steps: many slopes are alike
    places = np.concatenate([[0], ranks, [count]])[keep]
    edges = edges[keep]
    places[-1] = count
    return edges, np.diff(places) / count
