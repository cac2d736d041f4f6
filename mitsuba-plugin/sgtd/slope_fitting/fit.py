"""``sgtd.fit_slopes`` and ``sgtd.fit_heights``."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UserError
from ..fitting.rows import ROWS
from ..microsurface import Surface, distribution
from ..ndf import Ndf
from .cells import cells_of
from .climb import Climb, select
from .intervals import intervals
from .result import SlopeFit, SlopeScore

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

# Blocks along a side of a map, and along a list
_SIDE, _LIST = 12, 100
_FEWEST = 200
# A tilt that is more than this of the roughness moves the fit
_TILTED = 0.05
# Steps of slopes over the roughness that are worth a word
_COARSE = 0.05


def fit_slopes(
    sx: ArrayLike,
    sy: ArrayLike,
    *,
    model: str | tuple[str, ...] = "auto",
    title: str = "slopes",
) -> SlopeFit:
    """Fits the distribution of the slopes ``sx`` and ``sy`` of facets of equal projected area: maximum likelihood under D cos of a row with two
    roughnesses and a rotation of the axes.

    ``"auto"`` fits all rows of the family, each from those below it, and climbs as long as a row is better on the half that was left out of the
    fit, by a standard error. Neighbors are alike: arrays (ny, nx) are cut into blocks, lists (n,) into stretches, and intervals come
    from drawing blocks. NaN is a slope that was not measured. Raises ``UserError``, a ``ValueError``, for what is no set of slopes.
    """
    x, y = (np.asarray(s, dtype=np.float64) for s in (sx, sy))
    if x.shape != y.shape or x.ndim not in (1, 2):
        raise UserError(f"sx has shape {x.shape} and sy {y.shape}; both must be (n,) or (ny, nx)")
    if x.ndim == 2:
        places = np.moveaxis(np.indices(x.shape), 0, -1).reshape(-1, 2)
        block, halves = _blocks(places, x.shape)
    else:
        block = np.arange(len(x)) * _LIST // max(len(x), 1)
        halves = np.arange(_LIST) % 2 == 1
    slopes = np.stack([x.ravel(), y.ravel()], axis=1)
    return _fit(slopes, np.asarray(block, np.int64), halves, model, title)


def fit_heights(
    z: ArrayLike,
    spacing: float | tuple[float, float],
    *,
    periodic: bool = False,
    level: bool = False,
    model: str | tuple[str, ...] = "auto",
    title: str = "heights",
) -> SlopeFit:
    """:func:`fit_slopes` of the facets of a map of heights ``z`` (ny, nx), two triangles to a cell; ``spacing`` are the distances of its points along x
    and y in the unit of heights, NaN is a height that was not measured, ``level`` takes off the mean slope."""
    dx, dy = (spacing, spacing) if isinstance(spacing, (int, float)) else spacing
    surface = Surface(np.asarray(z, dtype=np.float64), (float(dx), float(dy)), periodic)
    return fit_surface(surface.levelled() if level else surface, model=model, title=title)


def fit_surface(surface: Surface, *, model: str | tuple[str, ...] = "auto", title: str = "heights") -> SlopeFit:
    """:func:`fit_heights` of a surface that was read from a file."""
    places = surface.facet_cells()
    block, halves = _blocks(places, surface.heights.shape)
    found = _fit(surface.slopes(), block, halves, model, title)
    return dataclasses.replace(found, notes=(*surface.notes, *_steps(surface, found.ndf), *found.notes))


def _steps(surface: Surface, ndf: Ndf) -> list[str]:
    """A remark if heights are whole multiples of a step that makes slopes coarse."""
    heights = np.unique(surface.heights[np.isfinite(surface.heights)])
    if len(heights) < 2 or len(heights) > 0.2 * surface.heights.size:
        return []
    step = float(np.median(np.diff(heights)))
    coarse = step / min(surface.spacing) / min(ndf.stretch)
    if coarse < _COARSE:
        return []
    return [f"heights come in steps of about {step:.3g}: slopes are resolved to {100 * coarse:.2g} % of the roughness"]


def _blocks(places: NDArray[np.int64], shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Block of each place in a grid, and of each block its color of a chessboard."""
    sides = [min(_SIDE, max(1, length // 4)) for length in shape]
    row, column = (places[:, k] * sides[k] // shape[k] for k in (0, 1))
    color = np.indices(sides).sum(axis=0).ravel() % 2 == 1
    return np.asarray(row * sides[1] + column, np.int64), color


def _fit(
    slopes: Array, block: NDArray[np.int64], halves: NDArray[np.bool_], model: str | tuple[str, ...], title: str
) -> SlopeFit:
    names = (model,) if isinstance(model, str) else tuple(model)
    for name in names:
        if name != "auto" and name not in ROWS:
            raise UserError(f'model "{name}" is no row that slopes are fitted with: choose auto, {", ".join(ROWS)}')
    known: NDArray[np.bool_] = np.asarray(np.isfinite(slopes).all(axis=1), np.bool_)
    notes = []
    if not known.all():
        notes.append(f"{int((~known).sum())} of {len(known)} slopes are not numbers; they are left out")
        slopes, block = slopes[known], block[known]
    if len(slopes) < _FEWEST:
        raise UserError(f"{title}: {len(slopes)} slopes: a distribution needs at least {_FEWEST}")
    axes = distribution(slopes)
    start = 0.5 * math.log(axes.alpha_u / axes.alpha_v), math.radians(axes.rotation)
    used, block = np.unique(block, return_inverse=True)
    climb = Climb(cells_of(slopes, block, axes), halves[used], start)
    if names == ("auto",):
        chosen = select(climb)
    else:
        for name in names:
            climb.fit(name)
        chosen = max(names, key=lambda name: climb.fit(name).value)
    for fitted in climb.found.values():
        fitted.v = _named_axes(fitted.v)
    best = climb.found[chosen]
    space = best.likelihood.space
    ndf = space.ndf(best.v, 1e-5)
    rotation = space.rotation(best.v)
    su, sv = ndf.stretch
    tilt = slopes.mean(axis=0)
    if np.hypot(tilt[0] / su, tilt[1] / sv) > _TILTED:
        notes.append(
            f"the mean slope is {tilt[0]:.3g} along x and {tilt[1]:.3g} along y, which the model takes to be 0: level the map first (--level)"
        )
    scores = tuple(
        SlopeScore(
            name,
            fitted.value,
            math.nan if fitted.held_out is None else _mean(fitted.held_out, climb),
            len(fitted.v),
            fitted.seconds,
            name == chosen,
        )
        for name, fitted in climb.found.items()
    )
    return SlopeFit(
        title,
        chosen,
        ndf,
        math.degrees(rotation),
        intervals(best),
        best.value,
        scores,
        _distance(slopes, ndf, rotation),
        len(slopes),
        (float(tilt[0]), float(tilt[1])),
        tuple(notes),
        climb.found,
    )


def _mean(held_out: Array, climb: Climb) -> float:
    weights = climb.cells.counts.sum(axis=1)
    return float(weights @ held_out / weights.sum())


def _named_axes(v: Array) -> Array:
    """The same distribution with u the axis nearer to x: a rotation from -45 to 45 degrees."""
    quarters = round(v[2] / (0.5 * math.pi))
    moved = v.copy()
    moved[2] -= 0.5 * math.pi * quarters
    if quarters % 2:
        moved[1] = -moved[1]
    return moved


def _distance(slopes: Array, ndf: Ndf, rotation: float) -> float:
    c, s = math.cos(rotation), math.sin(rotation)
    u = (c * slopes[:, 0] + s * slopes[:, 1]) / ndf.stretch[0]
    v = (c * slopes[:, 1] - s * slopes[:, 0]) / ndf.stretch[1]
    expected = ndf.cdf(np.sort(np.hypot(u, v)))
    steps = np.arange(len(slopes) + 1) / len(slopes)
    return float(max(np.abs(expected - steps[1:]).max(), np.abs(expected - steps[:-1]).max()))
