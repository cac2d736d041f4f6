"""The exchange of rough materials: one scene, made into a pair that differs in their microfacets alone.

On the left every rough metal is a ``roughconductor``, every rough glass a ``roughdielectric``, every rough plastic a ``roughplastic``; on the
right they are an ``sgtdconductor``, ``sgtddielectric`` or ``sgtdplastic`` of the same metal or indices, roughness, textures and reflectance.
What a scene file has of either kind is kept as it is on its own side:

=====================================  ==============================  ========================================
the file has                           left                            right
=====================================  ==============================  ========================================
one of Mitsuba's, ``rough…``           as in the file                  the same distribution, moved by ``--set``
one of ours, ``sgtd…``                 the nearest of GGX, Beckmann    as in the file, moved by ``--set``
=====================================  ==============================  ========================================

A material is one node of the scene graph, so one that is shared by ``<ref>``, nested in another BSDF or comes from
an included file is exchanged like any other.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Union

from ..errors import UserError
from . import numeric_distribution
from .graph import SceneGraph
from .numeric_distribution import radial_of

# Mitsuba's plugins, and what each is exchanged for.
PARTNERS = {
    "roughconductor": "sgtdconductor",
    "roughdielectric": "sgtddielectric",
    "roughplastic": "sgtdplastic",
}
ORIGINALS = {right: left for left, right in PARTNERS.items()}

# Those of Mitsuba's that have one roughness, where ours may have two.
ISOTROPIC = ("roughplastic",)

# Materials of Mitsuba without a partner, and why.
NEVER_EXCHANGED = {
    "principled": "a blend of several lobes",
    "principledthin": "a blend of several lobes",
    "plastic": "smooth",
    "pplastic": "its base scatters diffusely below the microfacets",
    "conductor": "smooth",
    "dielectric": "smooth",
    "thindielectric": "smooth",
    "diffuse": "no microfacets",
    "measured": "tabulated",
    "measured_polarized": "tabulated",
    "hair": "no microfacets",
    "null": "no surface",
}

# The properties in which two partners differ; all others (metal, indices, roughness, reflectance) stay as they are.
NUMBERS = ("gamma", "inv_gamma", "p", "lambda", "shift", "mu")
WORDS = ("distribution", "masking", *numeric_distribution.WORDS)
SETTINGS = WORDS + NUMBERS + numeric_distribution.NUMBERS

# What belongs to a distribution and goes with it.
_OF_DISTRIBUTION = NUMBERS + numeric_distribution.PROPERTIES

# Those that leave a fixed row of the family: a scene's own GGX or Beckmann cannot have them.
_TAIL_AND_BODY = ("gamma", "p", "lambda")

# gamma of the two distributions that Mitsuba has, as members of the family.
_GAMMA = {"beckmann": math.inf, "ggx": 2.0}

# Rows without a power tail.
_EXPONENTIAL_ROWS = ("beckmann", "gnd", "snd", "sgnd")

# Student's distribution of this gamma is as far from GGX as from Beckmann: the largest difference of
# P(slope > x) at equal roughness is 0.103 to either.
_HALFWAY_GAMMA = 3.2918

# alpha of GGX with a mean slope of 1.
_GGX_PER_MEAN_SLOPE = 2.0 / math.pi

Settings = Mapping[str, Union[str, float]]


@dataclass(frozen=True)
class Exchange:
    """One material: where it stands in the file, and what it is on either side."""

    place: str
    left: str
    right: str


@dataclass(frozen=True)
class Pair:
    """The two graphs and the list of what differs between them."""

    left: SceneGraph
    right: SceneGraph
    exchanges: tuple[Exchange, ...]

    def summary(self) -> list[tuple[str, str, int]]:
        """The distinct kinds of exchange with their numbers, in the order of the file."""
        counts: dict[tuple[str, str], int] = {}
        for exchange in self.exchanges:
            kind = (exchange.left, exchange.right)
            counts[kind] = counts.get(kind, 0) + 1
        return [(left, right, count) for (left, right), count in counts.items()]


def parse_settings(texts: tuple[str, ...] | list[str]) -> dict[str, str | float]:
    """Reads ``name=value`` texts. The plugin itself judges the values; here only their kind is checked."""
    settings: dict[str, str | float] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name or not value:
            raise UserError(f'--set {text}: expected name=value, as in "--set gamma=1.8"')
        if name not in SETTINGS:
            close = difflib.get_close_matches(name, SETTINGS, n=1)
            hint = f' (did you mean "{close[0]}"?)' if close else ""
            raise UserError(f"--set {name}: unknown property{hint}; it can be {', '.join(SETTINGS)}")
        if name in settings:
            raise UserError(f"--set {name} is given twice")
        if name in WORDS:
            settings[name] = value
            continue
        try:
            settings[name] = float(value)
        except ValueError:
            raise UserError(f'--set {name}={value}: "{value}" is not a number') from None
    return settings


def exchange(graph: SceneGraph, settings: Settings, roughness: Mapping[str, float] | None = None) -> Pair:
    """Makes the pair; ``graph`` itself stays as it is. ``roughness`` (``alpha``, or ``alpha_u`` and ``alpha_v``) is set on both sides."""
    left, right = graph.copy(), graph.copy()
    # Collected before anything changes: a node turned into the other plugin must not be met a second time.
    pairs = [
        nodes
        for plugin in (*PARTNERS, *ORIGINALS)
        for nodes in zip(list(left.materials(plugin)), list(right.materials(plugin)))
    ]
    pairs.sort(key=lambda pair: (pair[0].file_index, pair[0].offset))
    exchanges = []
    for left_node, right_node in pairs:
        if roughness:
            for node in (left_node, right_node):
                _set_roughness(node.props, roughness)
        if left_node.props.plugin_name() in PARTNERS:
            _to_sgtd(right_node.props, settings)
        else:
            _to_rough(left_node.props, graph.path.parent)
            _apply(right_node.props, settings)
        exchanges.append(Exchange(graph.place(left_node), describe(left_node.props), describe(right_node.props)))
    if not exchanges:
        raise UserError(_nothing_to_exchange(graph))
    return Pair(left, right, tuple(exchanges))


def _nothing_to_exchange(graph: SceneGraph) -> str:
    """Why, with what the scene has instead."""
    import mitsuba as mi

    wanted = ", ".join(PARTNERS)
    kinds = graph.plugins(mi.ObjectType.BSDF)
    if not kinds:
        return f"{graph.path}: nothing to exchange: the scene has no materials of its own, so none of {wanted}"
    found = ", ".join(f"{count} × {plugin}" for plugin, count in kinds.items())
    never = [f"{plugin} ({NEVER_EXCHANGED[plugin]})" for plugin in kinds if plugin in NEVER_EXCHANGED]
    why = f"; never exchanged: {', '.join(never)}" if never else ""
    return f"{graph.path}: nothing to exchange: the scene has {found}, but none of {wanted}, nor of ours{why}"


def describe(props: Any) -> str:
    """A material's plugin and shape in a few words: "sgtdconductor, student, gamma = 1.6"."""
    plugin = props.plugin_name()
    default = "beckmann" if plugin in PARTNERS else "sgtd"
    parts = [plugin, str(props["distribution"]) if "distribution" in props else default]
    parts += [f"{name} = {_text(props[name])}" for name in NUMBERS if name in props]
    parts += [str(props[name]) for name in ("filename", "members", "tail") if name in props]
    if "masking" in props:
        parts.append(f"{props['masking']} masking")
    return ", ".join(parts)


