"""UTIA's ``.bin``: anisotropic reflectance on a grid of angles (Filip and Vávra 2014).

Doubles without a header: three planes (red, green, blue), each a matrix whose rows are directions of the light and whose columns are views; within
both the azimuth is fastest, 48 of them by 7.5 degrees, and the polar angle has 6 values by 15 degrees.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UserError
from ..fitting.measurement import measurement
from .content import numbers, refuse_nan, size
from .half_difference import spherical
from .source import Source
from .thinning import thinned

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

POLAR, AZIMUTHS = 6, 48
_STEP = (15.0, 7.5)
_DIRECTIONS = POLAR * AZIMUTHS
BYTES = 3 * _DIRECTIONS**2 * 8


def read(path: Path) -> Source:
    length = size(path)
    if length != BYTES:
        what = "truncated" if length < BYTES else "too long"
        raise UserError(
            f"{path}: {what} at byte {length}: UTIA's three planes of {_DIRECTIONS} × {_DIRECTIONS} doubles take {BYTES} bytes; get the file again"
        )
    planes = numbers(path, "<f8", 0, (3, _DIRECTIONS, _DIRECTIONS))
    refuse_nan(path, planes, 0, 8, "values")
    if not (np.abs(planes) < 1e12).all():
        first = int(np.argmax(np.abs(planes).ravel() >= 1e12))
        raise UserError(
            f"{path}: byte {8 * first}: {planes.ravel()[first]:.3g} is no reflectance: the file has UTIA's length, but other contents"
        )
    polar, azimuth = (np.radians(step * np.arange(count)) for step, count in zip(_STEP, (POLAR, AZIMUTHS)))
    directions = spherical(*(a.ravel() for a in np.meshgrid(polar, azimuth, indexing="ij")))
    wi, wo = np.repeat(directions, _DIRECTIONS, axis=0), np.tile(directions, (_DIRECTIONS, 1))
    values = np.moveaxis(planes, 0, -1)
    data = measurement(wi, wo, values.reshape(-1, 3), title=path.name, channels=("R", "G", "B"))
    table = values.reshape(POLAR, AZIMUTHS, POLAR, AZIMUTHS, 3)
    return Source("UTIA", thinned(data), lambda wi, wo: _interpolated(table, wi, wo), _STEP)


def _interpolated(table: Array, wi: Array, wo: Array) -> Array:
    """Linear in all four angles; NaN beyond the last polar angle."""
    places, lows = [], []
    beyond = np.zeros(len(wi), bool)
    for w in (wi, wo):
        theta = np.degrees(np.arccos(np.clip(w[:, 2], -1.0, 1.0))) / _STEP[0]
        phi = np.degrees(np.arctan2(w[:, 1], w[:, 0])) % 360.0 / _STEP[1]
        beyond |= theta > POLAR - 1 + 1e-6
        low = np.minimum(theta.astype(np.int64), POLAR - 2), phi.astype(np.int64)
        places += [theta - low[0], phi - low[1]]
        lows += list(low)
    result = np.zeros((len(wi), 3))
    for corner in np.ndindex(2, 2, 2, 2):
        at = [(low + c) % (AZIMUTHS if k % 2 else POLAR) for k, (low, c) in enumerate(zip(lows, corner))]
        weight = np.prod([part if c else 1.0 - part for part, c in zip(places, corner)], axis=0)
        result += weight[:, None] * table[at[0], at[1], at[2], at[3]]
    return np.where(beyond[:, None], np.nan, result)
