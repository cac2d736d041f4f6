"""Members of the family that the tests share: one shape per row, and shapes that are hard in one way each."""

from __future__ import annotations

# One member of every row, none of them at a node of the tree that another row has too.
ROWS = {
    "sgtd": dict(distribution="sgtd", gamma=1.9, p=1.3, **{"lambda": 0.4}, shift=0.6),
    "gtd": dict(distribution="gtd", gamma=1.7, p=1.4, shift=0.3),
    "sgnd": dict(distribution="sgnd", p=0.8, **{"lambda": -0.5}, shift=1.0),
    "std": dict(distribution="std", gamma=2.2, **{"lambda": 0.5}, shift=0.4),
    "gnd": dict(distribution="gnd", p=2.5, shift=0.8),
    "snd": dict(distribution="snd", **{"lambda": 0.6}, shift=0.5),
    "student": dict(distribution="student", gamma=1.6),
    "hyper_cauchy": dict(distribution="hyper_cauchy", gamma=2.3),
    "beckmann": dict(distribution="beckmann", shift=0.7),
    "ggx": dict(distribution="ggx", shift=1.5),
    # without a shift these two are Mitsuba's own
    "beckmann_centered": dict(distribution="beckmann"),
    "ggx_centered": dict(distribution="ggx"),
}

# Shapes that differ in kind: a light and a heavy tail, a box, a ring, a cusp, both skews.
KINDS = {
    "ggx": dict(gamma=2.0),
    "normal": dict(gamma=float("inf")),
    "heavy_tail": dict(gamma=1.6),
    "box": dict(gamma=2.0, p=50.0),
    "ring": dict(gamma=2.0, shift=5.0),
    "skew": dict(gamma=1.8, p=1.2, **{"lambda": 0.7}, shift=0.4),
    "skew_inward": dict(gamma=float("inf"), **{"lambda": -0.7}, shift=1.0),
    "cusp": dict(gamma=8.0, p=0.4, shift=0.5),
}

ISOTROPIC = dict(alpha=0.25)
ANISOTROPIC = dict(alpha_u=0.35, alpha_v=0.1)


def named(shape: dict) -> dict:
    """The same shape as keyword arguments of sgtd.Ndf, for shapes without `distribution`."""
    names = {"gamma": "gamma", "p": "p", "lambda": "lam", "shift": "shift"}
    return {names[key]: value for key, value in shape.items()}