def nearest_distribution(distribution: str, gamma: float) -> str:
    """The distribution of Mitsuba that comes nearest to a member of the family, judged by its tail."""
    if distribution in _EXPONENTIAL_ROWS or gamma > _HALFWAY_GAMMA:
        return "beckmann"
    return "ggx"


def _to_sgtd(props: Any, settings: Settings) -> None:
    """Turns one of Mitsuba's plugins into the partner that equals it, then applies the settings.

    A setting of gamma, p or lambda without a distribution moves away from the scene's own distribution, in the
    row that has all parameters free: p = 0.8 on a Beckmann scene keeps gamma = inf.
    """
    own = str(props["distribution"]).lower() if "distribution" in props else "beckmann"
    props.set_plugin_name(PARTNERS[props.plugin_name()])
    moves = any(name in settings for name in _TAIL_AND_BODY) and "distribution" not in settings
    if moves and own in _GAMMA:
        props["distribution"] = "sgtd"
        props["gamma"] = _GAMMA[own]
    else:
        props["distribution"] = own
    _apply(props, settings)


def _to_rough(props: Any, folder: Path) -> None:
    """Turns one of our plugins into the nearest of its partner: for a table or a mixture GGX of the same mean slope."""
    row = str(props["distribution"]).lower() if "distribution" in props else "sgtd"
    gamma = props["gamma"] if "gamma" in props else _GAMMA["ggx"]
    if not isinstance(gamma, (int, float)):
        gamma = _GAMMA["ggx"]  # the right side will say what is wrong with it
    if row in numeric_distribution.ROWS:
        _keep_mean_slope(props, folder)
    props.set_plugin_name(ORIGINALS[props.plugin_name()])
    if props.plugin_name() in ISOTROPIC and (mean := one_roughness(props)) is not None:
        del props["alpha_u"], props["alpha_v"]
        props["alpha"] = mean
    for name in (*_OF_DISTRIBUTION, "masking"):
        if name in props:
            del props[name]
    props["distribution"] = nearest_distribution(row, gamma)


