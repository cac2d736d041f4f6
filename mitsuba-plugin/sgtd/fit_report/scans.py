"""Scans through the data and the fit: values in the plane of incidence at several angles of the light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..fitting import Fit
from ..measured import Source

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: degrees of the light that are shown, as far as the data go
INCIDENCES = (8.0, 30.0, 50.0, 70.0)
# Pairs this near to the plane of incidence belong to a scan; fewer are none
_NEAR = np.sin(np.radians(2.0))
_FEWEST = 8
# Lines are drawn so finely, and around the mirror direction finer
_STEPS = 240


@dataclass(frozen=True)
class Scan:
    """``angle`` in degrees, positive on the mirror's side; ``value`` (n, channels) measured there. The lines have their own ``fine`` angles."""

    theta_i: float
    phi_i: float
    angle: Array
    value: Array
    fine: Array
    #: pairs of directions along ``fine``
    wi: Array
    wo: Array


def scans(fit: Fit, source: Source, max_angle: float) -> list[Scan]:
    """From what the file says between its directions, or from the pairs that lie in the plane of incidence."""
    if source.evaluate is None:
        return _from_pairs(fit)
    limit = min(max_angle, 89.0)
    turned = not fit.data.isotropic and "alpha_u" in fit.parameters
    made = []
    for theta in INCIDENCES:
        for phi in _axes(fit) if turned else [0.0]:
            angle = np.concatenate([np.linspace(-limit, limit, 61), theta + np.linspace(-6.0, 6.0, 25)])
            if source.steps is not None:
                # at the points of the grid, and not between them
                step, turn = source.steps
                theta, phi = step * round(theta / step), turn * round(phi / turn)
                angle = step * np.arange(-np.floor(limit / step), np.floor(limit / step) + 1.0)
            angle = np.unique(angle[np.abs(angle) <= limit])
            if theta < limit:
                value = source.evaluate(*in_plane(theta, phi, angle))
                known = np.isfinite(value).all(axis=1)
                if known.any():
                    made.append(_scan(theta, phi, angle[known], value[known], limit))
    return made


def _axes(fit: Fit) -> list[float]:
    turn = fit.parameters.get("rotation", 0.0)
    return [turn, turn + 90.0]


def _from_pairs(fit: Fit) -> list[Scan]:
    data = fit.data
    sine = np.hypot(data.wi[:, 0], data.wi[:, 1])
    phi = np.where(sine > 1e-6, np.arctan2(data.wi[:, 1], data.wi[:, 0]), 0.0)
    # where the light comes along the normal, every plane will do: the one with the view
    phi = np.where(sine > 1e-6, phi, np.arctan2(data.wo[:, 1], data.wo[:, 0]) + np.pi)
    off = np.abs(-np.sin(phi) * data.wo[:, 0] + np.cos(phi) * data.wo[:, 1]) < _NEAR
    along = -(np.cos(phi) * data.wo[:, 0] + np.sin(phi) * data.wo[:, 1])
    theta = np.round(np.degrees(np.arccos(np.clip(data.wi[:, 2], -1.0, 1.0))), 0)
    angle = np.degrees(np.arctan2(along, data.wo[:, 2]))
    turn = np.round(np.degrees(phi) % 360.0, 0)
    groups = [
        (t, p, np.flatnonzero(off & (theta == t) & (turn == p)))
        for t, p in sorted(set(zip(theta[off].tolist(), turn[off].tolist())))
    ]
    groups = [group for group in groups if len(group[2]) >= _FEWEST]
    if not groups:
        return []
    chosen: dict[tuple[float, float], NDArray[np.int64]] = {}
    for wanted in INCIDENCES:
        t, p, rows = min(groups, key=lambda group: (abs(group[0] - wanted), -len(group[2])))
        chosen[(t, p)] = rows
    limit = float(np.abs(angle[off]).max())
    made = []
    for (t, p), rows in chosen.items():
        rows = rows[np.argsort(angle[rows])]
        made.append(_scan(t, p, angle[rows], data.value[rows], limit))
    return made


def _scan(theta: float, phi: float, angle: Array, value: Array, limit: float) -> Scan:
    fine = np.concatenate([np.linspace(-limit, limit, _STEPS), theta + 8.0 * np.linspace(-1.0, 1.0, 121) ** 3])
    fine = np.unique(fine[np.abs(fine) <= limit])
    return Scan(theta, phi, angle, value, fine, *in_plane(theta, phi, fine))


def in_plane(theta: float, phi: float, angle: Array) -> tuple[Array, Array]:
    """Light at ``theta`` and ``phi``, views at signed ``angle`` in its plane, positive opposite to it; degrees."""
    t, p, a = np.radians(theta), np.radians(phi), np.radians(angle)
    wi = np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])
    wo = np.stack([-np.sin(a) * np.cos(p), -np.sin(a) * np.sin(p), np.cos(a)], axis=1)
    return np.broadcast_to(wi, wo.shape).copy(), wo
