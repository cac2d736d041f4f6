"""From slopes to a distribution: maximum likelihood under D cos, the density of the slopes of facets."""

from __future__ import annotations

from .fit import fit_heights, fit_slopes, fit_surface
from .result import SlopeFit, SlopeScore

__all__ = ["SlopeFit", "SlopeScore", "fit_heights", "fit_slopes", "fit_surface"]
