"""The distributions of the family over numpy arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from . import _core

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

# How far the length of a direction may be from 1: single precision after a few operations.
_UNIT_TOLERANCE = 1e-4

# The range of roughness that the core accepts.
_ALPHA_RANGE = (1e-6, 1e6)


class Ndf:
    """A normal distribution of the SGTD family at given roughness.

    With the slope ``t = tan(theta)`` of a normal and ``x = t / alpha``::

        D = A f(x) / (pi alpha_u alpha_v cos(theta)^4)
        f(x) = (1 + u / (gamma - 1))^(-gamma),  u = (|x - shift| / (1 +- lam))^(2 p)

    with + where x exceeds the shift; ``gamma = inf`` means ``f = exp(-u)``. The defaults are GGX.

    Directions are unit vectors in the local frame, where z is the normal of the surface: one of shape (3,), or many of shape (N, 3).
    Results have shape () or (N,); one direction goes with many. Densities are per solid angle. Bad arguments raise ``ValueError``.

    ``accuracy`` is the permitted relative error of :meth:`g1` (0 to 0.1). 0, the default, computes it by quadrature on every call
    (Student's distribution by a closed form); the plugin's default of 1e-5 is 30 to some hundred times faster.
    """

    def __init__(
        self,
        gamma: float = 2.0,
        p: float = 1.0,
        lam: float = 0.0,
        shift: float = 0.0,
        alpha_u: float = 0.1,
        alpha_v: float = 0.1,
        accuracy: float = 0.0,
    ) -> None:
        values = dict(gamma=gamma, p=p, lam=lam, shift=shift, alpha_u=alpha_u, alpha_v=alpha_v, accuracy=accuracy)
        for name, value in values.items():
            try:
                values[name] = float(value)
            except (TypeError, ValueError):
                raise ValueError(f"{name}: {value!r} is not a number") from None
        for name in ("alpha_u", "alpha_v"):
            low, high = _ALPHA_RANGE
            if not low <= values[name] <= high:
                raise ValueError(f'parameter "{name}" is {values[name]:g}, but must be between {low:g} and {high:g}')
        self._shape = (values["gamma"], values["p"], values["lam"], values["shift"])
        self._alpha = (values["alpha_u"], values["alpha_v"])
        self._given_accuracy = values["accuracy"]
        self._core = _core.Ndf.get(*self._shape, self._given_accuracy)

    @classmethod
    def row(
        cls,
        name: str,
        *,
        gamma: float | None = None,
        p: float | None = None,
        lam: float | None = None,
        shift: float | None = None,
        alpha_u: float = 0.1,
        alpha_v: float = 0.1,
        accuracy: float = 0.0,
    ) -> Ndf:
        """A named row of the family, as the plugin's ``distribution``: only parameters that the row leaves free may be given."""
        *shape, alpha_scale = _core.shape_of_row(name, gamma, p, lam, shift)
        return cls(*shape, alpha_scale * alpha_u, alpha_scale * alpha_v, accuracy)

    def __repr__(self) -> str:
        gamma, p, lam, shift = self._shape
        return (
            f"Ndf(gamma={gamma:g}, p={p:g}, lam={lam:g}, shift={shift:g}, "
            f"alpha_u={self.alpha_u:g}, alpha_v={self.alpha_v:g}, accuracy={self._given_accuracy:g})"
        )

    @property
    def alpha_u(self) -> float:
        """Roughness along x."""
        return self._alpha[0]

    @property
    def alpha_v(self) -> float:
        """Roughness along y."""
        return self._alpha[1]

    @property
    def normalization(self) -> float:
        """The factor A."""
        return self._core.normalization

    @property
    def accuracy_reached(self) -> float:
        """The relative error of :meth:`g1` that the tables have."""
        return self._core.accuracy_reached

    @property
    def node(self) -> str:
        """The row of the family at which the shape runs: the lowest that its numbers allow."""
        return _core.lowest_node(*self._shape)[0]

    @property
    def table_bytes(self) -> int:
        """Memory of the tables."""
        return self._core.table_bytes

    def d(self, m: ArrayLike) -> Array:
        """The distribution of normals D(m)."""
        (m,), shape = _directions(m=m)
        return self._core.d(*self._alpha, m).reshape(shape)

    def lambda_(self, w: ArrayLike) -> Array:
        """Smith's Lambda: masked area over visible area."""
        (w,), shape = _directions(w=w)
        return self._core.lambda_(*self._alpha, w).reshape(shape)

    def g1(self, w: ArrayLike) -> Array:
        """Smith's masking 1 / (1 + Lambda)."""
        (w,), shape = _directions(w=w)
        return self._core.g1(*self._alpha, w).reshape(shape)

    def g2(self, wi: ArrayLike, wo: ArrayLike, masking: str = "separable") -> Array:
        """Masking and shadowing, ``"separable"`` or ``"height_correlated"``."""
        if masking not in ("separable", "height_correlated"):
            raise ValueError(f'masking: {masking!r} is not known; it must be "separable" or "height_correlated"')
        (wi, wo), shape = _directions(wi=wi, wo=wo)
        return self._core.g2(*self._alpha, wi, wo, masking == "height_correlated").reshape(shape)

    def pdf(self, wi: ArrayLike, m: ArrayLike, visible: bool = True) -> Array:
        """Density of the normals that :meth:`sample` draws."""
        (wi, m), shape = _directions(wi=wi, m=m)
        return self._core.pdf(*self._alpha, wi, m, bool(visible)).reshape(shape)

    def sample(self, wi: ArrayLike, u: ArrayLike, visible: bool = True) -> tuple[Array, Array]:
        """Draws normals with random numbers ``u`` of shape (2,) or (N, 2) in [0, 1).

        Returns the normals and their densities; a density of 0 marks a sample that no reflection can use.
        """
        (wi,), _ = _directions(wi=wi)
        u = _vectors("u", u, 2)
        if _core.first_outside(u, 0.0, np.nextafter(1.0, 0.0)) < u.size:
            raise ValueError("u: all numbers must be in [0, 1)")
        (wi, u), shape = _together(wi=wi, u=u)
        normals, pdf = self._core.sample(*self._alpha, wi, u, bool(visible))
        return normals.reshape((*shape, 3)), pdf.reshape(shape)

    def profile(self, x: ArrayLike) -> Array:
        """f at the stretched radial slope x >= 0."""
        x = _numbers("x", x, 0.0, np.inf)
        return self._core.profile(x).reshape(x.shape)

    def cdf(self, x: ArrayLike) -> Array:
        """Probability under D cos that the stretched radial slope is below x."""
        x = _numbers("x", x, 0.0, np.inf)
        return self._core.cdf(x).reshape(x.shape)

    def sf(self, x: ArrayLike) -> Array:
        """1 - cdf(x), to full precision in the tail."""
        x = _numbers("x", x, 0.0, np.inf)
        return self._core.sf(x).reshape(x.shape)

    def quantile(self, u: ArrayLike) -> Array:
        """The x with cdf(x) = u."""
        u = _numbers("u", u, 0.0, 1.0)
        return self._core.quantile(u).reshape(u.shape)

    def isf(self, s: ArrayLike) -> Array:
        """The x with sf(x) = s, to full precision in the tail."""
        s = _numbers("s", s, 0.0, 1.0)
        return self._core.isf(s).reshape(s.shape)


def _array(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name}: the type of its elements is {array.dtype}; it must be real numbers")
    return np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)


