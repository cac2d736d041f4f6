"""A distribution as numbers and as a picture: D, masking, what a view sees, and the lobe of reflections."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import UserError, require
from .ndf import Ndf

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Angles of the table; of the curves; views.
_ROWS = (0.0, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 85.0, 88.0, 89.5)
_POINTS = 400
_VIEWS = (0.0, 45.0, 75.0)
_LOBE_VIEW = 50.0


@dataclass(frozen=True)
class Row:
    """One angle in the plane of x: of a normal for the densities, of a direction for masking."""

    angle: float
    slope: float
    d: float
    d_cos: float
    slope_density: float
    share_below: float
    lambda_: float
    g1: float


def numbers(ndf: Ndf, angles: tuple[float, ...] = _ROWS) -> list[Row]:
    """At polar angles in degrees."""
    directions = _along_x(np.radians(angles))
    cos = directions[:, 2]
    slopes = np.tan(np.radians(angles))
    d, below = ndf.d(directions), ndf.cdf(slopes / _stretch(ndf))
    columns = (np.array(angles), slopes, d, d * cos, d * cos**4, below, ndf.lambda_(directions), ndf.g1(directions))
    return [Row(*(float(x) for x in row)) for row in zip(*columns)]


def convert(source: str, target: str, slope: Array, values: Array) -> Array:
    """Values of one quantity (``D``, ``D_cos``, ``slope``) at slopes as those of another."""
    power = {"D": 4, "D_cos": 3, "slope": 0}
    return np.asarray(values * np.hypot(1.0, slope) ** (power[target] - power[source]))


@dataclass(frozen=True)
class ResamplingError:
    """What a table makes of a distribution: greatest relative error of G1, of D down to 1e-6 of its peak, and of D cos in total variation."""

    nodes: int
    g1: float
    d: float
    d_at: float
    variation: float


def resampling_error(exact: Ndf, table: Ndf) -> ResamplingError:
    """Of a table against what it was made from, at one roughness."""
    theta = np.radians(np.concatenate([np.linspace(0.05, 89.9, 1200), 90.0 - np.geomspace(1e-3, 0.1, 100)]))
    w = _along_x(theta)
    slopes = _stretch(exact) * exact.quantile(np.linspace(0.0, 1.0, 4001)[:-1])
    m = _along_x(np.arctan(slopes))
    d = exact.d(m)
    error = np.where(d > 1e-6 * d.max(), np.abs(table.d(m) / np.maximum(d, 1e-300) - 1.0), 0.0)
    worst = int(np.argmax(error))
    shares = np.diff(table.cdf(slopes / _stretch(table)))
    return ResamplingError(
        nodes=len(table.table.slopes) if table.table else 0,
        g1=float(np.abs(table.g1(w) / exact.g1(w) - 1.0).max()),
        d=float(error[worst]),
        d_at=math.degrees(math.atan(slopes[worst])),
        variation=float(0.5 * np.abs(shares - 1.0 / 4000.0).sum()),
    )


def write_table(ndf: Ndf, path: Path, quantity: str = "slope") -> None:
    """Nodes, knee and tail of a table as CSV or npz, as ``Ndf.from_file`` and the plugins read them."""
    nodes = ndf.table
    if nodes is None:
        raise UserError(f"{path}: the distribution is no table: resample it first")
    cut = nodes.tail_exponent is None
    column = "slope_density" if quantity == "slope" else quantity
    values = convert("slope", quantity, nodes.slopes, nodes.densities)
    if path.suffix.lower() == ".npz":
        tail: dict[str, Any] = dict(tail_cut=True) if cut else dict(tail_exponent=nodes.tail_exponent)
        np.savez(path, **{"slopes": nodes.slopes, column: values, "knee": nodes.knee, **tail})
        return
    with open(path, "w", newline="", encoding="utf-8") as text:
        text.write(f"# knee: {nodes.knee!r}\n")
        text.write("# tail: cut\n" if cut else f"# tail_exponent: {nodes.tail_exponent!r}\n")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(("slope", column))
        writer.writerows((repr(float(x)), repr(float(f))) for x, f in zip(nodes.slopes, values))


def draw(ndf: Ndf, title: str, path: Path) -> None:
    """D, Lambda and G1, the slopes that views see, and the lobe that light makes on the sphere of directions."""
    require("report")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(2, 3)
    angle = np.concatenate([[0.0], np.geomspace(0.02, 89.9, _POINTS)])
    w = _along_x(np.radians(angle))
    d = ndf.d(w)
    for axis, log in ((axes[0, 0], False), (axes[0, 1], True)):
        axis.plot(angle, d, color="C0", label="D")
        axis.plot(angle, d * w[:, 2], color="C1", label="D cos θ")
        axis.set(xlabel="θ of the normal (degrees)", title="D per solid angle" if not log else "the same, logarithmic")
        if log:
            shown = d[d > 1e-12 * d.max()]
            axis.set(xscale="log", yscale="log", ylim=(0.5 * shown.min(), 2.0 * shown.max()), xlim=(0.05, 90.0))
        else:
            reach = math.degrees(math.atan(_stretch(ndf) * float(ndf.quantile(0.98))))
            axis.set_xlim(0.0, reach)
            axis.legend(frameon=False)
    axes[0, 2].plot(angle, ndf.g1(w), color="C0", label="G1")
    axes[0, 2].set(xlabel="θ of the view (degrees)", title="masking", ylim=(0.0, 1.02))
    twin = axes[0, 2].twinx()
    twin.plot(angle[1:], ndf.lambda_(w[1:]), color="C3", label="Λ")
    twin.set_yscale("log")
    twin.set_ylabel("Λ", color="C3")
    _draw_visible(ndf, axes[1, 0])
    _draw_lobe(ndf, axes[1, 1], _LOBE_VIEW, bounded=False)
    _draw_lobe(ndf, axes[1, 2], _LOBE_VIEW, bounded=True)
    figure.savefig(path, dpi=110)


def _draw_visible(ndf: Ndf, axis: Any) -> None:
    """The share of visible normals by their slope in the plane of the view."""
    reach = 3.0 * _stretch(ndf) * float(ndf.quantile(0.5))
    slope = np.linspace(-reach, reach, 801)
    m = _along_x(np.arctan(slope))
    for k, view in enumerate(_VIEWS):
        density = ndf.pdf(_along_x(np.radians([view]))[0], m) * m[:, 2] ** 3
        axis.plot(slope, density, color=f"C{k}", label=f"{view:g}°")
    axis.set(xlabel="slope along the view", title="visible normals, density of slopes")
    axis.legend(frameon=False, title="view")


def _draw_lobe(ndf: Ndf, axis: Any, view: float, bounded: bool) -> None:
    """Reflections of one view about the normals that are drawn, on the disc of directions (equal areas for equal D cos)."""
    side = 240
    edge = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    x, y = np.meshgrid(edge, edge)
    inside = x * x + y * y < 1.0
    wo = np.stack([x, y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=-1)[inside]
    wi = _along_x(np.radians([view]))[0]
    half = wi + wo
    m = half / np.linalg.norm(half, axis=-1, keepdims=True)
    density = ndf.pdf(wi, m, bounded=bounded) / (4.0 * np.maximum(np.sum(wo * m, axis=-1), 1e-9))
    picture = np.full(x.shape, np.nan)
    picture[inside] = np.log10(np.maximum(density, 1e-6))
    top = float(np.nanmax(picture))
    axis.imshow(picture, extent=(-1, 1, -1, 1), origin="lower", vmin=top - 4.0, vmax=top, cmap="magma")
    axis.plot([wi[0]], [wi[1]], "c+")
    kind = "bounded samples" if bounded else "samples of visible normals"
    axis.set(title=f"lobe at {view:g}°, {kind} (log)", xticks=[], yticks=[])


def _along_x(theta: Array) -> Array:
    theta = np.asarray(theta)
    return np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=-1)


def _stretch(ndf: Ndf) -> float:
    return ndf.stretch[0]
