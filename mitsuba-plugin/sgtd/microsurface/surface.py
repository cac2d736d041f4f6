"""A height map: its facets, their slopes, what of it is seen."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..errors import UserError, os_reason, require
from ..ndf import Ndf
from . import files
from .described import restore
from .height_map import HeightMap
from .images import gray_values

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Heights on a grid, row by row along y, with the distances of points along x and y.

    Two triangles per cell, ``(i, j), (i+1, j), (i, j+1)`` and ``(i+1, j+1), (i, j+1), (i+1, j)``: all have the same projected area, so
    the histogram of their slopes is the distribution D cos(theta). A ``periodic`` surface is a tile that repeats; of another one (a measured
    patch) the facets inside count. Points that were not measured are NaN: facets beside them are left out.

    ``info`` is what the sidecar file has: shape, roughness, seed, distances that were reached. ``notes`` say what reading a file has
    changed or left out.
    """

    heights: Array
    spacing: tuple[float, float]
    periodic: bool = True
    info: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        heights = np.ascontiguousarray(self.heights, dtype=np.float64)
        if heights.ndim != 2 or min(heights.shape) < 4:
            raise UserError(f"heights have the shape {heights.shape}: a surface is a grid of at least 4 × 4 points")
        if not all(np.isfinite(d) and d > 0.0 for d in self.spacing):
            raise UserError(f"the spacing of points is {self.spacing}: it must be two positive numbers")
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "spacing", (float(self.spacing[0]), float(self.spacing[1])))

    @property
    def missing(self) -> int:
        """Number of points that were not measured."""
        return int(np.count_nonzero(~np.isfinite(self.heights)))

    @functools.cached_property
    def core(self) -> _core.Microsurface:
        """The surface as the core traces it: whole and periodic."""
        if not self.periodic:
            raise UserError("the surface does not repeat, and light would leave it at its sides: mirror it (--mirror)")
        if self.missing:
            raise UserError(
                f"{self.missing} heights were not measured: fill them first, or cut out a part without them"
            )
        ny, nx = self.heights.shape
        try:
            return _core.Microsurface(nx, ny, *self.spacing, self.heights)
        except ValueError as error:
            raise UserError(str(error)) from error

    def slopes(self) -> Array:
        """Slopes (n, 2) of all facets, lower and upper of each cell in turn; of a patch, those that were measured."""
        if self.periodic and not self.missing:
            return self.core.slopes().reshape(-1, 2)
        slopes = self._cell_slopes().reshape(-1, 2)
        return np.ascontiguousarray(slopes[np.isfinite(slopes).all(axis=1)])

    def facet_cells(self) -> NDArray[np.int64]:
        """Row and column (n, 2) of the cell of each facet of :meth:`slopes`."""
        ny, nx = self.heights.shape
        shape = (ny, nx) if self.periodic else (ny - 1, nx - 1)
        cells = np.repeat(np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 2), 2, axis=0)
        return cells[np.isfinite(self._cell_slopes().reshape(-1, 2)).all(axis=1)] if self.missing else cells

    def _cell_slopes(self) -> Array:
        """Slopes (rows, columns, 4) of both facets of every cell, along x and y in turn."""
        h = self.heights
        if self.periodic:
            h = np.pad(h, ((0, 1), (0, 1)), mode="wrap")
        a, b, c, d = h[:-1, :-1], h[:-1, 1:], h[1:, :-1], h[1:, 1:]
        cells = np.stack([b - a, c - a, d - c, d - b], axis=-1)
        return cells / np.tile(np.asarray(self.spacing), 2)

    def lag_correlation(self) -> float:
        """Correlation of slopes along x between cells that are neighbors along x, from ranks: heavy tails have no variance."""
        require("report")
        from scipy.stats import rankdata

        slopes = np.diff(self.heights, axis=1)
        known = np.isfinite(slopes)
        ranks = np.full(slopes.shape, np.nan)
        ranks[known] = rankdata(slopes[known])
        left, right = ranks[:, :-1], ranks[:, 1:]
        both = np.isfinite(left) & np.isfinite(right)
        if not both.any() or not np.ptp(ranks[known]):
            return 0.0
        return float(np.corrcoef(left[both], right[both])[0, 1])

    def normals(self) -> Array:
        """Normals (ny, 2 nx, 3) of all facets of a periodic surface: lower and upper of each cell side by side."""
        ny, nx = self.heights.shape
        slopes = self.core.slopes().reshape(ny, 2 * nx, 2)
        normals = np.concatenate([-slopes, np.ones((ny, 2 * nx, 1))], axis=-1)
        return normals / np.linalg.norm(normals, axis=-1, keepdims=True)

    def projected_area(self, w: ArrayLike) -> Array:
        """Area of all facets that face directions ``w`` (..., 3), seen from there, per area of the surface."""
        directions = np.ascontiguousarray(w, dtype=np.float64)
        return self.core.projected_areas(directions).reshape(directions.shape[:-1])

    def g1(self, w: ArrayLike) -> Array:
        """Mean masking ``cos(theta) / projected area``, which is Smith's G1 of the surface's own distribution as well."""
        cosines = np.asarray(w, dtype=np.float64)[..., 2]
        return np.where(cosines > 0.0, cosines / self.projected_area(w), 0.0)

    def agreement(self, ndf: Ndf) -> _core.SlopeAgreement:
        """How near the slopes are to a distribution."""
        return ndf_agreement(self.slopes(), ndf)

    def stretched(self, alpha_u: float, alpha_v: float) -> Surface:
        """Slopes multiplied along x and y: heights by ``alpha_u``, the spacing along y by ``alpha_u / alpha_v``."""
        dx, dy = self.spacing
        return dataclasses.replace(self, heights=alpha_u * self.heights, spacing=(dx, dy * alpha_u / alpha_v))

    def levelled(self) -> Surface:
        """Without its tilt, the mean slope of its facets: Smith's theory supposes that there is none."""
        if self.periodic:
            return self  # what repeats has none
        ny, nx = self.heights.shape
        sx, sy = self.slopes().mean(axis=0)
        note = f"levelled: a tilt of {sx:.4g} along x and {sy:.4g} along y was taken off"
        dx, dy = self.spacing
        heights = self.heights - sx * dx * np.arange(nx) - sy * dy * np.arange(ny)[:, None]
        return dataclasses.replace(self, heights=heights, notes=(*self.notes, note))

    def mirrored(self) -> Surface:
        """A periodic surface of four mirror images of a patch."""
        h = np.concatenate([self.heights, self.heights[:, -2:0:-1]], axis=1)
        h = np.concatenate([h, h[-2:0:-1]], axis=0)
        note = "mirrored: the patch and its mirror images are one tile, whose slopes have no preferred sign"
        return dataclasses.replace(self, heights=h, periodic=True, notes=(*self.notes, note))

    @property
    def ndf(self) -> Ndf | None:
        """The distribution that it was made for, if its sidecar says so."""
        given = self.info.get("distribution")
        return restore(given) if isinstance(given, dict) else None

    def save(self, *paths: Path | str, tolerance: float = 1e-3) -> None:
        """Writes files by their endings, and a sidecar beside them.

        A ``.png`` has 16 bits: it is refused if rounding moves the distribution of slopes by more than ``tolerance`` (Kolmogorov–Smirnov).
        """
        places = [Path(path) for path in paths]
        files.check_endings(places)
        sidecar = {**self.info, "spacing": list(self.spacing), "periodic": self.periodic}
        whole = HeightMap(self.heights, self.spacing, self.periodic)
        if any(path.suffix.lower() == ".png" for path in places):
            values, low, high = gray_values(whole)
            loss = ks_distance(self.slopes(), self._with_heights(low + (high - low) / 65535.0 * values).slopes())
            if not loss <= tolerance:
                raise UserError(
                    f"16 bits would move the distribution of slopes by {loss:.2g}, more than the tolerance {tolerance:g}: "
                    "write .exr, .npy or .gsf instead"
                )
            sidecar["png"] = {"low": low, "high": high, "loss": loss}
        files.write(whole, sidecar, places)

    @staticmethod
    def load(path: Path | str) -> Surface:
        """Reads a file with what its sidecar says."""
        return read_heights(Path(path))

    def _with_heights(self, heights: Array) -> Surface:
        return dataclasses.replace(self, heights=heights)


