"""Coordinates in which every number is a shape: what optimizers move in.

================  =======================  ===================================================
parameter         variable v               why
================  =======================  ===================================================
``gamma``         log(gamma - g0)          above g0 = max(1, 1.5/p), where masking is finite
``p``             log p                    its effect is one of proportions
``lambda``        atanh(lambda / 0.9999)   between the two limits of the family
``shift``         log(exp(shift) - 1)      positive, and linear once it is above 1
``alpha``         log alpha                its effect is one of proportions
================  =======================  ===================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: What can be recovered, in the order that is used throughout.
NAMES = ("gamma", "p", "lambda", "shift", "alpha")

_DEFAULTS = {"gamma": 2.0, "p": 1.0, "lambda": 0.0, "shift": 0.0, "alpha": 0.1}
_SKEW = 0.9999
# Where variables end: gamma within 1e-3 of its limit and at 1e3, and what the family and its renderers accept of the others
_BOUNDS = {
    "gamma": (-7.0, 7.0),
    "p": (float(np.log(0.1)), float(np.log(100.0))),
    "lambda": (-5.0, 5.0),
    "shift": (-7.0, 100.0),
    "alpha": (float(np.log(1e-3)), float(np.log(10.0))),
}


class Variables:
    """The unknown ones of ``gamma``, ``p``, ``lambda``, ``shift`` and ``alpha``, and fixed values of the others."""

    def __init__(self, unknown: Sequence[str] = NAMES, **fixed: float) -> None:
        for name in (*unknown, *fixed):
            if name not in NAMES:
                raise ValueError(f'parameter "{name}" is unknown: choose among {", ".join(NAMES)}')
        both = [name for name in unknown if name in fixed]
        if both or len(set(unknown)) < len(unknown):
            raise ValueError(f'parameter "{(both or list(unknown))[0]}" is given more than once')
        if not unknown:
            raise ValueError("unknown: there is nothing to recover; name at least one parameter")
        self.unknown = tuple(name for name in NAMES if name in unknown)
        self.fixed = {**{name: value for name, value in _DEFAULTS.items() if name not in unknown}, **fixed}

    @property
    def bounds(self) -> tuple[Array, Array]:
        """The least and the greatest value of each variable."""
        low, high = np.transpose([_BOUNDS[name] for name in self.unknown])
        return low, high

    def from_parameters(self, parameters: Mapping[str, float]) -> Array:
        """The variables of given parameters; moved inside the bounds by at most 1e-3 of what they mean.

        Raises ``ValueError`` if one is missing or is no member of the family.
        """
        values = {**self.fixed, **parameters}
        for name in self.unknown:
            if name not in values:
                raise ValueError(f'parameter "{name}" is missing: give a value to start from')
        gamma, p, lam, shift, alpha = (float(values[name]) for name in NAMES)
        if not (p > 0.0 and gamma > max(1.0, 1.5 / p) and abs(lam) < 1.0 and shift >= 0.0 and alpha > 0.0):
            raise ValueError(
                f"gamma = {gamma:g}, p = {p:g}, lambda = {lam:g}, shift = {shift:g}, alpha = {alpha:g} is no member of the family: "
                "2 p gamma must exceed 3, lambda be within -1 and 1, and the others be positive"
            )
        all_of = {
            "gamma": np.log(min(gamma, 1e6) - max(1.0, 1.5 / p)),
            "p": np.log(p),
            "lambda": np.arctanh(np.clip(lam / _SKEW, -1.0, 1.0) * (1.0 - 1e-12)),
            "shift": shift + np.log(-np.expm1(-max(shift, 1e-12))),
            "alpha": np.log(alpha),
        }
        low, high = self.bounds
        inside = 1e-6 * (high - low)
        return np.clip([all_of[name] for name in self.unknown], low + inside, high - inside)

    def to_parameters(self, variables: Sequence[Any] | Array, functions: ModuleType | Any = np) -> dict[str, Any]:
        """The unknown parameters; ``functions`` is numpy, or drjit for its types and their derivatives."""
        at: dict[str, Any] = dict(zip(self.unknown, variables))
        result = dict(at)
        for name in ("p", "alpha"):
            if name in at:
                result[name] = functions.exp(at[name])
        if "gamma" in at:
            p = result["p"] if "p" in at else self.fixed["p"]
            result["gamma"] = functions.maximum(1.0, 1.5 / p) + functions.exp(at["gamma"])
        if "lambda" in at:
            result["lambda"] = _SKEW * functions.tanh(at["lambda"])
        if "shift" in at:
            v = at["shift"]
            result["shift"] = functions.maximum(v, 0.0) + functions.log(1.0 + functions.exp(-abs(v)))
        return result

    def jacobian(self, variables: Array) -> Array:
        """d parameter (row) / d variable (column)."""
        at = dict(zip(self.unknown, variables))
        result = np.zeros((len(at), len(at)))
        place = {name: number for number, name in enumerate(self.unknown)}
        slopes = {
            "gamma": lambda v: np.exp(v),
            "p": lambda v: np.exp(v),
            "lambda": lambda v: _SKEW / np.cosh(v) ** 2,
            "shift": lambda v: 1.0 / (1.0 + np.exp(-v)),
            "alpha": lambda v: np.exp(v),
        }
        for name, v in at.items():
            result[place[name], place[name]] = slopes[name](v)
        if "gamma" in at and "p" in at and np.exp(at["p"]) < 1.5:
            # g0 = 1.5 / p
            result[place["gamma"], place["p"]] = -1.5 * np.exp(-at["p"])
        return result
