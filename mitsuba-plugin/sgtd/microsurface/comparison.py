"""A surface beside its models: where Smith's model fails, and by how much.

Each :class:`Effect` is one number of the surface, with its standard error, beside the same number of one model:

======================  ====================================================================================================
mean masking            G1 of all facets together. For a periodic height field it *is* Smith's G1 of its own slopes: what
                        differs from the target is that a finite surface is not its target
masking by facet        the share that is seen of facets turned away from the light, and of those that face it: in Smith's
                        model both are G1
single scattering       energy of the first order, separable and height-correlated masking, and where it goes
multiple scattering     energy of the second order and of all further ones beside the random walk, of glass on both sides; of
                        both together beside the lobe, and where it goes
======================  ====================================================================================================

"Where it goes" is the total variation of directions, half the sum of differences of bins over the energy, less what noise alone has.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Optional

import numpy as np

from ..ndf import Ndf
from .goniometer import Bins, Material, Measured, Scattered, Setup, measure, measure_model, visible_shares
from .smith import COUNT, MASKINGS, MeshModel, SmithModel, TargetModel, lobe, single_scattering
from .surface import Surface
from .watching import Advance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Facets turned away from the light, and those that face it: quantiles of the facing area, ordered by cosine.
EDGE_ON, FACING = 0.1, 0.9

MODELS = ("target", "mesh")
WORDS = {"separable": "separable", "height_correlated": "height-correlated"}


@dataclass(frozen=True)
class Effect:
    """One number of the surface and of a model; ``error`` is the standard error of their difference."""

    theta: float
    effect: str
    model: str
    surface: float
    expected: float
    error: float

    @property
    def difference(self) -> float:
        """Model less surface."""
        return self.expected - self.surface

    @property
    def relative(self) -> float:
        """The same as a part of what the surface has."""
        return self.difference / self.surface if self.surface else math.nan

    @property
    def significant(self) -> bool:
        """Beyond three standard errors."""
        return abs(self.difference) > 3.0 * self.error


@dataclass(frozen=True)
class View:
    """All that is known of one direction of light."""

    setup: Setup
    mesh: Measured
    walk: Optional[Measured]
    """The model's random walk, if there is a target."""
    single: dict[tuple[str, str], Scattered]
    """By model (target, mesh) and masking."""
    lobes: dict[str, Scattered]
    """By masking; none for glass, and none for tables and mixtures, which the material is given as files."""
    g1: dict[str, float]
    """Of the surface, and of the target if there is one."""
    seen: tuple[Array, Array, Array]
    """By cosine: what is seen of facets, its error, their share of the facing area."""
    effects: tuple[Effect, ...]

    @property
    def theta(self) -> float:
        return self.setup.theta


@dataclass(frozen=True)
class Comparison:
    surface: Surface
    ndf: Optional[Ndf]
    material: Material
    views: tuple[View, ...]
    notes: tuple[str, ...]

    @property
    def effects(self) -> list[Effect]:
        return [effect for view in self.views for effect in view.effects]


def compare(
    surface: Surface,
    ndf: Ndf | None,
    thetas: Sequence[float],
    *,
    phi: float = 0.0,
    material: Material,
    bins: Bins,
    walks: int,
    seed: int = 0,
    progress: Callable[[str, int], Advance] | None = None,
) -> Comparison:
    """Measures the surface and its models; ``ndf`` is the target, if it has one."""
    advance = progress("walks", walks * len(thetas) * (2 if ndf else 1)) if progress else None
    models: dict[str, SmithModel] = {"mesh": MeshModel(surface)}
    if ndf:
        models["target"] = TargetModel(ndf)
    views = []
    for theta in thetas:
        setup = Setup(theta, phi, material, bins, walks, seed)
        mesh = measure(surface, setup, advance)
        walk = measure_model(ndf, setup, advance) if ndf else None
        single = {
            (name, masking): single_scattering(models[name], setup, masking)
            for name in MODELS
            if name in models
            for masking in MASKINGS
        }
        has_lobe = material.kind != "dielectric" and ndf and ndf.distribution not in ("tabulated", "mixture")
        lobes = {masking: lobe(ndf, setup, masking) for masking in MASKINGS} if ndf and has_lobe else {}
        g1 = {"mesh": float(surface.g1(setup.wi)), **({"target": float(ndf.g1(setup.wi))} if ndf else {})}
        seen = visible_shares(surface, setup, mesh)
        views.append(
            View(setup, mesh, walk, single, lobes, g1, seen, _effects(setup, mesh, walk, single, lobes, g1, seen))
        )
    return Comparison(surface, ndf, material, tuple(views), _warnings(surface, thetas))


