"""What would make a material, or a scene, cheaper. Each sentence names a property and a value, and what it changes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .. import _core
from .._core import Shape
from .material import Material

# A neighbor is proposed where no share of slopes changes by more than this.
_NEAR = 0.005

# Halvings of an interval of at most 10^4 until its ends agree to 1 %.
_BISECTIONS = 16

# Exponents that the core multiplies out in scalar variants.
_LARGEST_MULTIPLIED = 16.0

# At this roughness GGX loses 1.2 % at normal incidence.
_SMOOTH = 0.1


def advise(material: Material, scalar: bool) -> list[str]:
    """Advice on one material."""
    found = []
    near = _near_ggx(material)
    if near:
        found.append(near)
    if material.double_precision and not scalar:
        found.append(_less_steep(material))
    shape, node = material.shape, material.node_shape
    if material.builtin == "" and shape is not None and node is not None and shape.lam != node.lam:
        found.append(
            f"without a shift, lambda = {shape.lam:g} only scales the roughness: "
            f"lambda = 0 with alpha {1 + shape.lam:g} times as high is the same material"
        )
    u, v = (material.properties.get(name) for name in ("alpha_u", "alpha_v"))
    if isinstance(u, (int, float)) and u == v:
        found.append(f"alpha_u and alpha_v are both {u:g}: written as alpha, it needs no anisotropic code")
    if scalar and material.builtin == "":
        found += _exponents(material)
        if material.accuracy_asked == 0.0:
            found.append("accuracy = 0 computes masking by quadrature on every call: 1e-7 takes it from a table")
    if not material.on("visible normals"):
        found.append("sample_visible = true costs little per sample and has far less noise near grazing")
    alphas = [material.properties.get(name) for name in ("alpha", "alpha_u", "alpha_v")]
    smooth = [a for a in alphas if isinstance(a, (int, float))]
    if material.on("multiple scattering") and smooth and max(smooth) * material.alpha_scale < _SMOOTH:
        found.append(
            f"at a roughness of {max(smooth):g} single scattering loses little: compare with multiple_scattering = false, "
            "which needs no second lobe and no table of missing energy"
        )
    return found


def advise_scene(materials: list[Material], paths: int | None, scalar: bool) -> list[str]:
    """Advice on what materials have in common."""
    found = []
    kinds: dict[tuple[object, ...], list[Material]] = {}
    for material in materials:
        kinds.setdefault(material.structure(), []).append(material)
    if not scalar and len(kinds) > 1:
        text = "; ".join(", ".join(m.id for m in group) for group in kinds.values())
        found.append(f"the materials of this family need {len(kinds)} code paths: {text}")
        found += _joins(kinds)
    if not scalar and paths is not None and kinds and paths > len(kinds) + 1:
        found.append(
            f"{paths - len(kinds)} other code paths are those of other plugins; neighboring rays that meet several of them "
            "pay for each"
        )
    return found


# What two materials may differ in alone and could as well agree in
SWITCHES = ("sample_visible", "sample_bounded", "masking", "anisotropy", "multiple_scattering")


def _joins(kinds: dict[tuple[object, ...], list[Material]]) -> list[str]:
    """Groups that differ in one switch alone."""
    names = (
        *("plugin", "distribution", "scaled roughness", "double precision", "textured roughness", "anisotropy"),
        *("sample_visible", "sample_bounded", "masking", "multiple_scattering"),
    )
    found = []
    keys = list(kinds)
    for i, a in enumerate(keys):
        for b in keys[:i]:
            apart = [name for name, x, y in zip(names, a, b) if x != y]
            if len(apart) == 1 and apart[0] in SWITCHES:
                first, second = kinds[b][0].id, kinds[a][0].id
                found.append(f"{first} and {second} differ in {apart[0]} alone: the same for both saves a code path")
    return found


def greatest_change(a: Shape, b: Shape) -> float:
    """The largest difference of the share of slopes above any slope, at equal roughness."""
    ndf, other = (_core.Ndf.get(shape, 1e-2) for shape in (a, b))
    x = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 400), a.shift + np.linspace(-3.0, 3.0, 200)])
    x = np.ascontiguousarray(x[x >= 0.0])
    return float(np.abs(ndf.eval("sf", 1.0, 1.0, x) - other.eval("sf", 1.0, 1.0, x)).max())


def _near_ggx(material: Material) -> str:
    ggx, shape = Shape(2.0, 1.0, 0.0, 0.0), material.node_shape
    if material.builtin or shape is None:
        return ""
    # far shapes need no tables to be told apart
    if abs(math.log(shape.p)) > 0.1 or abs(shape.gamma - 2.0) > 0.2 or shape.shift > 0.05 or abs(shape.lam) > 0.1:
        return ""
    change = greatest_change(shape, ggx)
    if change > _NEAR:
        return ""
    names = (("gamma", shape.gamma, 2.0), ("p", shape.p, 1.0), ("lambda", shape.lam, 0.0), ("shift", shape.shift, 0.0))
    apart = [f"{name} = {value:g} (is {found:g})" for name, found, value in names if found != value]
    return f"{', '.join(apart)} makes it GGX, which needs no tables: no share of slopes changes by more than {100 * change:.2g} %"


def _less_steep(material: Material) -> str:
    """The nearest value of one parameter with which single precision does."""
    shape, limit = material.node_shape, _core.steep
    if shape is None:
        return (
            "it needs double precision: values change by more than a factor of e within 1/38 of a slope; fewer rows or smoother "
            "values do without"
        )

    def steepness(p: float, shift: float) -> float:
        return _core.Ndf.get(Shape(shape.gamma, p, shape.lam, shift), 1e-2).steepness

    ways: tuple[tuple[str, float, Callable[[float], float]], ...] = (
        ("p", shape.p, lambda x: steepness(x, shape.shift)),
        ("shift", shape.shift, lambda x: steepness(shape.p, x)),
    )
    for name, value, at in ways:
        low, high = (1.0 if name == "p" else 0.0), value
        if high <= low or at(low) > limit:
            continue
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if at(middle) <= limit else (low, middle)
        return f"{name} up to {low:.3g} (is {value:g}) needs no double precision"
    return "it needs double precision whatever p or shift alone is: D magnifies the rounding of a slope"


def _exponents(material: Material) -> list[str]:
    """Values next to those that scalar variants multiply out."""
    found: list[str] = []
    shape = material.node_shape
    if shape is None:
        return found
    if shape.p != 1.0 and abs(shape.p - 1.0) < 0.1:
        change = greatest_change(shape, Shape(shape.gamma, 1.0, shape.lam, shape.shift))
        if change <= _NEAR:
            found.append(
                f"p = 1 (is {shape.p:g}) needs no logarithm; no share of slopes changes by more than {100 * change:.2g} %"
            )
    half = round(2.0 * shape.gamma) / 2.0 if math.isfinite(shape.gamma) else shape.gamma
    if shape.gamma != half and 1.0 < half <= _LARGEST_MULTIPLIED and 2.0 * shape.p * half > 3.0:
        change = greatest_change(shape, Shape(half, shape.p, shape.lam, shape.shift))
        if change <= _NEAR:
            found.append(
                f"gamma = {half:g} (is {shape.gamma:g}) needs no logarithm; no share of slopes changes by more than "
                f"{100 * change:.2g} %"
            )
    return found
