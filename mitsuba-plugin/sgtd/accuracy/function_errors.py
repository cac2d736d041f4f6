"""Errors of the functions against the reference path, quadrature in double precision; at random arguments, as a renderer meets
them, and at hard ones on purpose.

The error of masking is that of G1 = 1/(1 + Lambda), relative: it is what ``accuracy`` promises, and what an image
sees. It is |difference of Lambda| / (1 + Lambda) to first order. The relative error of Lambda itself says little where
Lambda is next to nothing (at normal incidence it is 0); it is given over the arguments where Lambda exceeds
``LAMBDA_FLOOR``.

A whole material in single precision is what a variant of Mitsuba evaluates, against the core in double precision. It is a perfect
mirror with the shape's roughness, so its value times cos is D G1(wi) G1(wo) / (4 cos_i). JIT variants compute that from tables
in single precision; scalar variants call the core in double precision and round.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import mitsuba_errors
from ..named_shape import NamedShape
from . import published

# Roughness along the tangents for random directions: common, brushed, nearly smooth.
_RANDOM_ALPHAS = ((0.3, 0.3), (0.6, 0.06), (0.02, 0.02))

# Roughness for hard directions beside 1: the smallest that there is, and strongly stretched.
_HARD_ALPHAS = ((1e-4, 1e-4), (10.0, 0.01))


@dataclass(frozen=True)
class Batch:
    """Unit vectors at one roughness; ``kind`` is "random" or "hard"."""

    kind: str
    alpha_u: float
    alpha_v: float
    w: np.ndarray


def directions(shape: NamedShape, seed: int, count: int) -> Iterator[Batch]:
    """Directions above the surface for masking and sampling."""
    random = np.random.default_rng(seed)
    for alphas in _RANDOM_ALPHAS:
        yield Batch("random", *alphas, uniform(random, count // len(_RANDOM_ALPHAS)))
    yield Batch("hard", 1.0, 1.0, of_slope(hard_slopes(shape)))
    for alphas in _HARD_ALPHAS:
        yield Batch("hard", *alphas, edge_directions())


def uniform(random: np.random.Generator, count: int) -> np.ndarray:
    """Uniform over the hemisphere, cos of the polar angle in (0, 1]."""
    return _directions(1.0 - random.random(count), 2.0 * np.pi * random.random(count))


def of_slope(a: np.ndarray) -> np.ndarray:
    """Directions whose cot of the polar angle is ``a``: the argument of masking at roughness 1."""
    sin = 1.0 / np.sqrt(1.0 + a * a)
    return np.stack([sin, np.zeros_like(a), a * sin], axis=1)


def hard_slopes(shape: NamedShape) -> np.ndarray:
    """Arguments of masking where tables or formulas are strained.

    Powers of two and their neighbors in single precision (cell borders); eighteen decades in fine steps (the first
    cell, the power tail, the middle of each cell); and the places where the profile has a kink.
    """
    octaves = 2.0 ** np.arange(-30.0, 31.0)
    borders = np.concatenate([octaves * (1.0 + step * 2.0**-23) for step in (-1.0, -0.25, 0.0, 0.25, 1.0)])
    decades = np.geomspace(1e-9, 1e9, 2401)
    kinks = [shape.numbers.shift * (1.0 + offset) for offset in (-1e-1, -1e-3, -1e-6, 0.0, 1e-6, 1e-3, 1e-1)]
    return np.concatenate([borders, decades, [a for a in kinks if a > 0.0]])


def edge_directions() -> np.ndarray:
    """Grazing and nearly normal directions in several azimuths, and the normal itself."""
    grazing = np.geomspace(1e-12, 0.1, 45)
    normal = np.sqrt(1.0 - np.geomspace(1e-14, 0.1, 45))
    cos = np.concatenate([grazing, normal])
    azimuths = np.array([0.0, 0.4, 0.5 * np.pi, 2.3])
    vectors = _directions(np.tile(cos, azimuths.size), np.repeat(azimuths, cos.size))
    return np.concatenate([vectors, [[0.0, 0.0, 1.0]]])


def normals(shape: NamedShape, seed: int, count: int) -> Iterator[Batch]:
    """Microfacet normals for D: drawn from the shape itself (random), and far out in its tail (hard)."""
    random = np.random.default_rng(seed + 1)
    for alphas in _RANDOM_ALPHAS:
        ndf = shape.ndf(*alphas, 1e-3)
        up = np.array([0.0, 0.0, 1.0])
        drawn, pdf = ndf.sample(up, random.random((count // len(_RANDOM_ALPHAS), 2)), visible=False)
        yield Batch("random", *alphas, drawn[pdf > 0.0])
    slopes = 1.0 / hard_slopes(shape)
    kinks = [shape.numbers.shift * (1.0 + offset) for offset in (-1e-3, -1e-9, 0.0, 1e-9, 1e-3) if shape.numbers.shift]
    yield Batch("hard", 1.0, 1.0, of_slope(1.0 / np.concatenate([slopes, kinks])))
    for alphas in _HARD_ALPHAS:
        yield Batch("hard", *alphas, edge_directions())


def _directions(cos: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    sin = np.sqrt(np.maximum(0.0, (1.0 - cos) * (1.0 + cos)))
    return np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), cos], axis=1)


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


_ALPHA = 0.3
# Calls one by one from Python are slow: so many suffice for a scalar variant.
_SCALAR_COUNT = 1500


@dataclass(frozen=True)
class PrecisionErrors:
    """Relative errors of the material's value and of its sampling density."""

    variant: str
    value: Spread
    count: int


