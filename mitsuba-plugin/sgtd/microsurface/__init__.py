"""Explicit microgeometry: surfaces with facets of a given distribution, a virtual goniometer, and what Smith's model makes of them."""

from __future__ import annotations

from .distribution import SlopeDistribution, distribution
from .generate import generate
from .goniometer import goniometer
from .surface import Surface, ks_distance, read_heights

__all__ = ["SlopeDistribution", "Surface", "distribution", "generate", "goniometer", "ks_distance", "read_heights"]
