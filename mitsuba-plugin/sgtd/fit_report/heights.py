"""One map of heights: read, its slopes fitted, and written as a folder."""

from __future__ import annotations

import csv
import io
import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..atomic_output import AtomicOutput
from ..microsurface import Surface, read_heights
from ..page.plot_style import BLUE, FAINT, GREEN, INK, VERMILION, Plot, finish, new_figure, style
from ..page.template import data, load_template, number
from ..slope_fitting import SlopeFit, fit_surface
from .names import JSON, MATERIAL, REPORT, SCORES
from .options import Options
from .tree_figure import Node, draw_tree

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Bins of the density of slopes, and pixels along a side of their map
_BINS, _PIXELS = 60, 121
#: Log-likelihood a sample that the picture of the tree tells from nothing
_FAINTEST = 0.3


def fit_heights_file(path: Path, folder: Path, options: Options) -> dict[str, Any]:
    """Fits the slopes of one map and writes its folder."""
    start = time.perf_counter()
    surface = read_heights(path, options.spacing, options.level, options.gray)
    found = fit_surface(surface, model=options.model, title=path.name)
    summary = _summary(found, path, time.perf_counter() - start)
    with AtomicOutput(folder) as files:
        files.path(MATERIAL).write_text(found.to_xml(), encoding="utf-8")
        files.path(JSON).write_text(_json(found, surface, summary, options), encoding="utf-8")
        files.path(SCORES).write_text(scores_csv(found), encoding="utf-8")
        files.path(REPORT).write_text(_page(found, surface, summary), encoding="utf-8")
    return summary


def _summary(found: SlopeFit, path: Path, seconds: float) -> dict[str, Any]:
    return {
        "file": str(path),
        "format": "heights",
        "model": found.model,
        "error": found.ks,
        "over_ggx": None,
        "errors": {},
        "parameters": {p.name: p.value if abs(p.value) < 1e300 else None for p in found.parameters},
        "not_identifiable": [p.name for p in found.parameters if p.status == "not identifiable"],
        "at_a_bound": [p.name for p in found.parameters if p.status == "at a bound"],
        "pairs": found.count,
        "warnings": list(found.notes),
        "log_likelihoods": {score.model: score.log_likelihood for score in found.scores},
        "seconds": round(seconds, 3),
    }