def material_errors(
    shape: NamedShape, seed: int, count: int, settings: tuple[float, ...], variant: str
) -> dict[float, PrecisionErrors]:
    """Errors of one variant at each setting, over random pairs of directions; the variant stays set."""
    import mitsuba as mi

    mi.set_variant(variant)
    scalar = variant.startswith("scalar_")
    count = min(count, _SCALAR_COUNT) if scalar else count
    random = np.random.default_rng(seed + 3)
    # Directions as the variant will see them, lengthened to 1 again in double precision
    wi, wo = (uniform(random, count).astype(np.float32).astype(np.float64) for _ in range(2))
    exact = shape.ndf(_ALPHA, _ALPHA, 0.0)
    unit_i, unit_o = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wi, wo))
    half = unit_i + unit_o
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    reference = exact.d(half) * exact.g2(unit_i, unit_o) / (4.0 * unit_i[:, 2])
    counted = exact.d(half) * half[:, 2] > DENSITY_FLOOR
    result = {}
    for setting in settings:
        with mitsuba_errors(f"while evaluating {shape.text}"):
            bsdf = mi.load_dict({"type": "sgtdconductor", "alpha": _ALPHA, "accuracy": setting, **dict(shape.settings)})
            values = _one_by_one(bsdf, wi, wo) if scalar else _at_once(bsdf, wi, wo)
        collector = Collector()
        collector.add("random", np.abs(values[counted] / reference[counted] - 1.0))
        result[setting] = PrecisionErrors(variant, collector.spread(), int(counted.sum()))
    return result


def _at_once(bsdf: Any, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    import drjit as dr
    import mitsuba as mi

    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    value = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(wo.T.astype(np.float32)))
    return np.array(value, dtype=np.float64).reshape(-1, len(wi))[0]


def _one_by_one(bsdf: Any, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    import drjit as dr
    import mitsuba as mi

    context = mi.BSDFContext()
    si = dr.zeros(mi.SurfaceInteraction3f)
    values = []
    for a, b in zip(wi, wo):
        si.wi = mi.Vector3f(*a)
        values.append(np.array(bsdf.eval(context, si, mi.Vector3f(*b))).ravel()[0])
    return np.array(values, dtype=np.float64)
