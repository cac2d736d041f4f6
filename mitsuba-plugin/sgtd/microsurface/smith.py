"""What Smith's model says of a surface that a goniometer measures: single scattering, binned like the measurement.

Two models share the code: that of the target distribution, and that of the surface's own facets, whose slopes are drawn from the surface
itself. What the second one has wrong is the model's fault alone; what only the first one has wrong is that a finite surface is not its
target (cut tails, mostly).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..errors import require
from ..ndf import Ndf
from .goniometer import Scattered, Setup
from .surface import Surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MASKINGS = ("separable", "height_correlated")

# Nodes over the polar angle and the azimuth between which the projected area of a mesh is interpolated: to 1e-4.
_POLAR, _AZIMUTHS = 40, 24

# Points of a scrambled Sobol sequence.
COUNT = 1 << 17


class SmithModel(Protocol):
    """Facets that do not know of each other."""

    def visible(self, wi: Array, u: Array) -> tuple[Array, Array]:
        """Normals (n, 3) that are seen from ``wi``, and weights by which their density is ``D <wi, m> / projected area``."""

    def projected_area(self, w: Array) -> Array:
        """``cos(theta) (1 + Lambda)`` of directions (n, 3) above the horizon."""


class TargetModel:
    """Of a distribution."""

    def __init__(self, ndf: Ndf) -> None:
        self._ndf = ndf

    def visible(self, wi: Array, u: Array) -> tuple[Array, Array]:
        m, pdf = self._ndf.sample(wi, u)
        exact = self._ndf.d(m) * np.maximum(m @ wi, 0.0) / self.projected_area(wi[None])
        return m, np.divide(exact, pdf, out=np.zeros_like(pdf), where=pdf > 0.0)

    def projected_area(self, w: Array) -> Array:
        return np.maximum(w[:, 2], 1e-300) * (1.0 + self._ndf.lambda_(w))


class MeshModel:
    """Of the facets that a surface has."""

    def __init__(self, surface: Surface) -> None:
        require("report")
        from scipy.interpolate import RectBivariateSpline

        self._slopes = surface.slopes()
        theta = np.linspace(0.0, 0.5 * math.pi, _POLAR)
        # a few azimuths more on both sides, as the spline does not know that they repeat
        phi = 2.0 * math.pi * np.arange(-4, _AZIMUTHS + 5) / _AZIMUTHS
        inside = slice(4, _AZIMUTHS + 4)
        t, p = np.meshgrid(theta, phi[inside], indexing="ij")
        w = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.maximum(np.cos(t), 0.0)], axis=-1)
        area = surface.projected_area(w)
        self._area = RectBivariateSpline(theta, phi, np.take(area, np.arange(-4, _AZIMUTHS + 5), axis=1, mode="wrap"))

    def visible(self, wi: Array, u: Array) -> tuple[Array, Array]:
        facing = np.cumsum(np.maximum(wi[2] - self._slopes @ wi[:2], 0.0))
        slopes = self._slopes[np.searchsorted(facing, u[:, 0] * facing[-1], side="right").clip(max=len(facing) - 1)]
        m = np.concatenate([-slopes, np.ones((len(slopes), 1))], axis=1)
        return m / np.linalg.norm(m, axis=1, keepdims=True), np.ones(len(m))

    def projected_area(self, w: Array) -> Array:
        theta = np.arccos(np.clip(w[:, 2], 0.0, 1.0))
        phi = np.arctan2(w[:, 1], w[:, 0]) % (2.0 * math.pi)
        return self._area.ev(theta, phi)


def single_scattering(model: SmithModel, setup: Setup, masking: str, count: int = COUNT) -> Scattered:
    """Light that meets one facet: ``F G2 / G1`` of each visible normal, reflected or refracted. All of it is in the first order."""
    require("report")
    from scipy.stats import qmc

    u = np.minimum(qmc.Sobol(2, rng=setup.seed).random(count), np.nextafter(1.0, 0.0))
    wi = setup.wi
    m, weight = model.visible(wi, u)
    cosine = np.clip(m @ wi, 0.0, 1.0)
    fresnel = setup.reflectance(cosine)
    lambda_i = float(model.projected_area(wi[None])[0]) / wi[2] - 1.0
    bins = setup.bins
    shape = (2, bins.orders, bins.polar, bins.azimuths, 3)
    energy, squares = np.zeros(shape), np.zeros(shape)

    def add(w: Array, above: bool, weights: Array) -> None:
        leaves = (w[:, 2] > 0.0) if above else (w[:, 2] < 0.0)
        leaves &= (cosine > 0.0) & (weight > 0.0)
        w, weights = w[leaves], weights[leaves] * weight[leaves, None]
        mirrored = w * (1.0, 1.0, 1.0 if above else -1.0)
        lambda_o = model.projected_area(mirrored) / np.maximum(mirrored[:, 2], 1e-12) - 1.0
        weights = weights * _g2_over_g1(masking, lambda_i, np.maximum(lambda_o, 0.0), above)[:, None]
        hemisphere, polar, azimuth = bins.place(w)
        place = (hemisphere, np.zeros_like(polar), polar, azimuth)
        np.add.at(energy, place, weights / count)
        np.add.at(squares, place, weights**2 / count)

    add(2.0 * cosine[:, None] * m - wi, True, fresnel)
    if setup.material.kind == "dielectric":
        eta = setup.material.eta[0]
        beyond = 1.0 - (1.0 - cosine**2) / eta**2
        w = (cosine / eta - np.sqrt(np.maximum(beyond, 0.0)))[:, None] * m - wi / eta
        add(np.where(beyond[:, None] > 0.0, w, 1.0), False, 1.0 - fresnel)
    return Scattered(energy, squares, count)


def _g2_over_g1(masking: str, lambda_i: float, lambda_o: Array, reflects: bool) -> Array:
    """Smith's masking of both directions over that of the first one; light that is let through is masked below by B(1 + Λi, 1 + Λo)."""
    if masking == "separable":
        return 1.0 / (1.0 + lambda_o)
    if reflects:
        return (1.0 + lambda_i) / (1.0 + lambda_i + lambda_o)
    from scipy.special import beta

    return (1.0 + lambda_i) * beta(1.0 + lambda_i, 1.0 + lambda_o)


