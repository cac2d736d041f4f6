"""Half and difference angles of light and view (Rusinkiewicz 1998), in radians: h, and the light as seen from h."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def spherical(theta: Array, phi: Array) -> Array:
    """A direction (..., 3)."""
    sine = np.sin(theta)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)], axis=-1)


def pair_of(theta_h: Array, phi_h: Array, theta_d: Array, phi_d: Array) -> tuple[Array, Array]:
    """Light and view (n, 3)."""
    h = spherical(theta_h, phi_h)
    d = spherical(theta_d, phi_d)
    c, s = np.cos(theta_h), np.sin(theta_h)
    x, z = c * d[:, 0] + s * d[:, 2], c * d[:, 2] - s * d[:, 0]
    cos_p, sin_p = np.cos(phi_h), np.sin(phi_h)
    wi = np.stack([cos_p * x - sin_p * d[:, 1], sin_p * x + cos_p * d[:, 1], z], axis=-1)
    wo = 2.0 * np.sum(wi * h, axis=-1, keepdims=True) * h - wi
    return wi, wo


def half_and_difference(wi: Array, wo: Array) -> tuple[Array, Array, Array, Array]:
    """``theta_h``, ``phi_h``, ``theta_d``, ``phi_d`` of light and view (n, 3)."""
    h = wi + wo
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    theta_h, phi_h = np.arctan2(np.hypot(h[:, 0], h[:, 1]), h[:, 2]), np.arctan2(h[:, 1], h[:, 0])
    cos_p, sin_p = np.cos(phi_h), np.sin(phi_h)
    x, y = cos_p * wi[:, 0] + sin_p * wi[:, 1], cos_p * wi[:, 1] - sin_p * wi[:, 0]
    c, s = np.cos(theta_h), np.sin(theta_h)
    x, z = c * x - s * wi[:, 2], c * wi[:, 2] + s * x
    return theta_h, phi_h, np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
