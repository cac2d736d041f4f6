"""What the data say of each parameter: intervals, correlations, and which it does not say.

From the Jacobian at the minimum: the covariance of independent errors, and that of errors alike within blocks of neighboring directions (a
sandwich); the greater standard deviation counts. Data without noise are not far from a model at random.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .spaces import TableSpace
from .tree import Fitted, blocks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: half of a 95 % interval over the value (over 1 for a skew and a shift) up to which a parameter counts as known
KNOWN = 0.05
_NORMAL_95 = 1.96
# Two parameters that are more alike than this are one to the data
_ALIKE = 0.98


@dataclass(frozen=True)
class Parameter:
    """One parameter as a scene names it: its value, its interval, and what became of it."""

    name: str
    value: float
    low: float
    high: float
    #: "known", "not identifiable", "at a bound" or "fixed"
    status: str
    remark: str = ""


@dataclass(frozen=True)
class Uncertainty:
    parameters: tuple[Parameter, ...]
    #: names of what is in the matrix of correlations
    names: tuple[str, ...]
    correlations: Array

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the parameters that the data do not tell."""
        return tuple(p.name for p in self.parameters if p.status == "not identifiable")


def uncertainty(fitted: Fitted) -> Uncertainty:
    problem, x = fitted.problem, fitted.x
    problem.settle(x)
    jacobian, residual = problem.jacobian(x), problem.residual(x)
    span = np.minimum(problem.high - problem.low, 1.0)
    margin = 2e-3 * span
    bound = (x < problem.low + margin) | (x > problem.high - margin)
    # a turn of an isotropic frame, and what else does nothing
    idle = np.linalg.norm(jacobian, axis=0) < 1e-12
    free = ~(bound | idle)
    covariance = _covariance(jacobian[:, free], residual, np.repeat(blocks(problem.data), problem.channels))
    sigma = np.full(len(x), np.inf)
    sigma[free] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sigma[bound] = 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        correlations = covariance / np.outer(sigma[free], sigma[free])
    names = tuple(name for name, is_free in zip(problem.names, free) if is_free)
    partners = _partners(names, correlations)
    rows = tuple(_parameters(fitted, sigma, bound, partners))
    return Uncertainty(rows, names, np.where(np.isfinite(correlations), np.clip(correlations, -1.0, 1.0), 0.0))


def _covariance(jacobian: Array, residual: Array, block: Array) -> Array:
    count = jacobian.shape[1]
    if count == 0:
        return np.zeros((0, 0))
    scale = np.linalg.norm(jacobian, axis=0)
    j = jacobian / scale
    inverse = np.linalg.pinv(j.T @ j, rcond=1e-12)
    freedom = max(len(residual) - count, 1)
    plain = inverse * float(residual @ residual) / freedom
    scores = np.stack([j[block == b].T @ residual[block == b] for b in np.unique(block)])
    groups = len(scores)
    robust = inverse @ (scores.T @ scores) @ inverse * (groups / max(groups - 1, 1))
    take = np.diag(robust) > np.diag(plain)
    factor = np.where(take, np.sqrt(np.diag(robust) / np.maximum(np.diag(plain), 1e-300)), 1.0)
    # the correlations of independent errors, and the greater deviations
    return plain * np.outer(factor, factor) / np.outer(scale, scale)


def _partners(names: tuple[str, ...], correlations: Array) -> dict[str, str]:
    """Of each variable, the one that the data cannot tell it from."""
    found = {}
    for k, name in enumerate(names):
        others = np.abs(np.where(np.arange(len(names)) == k, 0.0, correlations[k]))
        if len(names) > 1 and others.max() > _ALIKE:
            found[name] = names[int(np.argmax(others))]
    return found


def _parameters(fitted: Fitted, sigma: Array, bound: Array, partners: dict[str, str]) -> list[Parameter]:
    problem, x = fitted.problem, fitted.x
    space = fitted.space
    rows: list[Parameter] = []
    at = dict(zip(problem.names, range(len(x))))

    def ends(name: str) -> tuple[Array, Array]:
        """The variables at both ends of the interval of one."""
        low, high = x.copy(), x.copy()
        k = at[name]
        step = _NORMAL_95 * sigma[k]
        low[k] = max(x[k] - step, problem.low[k])
        high[k] = min(x[k] + step, problem.high[k])
        return low, high

    def add(name: str, variable: str, of: object, relative: bool = True) -> None:
        value, low, high = (float(of(v)) for v in (x, *ends(variable)))  # type: ignore[operator]
        low, high = min(low, high), max(low, high)
        half = 0.5 * (high - low) if math.isfinite(high - low) else math.inf
        width = half / max(abs(value), 1e-12) if relative else half
        k = at[variable]
        status = "at a bound" if bound[k] else "known" if width <= KNOWN else "not identifiable"
        remark = ""
        if status == "not identifiable" and variable in partners:
            remark = f"the data cannot tell it from {partners[variable]}"
        if status == "at a bound":
            remark = _bound_remark(variable, x[k] <= problem.low[k] + 1e-2)
        rows.append(Parameter(name, value, low, high, status, remark))

    n = problem.count
    if not isinstance(space, TableSpace):
        shape = space.shape(x[:n])
        variable_of = {"gamma": "s", "p": "ln_p", "lambda": "lambda", "shift": "shift", "alpha": "ln_alpha"}
        variable_of |= {
            "alpha_u": "ln_alpha",
            "alpha_v": "ln_alpha",
            "alpha_core": "ln_alpha",
            "alpha_haze": "ln_widening",
        }
        variable_of |= {"gamma_core": "s", "gamma_haze": "s_wide", "share_of_haze": "logit"}
        for name in shape:
            variable = variable_of[name]
            if variable in at:
                add(name, variable, lambda v, name=name: space.shape(v[:n])[name], name not in ("lambda", "shift"))
            else:
                rows.append(
                    Parameter(name, shape[name], shape[name], shape[name], "fixed", f"by the row {fitted.name}")
                )
    if "rotation" in at:
        add("rotation", "rotation", lambda v: math.degrees(v[at["rotation"]]), False)
    for kind in ("f0", "tint", "specular", "diffuse"):
        for variable in problem.names:
            if variable == kind or variable.startswith(f"{kind}_"):
                _, _, channel = variable.partition("_")
                label = f"{kind}_{problem.data.channels[int(channel)]}" if channel else kind
                is_log = kind != "tint"
                add(
                    label, variable, lambda v, k=at[variable], is_log=is_log: math.exp(v[k]) if is_log else v[k], is_log
                )
    return [dataclasses.replace(row, low=_finite(row.low), high=_finite(row.high)) for row in rows]


def _bound_remark(variable: str, at_low: bool) -> str:
    if variable == "s":
        return (
            "gamma is infinite: the tail is exponential"
            if at_low
            else "the tail is as flat as Smith's masking admits, 2 p gamma = 3: measured tails end somewhere, so a table may fit better"
        )
    if variable.startswith("diffuse"):
        return "nothing is diffuse" if at_low else "all of the light below the interface comes back"
    return "the least that is allowed" if at_low else "the greatest that is allowed"


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.copysign(1e308, value) if not math.isnan(value) else value
