"""Pictures of a surface: its heights, and its slopes over their target."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..ndf import Ndf
from ..page.plot_style import BLUE, FAINT, INK, VERMILION, Plot, finish, new_figure, style
from .distribution import SlopeDistribution, distribution
from .surface import Surface

# Bins of equal probability of the picture of errors: those of the worst bin that is reported.
_BINS = 100
# Pixels along a side of the picture of heights; of greater maps one part is shown.
_SHOWN = 512


def draw_surface(surface: Surface, ndf: Ndf | None, title: str) -> Plot:
    """Heights; slopes, over their target if there is one, and how far each bin is off."""
    figure = new_figure(columns=3 if ndf else 2)
    panels = figure.subplots(1, 3 if ndf else 2)
    _heights(panels[0], surface)
    slopes = surface.slopes()
    if ndf is None:
        _profile(panels[1], distribution(slopes))
    else:
        x = np.linalg.norm(slopes / np.asarray(ndf.stretch), axis=1)
        _histogram(panels[1], x, ndf)
        _errors(panels[2], x, ndf)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, weight="bold", color=INK)
    return finish("surface", title, "", figure)


def _heights(axes: Any, surface: Surface) -> None:
    shown = surface.heights[:_SHOWN, :_SHOWN]
    dx, dy = surface.spacing
    ny, nx = shown.shape
    # gray from rank to rank: single spikes of heavy tails would leave all else black
    low, high = np.nanpercentile(shown, [0.5, 99.5])
    extent = (0.0, nx * dx, 0.0, ny * dy)
    aspect = "equal" if 0.25 < (nx * dx) / (ny * dy) < 4.0 else "auto"
    image = axes.imshow(shown, cmap="gray", vmin=low, vmax=high, origin="lower", extent=extent, aspect=aspect)
    axes.figure.colorbar(image, ax=axes, shrink=0.8, label="height")
    whole = shown.size == surface.heights.size
    axes.set_title("heights" if whole else f"heights, {nx} × {ny} points of them", loc="left", fontsize=10, color=INK)
    axes.set_xlabel("x")
    axes.set_ylabel("y")


def _histogram(axes: Any, x: np.ndarray[Any, Any], ndf: Ndf) -> None:
    """Shares per unit of ln x, so that areas are shares on a logarithmic axis."""
    edges = np.geomspace(float(ndf.quantile(1e-3)), max(float(ndf.isf(1e-6)), x.max()), 121)
    found, _ = np.histogram(x, edges)
    widths = np.diff(np.log(edges))
    axes.stairs(found / len(x) / widths, edges, fill=True, color=BLUE, alpha=0.45, label="facets")
    shares = ndf.sf(edges[:-1]) - ndf.sf(edges[1:])
    axes.plot(np.sqrt(edges[1:] * edges[:-1]), shares / widths, color=VERMILION, linewidth=1.4, label="target")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(0.3 / len(x), 3.0 * float((shares / widths).max()))
    axes.set_xlabel("slope over roughness")
    axes.set_ylabel("share per unit of ln(slope)")
    axes.legend(frameon=False, fontsize=9)
    style(axes)


def _errors(axes: Any, x: np.ndarray[Any, Any], ndf: Ndf) -> None:
    edges = np.concatenate([[0.0], ndf.quantile(np.arange(1, _BINS) / _BINS), [math.inf]])
    found, _ = np.histogram(x, edges)
    off = 100.0 * (found * _BINS / len(x) - 1.0)
    axes.axhline(0.0, color=FAINT, linewidth=0.8)
    noise = 100.0 * math.sqrt(_BINS / len(x))
    axes.axhspan(-noise, noise, color=FAINT, alpha=0.15, linewidth=0, label="σ of as many independent facets")
    axes.plot(np.arange(_BINS) + 0.5, off, color=BLUE, linewidth=1.2)
    axes.set_xlabel(f"share of slopes below, in {_BINS} bins, %")
    axes.set_ylabel("facets more than there should be, %")
    axes.legend(frameon=False, fontsize=9)
    style(axes)


def _profile(axes: Any, found: SlopeDistribution) -> None:
    axes.stairs(found.density, np.maximum(found.edges, 0.3 * found.edges[1]), color=BLUE, linewidth=1.4, baseline=None)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("slope over roughness (mean 1)")
    axes.set_ylabel("density of slopes")
    style(axes)
