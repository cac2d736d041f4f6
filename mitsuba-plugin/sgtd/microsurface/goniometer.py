"""A virtual goniometer: where light goes that falls on a surface, by how many facets it met, and which facets it met first."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .. import _core
from ..errors import UserError, mitsuba_errors
from ..ndf import Ndf
from .surface import Surface
from .watching import Advance, watched

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Walks per direction of light: energies are off by 7e-4 at the most (one standard deviation).
WALKS = 500_000

# Beyond it a ray may pass a thousand periods of the surface, whose repetition it then sees.
_GRAZING = 89.9


@dataclass(frozen=True)
class Material:
    """What facets are made of: ``kind`` is mirror, conductor or dielectric, with its indices per color."""

    name: str
    kind: str = "mirror"
    eta: tuple[float, float, float] = (1.0, 1.0, 1.0)
    k: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @staticmethod
    def of(material: str | None = None, ior: float | None = None) -> Material:
        """A metal by Mitsuba's name, in its three colors; glass by its index; a mirror, if neither is given."""
        if material is not None and ior is not None:
            raise UserError("a material and an index are given together: choose one")
        if ior is not None:
            if not (math.isfinite(ior) and ior > 0.0 and ior != 1.0):
                raise UserError(f"the index is {ior:g}: it must be a positive number other than 1")
            return Material(f"glass, index {ior:g}", "dielectric", (ior,) * 3)
        if material in (None, "none", "mirror"):
            return Material("mirror")
        import mitsuba as mi

        with rgb_variant(), mitsuba_errors(f'material "{material}"'):
            indices = mi.traverse(mi.load_dict({"type": "roughconductor", "material": material}))
            eta, k = (np.array(indices[f"{name}.value"], dtype=float).ravel() for name in ("eta", "k"))
        return Material(str(material), "conductor", (eta[0], eta[1], eta[2]), (k[0], k[1], k[2]))


@contextlib.contextmanager
def rgb_variant() -> Iterator[None]:
    """Mitsuba in three colors, whatever variant is set around it."""
    import mitsuba as mi

    before = mi.variant()
    mi.set_variant("scalar_rgb")
    try:
        yield
    finally:
        if before:
            mi.set_variant(before)


@dataclass(frozen=True)
class Bins:
    """How finely directions are told apart: polar angles of one hemisphere and azimuths (from −π) of even width, numbers of facets
    (the last one holds all greater ones), cosines at the first facet."""

    polar: int = 30
    azimuths: int = 24
    orders: int = 4
    cosines: int = 20

    def solid_angles(self) -> Array:
        """Of a polar bin, in one azimuth."""
        cosines = np.cos(np.linspace(0.0, 0.5 * math.pi, self.polar + 1))
        return (cosines[:-1] - cosines[1:]) * 2.0 * math.pi / self.azimuths

    def place(self, w: Array) -> tuple[NDArray[np.int64], ...]:
        """Hemisphere (0 is the upper one), polar bin and azimuth of directions (n, 3): the goniometer's own rule."""
        polar = np.arccos(np.minimum(np.abs(w[:, 2]), 1.0)) / (0.5 * math.pi) * self.polar
        azimuth = (np.arctan2(w[:, 1], w[:, 0]) / (2.0 * math.pi) + 0.5) * self.azimuths
        return (
            (w[:, 2] < 0.0).astype(np.int64),
            np.minimum(polar.astype(np.int64), self.polar - 1),
            np.minimum(azimuth.astype(np.int64), self.azimuths - 1),
        )


@dataclass(frozen=True)
class Scattered:
    """Light of one direction, by (hemisphere, order, polar, azimuth, color), as shares of what came; ``squares`` are means of the squares
    of what single walks carry, from which errors follow."""

    energy: Array
    squares: Array
    walks: int

    def total(self, hemisphere: int | None = None, orders: slice | int | None = None) -> tuple[float, float]:
        """Energy, as a mean over colors, and its standard error."""
        h = slice(None) if hemisphere is None else slice(hemisphere, hemisphere + 1)
        o = slice(orders, orders + 1) if isinstance(orders, int) else orders or slice(None)
        energy, squares = self.energy[h, o], self.squares[h, o]
        colors = energy.shape[-1]
        mean = float(energy.sum()) / colors
        # a walk's colors are nearly alike: their mean varies at most as they do
        square = float(squares.sum()) / colors
        return mean, math.sqrt(max(square - mean * mean, 0.0) / self.walks)

    def errors(self) -> Array:
        """Standard error of each bin."""
        return np.sqrt(np.maximum(self.squares - self.energy**2, 0.0) / self.walks)

    def directions(self, hemisphere: int, orders: slice) -> Array:
        """Energy by (polar, azimuth), a mean over colors."""
        return self.energy[hemisphere, orders].sum(axis=0).mean(axis=-1)