def read_heights(
    path: Path,
    spacing: tuple[float, float] | None = None,
    level: bool = False,
    gray: tuple[float, float] | None = None,
) -> Surface:
    """Reads a height map of any kind that ``sgtd.microsurface.files`` lists.

    ``spacing``, the distances of points in the unit of heights, goes before that of the sidecar, and that before the file's own. ``level``
    takes off the mean slope. ``gray`` are the heights of black and white in an image of whole numbers. What is not known is asked for in an error.
    """
    if not path.is_file():
        raise UserError(f"{path}: there is no such file")
    sidecar = files.read_sidecar(path)
    try:
        raw = files.read(path, {**sidecar, "png": {"low": gray[0], "high": gray[1]}} if gray else sidecar)
    except OSError as error:
        raise UserError(f"{path}: {os_reason(error)}") from error
    told = sidecar.get("spacing")
    known = spacing or (tuple(told) if told else None) or raw.spacing
    if known is None:
        raise UserError(
            f"{path}: the distance of its points is not known: give --spacing DX DY, in units of the heights"
        )
    periodic = sidecar.get("periodic", raw.periodic)
    notes = raw.notes
    if periodic is None:
        periodic = False
        notes = (*notes, "nothing says that the map repeats: its facets inside count, none across its sides")
    surface = Surface(raw.heights, known, bool(periodic), sidecar, notes)
    if surface.missing:
        note = f"{surface.missing} of {surface.heights.size} heights were not measured: facets beside them are left out"
        surface = dataclasses.replace(surface, notes=(*surface.notes, note))
    return surface.levelled() if level else surface


def ndf_agreement(slopes: Array, ndf: Ndf) -> _core.SlopeAgreement:
    """How near slopes (n, 2) are to a distribution at its roughness."""
    return _core.slope_agreement(ndf._core, *ndf.stretch, slopes)


def ks_distance(first: Array, second: Array) -> float:
    """Kolmogorov–Smirnov distance of the lengths of two sets of slopes."""
    a, b = (np.sort(np.linalg.norm(slopes, axis=1)) for slopes in (first, second))
    both = np.concatenate([a, b])
    shares = [np.searchsorted(x, both, side="right") / x.size for x in (a, b)]
    return float(np.abs(shares[0] - shares[1]).max())
