"""What else exists: formulas of other authors for the same functions, written from their equations.

All take ``a = 1 / (alpha tan theta)``, the argument of masking, or ``x = tan(theta_m) / alpha``, the stretched slope,
and serve as comparison lines. Nothing but the report uses them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from ..named_shape import NamedShape

Function = Callable[[np.ndarray], np.ndarray]

# Nodes of the naive quadrature.
ORDERS = (8, 16, 32, 64, 128)

# Values in one NumPy operation at most, so that intermediate arrays stay in the cache.
_CHUNK = 4096


@dataclass(frozen=True)
class Line:
    """One published way to evaluate a function of one variable."""

    name: str
    source: str
    evaluate: Function


def masking_lines(shape: NamedShape, orders: tuple[int, ...] = ORDERS) -> list[Line]:
    """Ways to compute Smith's Lambda for this shape."""
    lines = []
    if shape.is_ggx:
        lines.append(Line("GGX, closed form", "Walter et al. 2007, eq. 34", ggx_lambda))
    elif shape.is_student:
        lines.append(
            Line("closed form, incomplete beta", "own integration", lambda a: student_lambda(a, shape.numbers.gamma)),
        )
    if shape.is_student and not shape.is_ggx:  # nobody needs a fit of GGX
        fit = Line("fit of 2017", "Ribardière et al. 2017, eq. 22 to 23", lambda a: student_fit(a, shape.numbers.gamma))
        lines.append(fit)
    if shape.is_beckmann:
        lines.append(Line("Beckmann, closed form", "Smith 1967; Walter et al. 2007, eq. 26", beckmann_lambda))
        lines.append(Line("rational fit of 2007", "Walter et al. 2007, eq. 27", beckmann_fit))
    for order in orders:
        lines.append(Line(f"Gauss-Legendre, {order} nodes", "fixed order", FixedOrder(shape, order)))
    return lines


def profile_lines(shape: NamedShape) -> list[Line]:
    """Ways to compute A f(x), the part of D that is not geometry."""
    if shape.is_beckmann:
        return [Line("Beckmann, closed form", "Walter et al. 2007, eq. 25", lambda x: np.exp(-x * x))]
    if shape.is_ggx:
        return [Line("GGX, closed form", "Walter et al. 2007, eq. 33", lambda x: 1.0 / np.square(1.0 + x * x))]
    if shape.is_student:
        gamma = shape.numbers.gamma
        formula = Line("closed form", "Ribardière et al. 2017", lambda x: (1.0 + x * x / (gamma - 1.0)) ** -gamma)
        return [formula]
    return []


def ggx_lambda(a: np.ndarray) -> np.ndarray:
    """GGX: Lambda = (sqrt(1 + 1/a^2) - 1) / 2, in a form that does not cancel for large a."""
    inverse = 1.0 / np.square(a)
    return 0.5 * inverse / (1.0 + np.sqrt(1.0 + inverse))


def beckmann_lambda(a: np.ndarray) -> np.ndarray:
    """Beckmann: Lambda = exp(-a^2) / (2 a sqrt(pi)) - erfc(a) / 2."""
    return np.exp(-a * a) * (1.0 / (2.0 * math.sqrt(math.pi) * a) - 0.5 * special.erfcx(a))


def beckmann_fit(a: np.ndarray) -> np.ndarray:
    """Walter et al. 2007, eq. 27: G1 = (3.535 a + 2.181 a^2) / (1 + 2.276 a + 2.577 a^2) below a = 1.6, else 1."""
    g1 = np.where(a < 1.6, (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a), 1.0)
    with np.errstate(divide="ignore"):
        return 1.0 / g1 - 1.0


def student_lambda(a: np.ndarray, gamma: float) -> np.ndarray:
    """Student's distribution exactly, by the incomplete beta function."""
    g = gamma - 1.0
    factor = math.exp(g * math.log(g) + math.lgamma(gamma - 0.5) - math.lgamma(g)) / math.sqrt(math.pi)
    power = factor * (g + a * a) ** (1.5 - gamma) / ((2.0 * gamma - 3.0) * a)
    return power - 0.5 * special.betainc(g, 0.5, g / (g + a * a))


