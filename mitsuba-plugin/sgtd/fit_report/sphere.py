"""A sphere of the data beside one of the fit: the same lights on both, reflectance looked up where a pixel sees it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_SIZE = 168
# Direction, radiant exitance towards the surface, angular radius in degrees and directions of each light: one from the left above, one that grazes from the right
_LIGHTS = (((-0.5, 0.55, 0.65), 3.0, 5.0, 12), ((0.9, 0.1, 0.12), 1.5, 3.0, 3))
# The brightest pixels that are allowed to burn out, and how bright the others become
_BURNT, _BRIGHT = 0.985, 0.85
#: Ratio of fit to data at the ends of the colors of the difference
MOST = 2.0

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True)
class Spheres:
    """Images in [0, 1] of data, fit, and the logarithm of the ratio of their luminances; gray is where nothing was measured."""

    data: Array
    fit: Array
    difference: Array


def render(data: Callable[[Array, Array], Array], fit: Callable[[Array, Array], Array], size: int = _SIZE) -> Spheres:
    """Orthographic; the tangent runs around the vertical axis."""
    y, x = np.meshgrid(np.linspace(1.0, -1.0, size), np.linspace(-1.0, 1.0, size), indexing="ij")
    inside = x * x + y * y < 0.995
    x, y = x[inside], y[inside]
    n = np.stack([x, y, np.sqrt(1.0 - x * x - y * y)], axis=1)
    t = np.stack([n[:, 2], np.zeros_like(x), -n[:, 0]], axis=1)
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    frame = np.stack([t, np.cross(n, t), n], axis=1)
    wo = frame[:, :, 2]
    radiance = [np.zeros((len(x), 3)) for _ in range(2)]
    known, lighted = np.zeros(len(x), np.bool_), np.zeros(len(x), np.bool_)
    for direction, strength, radius, count in _LIGHTS:
        for light in _cone(np.array(direction), np.radians(radius), count):
            wi = frame @ light
            lit = np.flatnonzero(wi[:, 2] > 1e-3)
            lighted[lit] = True
            first = np.broadcast_to(data(wi[lit], wo[lit]), (len(lit), 3))
            there = np.isfinite(first).all(axis=1)
            lit = lit[there]
            known[lit] = True
            scale = strength / count * wi[lit, 2:]
            radiance[0][lit] += scale * first[there]
            radiance[1][lit] += scale * np.broadcast_to(fit(wi[lit], wo[lit]), (len(lit), 3))
    known |= ~lighted
    exposure = _BRIGHT / max(float(np.quantile(radiance[0][known].mean(axis=1), _BURNT)), 1e-9) if known.any() else 1.0
    first, second = (_image(inside, np.where(known[:, None], _srgb(exposure * k), 0.6)) for k in radiance)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.log(radiance[1].mean(axis=1) / radiance[0].mean(axis=1)) / np.log(MOST)
    dark = radiance[0].mean(axis=1) * exposure < 1e-4
    ratio = np.where(known & ~dark & np.isfinite(ratio), np.clip(ratio, -1.0, 1.0), 0.0)
    return Spheres(first, second, _image(inside, _diverging(ratio)))


def _cone(axis: Array, radius: float, count: int) -> Array:
    """Directions that fill a cone evenly."""
    axis = axis / np.linalg.norm(axis)
    u = np.cross(axis, [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    r = np.tan(radius) * np.sqrt((np.arange(count) + 0.5) / count)
    turn = _GOLDEN * np.arange(count)
    w = axis + (r * np.cos(turn))[:, None] * u + (r * np.sin(turn))[:, None] * v
    return np.asarray(w / np.linalg.norm(w, axis=1, keepdims=True))


def _srgb(linear: Array) -> Array:
    x = np.clip(np.nan_to_num(linear), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)


def _image(inside: NDArray[np.bool_], colors: Array) -> Array:
    image = np.ones((*inside.shape, 3))
    image[inside] = colors
    return image


def _diverging(x: Array) -> Array:
    from matplotlib import colormaps

    return np.asarray(colormaps["RdBu_r"](0.5 + 0.5 * x)[:, :3])