def lobe(ndf: Ndf, setup: Setup, masking: str) -> Scattered:
    """The lobe of ``sgtdconductor``'s ``multiple_scattering``: with it less without it. All of it is in the second order."""
    import mitsuba as mi

    from .goniometer import rgb_variant

    bins, material = setup.bins, setup.material
    alpha_u, alpha_v = ndf.alpha_u, ndf.alpha_v
    names = {"distribution", "gamma", "p", "lam", "shift"}
    shape = {"lambda" if name == "lam" else name: v for name, v in ndf._given.items() if name in names}
    if "shift" not in shape and ndf.shift:
        shape["shift"] = ndf.shift
    base = {"type": "sgtdconductor", **shape, "alpha_u": alpha_u, "alpha_v": alpha_v, "masking": masking}
    energy = np.zeros((2, bins.orders, bins.polar, bins.azimuths, 3))
    isotropic = alpha_u == alpha_v
    nodes, weights = np.polynomial.legendre.leggauss(3)
    with rgb_variant():
        if material.kind == "conductor":
            base["eta"] = {"type": "rgb", "value": list(material.eta)}
            base["k"] = {"type": "rgb", "value": list(material.k)}
        else:
            base["material"] = "none"
        with_it = mi.load_dict({**base, "multiple_scattering": True})
        without = mi.load_dict(base)
        context = mi.BSDFContext()
        si = mi.SurfaceInteraction3f()
        si.wi = mi.Vector3f(*setup.wi)
        width = 0.5 * math.pi / bins.polar
        for i in range(bins.polar):
            for node, weight in zip(nodes, weights):
                theta = width * (i + 0.5 + 0.5 * node)
                for j in range(1 if isotropic else bins.azimuths):
                    phi = 2.0 * math.pi * ((j + 0.5) / bins.azimuths - 0.5)
                    w = mi.Vector3f(math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta))
                    value = np.array(with_it.eval(context, si, w)) - np.array(without.eval(context, si, w))
                    part = 0.5 * weight * width * math.sin(theta) * 2.0 * math.pi / bins.azimuths * value.ravel()[:3]
                    energy[0, min(1, bins.orders - 1), i, slice(None) if isotropic else j] += part
    return Scattered(energy, np.zeros_like(energy), 1)