def student_fit(a: np.ndarray, gamma: float) -> np.ndarray:
    """Ribardière et al. 2017: the incomplete beta function of :func:`student_lambda` by four rational functions.

    Lambda = Gamma(gamma - 1/2) / (Gamma(gamma) sqrt(pi)) * (A1 S1 + sqrt(gamma - 1) S2) - 1/2, with the fit
    S2 = F21 (F22 + F23 F24). It holds for gamma > 3/2.
    """
    g, z = gamma - 1.0, a
    ratio = math.exp(math.lgamma(gamma - 0.5) - math.lgamma(gamma)) / math.sqrt(math.pi)
    base = g + z * z
    s1 = (g / base) ** gamma * base**1.5 / ((2.0 * gamma - 3.0) * z)
    # written in 1/z, so that large z does not overflow
    y = 1.0 / z
    f21 = _ratio((4.892, 2.655, 1.066, 0.0), (4.418, 4.305, 2.969, 1.038), y)
    f24 = _ratio((5.223, -0.623, 6.074, 6.537), (6.347, -3.218, 6.103, 6.538), y)
    f22 = _ratio((14.402, -27.145, 20.574, -2.745), (-30.612, 86.567, -84.341, 29.938), gamma)
    f23 = _ratio((-129.404, 324.987, -299.305, 93.268), (-92.609, 256.006, -245.663, 86.064), gamma)
    return ratio * (s1 + math.sqrt(g) * f21 * (f22 + f23 * f24)) - 0.5


def _ratio(above: tuple[float, ...], below: tuple[float, ...], x: np.ndarray | float) -> np.ndarray | float:
    """A ratio of two cubics, coefficients from the constant one upwards; its limit for an infinite x."""
    x = np.minimum(x, 1e90)

    def cubic(c: tuple[float, ...]) -> np.ndarray | float:
        return c[0] + x * (c[1] + x * (c[2] + x * c[3]))

    return cubic(above) / cubic(below)


class FixedOrder:
    """Masking by Gauss-Legendre quadrature of one fixed order, as one writes it down first.

    H(a) = (2A/pi) int_a^inf f(rho) rho (sqrt(rho^2 - a^2) - a acos(a/rho)) drho with rho = a + t/(1-t), t in [0, 1].
    """

    def __init__(self, shape: NamedShape, order: int) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(order)
        t = 0.5 * (nodes + 1.0)
        self._step = t / (1.0 - t)
        self._weights = 0.5 * weights / np.square(1.0 - t)
        self._shape = shape
        self._factor = 2.0 * shape.ndf(1.0, 1.0, 0.1).normalization / math.pi
        self._chunk = max(16, 8 * _CHUNK // order)

    def __call__(self, a: np.ndarray) -> np.ndarray:
        parts = [self._integrate(a[k : k + self._chunk]) for k in range(0, a.size, self._chunk)]
        return np.concatenate(parts) / a

    def _integrate(self, a: np.ndarray) -> np.ndarray:
        a = a[:, None]
        rho = a + self._step
        bracket = np.sqrt(self._step * (rho + a)) - a * np.arccos(a / rho)
        with np.errstate(over="ignore", under="ignore"):
            values = self._profile(rho) * rho * bracket
        return self._factor * (values @ self._weights)

    def _profile(self, x: np.ndarray) -> np.ndarray:
        shape = self._shape
        distance = x - shape.numbers.shift
        if shape.numbers.lam:
            distance = distance / np.where(distance > 0.0, 1.0 + shape.numbers.lam, 1.0 - shape.numbers.lam)
        u = np.abs(distance) ** (2.0 * shape.numbers.p)
        return (
            np.exp(-u)
            if math.isinf(shape.numbers.gamma)
            else (1.0 + u / (shape.numbers.gamma - 1.0)) ** -shape.numbers.gamma
        )


def over_directions(line: Function, alpha_u: float, alpha_v: float, w: np.ndarray) -> np.ndarray:
    """A function of ``a`` over directions, chunk by chunk as NumPy likes it."""
    parts = []
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        for k in range(0, len(w), _CHUNK):
            x, y, z = w[k : k + _CHUNK].T
            a = z / np.hypot(alpha_u * x, alpha_v * y)
            # the normal itself has no masking; every renderer asks for that before it asks the formula
            parts.append(np.where(np.isinf(a), 0.0, line(a)))
    return np.concatenate(parts)


def density_over_normals(line: Function, factor: float, alpha_u: float, alpha_v: float, m: np.ndarray) -> np.ndarray:
    """D(m) from a formula for f; ``factor`` is A."""
    parts = []
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        for k in range(0, len(m), _CHUNK):
            x, y, z = m[k : k + _CHUNK].T
            f = line(np.hypot(x / alpha_u, y / alpha_v) / z)
            parts.append(f * (factor / (math.pi * alpha_u * alpha_v)) / np.square(np.square(z)))
    return np.concatenate(parts)
