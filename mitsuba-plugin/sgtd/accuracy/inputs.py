"""Arguments at which errors are measured: random ones as a renderer meets them, and hard ones on purpose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..named_shape import NamedShape

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
