"""A measured reflectance as arrays, and what can be said of it before anything is fitted."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Optional

import numpy as np

from ..errors import UserError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

# How far the length of a direction may be from 1, as everywhere in the package
_UNIT = 1e-4
# Azimuths of the light that are nearer than this are one
_SAME_AZIMUTH = 1e-3
# A pair of directions counts as another one's reverse within this distance
_SAME = 1e-3
# Values that are this far below their neighbors on both sides of a border look like a shadow
_SHADOW = 0.05


@dataclass(frozen=True)
class Measurement:
    """Reflectance ``value`` (n, channels), per steradian and without the cosine, for light from ``wi`` and views along ``wo`` (n, 3), unit
    vectors with z along the normal.

    ``isotropic`` says that the file has no azimuth of the light. ``notes`` are what was found and changed on the way here.
    """

    title: str
    wi: Array
    wo: Array
    value: Array
    channels: tuple[str, ...] = ()
    isotropic: bool = False
    notes: tuple[str, ...] = ()
    #: how the data can be rendered: the file of Mitsuba's ``measured``
    renderable: Optional[str] = None

    @property
    def h(self) -> Array:
        """The half vectors."""
        both = self.wi + self.wo
        return both / np.linalg.norm(both, axis=1, keepdims=True)

    @property
    def cos_d(self) -> Array:
        """Cosine between light and half vector."""
        return np.clip(np.sum(self.wi * self.h, axis=1), 0.0, 1.0)

    def only(self, keep: NDArray[np.bool_]) -> Measurement:
        return dataclasses.replace(self, wi=self.wi[keep], wo=self.wo[keep], value=self.value[keep])


def measurement(
    wi: ArrayLike,
    wo: ArrayLike,
    value: ArrayLike,
    *,
    title: str = "data",
    channels: tuple[str, ...] = (),
    isotropic: bool = False,
    notes: tuple[str, ...] = (),
    renderable: str | None = None,
) -> Measurement:
    """Checks arrays: directions of length 1, as many values as directions, all of them numbers."""
    light, view = (_directions(name, given) for name, given in (("wi", wi), ("wo", wo)))
    try:
        shape = np.broadcast_shapes(light.shape[:-1], view.shape[:-1])
    except ValueError:
        raise UserError(f"{title}: wi has shape {light.shape} and wo {view.shape}; they must go together") from None
    light, view = (np.broadcast_to(w, (*shape, 3)).reshape(-1, 3) for w in (light, view))
    values = np.asarray(value)
    if values.dtype.kind not in "fiu":
        raise UserError(f"{title}: values have the type {values.dtype}; they must be real numbers")
    if values.shape[: len(shape)] != shape or values.ndim > len(shape) + 1:
        raise UserError(
            f"{title}: values have shape {values.shape}, directions {shape}; give one value, or one list of channels, to each pair"
        )
    values = values.astype(np.float64).reshape(len(light), -1)
    if channels and len(channels) != values.shape[1]:
        raise UserError(f"{title}: {len(channels)} names for {values.shape[1]} channels")
    bad: NDArray[np.bool_] = np.asarray(~np.isfinite(values).all(axis=1), dtype=np.bool_)
    if bad.any():
        raise UserError(
            f"{title}: {int(bad.sum())} of {len(bad)} values are not numbers, the first in row {int(np.argmax(bad))}: leave these rows out"
        )
    names = channels or _names(values.shape[1])
    return Measurement(title, light.copy(), view.copy(), values, names, isotropic, notes, renderable)


def _names(count: int) -> tuple[str, ...]:
    return ("value",) if count == 1 else tuple("RGB") if count == 3 else tuple(f"c{k}" for k in range(count))


def _directions(name: str, given: ArrayLike) -> Array:
    w = np.asarray(given, dtype=np.float64)
    if w.ndim == 0 or w.shape[-1] != 3:
        raise UserError(f"{name} has shape {w.shape}; it must be (..., 3)")
    with np.errstate(invalid="ignore"):
        wrong = ~(np.abs(np.linalg.norm(w, axis=-1) - 1.0) <= _UNIT)
    if wrong.any():
        place = ", ".join(map(str, np.argwhere(wrong)[0]))
        raise UserError(f"{name}: direction [{place}] is not of length 1: divide directions by their length")
    return w


def usable(data: Measurement, max_angle: float) -> Measurement:
    """What a fit uses: both directions within ``max_angle`` degrees of the normal, no negative values and no shadowed borders; says in its
    notes what was left out, and what else is odd."""
    if not 5.0 <= max_angle < 90.0:
        raise UserError(f"the greatest angle is {max_angle:g}, but must be between 5 and 90 degrees")
    notes = list(data.notes)
    above = (data.wi[:, 2] > 0.0) & (data.wo[:, 2] > 0.0)
    if not above.all():
        notes.append(
            f"{int((~above).sum())} of {len(above)} pairs have a direction below the surface; they are left out"
        )
    limit = np.cos(np.radians(max_angle)) - 1e-9
    near = above & (data.wi[:, 2] >= limit) & (data.wo[:, 2] >= limit)
    if not near.any():
        raise UserError(
            f"{data.title}: no pair of directions is within {max_angle:g} degrees of the normal; allow more with a greater angle (--max-angle)"
        )
    left_out = int((above & ~near).sum())
    if left_out:
        notes.append(f"{left_out} pairs with a direction beyond {max_angle:g}° are left out")
    data = data.only(near)
    negative: NDArray[np.bool_] = np.asarray((data.value < 0.0).any(axis=1), dtype=np.bool_)
    if negative.any():
        notes.append(
            f"{int(negative.sum())} of {len(negative)} values are negative, the least {data.value.min():.3g}; they are left out"
        )
        data = data.only(~negative)
    shadowed = _shadowed(data)
    if shadowed.any():
        notes.append(
            f"{int(shadowed.sum())} values of exactly 0 lie at grazing angles among greater ones: the instrument shadows itself there; they are left out"
        )
        data = data.only(~shadowed)
    if len(data.value) < 8 or not (data.value > 0.0).any():
        raise UserError(
            f"{data.title}: {len(data.value)} usable values, of which {int((data.value > 0).any(axis=1).sum())} are positive: too few for a fit"
        )
    notes += _oddities(data)
    return dataclasses.replace(data, notes=tuple(notes))


def _shadowed(data: Measurement) -> NDArray[np.bool_]:
    """Zeros in all channels beyond 60 degrees, where most of what is seen elsewhere at such angles is positive."""
    zero = (data.value == 0.0).all(axis=1)
    grazing = np.minimum(data.wi[:, 2], data.wo[:, 2]) < 0.5
    share = zero[grazing].mean() if grazing.any() else 0.0
    return zero & grazing if zero.any() and share < 0.5 and zero.mean() < 0.5 else np.zeros(len(zero), bool)


def _oddities(data: Measurement) -> list[str]:
    notes = []
    energy = _albedo(data)
    if energy > 1.5:
        notes.append(
            f"a facing view reflects about {energy:.2g} of the light that comes: more than all, so values are not per steradian, or they lack a scale"
        )
    elif float(data.value.max()) < 1e-3:
        notes.append(
            f"the greatest value is {data.value.max():.2g} per steradian: darker than soot, so values may lack a scale"
        )
    difference, pairs = reciprocity(data)
    if pairs >= 10 and difference > 0.1:
        notes.append(
            f"{pairs} pairs were measured in both directions, and differ by {100 * difference:.0f} % (median): values may contain a cosine, and no fit can be better than that"
        )
    return notes


def _albedo(data: Measurement) -> float:
    """A rough estimate of what the steepest light loses to reflection: the mean of value cos over views, times pi if they cover the dome."""
    first = data.wi[:, 2] >= np.quantile(data.wi[:, 2], 0.9)
    weights = np.sqrt(np.maximum(1.0 - data.wo[first, 2] ** 2, 1e-6))
    mean = (data.value[first].mean(axis=1) * data.wo[first, 2] * weights).sum() / (weights).sum()
    # views of a fine lobe are denser than the dome: only the order of magnitude counts
    body = np.median(data.value[first].mean(axis=1) * data.wo[first, 2])
    return float(np.pi * min(mean, 4.0 * body))


def reciprocity(data: Measurement) -> tuple[float, int]:
    """Median relative difference between values of a pair and of its reverse, up to a rotation about the normal for isotropic data; and
    how many such pairs there are."""
    azimuth_i, azimuth_o = (np.arctan2(w[:, 1], w[:, 0]) for w in (data.wi, data.wo))
    theta_i, theta_o = (np.arccos(np.clip(w[:, 2], -1.0, 1.0)) for w in (data.wi, data.wo))
    if data.isotropic or not has_azimuths(data):
        turn = np.abs((azimuth_o - azimuth_i + np.pi) % (2.0 * np.pi) - np.pi)
        turn[np.minimum(theta_i, theta_o) < 1e-6] = 0.0
        forth, back = (np.stack(k, axis=1) for k in ((theta_i, theta_o, turn), (theta_o, theta_i, turn)))
    else:
        forth, back = np.hstack([data.wi, data.wo]), np.hstack([data.wo, data.wi])
    from scipy.spatial import cKDTree

    distance, other = cKDTree(forth).query(back, distance_upper_bound=_SAME)
    found = np.isfinite(distance) & (np.abs(theta_i - theta_o) > _SAME)
    if not found.any():
        return 0.0, 0
    a, b = data.value[found].mean(axis=1), data.value[other[found]].mean(axis=1)
    return float(np.median(2.0 * np.abs(a - b) / np.maximum(a + b, 1e-12))), int(found.sum()) // 2


def has_azimuths(data: Measurement) -> bool:
    """Was the sample turned: does the light come from more than one plane?"""
    oblique = data.wi[:, 2] < 0.999
    if data.isotropic or not oblique.any():
        return False
    azimuth = np.arctan2(data.wi[oblique, 1], data.wi[oblique, 0]) % np.pi
    doubled = np.exp(2j * azimuth)
    return bool(np.abs(doubled - doubled[0]).max() > _SAME_AZIMUTH)
