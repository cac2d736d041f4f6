"""RGL's ``.bsdf``: reflectance over an adaptive parametrization (Dupuy and Jakob 2018), as Mitsuba's ``measured`` evaluates it.

For each direction of the light the half vector goes through the inverse of the sampling of visible normals, and a table over that square
has reflectance times the cosine of the view, divided by ``ndf / (4 sigma)`` if ``jacobian`` says so.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UserError
from ..fitting.measurement import measurement
from .half_difference import spherical
from .marginal import Marginal, bilinear
from .source import Source
from .tensor_file import MAGIC, TensorFile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .marginal import Corners

    Array = NDArray[np.float64]

__all__ = ["MAGIC", "read"]

# Half vectors for each direction of light: at equal steps of the root of their angle; azimuths of isotropic and of other materials
_HALF, _AZIMUTHS, _AZIMUTHS_ALL = 22, 8, 12
# Directions of light of an anisotropic material
_LIGHTS, _TURNS = 5, 6


class _Rgl:
    """The tables of one file."""

    def __init__(self, path: Path) -> None:
        file = TensorFile(path)
        self.theta, self.phi = file.read("theta_i", 1), file.read("phi_i", 1)
        for name, axis in (("theta_i", self.theta), ("phi_i", self.phi)):
            if (np.diff(axis) <= 0.0).any() or np.abs(axis).max() > 2.0 * np.pi:
                raise UserError(
                    f'{path}: the field "{name}" must have increasing angles in radians, but goes from {axis[0]:.4g} to {axis[-1]:.4g}'
                )
        self.ndf, self.sigma = file.read("ndf", 2), file.read("sigma", 2)
        self.vndf = Marginal(file.read("vndf", 4))
        self.spectral = "wavelengths" in file
        self.table = file.read("spectra" if self.spectral else "rgb", 5)
        self.jacobian = bool(file.read("jacobian", 1)[0])
        channels = file.read("wavelengths", 1) if self.spectral else np.arange(3.0)
        lights = (len(self.phi), len(self.theta))
        if self.vndf.values.shape[:2] != lights or self.table.shape[:3] != (*lights, len(channels)):
            raise UserError(
                f"{path}: tables of {self.vndf.values.shape} and {self.table.shape} do not belong to {lights[0]} azimuths, {lights[1]} polar "
                f"angles and {len(channels)} channels: the file is damaged; get it again"
            )
        if self.spectral:
            self.table = np.einsum("abcde,ck->abkde", self.table, _to_srgb(channels))
        self.isotropic = len(self.phi) <= 2
        #: copies of the measured azimuths by symmetry that make a turn
        self.copies = 1 if self.isotropic else round(2.0 * np.pi / (self.phi[-1] - self.phi[0]))

    def __call__(self, wi: Array, wo: Array) -> Array:
        """Reflectance (n, 3) per steradian, without the cosine."""
        cos_o = wo[:, 2:]
        if self.copies >= 2:
            # the measured part has lights with y <= 0, and x <= 0 if it is a quarter
            y = np.where(wi[:, 1] > 0.0, -1.0, 1.0)
            x = np.where(wi[:, 0] > 0.0, -1.0, 1.0) if self.copies == 4 else y
            flip = np.stack([x, y, np.ones_like(x)], axis=1)
            wi, wo = wi * flip, wo * flip
        h = wi + wo
        h = h / np.linalg.norm(h, axis=1, keepdims=True)
        (theta_i, phi_i), (theta_h, phi_h) = (_angles(w) for w in (wi, h))
        u_i = np.stack([_root(theta_i), _turn(phi_i)])
        u_h = np.stack([_root(theta_h), _turn(phi_h - phi_i if self.isotropic else phi_h) % 1.0])
        corners = _corners(self.phi, phi_i, self.theta, theta_i)
        sample = self.vndf.invert(u_h, corners)
        value = np.zeros((len(wi), 3))
        for weight, at in corners:
            value += weight[:, None] * bilinear(self.table, at, sample)
        if self.jacobian:
            ratio = bilinear(self.ndf, None, u_h) / (4.0 * np.maximum(bilinear(self.sigma, None, u_i), 1e-12))
            value *= ratio[:, None]
        return value / np.maximum(cos_o, 1e-6)


def read(path: Path) -> Source:
    tables = _Rgl(path)
    wi, wo = _pairs(tables)
    value = tables(wi, wo)
    kind = "spectral, made sRGB under D65" if tables.spectral else "sRGB"
    lights = "isotropic" if tables.isotropic else f"{len(tables.phi)} azimuths"
    data = measurement(
        wi,
        wo,
        value,
        title=path.name,
        channels=("R", "G", "B"),
        isotropic=tables.isotropic,
        notes=(f"RGL: {lights}, {len(tables.theta)} polar angles of light, {kind}",),
        renderable=None if tables.spectral else str(path.resolve()),
    )
    return Source("RGL", data, tables)


def _pairs(tables: _Rgl) -> tuple[Array, Array]:
    """Measured directions of light, and views by facets at all angles."""
    theta = tables.theta[tables.theta < 0.5 * np.pi - 1e-3]
    phi = np.zeros(1)
    if not tables.isotropic:
        theta = theta[np.unique(np.linspace(0, len(theta) - 1, min(_LIGHTS, len(theta))).astype(int))]
        phi = tables.phi[np.unique(np.linspace(0, len(tables.phi) - 1, min(_TURNS, len(tables.phi))).astype(int))]
    count = _AZIMUTHS if tables.isotropic else _AZIMUTHS_ALL
    half = 0.5 * np.pi * ((np.arange(_HALF) + 0.5) / _HALF) ** 2
    around = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    t, p, h, a = (x.ravel() for x in np.meshgrid(theta, phi, half, around, indexing="ij"))
    wi, m = spherical(t, p), spherical(h, a)
    wo = 2.0 * np.sum(wi * m, axis=1, keepdims=True) * m - wi
    keep = (wo[:, 2] > 1e-3) & (np.sum(wi * m, axis=1) > 1e-3)
    return wi[keep], wo[keep]


def _angles(w: Array) -> tuple[Array, Array]:
    return np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2]), np.arctan2(w[:, 1], w[:, 0])


def _root(theta: Array) -> Array:
    return np.sqrt(theta / (0.5 * np.pi))


def _turn(phi: Array) -> Array:
    return (phi + np.pi) / (2.0 * np.pi)


def _corners(*axes: Array) -> Corners:
    """Weights and places of the neighbors on a grid: two for each axis with more than one entry. ``axes``: knots, positions, knots, positions."""
    found: Corners = [(np.ones_like(axes[1]), ())]
    for knots, x in zip(axes[::2], axes[1::2]):
        if len(knots) == 1:
            found = [(weight, (*at, np.zeros(len(x), np.int64))) for weight, at in found]
            continue
        low = np.asarray(np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2), np.int64)
        part = np.clip((x - knots[low]) / (knots[low + 1] - knots[low]), 0.0, 1.0)
        found = [
            (weight * (part if step else 1.0 - part), (*at, low + step)) for weight, at in found for step in (0, 1)
        ]
    return found


def _to_srgb(wavelengths: Array) -> Array:
    """Weights (n, 3) that make a reflectance at these wavelengths a color under D65."""
    import mitsuba as mi

    with mi.variant_context("scalar_rgb"):
        xyz = np.array(
            [np.array(mi.cie1931_xyz(float(w))) * float(np.array(mi.cie_d65(float(w))).ravel()[0]) for w in wavelengths]
        )
        xyz *= np.gradient(wavelengths)[:, None]
        xyz /= xyz[:, 1].sum()
        columns = [np.array(mi.xyz_to_srgb(mi.Color3f(*map(float, unit)))) for unit in np.eye(3)]
    weights = xyz @ np.array(columns)
    # white stays white: wavelengths end somewhere
    return np.asarray(weights / weights.sum(axis=0))
