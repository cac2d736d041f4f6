"""Distributions beyond the rows: a free table that ends somewhere, and a sum of two."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from ..ndf import Ndf
from .rows import GREATEST_TAIL, FamilySpace

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# ln of a density of slopes: neighbors differ by less than a cliff of the core
_DEEPEST = 60.0


@dataclass(frozen=True)
class TableSpace:
    """ln of the density of slopes at fixed slopes, the first of them 0 by definition: the scale of a table means nothing.

    Behind the last node nothing is left (``cut``): what the data do not show, and a flatter tail than masking admits ends there.
    """

    slopes: tuple[float, ...]
    knee: float
    anisotropic: bool = False

    @property
    def title(self) -> str:
        return "tabulated"

    @property
    def names(self) -> tuple[str, ...]:
        around = ("ln_ratio", "rotation") if self.anisotropic else ()
        return (*around, *(f"ln_f_{k}" for k in range(1, len(self.slopes))))

    @property
    def bounds(self) -> tuple[Array, Array]:
        count = len(self.slopes) - 1
        low, high = np.full(count, -_DEEPEST), np.full(count, 10.0)
        if self.anisotropic:
            low, high = np.concatenate([[-2.5, -np.inf], low]), np.concatenate([[2.5, np.inf], high])
        return low, high

    def density(self, v: Array) -> Array:
        """Densities of slopes at the nodes; the first is 1."""
        return np.exp(np.concatenate([[0.0], v[2:] if self.anisotropic else v]))

    def rotation(self, v: Array) -> float:
        return float(v[1]) if self.anisotropic else 0.0

    def ndf(self, v: Array, accuracy: float) -> Ndf:
        ndf = self._table(v, accuracy)
        if not self.anisotropic:
            return ndf
        return self._table(
            v, accuracy, alpha_u=ndf.mean_slope * math.exp(v[0]), alpha_v=ndf.mean_slope * math.exp(-v[0])
        )

    def _table(self, v: Array, accuracy: float, **alphas: float) -> Ndf:
        return Ndf.tabulated(
            slopes=self.slopes,
            values=self.density(v),
            quantity="slope",
            tail="cut",
            knee=self.knee,
            accuracy=accuracy,
            **alphas,
        )

    def of(self, ndf: Ndf) -> Array:
        """The nodes of a distribution at unit cut: what it has there."""
        alpha = math.sqrt(ndf.stretch[0] * ndf.stretch[1])
        f = np.maximum(ndf.profile(np.array(self.slopes) / alpha), 1e-300)
        logs = np.clip(np.log(f[1:] / max(f[0], 1e-300)), 1.0 - _DEEPEST, 9.0)
        around = [0.5 * math.log(ndf.stretch[0] / ndf.stretch[1]), 0.0] if self.anisotropic else []
        return np.concatenate([around, logs])

    def properties(self, v: Array) -> dict[str, Any]:
        ndf = self.ndf(v, 1e-5)
        texts = {
            "slopes": ", ".join(f"{t:.9g}" for t in self.slopes),
            "values": ", ".join(f"{f:.9g}" for f in self.density(v)),
        }
        alphas = {"alpha_u": ndf.alpha_u, "alpha_v": ndf.alpha_v} if self.anisotropic else {}
        return {"distribution": "tabulated", **texts, "quantity": "slope", "tail": "cut", "knee": self.knee, **alphas}

    def shape(self, v: Array) -> dict[str, float]:
        ndf = self.ndf(v, 1e-3)
        return {"alpha_u": ndf.alpha_u, "alpha_v": ndf.alpha_v} if self.anisotropic else {"alpha": ndf.alpha_u}


@dataclass(frozen=True)
class MixtureSpace:
    """Two of Student's distributions: a core and a haze. The second has ``ln_widening`` more roughness; ``logit`` of its share."""

    anisotropic: bool = False

    names = ("ln_alpha", "ln_widening", "logit", "s", "s_wide")

    @property
    def title(self) -> str:
        return "mixture"

    @property
    def bounds(self) -> tuple[Array, Array]:
        low = np.array([math.log(5e-4), 0.0, -9.0, 0.0, 0.0])
        high = np.array([math.log(3.0), 6.0, 9.0, GREATEST_TAIL, GREATEST_TAIL])
        return low, high

    def starts(self, values: Mapping[str, float]) -> list[Array]:
        """From one of Student's: itself, and more spread."""
        alpha, s = values["ln_alpha"], min(values["s"], 0.9)
        return [np.array([alpha - 0.2, 1.2, -1.0, s, s]), np.array([alpha, 2.5, -2.0, 0.3, 0.5])]

    def members(self, v: Array) -> list[tuple[float, float, float]]:
        """Weight, roughness and gamma of both."""
        share = 1.0 / (1.0 + math.exp(-v[2]))
        alphas = math.exp(v[0]), math.exp(min(v[0] + v[1], math.log(20.0)))
        gammas = [3.0 / (2.0 * s) if s > 1e-9 else math.inf for s in (v[3], v[4])]
        return [(1.0 - share, alphas[0], gammas[0]), (share, alphas[1], gammas[1])]

    def rotation(self, v: Array) -> float:
        return 0.0

    def ndf(self, v: Array, accuracy: float) -> Ndf:
        parts = [(w, Ndf(gamma=g, alpha=a, accuracy=0.1)) for w, a, g in self.members(v)]
        return Ndf.mixture(parts, accuracy=accuracy)

    def properties(self, v: Array) -> dict[str, Any]:
        texts = [
            f"weight={w:.9g} alpha={a:.9g} distribution=student gamma={min(g, 1e9):.9g}" for w, a, g in self.members(v)
        ]
        return {"distribution": "mixture", "members": "; ".join(texts)}

    def shape(self, v: Array) -> dict[str, float]:
        (_, a, g), (share, b, h) = self.members(v)
        return {"alpha_core": a, "gamma_core": g, "alpha_haze": b, "gamma_haze": h, "share_of_haze": share}


Space = Union[FamilySpace, TableSpace, MixtureSpace]


def table_space(ndf: Ndf, steepest: float, nodes: int, anisotropic: bool) -> TableSpace:
    """Nodes where a distribution bends, as far as the data reach: evenly in ln(1 + (t / median)^2), the coordinate in which tables are lines."""
    alpha = math.sqrt(ndf.stretch[0] * ndf.stretch[1])
    median = max(alpha * float(ndf.quantile(0.5)), 1e-4)
    end = max(steepest, 3.0 * median)
    # finer towards the peak than the distribution itself: measured peaks are sharper than fits of their tails
    knee = 0.5 * median
    u = np.linspace(0.0, 1.0, nodes)
    y = np.log1p((end / knee) ** 2) * (0.5 * u + 0.5 * u**2)
    return TableSpace(tuple(float(t) for t in knee * np.sqrt(np.expm1(y))), float(knee), anisotropic)
