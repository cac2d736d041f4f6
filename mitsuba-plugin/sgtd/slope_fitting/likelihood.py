"""The likelihood of slopes under one row of the family.

Facets of equal projected area have slopes with the density ``D cos^4 = A f(x) / (pi alpha_u alpha_v)``, x being the length of a slope after it
was turned by minus the rotation and divided by the two roughnesses.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..fitting.rows import FamilySpace
from ..ndf import Ndf
from .cells import Cells

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Of differences over ln x and over the parameters of the shape
_STEP = 1e-5
_SHAPE_STEP = 1e-5
# f is taken from its tail's own formula where doubles cannot hold it
_LEAST = 1e-200
# Damping at which a step is no longer tried, and the gain of a step that is none
_MOST_DAMPED, _SETTLED = 1e6, 1e-8
#: The masking of an Ndf is never asked for here
_ACCURACY = 1e-2


def log_profile(ndf: Ndf, x: Array) -> Array:
    """ln f, as far out as one wants: beyond what doubles hold, f is (1 + w)^-gamma, or exp(-w), with w a power of x - m that one point fixes."""
    f = ndf.profile(x)
    far = f < _LEAST
    if not far.any():
        return np.asarray(np.log(f))
    near = float(ndf.isf(1e-100))
    log_near = -math.log(float(ndf.profile(near)))
    heavy = math.isfinite(ndf.gamma)
    past = x[far] - ndf.shift
    # a skew widens the side above m and narrows that below
    side = np.where(past < 0.0, (1.0 + ndf.lam) / (1.0 - ndf.lam), 1.0)
    w = (np.abs(past) * side / (near - ndf.shift)) ** (2.0 * ndf.p)
    w *= math.expm1(log_near / ndf.gamma) if heavy else log_near
    result = np.log(np.maximum(f, _LEAST))
    result[far] = -ndf.gamma * np.log1p(w) if heavy else -w
    return np.asarray(result)


def log_density(ndf: Ndf, rotation: float, radius: Array, azimuth: Array) -> Array:
    """ln of the density of slopes (per unit of slope along x and along y)."""
    su, sv = ndf.stretch
    x = radius * np.hypot(np.cos(azimuth - rotation) / su, np.sin(azimuth - rotation) / sv)
    return log_profile(ndf, x) + math.log(ndf.normalization / (math.pi * su * sv))


class Likelihood:
    """One row on the cells: variables are those of its space."""

    def __init__(self, space: FamilySpace, cells: Cells) -> None:
        self.space, self.cells = space, cells
        low, high = space.bounds
        self.bounds = list(zip(low.tolist(), high.tolist()))

    def logs(self, v: Array) -> Array:
        """ln of the density in each cell."""
        return log_density(self.space.ndf(v, _ACCURACY), self.space.rotation(v), self.cells.radius, self.cells.azimuth)

    def derivatives(self, v: Array) -> tuple[Array, Array]:
        """ln of the density (n,) and its derivatives (variables, n): those by roughness and rotation follow from that by ln x."""
        ndf, rotation = self.space.ndf(v, _ACCURACY), self.space.rotation(v)
        radius, azimuth = self.cells.radius, self.cells.azimuth
        su, sv = ndf.stretch
        c, s = np.cos(azimuth - rotation), np.sin(azimuth - rotation)
        along, across = (c / su) ** 2, (s / sv) ** 2
        x = radius * np.sqrt(along + across)
        logs = log_profile(ndf, x)
        slope = (log_profile(ndf, x * (1.0 + _STEP)) - logs) / math.log1p(_STEP)
        logs = logs + math.log(ndf.normalization / (math.pi * su * sv))
        share = along + across
        by = {
            "ln_alpha": -2.0 - slope,
            "ln_ratio": slope * (across - along) / share,
            "rotation": slope * c * s * (su**-2 - sv**-2) / share,
        }
        rows = []
        for k, name in enumerate(self.space.names):
            if name in by:
                rows.append(by[name])
                continue
            step = -_SHAPE_STEP if v[k] + _SHAPE_STEP > self.bounds[k][1] else _SHAPE_STEP
            moved = v.copy()
            moved[k] += step
            rows.append((self.logs(moved) - logs) / step)
        return logs, np.array(rows)

    def mean(self, v: Array, weights: Array) -> float:
        """Log-likelihood a sample."""
        return float(weights @ self.logs(v))

    def search(self, v: Array, weights: Array, steps: int = 60) -> tuple[Array, float]:
        """From one start uphill: variables and the log-likelihood a sample.

        Newton's method with the mean outer product of the scores for the curvature, damped; variables at a bound that the gradient holds there stay.
        Where a row is far from the data, that product is much more than the curvature: steps are doubled as long as it helps.
        """
        low, high = np.transpose(self.bounds)
        v = np.clip(v, low, high)
        logs, by = self.derivatives(v)
        value, damping = float(weights @ logs), 1e-3
        for _ in range(steps):
            gradient = by @ weights
            free = ~(((v <= low) & (gradient < 0.0)) | ((v >= high) & (gradient > 0.0)))
            curvature = np.einsum("in,n,jn->ij", by[free], weights, by[free], optimize=False)
            diagonal = np.diag(curvature) + 1e-9
            gained = 0.0
            while damping < _MOST_DAMPED:
                step = np.linalg.solve(curvature + np.diag(damping * diagonal + 1e-12), gradient[free])
                moved = v.copy()
                moved[free] += step
                moved = np.clip(moved, low, high)
                reached = self.mean(moved, weights)
                if reached > value:
                    damping = max(0.2 * damping, 1e-6)
                    while True:
                        step *= 2.0
                        further = v.copy()
                        further[free] += step
                        further = np.clip(further, low, high)
                        beyond = self.mean(further, weights)
                        if not beyond > reached:
                            break
                        moved, reached = further, beyond
                    gained, v = reached - value, moved
                    break
                damping *= 5.0
            if gained < _SETTLED:
                break
            logs, by = self.derivatives(v)
            value = float(weights @ logs)
        return v, self.mean(v, weights)
