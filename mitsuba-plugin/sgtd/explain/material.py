"""What a material of a scene file needs: its node in the tree of the family, its effects, its tables.

Nothing here renders; every number comes from the core, for the same shape and accuracy as the plugin asks for.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from .. import _core
from .._core import Radial, Shape
from ..errors import UserError
from ..scene import numeric_distribution
from ..scene.exchange import NUMBERS
from ..scene.graph import SceneGraph

# Values that properties have when they are left out.
DEFAULTS: Mapping[str, Any] = {
    "distribution": "sgtd",
    "alpha": 0.1,
    "masking": "separable",
    "sample_visible": True,
    "accuracy": _core.default_accuracy,
}

# A table is built so often; the median is told.
_BUILDS = 3


@dataclass(frozen=True)
class Effect:
    """One effect of the list that a material may call for."""

    name: str
    on: bool
    words: str


@dataclass(frozen=True)
class Tables:
    """What the core made for a shape."""

    bytes: int
    build_seconds: float
    accuracy_reached: float
    steepness: float
    by_odds: bool


@dataclass(frozen=True)
class MissingEnergy:
    """The table of what single scattering loses."""

    bytes: int
    error: float


@dataclass(frozen=True)
class Material:
    """A material of this family."""

    id: str
    plugin: str
    place: str
    holders: tuple[str, ...]
    row: str
    properties: Mapping[str, Any]
    objects: frozenset[str]
    defaulted: tuple[str, ...]
    shape: Shape | None
    node: str
    node_shape: Shape | None
    key: bytes
    alpha_scale: float
    builtin: str
    why: str
    effects: tuple[Effect, ...]
    accuracy_asked: float
    tables: Tables | None
    missing_energy: MissingEnergy | None
    textured: bool
    anisotropic: bool

    @property
    def cells(self) -> bool:
        """Is it a table or a mixture, which has code of its own?"""
        return self.shape is None

    @property
    def double_precision(self) -> bool:
        """Is D evaluated in double precision in JIT variants?"""
        return self.tables is not None and self.tables.steepness > _core.steep

    def on(self, effect: str) -> bool:
        return any(entry.on for entry in self.effects if entry.name == effect)

    def structure(self) -> tuple[Any, ...]:
        """What the traced code depends on, as far as this family decides it: equal structures can share one code path."""
        return (
            self.plugin,
            self.builtin
            or ((self.row if self.tables and self.tables.by_odds else "mixture") if self.cells else "tables"),
            self.builtin != "" and self.alpha_scale != 1.0,
            self.double_precision,
            self.textured,
            self.anisotropic,
            *(effect.on for effect in self.effects if effect.name in STRUCTURAL),
        )


# The plugins whose sampling can be bounded: light that is refracted has no such limit.
REFLECT_ONLY = ("sgtdconductor", "sgtdplastic")

# Effects, beside anisotropy, textures and double precision, that are code and not numbers.
STRUCTURAL = ("visible normals", "bounded sampling", "height-correlated masking", "multiple scattering")


def explain_material(graph: SceneGraph, node: Any, holders: list[Any]) -> Material:
    """Reads a BSDF node of the scene graph that Mitsuba has already accepted."""
    props = node.props
    place = graph.place(node)
    values = {name: props[name] for name in props.keys()}
    row = str(values.get("distribution", DEFAULTS["distribution"])).lower()
    given = {name: float(values[name]) for name in NUMBERS if name in values}
    shape = reduced = None
    node_name, scale, node_scale, builtin = row, 1.0, 1.0, ""
    try:
        if row in numeric_distribution.ROWS:
            radial = numeric_distribution.radial_of(values, graph.path.parent)
            why = _why_cells(row, radial, values)
        else:
            shape, scale = _resolve(row, given, values)
            node_of_tree = _core.lowest_node(shape)
            node_name, reduced, node_scale = node_of_tree.name, node_of_tree.shape, node_of_tree.alpha_scale
            path = _core.code_path(row, shape, bool(values.get("sample_bounded", False)))
            builtin = "" if path == "tables" else path
            radial = Radial.family(reduced)
            why = _why(row, shape, node_name, reduced, builtin, node_scale)
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{place}: {error}") from error
    accuracy = float(values.get("accuracy", DEFAULTS["accuracy"]))
    visible = bool(values.get("sample_visible", DEFAULTS["sample_visible"]))
    anisotropic = "alpha_u" in values
    nested = {name: graph.referred(value) for name, value in values.items()}
    objects = frozenset(name for name, other in nested.items() if other is not None)
    textured = not objects.isdisjoint(("alpha", "alpha_u", "alpha_v"))
    # as the plugin decides it
    bounded = props.plugin_name() in REFLECT_ONLY and visible and bool(values.get("sample_bounded", not builtin))
    tables = None if builtin else _tables(radial, accuracy, visible)
    return Material(
        id=str(props.id()) or "unnamed",
        plugin=props.plugin_name(),
        place=place,
        holders=tuple(_name(holder) for holder in holders),
        row=row,
        properties={
            name: f"a {other.props.plugin_name()}" if (other := nested[name]) is not None else _plain(value)
            for name, value in values.items()
        },
        objects=objects,
        defaulted=tuple(key for key in DEFAULTS if key not in values and not (key == "alpha" and anisotropic)),
        shape=shape,
        node=node_name,
        node_shape=reduced,
        key=radial.key,
        alpha_scale=scale * node_scale,
        builtin=builtin,
        why=why,
        effects=_effects(shape, values, visible, bounded, anisotropic, textured, tables),
        accuracy_asked=accuracy,
        tables=tables,
        missing_energy=_missing_energy(radial, accuracy, scale * node_scale, values, objects, builtin),
        textured=textured,
        anisotropic=anisotropic,
    )


def _resolve(row: str, given: dict[str, float], values: Mapping[str, Any]) -> tuple[Shape, float]:
    """The shape and the factor on the roughness, as the plugin finds them."""
    gamma, p, lam = (given.get(name) for name in ("gamma", "p", "lambda"))
    if "inv_gamma" in given:
        gamma = 1.0 / given["inv_gamma"] if given["inv_gamma"] else math.inf
    shift = given.get("shift")
    if "mu" in given:
        _, scale = _core.shape_of_row(row, gamma, p, lam)
        shift = given["mu"] / max(float(values.get("alpha", DEFAULTS["alpha"])) * scale, _core.least_alpha)
    return _core.shape_of_row(row, gamma, p, lam, shift)


def _tables(radial: Radial, accuracy: float, visible: bool) -> Tables:
    seconds = []
    for _ in range(_BUILDS):
        start = time.perf_counter()
        ndf = _core.Ndf.get(radial, _asked_of_core(accuracy), visible)
        seconds.append(time.perf_counter() - start)
        tables = Tables(ndf.table_bytes, 0.0, ndf.accuracy_reached, ndf.steepness, ndf.by_odds)
        # tables without a user are dropped, so the next turn builds them again
        del ndf
    return replace(tables, build_seconds=sorted(seconds)[_BUILDS // 2])


def _missing_energy(
    radial: Radial, accuracy: float, scale: float, values: Mapping[str, Any], objects: frozenset[str], builtin: str
) -> MissingEnergy | None:
    """As the plugin makes it: for one pair of roughnesses, or for every isotropic one."""
    if not values.get("multiple_scattering", False):
        return None
    ndf = _core.Ndf.get(radial, _core.default_accuracy if builtin else _asked_of_core(accuracy), False)
    pair = [max(float(values.get(key, DEFAULTS["alpha"])) * scale, _core.least_alpha) for key in ("alpha_u", "alpha_v")
            if key in values and key not in objects]  # fmt: skip
    correlated = str(values.get("masking", DEFAULTS["masking"])).lower() == "height_correlated"
    return MissingEnergy(*(ndf.missing_energy(correlated, *pair) if len(pair) == 2 else ndf.missing_energy(correlated)))


def _asked_of_core(accuracy: float) -> float:
    """The plugin asks for nothing finer than single precision can show, where it computes in that."""
    import mitsuba as mi

    return accuracy if accuracy == 0.0 or mi.variant().startswith("scalar_") else max(accuracy, 1e-7)


def _why_cells(row: str, radial: Radial, values: Mapping[str, Any]) -> str:
    width = f"mean slope {radial.width:.4g}"
    if "alpha" in values or "alpha_u" in values:
        width += ", stretched to alpha"
    if row == "mixture":
        return f"a sum of distributions, {width}: cells near enough to it for single precision"
    tail = f"a tail of slope^-{radial.tail_exponent:.3g}" if radial.tail_exponent else "nothing beyond the last row"
    return f"{len(radial.slopes)} nodes, knee {radial.knee:.3g}, {tail}, {width}: cells that are found without a search"


def _why(row: str, shape: Shape, node: str, reduced: Shape, builtin: str, scale: float) -> str:
    fixed = []
    if reduced.gamma in (2.0, math.inf):
        fixed.append(f"gamma = {reduced.gamma:g}")
    if reduced.p == 1.0:
        fixed.append("p = 1")
    if reduced.lam == 0.0:
        fixed.append("lambda = 0")
    fixed.append("shift = 0" if reduced.shift == 0.0 else f"shift = {reduced.shift:g}")
    text = ", ".join(fixed)
    if builtin == "ggx":
        text += ": GGX's closed form, Mitsuba's own code"
    elif builtin == "beckmann":
        text += ': "beckmann" by name: Mitsuba\'s own code, whose masking is a fit that is off by up to 6e-3'
    elif node == "ggx":
        text += ": GGX, but its shift needs tables"
    elif node == "beckmann" and reduced.shift == 0.0:
        text += f': Beckmann, with masking as exact as "accuracy" asks for, because it was written as "{row}"'
    else:
        text += ": no closed form for masking and visible normals, so tables"
    if scale != 1.0:
        text += f"; without a shift, lambda = {shape.lam:g} is nothing but a roughness {scale:g} times as high"
    return text


def _effects(
    shape: Shape | None,
    values: Mapping[str, Any],
    visible: bool,
    bounded: bool,
    anisotropic: bool,
    textured: bool,
    tables: Tables | None,
) -> tuple[Effect, ...]:
    correlated = str(values.get("masking", DEFAULTS["masking"])).lower() == "height_correlated"
    multiple = bool(values.get("multiple_scattering", False))
    steep = tables is not None and tables.steepness > _core.steep
    return (
        *(_shape_effects(shape) if shape is not None else ()),
        Effect("anisotropy", anisotropic, "alpha_u, alpha_v" if anisotropic else "one alpha"),
        Effect("roughness texture", textured, "looked up per hit" if textured else "a number"),
        Effect("visible normals", visible, "sample_visible" if visible else "all normals are drawn from"),
        Effect(
            "bounded sampling", bounded, "of reflections above the horizon" if bounded else "of all that are visible"
        ),
        Effect("height-correlated masking", correlated, "height_correlated" if correlated else "separable"),
        Effect("multiple scattering", multiple, "on" if multiple else "single scattering"),
        Effect(
            "double precision",
            steep,
            f"|d ln D / d ln slope| is {tables.steepness:.3g}, JIT variants bear {_core.steep:g}"
            if tables is not None and steep
            else "not needed",
        ),
    )


def _shape_effects(shape: Shape) -> tuple[Effect, ...]:
    skewed = shape.lam != 0.0 and shape.shift > 0.0
    tail = "that of GGX" if shape.gamma == 2.0 else "none: exponential" if shape.gamma == math.inf else None
    return (
        Effect("shift", shape.shift > 0.0, f"{shape.shift:g}"),
        Effect("skew", skewed, f"{shape.lam:g}" if skewed or shape.lam == 0.0 else "a roughness, without a shift"),
        Effect("kurtosis", shape.p != 1.0, f"p = {shape.p:g}"),
        Effect("tail", tail is None, tail or f"gamma = {shape.gamma:g}"),
    )


def _name(node: Any) -> str:
    identity = str(node.props.id())
    plugin = str(node.props.plugin_name())
    return f'{plugin} "{identity}"' if identity else plugin


def _plain(value: Any) -> Any:
    """A property as JSON can hold it."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if isinstance(value, (int, float, str, bool)) else str(value)