@dataclass(frozen=True)
class Measured:
    """One direction of light on a surface, or on its model."""

    scattered: Scattered
    lost: int
    mean_bounces: float
    first: Array
    """Walks by the cosine at the first facet."""


@dataclass(frozen=True)
class Setup:
    """A direction of light on a material."""

    theta: float
    phi: float
    material: Material
    bins: Bins
    walks: int = WALKS
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.theta <= _GRAZING:
            raise UserError(f"theta is {self.theta:g}: it must be between 0 and {_GRAZING} degrees")
        if not 1 <= self.walks <= 10**12:
            raise UserError(f"{self.walks} walks are asked for: at least 1 and at most 10¹²")

    @property
    def wi(self) -> Array:
        theta, phi = math.radians(self.theta), math.radians(self.phi)
        return np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])

    @property
    def core(self) -> _core.Goniometer:
        m, b = self.material, self.bins
        return _core.Goniometer(
            list(self.wi), m.kind, m.eta, m.k, b.orders, b.polar, b.azimuths, b.cosines, self.walks, self.seed
        )

    def reflectance(self, cosines: Array) -> Array:
        """Fresnel's, (n, 3)."""
        return self.core.reflectance(np.ascontiguousarray(cosines)).reshape(-1, 3)

    def unpack(self, numbers: Array) -> Measured:
        """What the core counts, as shares."""
        b = self.bins
        walks, lost, bounces, _ = numbers[:4]
        first, rest = np.split(numbers[4:], [b.cosines])
        energy, squares = rest.reshape(2, 2, b.orders, b.polar, b.azimuths, 3) / walks
        ended = max(walks - lost, 1.0)
        return Measured(Scattered(energy, squares, int(walks)), int(lost), bounces / ended, first)


def measure(surface: Surface, setup: Setup, advance: Advance = None) -> Measured:
    """Follows light on the surface, facet by facet, until it leaves. Parallel; the same for the same seed."""
    core = surface.core
    return _measured(setup, lambda watch: core.measure(setup.core, watch), advance)


def measure_model(ndf: Ndf, setup: Setup, advance: Advance = None) -> Measured:
    """The same on Smith's model of a surface: the random walk of Heitz et al. (2016)."""
    return _measured(setup, lambda watch: _core.measure_model(ndf._core, *ndf.stretch, setup.core, watch), advance)


def _measured(setup: Setup, call, advance: Advance) -> Measured:  # type: ignore[no-untyped-def]
    try:
        return setup.unpack(watched(call, advance))
    except ValueError as error:
        raise UserError(str(error)) from error


def visible_shares(surface: Surface, setup: Setup, measured: Measured) -> tuple[Array, Array, Array]:
    """By the cosine between light and facet: what is seen of all facets that face the light, its standard error, and their share of
    the facing area. Smith's model has the same everywhere, G1."""
    area = surface.core.areas_by_cosine(setup.core)
    walks = measured.scattered.walks
    cos = math.cos(math.radians(setup.theta))
    share = measured.first / walks
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = np.where(area > 0.0, share * cos / area, np.nan)
        error = np.where(area > 0.0, np.sqrt(share * (1.0 - share) / walks) * cos / area, np.nan)
    return seen, error, area / area.sum()


def goniometer(
    surface: Surface,
    thetas: Sequence[float],
    *,
    phi: float = 0.0,
    material: str | None = None,
    ior: float | None = None,
    orders: int = 4,
    bins: Bins | None = None,
    walks: int = WALKS,
    seed: int = 0,
    advance: Advance = None,
) -> list[Measured]:
    """Light from each of the polar angles, in degrees, on a mirror, a metal or glass; ``bins`` say more than ``orders`` alone."""
    facets = Material.of(material, ior)
    chosen = bins or Bins(orders=orders)
    return [measure(surface, Setup(theta, phi, facets, chosen, walks, seed), advance) for theta in thetas]
