"""The rows of the family on one set of slopes, each started from those below it and never worse than they are."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..fitting.rows import ROWS, FamilySpace, ancestors
from .cells import Cells
from .likelihood import Likelihood

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Steps from every start, before the best of them goes on
_FIRST_STEPS = 8
_HELD_STEPS = 25


@dataclass
class Fitted:
    """A row: its variables, and the log-likelihood a sample."""

    likelihood: Likelihood
    v: Array
    value: float
    seconds: float
    #: of each block, the log-likelihood a sample of a fit to the other half; None if that was not asked for
    held_out: Array | None = None


class Climb:
    """``halves`` says of each block to which of two halves it belongs."""

    def __init__(self, cells: Cells, halves: NDArray[np.bool_], start: tuple[float, float]) -> None:
        self.cells, self.halves, self.start = cells, halves, start
        self.weights = cells.weights()
        self.found: dict[str, Fitted] = {}

    def fit(self, name: str) -> Fitted:
        """A row, with those below it."""
        if name not in self.found:
            children = [self.fit(child) for child in ROWS[name].children]
            begin = time.perf_counter()
            space = FamilySpace(ROWS[name], True)
            likelihood = Likelihood(space, self.cells)
            starts = self._starts(space, children)
            # children are members of this row, so their variables are candidates as they are
            kept = [(child.value, v) for child, v in zip(children, starts)]
            tried = [likelihood.search(v, self.weights, _FIRST_STEPS) for v in starts]
            v, value = likelihood.search(max(tried, key=lambda one: one[1])[0], self.weights)
            for its_value, other in kept:
                if its_value >= value:
                    v, value = other, its_value
            self.found[name] = Fitted(likelihood, v, value, time.perf_counter() - begin)
        return self.found[name]

    def _starts(self, space: FamilySpace, children: Sequence[Fitted]) -> list[Array]:
        if children:
            best = max(children, key=lambda child: child.value)
            below = [space.of(child.likelihood.space.values(child.v)) for child in children]
            return below + space.starts(best.likelihood.space.values(best.v))
        # a row without a free shape: the roughness with which its median is that of the slopes
        ln_ratio, rotation = self.start
        probe = np.array([0.0, ln_ratio, rotation])
        ndf = space.ndf(probe, 1e-2)
        su, sv = ndf.stretch
        c, s = np.cos(self.cells.azimuth - rotation), np.sin(self.cells.azimuth - rotation)
        x = self.cells.radius * np.hypot(c / su, s / sv)
        order = np.argsort(x)
        median = float(np.interp(0.5, np.cumsum(self.weights[order]), x[order]))
        return [np.array([np.log(max(median, 1e-9) / float(ndf.quantile(0.5))), ln_ratio, rotation])]

    def held_out(self, name: str) -> Array:
        """Of each block, the log-likelihood a sample by a fit to the half that it is not in; fits start from that to all."""
        fitted = self.fit(name)
        if fitted.held_out is None:
            counts = self.cells.counts
            found = np.zeros(len(counts))
            for half in (False, True):
                inside = self.halves == half
                v, _ = fitted.likelihood.search(fitted.v, self.cells.weights(inside), _HELD_STEPS)
                logs = fitted.likelihood.logs(v)
                left = ~inside
                found[left] = counts[left] @ logs / np.maximum(counts[left].sum(axis=1), 1.0)
            fitted.held_out = found
        return fitted.held_out

    def pays(self, name: str, current: str) -> bool:
        """Is a row better on what was left out, by a standard error over blocks?"""
        if self.fit(name).value - self.fit(current).value < _LEAST_GAIN:
            return False
        weights = self.cells.counts.sum(axis=1)
        gain = self.held_out(name) - self.held_out(current)
        mean = float(weights @ gain / weights.sum())
        error = float(np.sqrt((weights**2) @ (gain - mean) ** 2) / weights.sum())
        return mean > error


# Log-likelihood a sample that no picture shows
_LEAST_GAIN = 1e-4


def select(climb: Climb) -> str:
    """Fits all rows and climbs as far as it pays."""
    for name in ROWS:
        climb.fit(name)
    current = max((name for name in ROWS if not ROWS[name].children), key=lambda name: climb.fit(name).value)
    while True:
        above = sorted(ancestors(current), key=lambda name: (ROWS[name].count, -climb.fit(name).value))
        step = next((name for name in above if climb.pays(name, current)), None)
        if step is None:
            return current
        current = step
