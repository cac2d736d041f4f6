"""Fewer pairs of directions, where a file has more than a fit needs."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from ..fitting.measurement import Measurement, has_azimuths
from .half_difference import half_and_difference

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: pairs that are kept of isotropic data, and of others: intervals and residuals are the same with more
ISOTROPIC, ANISOTROPIC = 1500, 3000

# Cells along the root of the half angle, its azimuth, the difference angle and its azimuth, as proportions
_PROPORTIONS = (3.0, 1.5, 1.5, 0.75)


def thinned(data: Measurement) -> Measurement:
    """One pair from each cell of half and difference angles, with as many cells as shall be left; highlights, which are small, keep their share."""
    anisotropic = has_azimuths(data)
    wanted = ANISOTROPIC if anisotropic else ISOTROPIC
    if len(data.value) <= 2 * wanted:
        return data
    above = np.flatnonzero((data.wi[:, 2] > 1e-3) & (data.wo[:, 2] > 1e-3))
    theta_h, phi_h, theta_d, phi_d = half_and_difference(data.wi[above], data.wo[above])
    unit = np.stack(
        [
            np.sqrt(theta_h / (0.5 * np.pi)),
            phi_h % np.pi / np.pi if anisotropic else 0.0 * phi_h,
            theta_d / (0.5 * np.pi),
            phi_d % np.pi / np.pi,
        ]
    )
    # any fixed order that has nothing to do with that of the file
    order = np.random.default_rng(0).permutation(len(above))
    low, high = 0.5, 200.0
    keep = order[:wanted]
    for _ in range(24):
        middle = float(np.sqrt(low * high))
        found = _first_of_each(unit[:, order], middle)
        keep = order[found]
        low, high = (middle, high) if len(found) < wanted else (low, middle)
    mask = np.zeros(len(data.value), bool)
    mask[above[keep]] = True
    note = f"{int(mask.sum())} of {len(mask)} pairs are used, spread over half and difference angles"
    return dataclasses.replace(data.only(mask), notes=(*data.notes, note))


def _first_of_each(unit: NDArray[np.float64], scale: float) -> NDArray[np.int64]:
    counts = [max(1, round(scale * part)) for part in _PROPORTIONS]
    cell = np.zeros(unit.shape[1], np.int64)
    for x, count in zip(unit, counts):
        cell = cell * count + np.minimum((x * count).astype(np.int64), count - 1)
    return np.unique(cell, return_index=True)[1]