def _json(found: SlopeFit, surface: Surface, summary: Mapping[str, Any], options: Options) -> str:
    from .. import __version__

    first = {"file": summary["file"], "format": "heights", "sgtd": __version__, "options": options.as_json()}
    map_of = {
        "points": list(surface.heights.shape[::-1]),
        "spacing": list(surface.spacing),
        "periodic": surface.periodic,
    }
    content = {**first, "map": map_of, **json.loads(found.as_json()), "seconds": summary["seconds"]}
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def scores_csv(found: SlopeFit) -> str:
    """A line for each row that was tried."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("model", "log_likelihood", "log_likelihood_of_what_was_left_out", "variables", "seconds", "chosen"))
    for score in _sorted(found):
        held = "" if math.isnan(score.held_out) else f"{score.held_out:.9g}"
        row = (score.model, f"{score.log_likelihood:.9g}", held, score.parameters, f"{score.seconds:.3f}")
        table.writerow((*row, "yes" if score.chosen else ""))
    return text.getvalue()


def _sorted(found: SlopeFit) -> list[Any]:
    return sorted(found.scores, key=lambda score: -score.log_likelihood)


def _page(found: SlopeFit, surface: Surface, summary: Mapping[str, Any]) -> str:
    slopes = surface.slopes()
    best = max(score.log_likelihood for score in found.scores)
    template = load_template(Path(__file__).with_name("heights.html.j2"), svg_of_png=lambda plot: data("png", plot.png))
    return template.render(
        title=found.title,
        found=found,
        surface=surface,
        lag=surface.lag_correlation(),
        heights=_draw_heights(surface, slopes, found),
        density=_draw_density(found, slopes),
        tree=_draw_tree(found) if len(found.scores) > 1 else None,
        scores=[(score, best - score.log_likelihood) for score in _sorted(found)],
        xml=found.to_xml(),
        seconds=summary["seconds"],
        sentences=_sentences(found),
        show=lambda x: "∞" if abs(x) > 1e300 else number(x, 4),
    )


def _sentences(found: SlopeFit) -> list[str]:
    values = {p.name: p for p in found.parameters}
    told = ", ".join(
        f"{name} = {'∞' if abs(p.value) > 1e300 else number(p.value, 4)}"
        for name, p in values.items()
        if p.status != "fixed"
    )
    sentences = [
        f"The row {found.model}: {told}; rotation in degrees.",
        f"Its distribution of lengths of slopes is off by {number(found.ks)} at the most (KS).",
    ]
    unknown = [p.name for p in found.parameters if p.status == "not identifiable"]
    if unknown:
        sentences.append(f"Not known within 5 %: {', '.join(unknown)}.")
    return sentences


def _stretched(found: SlopeFit, slopes: Array) -> Array:
    """Slopes over roughness along the axes of the fit, times the geometric mean of both: of one roughness, their lengths."""
    turn = math.radians(found.rotation)
    c, s = math.cos(turn), math.sin(turn)
    su, sv = found.ndf.stretch
    u, v = (c * slopes[:, 0] + s * slopes[:, 1]) / su, (c * slopes[:, 1] - s * slopes[:, 0]) / sv
    return np.asarray(np.hypot(u, v) * math.sqrt(su * sv))


def _draw_density(found: SlopeFit, slopes: Array) -> Plot:
    """The density of slopes over their length, and what it is over the fit."""
    t = _stretched(found, slopes)
    low = max(float(np.quantile(t, 2e-4)), 1e-9)
    edges = np.geomspace(low, float(t.max()) * 1.0001, _BINS + 1)
    counts, _ = np.histogram(t, edges)
    area = math.pi * np.diff(edges**2)
    middles = np.sqrt(0.5 * (edges[1:] ** 2 + edges[:-1] ** 2))
    there = counts > 0
    figure = new_figure(columns=2)
    left, right = figure.subplots(1, 2)
    left.plot(middles[there], (counts / len(t) / area)[there], ".", color=BLUE, markersize=5, label="facets")
    lines = np.geomspace(low, 1.3 * float(t.max()), 300)
    for name, color, dash in (("beckmann", FAINT, ":"), ("ggx", GREEN, "--"), (found.model, VERMILION, "-")):
        fitted = found.fitted.get(name)
        if fitted is None or (name != found.model and dash == "-"):
            continue
        ndf = fitted.likelihood.space.ndf(fitted.v, 1e-2)
        su, sv = ndf.stretch
        scale = math.sqrt(su * sv)
        f = ndf.normalization * ndf.profile(lines / scale) / (math.pi * su * sv)
        left.plot(lines, f, color=color, linestyle=dash, linewidth=1.4, label=name)
        # shares of the bins, not the density in their middles: bins of a tail are wide
        expected = (ndf.sf(edges[:-1] / scale) - ndf.sf(edges[1:] / scale)) * len(t)
        ratio = counts / np.maximum(expected, 1e-12)
        shown = there & (expected > 1e-3)
        right.plot(middles[shown], ratio[shown], color=color, linestyle=dash, linewidth=1.4, label=name)
    left.set(xscale="log", yscale="log")
    left.set_ylim(0.3 * float((counts / len(t) / area)[there].min()), 3.0 * float((counts / len(t) / area).max()))
    left.set_xlabel("slope")
    left.set_ylabel("density of slopes")
    left.legend(frameon=False, fontsize=8)
    right.set(xscale="log", yscale="log", ylim=(0.25, 4.0))
    right.set_yticks([0.25, 0.5, 1.0, 2.0, 4.0], ["¼", "½", "1", "2", "4"])
    right.minorticks_off()
    right.axhline(1.0, color=INK, linewidth=0.7)
    right.set_xlabel("slope")
    right.set_ylabel("facets over what the row expects")
    for axes in (left, right):
        style(axes)
    words = (
        "Left: the density of slopes over their length along the axes of the fit. Right: facets in each bin over the number that each row expects: "
        "1 where it is right."
    )
    return finish("density", "Slopes", words, figure, ("svg",))


def _draw_heights(surface: Surface, slopes: Array, found: SlopeFit) -> Plot:
    """The map, and its slopes along x and y under lines of equal density of the fit."""
    from matplotlib.colors import LogNorm

    figure = new_figure(columns=2)
    figure.set_figheight(4.0)
    left, right = figure.subplots(1, 2)
    dx, dy = surface.spacing
    ny, nx = surface.heights.shape
    step = max(1, max(nx, ny) // 512)
    low, high = np.nanpercentile(surface.heights, [0.5, 99.5])
    image = left.imshow(
        surface.heights[::step, ::step],
        cmap="gray",
        vmin=low,
        vmax=high,
        origin="lower",
        extent=(0.0, nx * dx, 0.0, ny * dy),
    )
    figure.colorbar(image, ax=left, shrink=0.8, label="height")
    left.set_title("heights", loc="left", fontsize=10, color=INK)
    reach = float(np.quantile(np.abs(slopes), 0.995))
    edges = np.linspace(-reach, reach, _PIXELS + 1)
    counts, _, _ = np.histogram2d(slopes[:, 0], slopes[:, 1], bins=(edges, edges))
    density = counts / len(slopes) / (edges[1] - edges[0]) ** 2
    top = float(density.max())
    mesh = right.imshow(
        np.ma.masked_less_equal(density.T, 0.0),
        norm=LogNorm(1e-4 * top, top),
        cmap="Greys",
        origin="lower",
        extent=(-reach, reach, -reach, reach),
    )
    figure.colorbar(mesh, ax=right, shrink=0.8, label="density of slopes")
    middles = 0.5 * (edges[1:] + edges[:-1])
    x, y = np.meshgrid(middles, middles, indexing="xy")
    logs = found.log_density(x, y) / math.log(10.0)
    levels = np.floor(logs.max()) - np.arange(4.0)[::-1]
    right.contour(x, y, logs, levels=levels, colors=VERMILION, linewidths=1.0)
    right.set_title("slopes", loc="left", fontsize=10, color=INK)
    right.set_xlabel("along x")
    right.set_ylabel("along y")
    words = "Left: the map. Right: slopes of its facets along x and y, and lines of equal density of the fit, a decade apart."
    return finish("heights", "The surface", words, figure, ("png",))


def _draw_tree(found: SlopeFit) -> Plot:
    best = max(score.log_likelihood for score in found.scores)
    nodes = []
    for score in found.scores:
        less = best - score.log_likelihood
        held = "" if math.isnan(score.held_out) else f"\nleft out {score.held_out:.4f}"
        good = math.exp(-less / _FAINTEST)
        text = f"{score.log_likelihood:.4f}" + ("" if less < 5e-5 else f" (−{less:.4f})") + held
        nodes.append(Node(score.model, text, good, score.chosen))
    words = (
        "Log-likelihood a facet, in brackets less the best, and where it was asked for that of each half by a fit to the other. Lines go to special cases; "
        "the framed row is the one that pays."
    )
    return draw_tree(nodes, words)
