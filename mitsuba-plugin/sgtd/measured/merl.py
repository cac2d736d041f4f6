"""MERL's ``.binary``: 90 × 90 × 180 cells by half and difference angles (Matusik et al. 2003).

Three integers of 32 bits, the numbers of cells, then three planes (red, green, blue) of doubles, the azimuth of the difference fastest. The
polar angle of the half vector is that of cell i from ``i^2 / 90`` to ``(i + 1)^2 / 90`` degrees, that of the difference goes by one degree, its azimuth
covers half a turn: the other half is the reverse of light and view. Negative numbers say that nothing was measured.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UserError
from ..fitting.measurement import measurement
from .content import head, numbers, refuse_nan, size
from .half_difference import half_and_difference, pair_of
from .source import Source

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

CELLS = (90, 90, 180)
_HEADER = 12
_BYTES = _HEADER + 3 * 8 * int(np.prod(CELLS))
#: what a stored number of each plane is worth
SCALE = np.array([1.0, 1.15, 1.66]) / 1500.0

# Cells that a fit uses: half angles at equal steps of their root, so that peaks have their share, and a few of the others
_HALF, _DIFFERENCE, _AZIMUTH = 26, 14, 6


def is_merl(start: bytes, length: int) -> bool:
    """By its header, or by its length where the header is damaged."""
    return start[:_HEADER] == np.array(CELLS, "<i4").tobytes() or length == _BYTES


def read(path: Path) -> Source:
    length = size(path)
    cells = tuple(int(n) for n in np.frombuffer(head(path, _HEADER).ljust(_HEADER, b"\0"), "<i4"))
    if cells != CELLS:
        raise UserError(
            f"{path}: byte 0: the header says {' × '.join(map(str, cells))} cells, but MERL's files have 90 × 90 × 180: get the file again"
        )
    if length != _BYTES:
        what = "truncated" if length < _BYTES else "longer than it says"
        raise UserError(f"{path}: {what} at byte {length}: 90 × 90 × 180 cells take {_BYTES} bytes; get the file again")
    planes = numbers(path, "<f8", _HEADER, (3, *CELLS))
    refuse_nan(path, planes, _HEADER, 8, "values")
    table = np.moveaxis(planes, 0, -1)
    known: NDArray[np.bool_] = np.asarray((table >= 0.0).all(axis=-1), np.bool_)
    table = np.where(known[..., None], table * SCALE, np.nan)
    wi, wo = _directions(*np.meshgrid(*_chosen(), indexing="ij"))
    values = table[np.ix_(*_chosen())].reshape(-1, 3)
    above = (wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)
    inside = above & np.isfinite(values).all(axis=1)
    notes = []
    if (above & ~inside).any():
        notes.append(
            f"{int((above & ~inside).sum())} of {int(above.sum())} cells above the horizon say that they were not measured"
        )
    data = measurement(
        wi[inside],
        wo[inside],
        values[inside],
        title=path.name,
        channels=("R", "G", "B"),
        isotropic=True,
        notes=(f"MERL: {int(inside.sum())} of {int(known.sum())} cells are used", *notes),
    )
    return Source("MERL", data, lambda wi, wo: _interpolated(table, wi, wo))


def _chosen() -> tuple[NDArray[np.int64], ...]:
    """Cells along each axis that a fit uses."""
    counts = (_HALF, _DIFFERENCE, _AZIMUTH)
    return tuple(
        np.asarray((np.arange(count) + 0.5) * cells / count, dtype=np.int64) for count, cells in zip(counts, CELLS)
    )


def _directions(
    half: NDArray[np.int64], difference: NDArray[np.int64], azimuth: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Light and view in the middles of cells."""
    theta_h = np.radians((half.ravel() + 0.5) ** 2 / 90.0)
    theta_d, phi_d = np.radians(difference.ravel() + 0.5), np.radians(azimuth.ravel() + 0.5)
    return pair_of(theta_h, np.zeros_like(theta_h), theta_d, phi_d)


def _interpolated(table: Array, wi: Array, wo: Array) -> Array:
    """Linear between the middles of those neighboring cells that were measured; NaN if there is none."""
    theta_h, _, theta_d, phi_d = half_and_difference(wi, wo)
    places = np.stack(
        [np.sqrt(90.0 * np.degrees(theta_h)) - 0.5, np.degrees(theta_d) - 0.5, np.degrees(phi_d) % 180.0 - 0.5]
    )
    low = np.floor(places).astype(np.int64)
    part = places - low
    total, weights = np.zeros((len(wi), table.shape[-1])), np.zeros(len(wi))
    for corner in np.ndindex(2, 2, 2):
        at = low + np.array(corner)[:, None]
        at[0], at[1] = np.clip(at[0], 0, CELLS[0] - 1), np.clip(at[1], 0, CELLS[1] - 1)
        at[2] %= CELLS[2]
        values = table[at[0], at[1], at[2]]
        weight = np.prod(np.where(np.array(corner)[:, None] == 1, part, 1.0 - part), axis=0)
        weight = np.where(np.isfinite(values).all(axis=1), weight, 0.0)
        total += weight[:, None] * np.nan_to_num(values)
        weights += weight
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weights[:, None] > 1e-9, total / weights[:, None], np.nan)
