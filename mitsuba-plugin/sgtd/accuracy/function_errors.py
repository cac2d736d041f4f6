"""Errors of the functions against the reference path, quadrature in double precision.

The error of masking is that of G1 = 1/(1 + Lambda), relative: it is what ``accuracy`` promises, and what an image
sees. It is |difference of Lambda| / (1 + Lambda) to first order. The relative error of Lambda itself says little where
Lambda is next to nothing (at normal incidence it is 0); it is given over the arguments where Lambda exceeds
``LAMBDA_FLOOR``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..named_shape import NamedShape
from . import published
from .inputs import directions, normals

# Below this Lambda its own relative error is not counted: G1 is within 1 % of 1 there.
LAMBDA_FLOOR = 0.01

# Where D cos is below 1e-20, Mitsuba takes D as 0; a little above, rounding decides.
DENSITY_FLOOR = 1.01e-20


@dataclass
class Spread:
    """Worst and root mean square of errors, for random and for hard arguments."""

    worst: dict[str, float] = field(default_factory=dict)
    rms: dict[str, float] = field(default_factory=dict)

    @property
    def largest(self) -> float:
        return max(self.worst.values(), default=0.0)


class Collector:
    """Gathers errors by kind of argument."""

    def __init__(self) -> None:
        self._parts: dict[str, list[np.ndarray]] = {}

    def add(self, kind: str, errors: np.ndarray) -> None:
        self._parts.setdefault(kind, []).append(np.nan_to_num(errors, nan=np.inf))

    def spread(self) -> Spread:
        spread = Spread()
        for kind, parts in self._parts.items():
            errors = np.concatenate(parts)
            if errors.size:
                spread.worst[kind] = float(errors.max())
                spread.rms[kind] = float(np.sqrt(np.mean(np.square(errors))))
        return spread


@dataclass(frozen=True)
class MaskingErrors:
    """Errors of one way to compute Lambda."""

    g1: Spread
    lambda_itself: Spread


Masking = Callable[[float, float, np.ndarray], np.ndarray]


def masking_errors(shape: NamedShape, seed: int, count: int, ways: dict[str, Masking]) -> dict[str, MaskingErrors]:
    """Errors of several ways at the same arguments; the reference is computed once."""
    collected = {name: (Collector(), Collector()) for name in ways}
    for batch in directions(shape, seed, count):
        reference = shape.ndf(batch.alpha_u, batch.alpha_v, 0.0).lambda_(batch.w)
        finite = np.isfinite(reference)
        for name, way in ways.items():
            values = way(batch.alpha_u, batch.alpha_v, batch.w)
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                # Of G1: (1 + reference) / (1 + value) - 1
                g1 = np.abs((reference - values) / (1.0 + values))
                own = np.abs(values - reference) / reference
            collected[name][0].add(batch.kind, np.where(finite, g1, values != reference))
            collected[name][1].add(batch.kind, own[finite & (reference > LAMBDA_FLOOR)])
    return {name: MaskingErrors(a.spread(), b.spread()) for name, (a, b) in collected.items()}


def table_way(shape: NamedShape, setting: float) -> Masking:
    """Lambda by the core at a setting of the dial."""
    return lambda alpha_u, alpha_v, w: shape.ndf(alpha_u, alpha_v, setting).lambda_(w)


def published_way(shape: NamedShape, line: published.Line) -> Masking:
    """Lambda by a published formula; its ``a`` is at the stretched roughness."""
    scale = shape.alpha_scale
    return lambda alpha_u, alpha_v, w: published.over_directions(line.evaluate, scale * alpha_u, scale * alpha_v, w)


def density_errors(shape: NamedShape, seed: int, count: int, settings: tuple[float, ...]) -> dict[str, Spread]:
    """Errors of D: of the core at each setting, and of closed forms.

    The reference is A f(x) / (pi alpha_u alpha_v cos^4), with f from the careful path of the core (``Ndf.profile``).
    """
    names = [str(setting) for setting in settings]
    lines = published.profile_lines(shape)
    collected = {name: Collector() for name in [*names, *(line.name for line in lines)]}
    for batch in normals(shape, seed, count):
        exact = shape.ndf(batch.alpha_u, batch.alpha_v, 0.0)
        u, v = shape.alpha_scale * batch.alpha_u, shape.alpha_scale * batch.alpha_v
        x, y, z = batch.w.T
        with np.errstate(all="ignore"):
            geometry = np.square(np.square(z))
            reference = exact.profile(np.hypot(x / u, y / v) / z) * (exact.normalization / (math.pi * u * v)) / geometry
        counted = (reference * z > DENSITY_FLOOR) & np.isfinite(reference)
        for name, setting in zip(names, settings):
            values = shape.ndf(batch.alpha_u, batch.alpha_v, setting).d(batch.w)
            collected[name].add(batch.kind, np.abs(values[counted] / reference[counted] - 1.0))
        for line in lines:
            # the formulas' A is 1: Beckmann, GGX and Student's without a shift
            values = published.density_over_normals(line.evaluate, 1.0, u, v, batch.w)
            collected[line.name].add(batch.kind, np.abs(values[counted] / reference[counted] - 1.0))
    return {name: collector.spread() for name, collector in collected.items()}


@dataclass(frozen=True)
class SamplingErrors:
    """How far samples are from the visible normals of the reference path.

    The weight of a sample is the exact density of visible normals, with masking by quadrature, over the density that
    the sampler reports. ``weight`` has |weight - 1|; ``mean`` is the mean weight (1 but for lost samples and noise)
    and ``variance`` its variance, so the price of a sampler in noise. ``lost`` is the part of samples that are invalid.
    """

    weight: Spread
    mean: float
    variance: float
    lost: float


def sampling_errors(shape: NamedShape, seed: int, count: int, setting: float, visible: bool = True) -> SamplingErrors:
    """Draws from views all over the hemisphere (random) and at its edge (hard)."""
    random = np.random.default_rng(seed + 2)
    collector = Collector()
    weights = []
    for batch in directions(shape, seed, count):
        exact = shape.ndf(batch.alpha_u, batch.alpha_v, 0.0)
        drawing = shape.ndf(batch.alpha_u, batch.alpha_v, setting)
        wi = batch.w
        m, pdf = drawing.sample(wi, random.random((len(wi), 2)), visible=visible)
        valid = pdf > 0.0
        wi, m, pdf = wi[valid], m[valid], pdf[valid]
        facing = np.maximum(np.einsum("ij,ij->i", wi, m), 0.0)
        with np.errstate(all="ignore"):
            ratio = exact.g1(wi) * facing / wi[:, 2] * exact.d(m) / pdf
        # beyond the range of double precision neither side means anything
        ratio = ratio[np.isfinite(ratio)]
        collector.add(batch.kind, np.abs(ratio - 1.0))
        if batch.kind == "random":
            weights.append(np.concatenate([ratio, np.zeros(int(np.sum(~valid)))]))
    together = np.concatenate(weights)
    lost = float(np.mean(together == 0.0))
    return SamplingErrors(collector.spread(), float(together.mean()), float(together.var()), lost)