def one_roughness(properties: Any) -> float | None:
    """The geometric mean of two roughnesses, which has as many facets to a solid angle along the normal; None if there are not two."""
    pair = [properties[name] for name in ("alpha_u", "alpha_v") if name in properties]
    if len(pair) != 2 or not all(isinstance(value, (int, float)) for value in pair):
        return None
    return math.sqrt(max(pair[0], 0.0) * max(pair[1], 0.0))


def _keep_mean_slope(props: Any, folder: Path) -> None:
    """Roughness of ours is the mean slope of a table, GGX has one of pi/2 times its own."""
    given = [name for name in ("alpha", "alpha_u", "alpha_v") if name in props]
    for name in given:
        if isinstance(props[name], (int, float)):
            props[name] = float(props[name]) * _GGX_PER_MEAN_SLOPE
    if not given:
        try:
            width = radial_of({name: props[name] for name in props.keys()}, folder).width
        except (KeyError, ValueError):
            return  # the right side will say what is wrong with it
        props["alpha"] = width * _GGX_PER_MEAN_SLOPE


def _set_roughness(props: Any, roughness: Mapping[str, float]) -> None:
    """One of two roughnesses leaves the other as it is, or as the single one that was there."""
    single = props["alpha"] if "alpha" in props else None
    if "alpha" in roughness:
        for name in ("alpha_u", "alpha_v"):
            if name in props:
                del props[name]
    elif single is not None:
        del props["alpha"]
        props["alpha_u"] = props["alpha_v"] = single
    for name, value in roughness.items():
        props[name] = value


def _apply(props: Any, settings: Settings) -> None:
    """Sets the properties; of ``shift`` and ``mu``, two ways to say the same, the last word counts.

    A distribution is a whole shape: parameters that belonged to the one before go with it. A table or a mixture has a roughness of its own,
    which it keeps instead of a number of the scene; a texture stays.
    """
    if "distribution" in settings:
        for name in _OF_DISTRIBUTION:
            if name in props and name not in settings:
                del props[name]
        if str(settings["distribution"]).lower() in numeric_distribution.ROWS:
            for name in ("alpha", "alpha_u", "alpha_v"):
                if name in props and isinstance(props[name], (int, float)):
                    del props[name]
    for name, value in settings.items():
        props[name] = value
        other = {"shift": "mu", "mu": "shift"}.get(name)
        if other and other not in settings and other in props:
            del props[other]


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
