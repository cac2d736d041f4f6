"""What facets reflect: Fresnel's equations of an index that is fitted.

A renderer has no Schlick term, so none is fitted: ``schlick`` means one number for each channel, the reflectance F0 along the normal, and
the exact reflectance of the index ``eta = (1 + sqrt F0) / (1 - sqrt F0)`` that has it. No solid has an index below 1.3, so none is
fitted: what a fit gains there is a grazing brightness that no interface has. ``conductor`` has one more for each channel, the edge tint g of
Gulbrandsen (2014), which spans all complex indices of one F0; ``dielectric`` has one index for all channels, and a factor for each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

KINDS = ("schlick", "dielectric", "conductor")

#: of F0: less could not be measured, more is the mirror of an index above 4000
LEAST, GREATEST = 1e-6, 0.999
#: F0 of an index of 1.3, the least that is fitted
LEAST_INDEX = (0.3 / 2.3) ** 2
#: of factors on a reflectance
LEAST_FACTOR = 1e-6


@dataclass(frozen=True)
class Fresnel:
    """Index ``eta + i k`` and a factor for each channel."""

    eta: Array
    k: Array
    factor: Array

    def __call__(self, cos: Array) -> Array:
        """Reflectance (n, channels) at cosines (n)."""
        return self.factor * reflectance(self.eta, self.k, cos[:, None])


def reflectance(eta: Array, k: Array, cos: Array) -> Array:
    """Unpolarized reflectance of an interface from vacuum into ``eta + i k``: the mean of Fresnel's two."""
    square, sine2 = cos * cos, 1.0 - cos * cos
    eta2, k2 = eta * eta, k * k
    t0 = eta2 - k2 - sine2
    a2b2 = np.sqrt(t0 * t0 + 4.0 * eta2 * k2)
    a = np.sqrt(np.maximum(0.5 * (a2b2 + t0), 0.0))
    t1, t2 = a2b2 + square, 2.0 * cos * a
    s = (t1 - t2) / (t1 + t2)
    t3, t4 = square * a2b2 + sine2 * sine2, t2 * sine2
    with np.errstate(invalid="ignore", divide="ignore"):
        p = s * (t3 - t4) / (t3 + t4)
    return 0.5 * (np.where(np.isfinite(p), p, s) + s)


def index(f0: Array) -> Array:
    """The real index that reflects ``f0`` along the normal."""
    root = np.sqrt(f0)
    return (1.0 + root) / (1.0 - root)


class Variables:
    """Numbers of a least-squares problem, and the interface that they mean: ln F0 for each channel, and what the kind adds."""

    def __init__(self, kind: str, channels: int, plastic: bool) -> None:
        self.kind, self.channels, self.plastic = kind, channels, plastic
        high = np.log(GREATEST)
        if kind == "dielectric":
            self.names = ("f0", *(f"specular_{k}" for k in range(channels)))
            self.low = np.array([np.log(LEAST_INDEX), *[np.log(LEAST_FACTOR)] * channels])
            self.high = np.array([np.log(0.5), *[0.0] * channels])
        else:
            self.names = tuple(f"f0_{k}" for k in range(channels))
            # a plastic has one index, that of its brightest channel, and its other channels are less by a factor
            self.low, self.high = np.full(channels, np.log(LEAST if plastic else LEAST_INDEX)), np.full(channels, high)
            if kind == "conductor":
                self.names += tuple(f"tint_{k}" for k in range(channels))
                self.low = np.concatenate([self.low, np.zeros(channels)])
                self.high = np.concatenate([self.high, np.ones(channels)])

    def start(self, f0: Array) -> Array:
        """Variables of a reflectance (channels) along the normal."""
        f0 = np.clip(f0, 2.0 * LEAST_INDEX, 0.9)
        if self.kind == "dielectric":
            top = np.clip(f0.max(), 0.04, 0.3)
            return np.concatenate([[np.log(top)], np.log(np.clip(f0 / top, 2.0 * LEAST_FACTOR, 0.999))])
        rest = np.full(self.channels, 0.5) if self.kind == "conductor" else np.empty(0)
        return np.concatenate([np.log(f0), rest])

    def interface(self, v: Array) -> Fresnel:
        ones, n = np.ones(self.channels), self.channels
        if self.kind == "dielectric":
            return Fresnel(index(np.exp(v[0])) * ones, 0.0 * ones, np.exp(v[1:]))
        f0 = np.exp(v[:n])
        if self.kind == "conductor":
            eta = v[n:] * (1.0 - f0) / (1.0 + f0) + (1.0 - v[n:]) * index(f0)
            return Fresnel(eta, np.sqrt(np.maximum((f0 * (eta + 1.0) ** 2 - (eta - 1.0) ** 2) / (1.0 - f0), 0.0)), ones)
        if self.plastic:
            top = max(f0.max(), LEAST_INDEX)
            return Fresnel(index(top) * ones, 0.0 * ones, f0 / f0.max())
        return Fresnel(index(f0), 0.0 * ones, ones)
