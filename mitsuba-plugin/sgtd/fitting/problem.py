"""The least-squares problem of one distribution on one measurement: what is predicted, and how far it is off.

Variables are those of the space (shape, roughness, rotation), of the interface (F0, or an index with its color), and ln of the diffuse reflectance; all are
searched together, because a little diffuse light moves tails a lot.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Optional

import numpy as np

from ..ndf import Ndf
from . import fresnel
from .diffuse import DiffuseBase
from .measurement import Measurement
from .spaces import Space

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

LOSSES = ("log", "cbrt", "l2")
BASES = ("none", "diffuse")
MASKINGS = ("separable", "height_correlated")

#: of G1 while a fit searches, and of what it says at the end
SEARCH_ACCURACY, FINAL_ACCURACY = 1e-5, 1e-6
# Steps of derivatives: the masking table, whose cells follow the shape, is not smooth below them
_SHAPE_STEP, _COLOR_STEP = 1e-3, 1e-5
_DARKEST = float(np.log(1e-7))
# Rounds in which transmission into a plastic is computed anew, and the change of the cost that is none
_ROUNDS, _SETTLED = 4, 1e-5


@dataclass(frozen=True)
class Model:
    """What is fitted, apart from the distribution."""

    base: str = "diffuse"
    fresnel: str = "schlick"
    loss: str = "log"
    masking: str = "separable"


@dataclass(frozen=True)
class Prediction:
    """A material in numbers: evaluates reflectance for any directions."""

    ndf: Ndf
    rotation: float
    interface: fresnel.Fresnel
    diffuse: Array
    base: Optional[DiffuseBase]
    masking: str

    def __call__(self, wi: Array, wo: Array) -> Array:
        """Reflectance (n, channels) per steradian, without the cosine."""
        h = wi + wo
        h = h / np.linalg.norm(h, axis=-1, keepdims=True)
        cos_d = np.clip(np.sum(wi * h, axis=-1), 0.0, 1.0)
        lobe = lobe_of(self.ndf, self.rotation, wi, wo, h, self.masking)
        value = self.interface(cos_d) * lobe[:, None]
        if self.base is not None:
            value = value + self.base.kernel(wi[:, 2], wo[:, 2])[:, None] * self.diffuse
        return value


def turned(w: Array, rotation: float) -> Array:
    """Directions as they are in a frame that is turned by ``rotation`` about the normal."""
    if rotation == 0.0:
        return w
    c, s = np.cos(rotation), np.sin(rotation)
    return np.stack([c * w[:, 0] + s * w[:, 1], c * w[:, 1] - s * w[:, 0], w[:, 2]], axis=1)


def lobe_of(ndf: Ndf, rotation: float, wi: Array, wo: Array, h: Array, masking: str) -> Array:
    """``D G2 / (4 cos_i cos_o)``."""
    wi, wo, h = (turned(w, rotation) for w in (wi, wo, h))
    g2 = ndf.g1(wi) * ndf.g1(wo) if masking == "separable" else ndf.g2(wi, wo, masking)
    return ndf.d(h) * g2 / (4.0 * wi[:, 2] * wo[:, 2])


class Problem:
    """One space on one measurement."""

    def __init__(self, data: Measurement, model: Model, space: Space, weights: Array | None = None) -> None:
        self.data, self.model, self.space = data, model, space
        self.h, self.cos_d = data.h, data.cos_d
        self.channels = data.value.shape[1]
        self.diffuse = model.base == "diffuse"
        self.colors = fresnel.Variables(model.fresnel, self.channels, self.diffuse)
        self.count = len(space.names)
        low, high = space.bounds
        dark = np.full(self.channels if self.diffuse else 0, _DARKEST)
        self.low = np.concatenate([low, self.colors.low, dark])
        self.high = np.concatenate([high, self.colors.high, 0.0 * dark])
        self.names = (*space.names, *self.colors.names, *(f"diffuse_{k}" for k in range(len(dark))))
        self.cos_o = data.wo[:, 2:]
        self.weights = None if weights is None else np.sqrt(weights)[:, None]
        self.base: DiffuseBase | None = None
        self.transform, self.slope = _transforms(model.loss, data.value * self.cos_o)
        self.target = self.transform(data.value * self.cos_o)
        self._lobes: Callable[[bytes], Array] = functools.lru_cache(maxsize=4)(self._lobe)

    def split(self, x: Array) -> tuple[Array, Array, Array]:
        """Variables of shape, interface and base."""
        n = self.count
        m = n + len(self.colors.names)
        return x[:n], x[n:m], x[m:]

    def _lobe(self, key: bytes) -> Array:
        v = np.frombuffer(key)
        ndf = self.space.ndf(v, SEARCH_ACCURACY)
        return lobe_of(ndf, self.space.rotation(v), self.data.wi, self.data.wo, self.h, self.model.masking)

    def settle(self, x: Array) -> None:
        """Computes the transmission into a plastic of this shape; a no-op without a base."""
        if self.diffuse:
            shape, colors, _ = self.split(x)
            eta = float(self.colors.interface(colors).eta[0])
            self.base = DiffuseBase.below(self.space.ndf(shape, 1e-3), eta, self.model.masking)
            self.kernel = self.base.kernel(self.data.wi[:, 2], self.data.wo[:, 2])[:, None]

    def value(self, x: Array, lobe: Array | None = None) -> Array:
        """Predicted value (n, channels)."""
        shape, colors, diffuse = self.split(x)
        lobe = self._lobes(shape.tobytes()) if lobe is None else lobe
        value = self.colors.interface(colors)(self.cos_d) * lobe[:, None]
        return value + self.kernel * np.exp(diffuse) if self.diffuse else value

    def residual(self, x: Array) -> Array:
        difference = self.transform(self.value(x) * self.cos_o) - self.target
        return (difference if self.weights is None else difference * self.weights).ravel()

    def jacobian(self, x: Array) -> Array:
        """Of the residual: differences over the shape and the interface, exact for the base."""
        shape, colors, diffuse = self.split(x)
        lobe = self._lobes(shape.tobytes())
        interface = self.colors.interface(colors)(self.cos_d)
        value = self.value(x, lobe)
        by = np.empty((len(x), *value.shape))
        for k in range(len(x)):
            step = _SHAPE_STEP if k < self.count else _COLOR_STEP
            step = -step if x[k] + step > self.high[k] else step
            if k < self.count:
                moved = shape.copy()
                moved[k] += step
                by[k] = interface * ((self._lobe(moved.tobytes()) - lobe) / step)[:, None]
            elif k < self.count + len(colors):
                moved = colors.copy()
                moved[k - self.count] += step
                by[k] = (self.colors.interface(moved)(self.cos_d) - interface) * (lobe / step)[:, None]
            else:
                channel = k - self.count - len(colors)
                by[k] = 0.0
                by[k, :, channel] = self.kernel[:, 0] * np.exp(diffuse[channel])
        by *= self.slope(value * self.cos_o) * self.cos_o * (1.0 if self.weights is None else self.weights)
        return by.reshape(len(x), -1).T

    def cost(self, x: Array) -> float:
        """Half the sum of squares, with the transmission that belongs to these variables."""
        self.settle(x)
        residual = self.residual(x)
        return 0.5 * float(residual @ residual)

    def inside(self, x: Array) -> Array:
        """Moved off the bounds, where a search cannot begin."""
        span = np.minimum(self.high - self.low, 1.0)
        return np.clip(x, self.low + 1e-3 * span, self.high - 1e-3 * span)

    def search(self, x: Array, steps: int = 60, tolerance: float = 1e-5) -> tuple[Array, float]:
        """From one start to a minimum near it: variables and their cost."""
        from scipy.optimize import least_squares

        best, cost = x, self.cost(x)
        for _ in range(_ROUNDS if self.diffuse and steps > 10 else 1):
            found = least_squares(
                self.residual,
                self.inside(best),
                self.jacobian,
                bounds=(self.low, self.high),
                x_scale="jac",
                ftol=tolerance,
                xtol=tolerance,
                gtol=None,
                max_nfev=steps,
            )
            if not np.isfinite(found.cost):
                break
            here = self.cost(found.x)
            gained = cost - here
            if gained > 0.0:
                best, cost = found.x, here
            if gained < _SETTLED * cost:
                break
        self.settle(best)
        return best, cost

    def prediction(self, x: Array) -> Prediction:
        """The material of these variables, at the accuracy of results."""
        shape, colors, diffuse = self.split(x)
        self.settle(x)
        ndf = self.space.ndf(shape, FINAL_ACCURACY)
        rotation = self.space.rotation(shape)
        return Prediction(ndf, rotation, self.colors.interface(colors), np.exp(diffuse), self.base, self.model.masking)

    def start(self) -> tuple[Array, Array]:
        """F0 and diffuse reflectance as the data suggest them."""
        mean = self.data.value.mean(axis=0)
        dark = np.maximum(np.quantile(self.data.value, 0.1, axis=0), 1e-3 * mean)
        base = np.log(np.clip(3.0 * dark, 1e-5, 0.9)) if self.diffuse else np.empty(0)
        share = np.clip(mean / max(float(mean.max()), 1e-9), 1e-2, 1.0)
        return self.colors.start(share * (0.05 if self.diffuse else 0.3)), base


def _transforms(loss: str, values: Array) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """How values times the cosine count, and the derivative of that."""
    if loss == "log":
        return np.log1p, lambda v: 1.0 / (1.0 + v)
    scale = max(float(np.sqrt(np.mean(values**2))), 1e-12)
    if loss == "l2":
        return (lambda v: v / scale), (lambda v: 1.0 / scale + 0.0 * v)
    least = 1e-9 * scale
    return (lambda v: np.cbrt(v / scale)), (
        lambda v: np.cbrt(np.maximum(v, least) / scale) / (3.0 * np.maximum(v, least))
    )