def _effects(
    setup: Setup,
    mesh: Measured,
    walk: Measured | None,
    single: dict[tuple[str, str], Scattered],
    lobes: dict[str, Scattered],
    g1: dict[str, float],
    seen: tuple[Array, Array, Array],
) -> tuple[Effect, ...]:
    theta = setup.theta
    found: list[Effect] = []
    if "target" in g1:
        found.append(Effect(theta, "mean masking", "Smith, target", g1["mesh"], g1["target"], 0.0))
    for name, (value, error) in _by_facet(seen).items():
        found.append(Effect(theta, f"masking, {name}", "Smith, mesh", value, g1["mesh"], error))
    sides = (("", 0), (" transmitted", 1)) if setup.material.kind == "dielectric" else (("", 0),)
    first = mesh.scattered
    for (model, masking), scattered in single.items():
        words = f"Smith, {model}, {WORDS[masking]}"
        for side, hemisphere in sides:
            (value, error), (expected, noise) = first.total(hemisphere, 0), scattered.total(hemisphere, 0)
            # Sobol's points have less noise than random ones
            found.append(
                Effect(theta, f"energy, 1 facet{side}", words, value, expected, math.hypot(error, 0.3 * noise))
            )
            found.append(
                _direction(theta, f"directions, 1 facet{side}", words, first, scattered, hemisphere, slice(0, 1))
            )
    for order in range(1, setup.bins.orders):
        facets = f"{order + 1}{' and more' if order == setup.bins.orders - 1 else ''} facets"
        if walk:
            found += [
                _energy(theta, f"energy, {facets}{side}", first, walk.scattered, hemisphere, order)
                for side, hemisphere in sides
            ]
    if walk and setup.bins.orders > 1:
        more = slice(1, None)
        for side, hemisphere in sides:
            again = first, walk.scattered, hemisphere, more
            found.append(_energy(theta, f"energy, 2 and more facets{side}", *again))
            found.append(_direction(theta, f"directions, 2 and more facets{side}", "random walk", *again))
        value, error = first.total(0, more)
        for masking, scattered in lobes.items():
            words = f"lobe, {WORDS[masking]}"
            found.append(Effect(theta, "energy, 2 and more facets", words, value, scattered.total(0)[0], error))
            found.append(_direction(theta, "directions, 2 and more facets", words, first, scattered, 0, more))
    return tuple(found)


def _energy(theta: float, name: str, first: Scattered, walk: Scattered, hemisphere: int, orders: int | slice) -> Effect:
    (value, error), (expected, noise) = (x.total(hemisphere, orders) for x in (first, walk))
    return Effect(theta, name, "random walk", value, expected, math.hypot(error, noise))


def _by_facet(seen: tuple[Array, Array, Array]) -> dict[str, tuple[float, float]]:
    """What is seen of the facing area's part that is turned away most, and of the part that faces the light most."""
    share, error, area = seen
    before = np.cumsum(area) - area
    result = {}
    for name, chosen in (("facets turned away", before < EDGE_ON), ("facets that face it", before + area > FACING)):
        chosen = chosen & (area > 0.0)
        weight = area[chosen] / area[chosen].sum()
        result[name] = (
            float((weight * share[chosen]).sum()),
            float(np.sqrt(((weight * error[chosen]) ** 2).sum())),
        )
    return result


def _direction(
    theta: float, name: str, model: str, first: Scattered, second: Scattered, hemisphere: int, orders: slice
) -> Effect:
    """Total variation between directions, both scaled to an energy of 1, and what noise alone would have of it."""
    a, b = (x.directions(hemisphere, orders) for x in (first, second))
    if not a.sum() > 0.0 or not b.sum() > 0.0:
        return Effect(theta, name, model, 0.0, 0.0, 1.0)
    distance = 0.5 * float(np.abs(a / a.sum() - b / b.sum()).sum())
    # of a bin with count n, |noise| is sqrt(2 n / pi) on average
    noise = 0.5 * float(np.sqrt(2.0 / math.pi * (a / first.walks / a.sum() ** 2)).sum())
    if second.walks > 1:
        more = 0.5 * float(np.sqrt(2.0 / math.pi * (b / second.walks / b.sum() ** 2)).sum())
        noise = math.hypot(noise, more)
    return Effect(theta, name, model, 0.0, max(distance - noise, 0.0), noise / 3.0)


def _warnings(surface: Surface, thetas: Sequence[float]) -> tuple[str, ...]:
    """What a periodic tile cannot tell."""
    ny, nx = surface.heights.shape
    period = min(nx * surface.spacing[0], ny * surface.spacing[1])
    tallest = float(np.ptp(surface.heights))
    notes = []
    for theta in thetas:
        shadow = tallest * math.tan(math.radians(theta))
        if shadow > period:
            notes.append(
                f"at {theta:g}° the tallest spike throws a shadow over {shadow / period:.1f} periods of the surface: light "
                "meets the same spikes again, and more points would see less of that"
            )
    return tuple(notes)


__all__ = ["COUNT", "Comparison", "Effect", "View", "compare"]