def _numbers(name: str, values: ArrayLike, low: float, high: float) -> Array:
    array = _array(name, values)
    if _core.first_outside(array, low, high) < array.size:
        raise ValueError(f"{name}: all numbers must be between {low:g} and {high:g}")
    return array


def _vectors(name: str, values: ArrayLike, size: int) -> Array:
    array = _array(name, values)
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise ValueError(f"{name}: its shape is {array.shape}; it must be ({size},) or (N, {size})")
    return array


def _directions(**named: ArrayLike) -> tuple[list[Array], tuple[int, ...]]:
    """Checks unit vectors; returns them with as many rows each, and the shape of the results."""
    arrays = {}
    for name, values in named.items():
        array = _vectors(name, values, 3)
        wrong = _core.first_of_wrong_length(array, _UNIT_TOLERANCE)
        if wrong < array.size // 3:
            row = f" {wrong}" if array.ndim == 2 else ""
            length = np.linalg.norm(np.atleast_2d(array)[wrong])
            raise ValueError(f"{name}: direction{row} has length {length:g}; it must be 1")
        arrays[name] = array
    return _together(**arrays)


def _together(**arrays: Array) -> tuple[list[Array], tuple[int, ...]]:
    """Repeats single vectors so that all arrays have as many rows."""
    counts = {name: array.shape[0] for name, array in arrays.items() if array.ndim == 2}
    if len(set(counts.values())) > 1:
        listing = ", ".join(f"{name} has {count}" for name, count in counts.items())
        raise ValueError(f"the numbers of rows differ: {listing}")
    shape = (next(iter(counts.values())),) if counts else ()
    full = [np.ascontiguousarray(np.broadcast_to(a, (*shape, a.shape[-1]))) for a in arrays.values()]
    return full, shape
