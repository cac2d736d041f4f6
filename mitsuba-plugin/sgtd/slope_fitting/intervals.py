"""Intervals of the parameters: neighboring facets are alike, so whole blocks of them are drawn anew."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..fitting.uncertainty import KNOWN, Parameter
from .climb import Fitted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_DRAWS = 1000
_ENDS = (2.5, 97.5)
_VARIABLE = {
    "gamma": "s",
    "p": "ln_p",
    "lambda": "lambda",
    "shift": "shift",
    "alpha_u": "ln_alpha",
    "alpha_v": "ln_alpha",
}


def intervals(fitted: Fitted, seed: int = 0) -> tuple[Parameter, ...]:
    """95 % intervals by a bootstrap over blocks, each draw moved by one step of Newton from the fit to all."""
    likelihood, v = fitted.likelihood, fitted.v
    space = likelihood.space
    low, high = space.bounds
    span = np.minimum(high - low, 1.0)
    bound = (v < low + 1e-4 * span) | (v > high - 1e-4 * span)
    free = np.flatnonzero(~bound)
    draws = np.tile(v, (_DRAWS, 1))
    draws[:, free] += _steps(fitted, free, seed)
    draws = np.clip(draws, low, high)
    # axes that change their names are the same axes
    shapes = [space.shape(draw) for draw in draws]
    at = space.shape(v)
    rows = []
    for name, value in at.items():
        variable = _VARIABLE[name]
        if variable not in space.names:
            rows.append(Parameter(name, value, value, value, "fixed", f"by the row {space.title}"))
            continue
        spread = np.array([shape[name] for shape in shapes])
        rows.append(_parameter(name, value, spread, bool(bound[space.names.index(variable)])))
    turn = np.degrees([space.rotation(draw) for draw in draws])
    rows.append(_parameter("rotation", math.degrees(space.rotation(v)), turn, False))
    return tuple(rows)


def _steps(fitted: Fitted, free: NDArray[np.int64], seed: int) -> Array:
    """Of each draw, the step of the free variables."""
    likelihood, v = fitted.likelihood, fitted.v
    counts = likelihood.cells.counts
    _, by = likelihood.derivatives(v)
    by = by[free]
    total = counts.sum()
    weights = counts.sum(axis=0)
    # outer products of the scores stand for the curvature: positive, and the same where the row is right
    curvature = (by * weights) @ by.T / total
    scores = counts @ by.T
    rng = np.random.default_rng(seed)
    blocks = len(counts)
    times = rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=_DRAWS)
    sizes = times @ counts.sum(axis=1)
    gradient = (times @ scores) / np.maximum(sizes, 1.0)[:, None] - scores.sum(axis=0) / total
    return np.asarray(gradient @ np.linalg.pinv(curvature, rcond=1e-10))


def _parameter(name: str, value: float, spread: Array, bound: bool) -> Parameter:
    finite = np.where(np.isfinite(spread), spread, 1e308)
    low, high = (float(x) for x in np.percentile(finite, _ENDS))
    if bound:
        remark = {
            "gamma": "the tail is exponential" if math.isinf(value) else "the tail is as flat as Smith's masking admits"
        }
        return Parameter(
            name, min(value, 1e308), low, high, "at a bound", remark.get(name, "the end of what is allowed")
        )
    half = 0.5 * (high - low)
    width = half if name in ("lambda", "shift", "rotation") else half / max(abs(value), 1e-12)
    known = width <= (5.0 if name == "rotation" else KNOWN)
    return Parameter(name, min(value, 1e308), low, high, "known" if known else "not identifiable")
