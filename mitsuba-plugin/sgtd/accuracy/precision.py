"""A whole material in single precision: what a variant of Mitsuba evaluates, against the core in double precision.

The material is a perfect mirror with the shape's roughness, so its value times cos is D G1(wi) G1(wo) / (4 cos_i).
JIT variants compute that from tables in single precision; scalar variants call the core in double precision and round.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import mitsuba_errors
from ..named_shape import NamedShape
from .function_errors import DENSITY_FLOOR, Collector, Spread
from .inputs import uniform

_ALPHA = 0.3
# Calls one by one from Python are slow: so many suffice for a scalar variant.
_SCALAR_COUNT = 1500


@dataclass(frozen=True)
class PrecisionErrors:
    """Relative errors of the material's value and of its sampling density."""

    variant: str
    value: Spread
    count: int


def material_errors(
    shape: NamedShape, seed: int, count: int, settings: tuple[float, ...], variant: str
) -> dict[float, PrecisionErrors]:
    """Errors of one variant at each setting, over random pairs of directions; the variant stays set."""
    import mitsuba as mi

    mi.set_variant(variant)
    scalar = variant.startswith("scalar_")
    count = min(count, _SCALAR_COUNT) if scalar else count
    random = np.random.default_rng(seed + 3)
    # Directions as the variant will see them, lengthened to 1 again in double precision
    wi, wo = (uniform(random, count).astype(np.float32).astype(np.float64) for _ in range(2))
    exact = shape.ndf(_ALPHA, _ALPHA, 0.0)
    unit_i, unit_o = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wi, wo))
    half = unit_i + unit_o
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    reference = exact.d(half) * exact.g2(unit_i, unit_o) / (4.0 * unit_i[:, 2])
    counted = exact.d(half) * half[:, 2] > DENSITY_FLOOR
    result = {}
    for setting in settings:
        with mitsuba_errors(f"while evaluating {shape.text}"):
            bsdf = mi.load_dict({"type": "sgtdconductor", "alpha": _ALPHA, "accuracy": setting, **dict(shape.settings)})
            values = _one_by_one(bsdf, wi, wo) if scalar else _at_once(bsdf, wi, wo)
        collector = Collector()
        collector.add("random", np.abs(values[counted] / reference[counted] - 1.0))
        result[setting] = PrecisionErrors(variant, collector.spread(), int(counted.sum()))
    return result


def _at_once(bsdf: Any, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    import drjit as dr
    import mitsuba as mi

    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    value = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(wo.T.astype(np.float32)))
    return np.array(value, dtype=np.float64).reshape(-1, len(wi))[0]


def _one_by_one(bsdf: Any, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    import drjit as dr
    import mitsuba as mi

    context = mi.BSDFContext()
    si = dr.zeros(mi.SurfaceInteraction3f)
    values = []
    for a, b in zip(wi, wo):
        si.wi = mi.Vector3f(*a)
        values.append(np.array(bsdf.eval(context, si, mi.Vector3f(*b))).ravel()[0])
    return np.array(values, dtype=np.float64)
