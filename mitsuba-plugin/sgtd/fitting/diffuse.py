"""The diffuse base of a plastic: what is scattered below the interface, as ``sgtdplastic`` has it.

``value = rho / (1 - rho_int) * T(theta_i) T(theta_o) / (pi eta^2)``: T is what the rough interface lets in, rho_int what its inside returns: averages over
576 visible facets, where the plugin has tables by quadrature; materials agree with predictions within 1.5e-2 (tests/test_fitting.py). Both follow
the shape slowly, so a search holds them and computes them anew when it has come to an end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..ndf import Ndf
from .fresnel import reflectance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: cosines at which transmission is computed, more of them near the horizon; its accuracy is 1e-3, that of the plugin's tables
_VIEWS = 16
#: directions from below that the average over diffuse light takes
_BELOW = 64
#: strata of the normals that are averaged over
_NORMALS = (24, 24)


@dataclass(frozen=True)
class DiffuseBase:
    """What light meets at an interface above a diffuse base."""

    cosines: Array
    transmitted: Array
    internal: float
    eta: float

    @classmethod
    def below(cls, ndf: Ndf, eta: float, masking: str) -> DiffuseBase:
        """Of an interface with this distribution and relative index."""
        cosines = ((np.arange(_VIEWS) + 1.0) / _VIEWS) ** 2
        cosines = np.concatenate([cosines[0] * np.array([0.05, 0.25, 0.5]), cosines])
        transmitted = _mean_over_facets(ndf, eta, cosines, masking, transmit=True)
        # 2 mu dmu by the midpoints of mu^2
        below = np.sqrt((np.arange(_BELOW) + 0.5) / _BELOW)
        internal = float(_mean_over_facets(ndf, 1.0 / eta, below, masking, transmit=False).mean())
        return cls(cosines, transmitted, internal, eta)

    def transmission(self, cos: Array) -> Array:
        """T of a direction."""
        from scipy.interpolate import PchipInterpolator

        return np.asarray(PchipInterpolator(np.sqrt(self.cosines), self.transmitted, extrapolate=True)(np.sqrt(cos)))

    def kernel(self, cos_i: Array, cos_o: Array) -> Array:
        """Reflectance per steradian and unit of diffuse reflectance."""
        scale = 1.0 / (np.pi * self.eta**2 * (1.0 - self.internal))
        return scale * self.transmission(cos_i) * self.transmission(cos_o)


def _mean_over_facets(ndf: Ndf, eta: float, cosines: Array, masking: str, *, transmit: bool) -> Array:
    """``<F G>`` of what is reflected, or ``<(1 - F) G>`` of what is refracted, over the facets visible from each cosine."""
    rows, columns = _NORMALS
    u = np.stack(np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij"), -1)
    wi = np.stack([np.sqrt(np.maximum(1.0 - cosines**2, 0.0)), np.zeros(len(cosines)), cosines], -1)
    m, pdf = ndf.sample(wi[:, None], u.reshape(1, -1, 2))
    view = np.broadcast_to(wi[:, None], m.shape)
    facing = np.clip(np.sum(view * m, axis=-1), 0.0, 1.0)
    f = reflectance(np.array(eta), np.array(0.0), facing)
    if transmit:
        beyond = np.sqrt(np.maximum(1.0 - (1.0 - facing**2) / eta**2, 0.0))
        # the refracted direction, turned upwards
        wo = view / eta + (beyond - facing / eta)[..., None] * m
        share = 1.0 - f
    else:
        wo = 2.0 * facing[..., None] * m - view
        share = f
    used = (pdf > 0.0) & (facing > 0.0) & (wo[..., 2] > 0.0) & (share > 0.0)
    wo = np.where(used[..., None], wo, [0.0, 0.0, 1.0])
    wo /= np.linalg.norm(wo, axis=-1, keepdims=True)
    if transmit and masking == "height_correlated":
        # light that goes on below: G2/G1 is a beta function
        from scipy.special import beta

        first, second = (1.0 / ndf.g1(w) - 1.0 for w in (view, wo))
        g2 = beta(1.0 + first, 1.0 + second)
    else:
        g2 = ndf.g2(view, wo, masking)
    weight = ndf.d(m) * g2 * facing / np.where(used, pdf, 1.0) / cosines[:, None]
    return np.mean(np.where(used, share * weight, 0.0), axis=1)
