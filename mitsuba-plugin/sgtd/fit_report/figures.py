"""Plots of one fit of reflectance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..fitting import Fit
from ..fitting.measurement import has_azimuths
from ..fitting.problem import Prediction, turned
from ..measured import Source
from ..measured.half_difference import half_and_difference, pair_of
from ..page.plot_style import BLUE, FAINT, GREEN, INK, ORANGE, VERMILION, Plot, finish, new_figure, style
from .scans import Scan
from .sphere import MOST, Spheres

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_CHANNELS = (VERMILION, GREEN, BLUE)
# Bins of the residual map along the root of the half angle and along the difference angle
_BINS = (22, 12)
# Azimuths of the difference over which a cell is averaged
_DIFFERENCE_AZIMUTHS = (15.0, 55.0, 95.0, 140.0)


def reference(fit: Fit) -> Prediction | None:
    """What GGX would have been, if it was tried and is not what was chosen."""
    ggx = fit.fitted.get("ggx")
    return None if ggx is None or fit.model == "ggx" else ggx.problem.prediction(ggx.x)


def _logarithmic(axes: Any, which: str) -> None:
    """Decades alone: ticks between them take as long to draw as all the rest."""
    for name in which:
        axes.set(**{f"{name}scale": "log"})
    axes.minorticks_off()


def draw_scans(fit: Fit, found: list[Scan], other: Prediction | None) -> Plot:
    """Values against the angle of the view, logarithmic."""
    columns = 2 if len(found) > 1 else 1
    rows = (len(found) + 1) // 2
    figure = new_figure(columns=columns)
    figure.set_figheight(3.3 * rows + 0.4)
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    names = fit.data.channels
    several = has_azimuths(fit.data)
    for axes, scan in zip(panels, found):
        predicted = fit.predict(scan.wi, scan.wo)
        ggx = None if other is None else other(scan.wi, scan.wo)
        for k, name in enumerate(names):
            color = _CHANNELS[k] if len(names) == 3 else INK
            shown = scan.value[:, k] > 0.0
            axes.plot(
                scan.angle[shown],
                scan.value[shown, k],
                ".",
                color=color,
                markersize=4,
                alpha=0.75,
                label=f"data {name}",
            )
            if ggx is not None:
                axes.plot(scan.fine, ggx[:, k], color=color, linewidth=0.8, linestyle=":")
            axes.plot(scan.fine, predicted[:, k], color=color, linewidth=1.3)
        _logarithmic(axes, "y")
        measured = scan.value[scan.value > 0.0]
        if measured.size:
            axes.set_ylim(0.5 * min(measured.min(), predicted.min()), 2.5 * max(measured.max(), predicted.max()))
        axes.axvline(scan.theta_i, color=FAINT, linewidth=0.7, linestyle="--")
        azimuth = f", azimuth {scan.phi_i:g}°" if several and scan.theta_i > 0.0 else ""
        axes.set_title(f"light at {scan.theta_i:g}°{azimuth}", fontsize=10, color=INK, loc="left")
        axes.set_xlabel("view, degrees (mirror side positive)")
        style(axes)
    for axes in panels[len(found) :]:
        axes.set_visible(False)
    panels[0].set_ylabel("reflectance, 1/sr")
    handles, labels = panels[0].get_legend_handles_labels()
    from matplotlib.lines import Line2D

    handles += [Line2D([], [], color=INK, linewidth=1.3)]
    labels += [f"fit ({fit.model})"]
    if other is not None:
        handles += [Line2D([], [], color=INK, linewidth=0.8, linestyle=":")]
        labels += ["best GGX"]
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    words = "The plane of incidence: dots are data, lines the fit; the dashed line is the mirror direction."
    return finish("scans", "Data against fit", words, figure, ("svg",))


def draw_parity(fit: Fit) -> Plot:
    """Every pair that was used: predicted over measured."""
    figure = new_figure()
    axes = figure.add_subplot()
    measured, predicted = fit.data.value.mean(axis=1), fit.predict(fit.data.wi, fit.data.wo).mean(axis=1)
    shown = (measured > 0.0) & (predicted > 0.0)
    between = np.degrees(np.arccos(fit.data.cos_d))
    points = axes.scatter(measured[shown], predicted[shown], c=between[shown], s=5, cmap="viridis", linewidths=0)
    low, high = float(np.quantile(measured[shown], 0.002)), float(measured[shown].max())
    ends = np.array([0.7 * low, 1.5 * high])
    axes.plot(ends, ends, color=INK, linewidth=0.8)
    _logarithmic(axes, "xy")
    axes.set(xlim=ends, ylim=ends, xlabel="measured, 1/sr", ylabel="fit, 1/sr")
    bar = figure.colorbar(points, ax=axes)
    bar.set_label("difference angle, degrees", fontsize=9)
    style(axes)
    words = "All pairs of the fit, mean of the channels. Off the line at one color only: Fresnel or masking; at all colors: the lobe."
    return finish("parity", "Fit over data", words, figure, ("svg",))


def draw_lobe(fit: Fit, other: Prediction | None) -> Plot:
    """D over the angle of the half vector, and what each pair says of it."""
    figure = new_figure()
    axes = figure.add_subplot()
    tilt = np.degrees(np.arccos(np.clip(fit.data.h[:, 2], -1.0, 1.0)))
    shown = np.geomspace(max(0.05, 0.5 * float(tilt[tilt > 0.0].min())), 85.0, 300)
    turn = np.radians(fit.parameters.get("rotation", 0.0))
    anisotropic = fit.ndf.alpha_u != fit.ndf.alpha_v

    def along(ndf: Any, phi: float) -> Array:
        t = np.radians(shown)
        h = np.stack([np.sin(t) * np.cos(phi), np.sin(t) * np.sin(phi), np.cos(t)], axis=1)
        return np.asarray(ndf.d(h))

    said, between = implied(fit)
    good = said > 0.0
    points = axes.scatter(tilt[good], said[good], c=between[good], s=5, cmap="viridis", linewidths=0, zorder=1)
    if other is not None:
        axes.plot(shown, along(other.ndf, 0.0), color=INK, linestyle=":", linewidth=1.2, label="best GGX")
    axes.plot(
        shown,
        along(fit.ndf, 0.0),
        color=VERMILION,
        linewidth=1.5,
        label=fit.model + (", along u" if anisotropic else ""),
    )
    if anisotropic:
        axes.plot(shown, along(fit.ndf, 0.5 * np.pi), color=ORANGE, linewidth=1.5, label=f"{fit.model}, along v")
    peak = float(max(along(fit.ndf, 0.0).max(), np.quantile(said[good], 0.99) if good.any() else 0.0))
    _logarithmic(axes, "xy")
    axes.set(ylim=(1e-6 * peak, 3.0 * peak), xlim=(shown[0], 90.0))
    axes.set_xlabel("half vector from the normal, degrees")
    axes.set_ylabel("D, 1/sr")
    axes.legend(frameon=False, fontsize=8, loc="lower left")
    bar = figure.colorbar(points, ax=axes)
    bar.set_label("difference angle, degrees", fontsize=9)
    style(axes)
    turned = f" The axes are turned by {np.degrees(turn):.3g}°." if turn else ""
    words = (
        "The distribution of normals. Each dot is what one pair says of D if base, Fresnel and masking are those of the fit: "
        "dots on one curve mean that a microfacet model holds, colors that part that it does not." + turned
    )
    return finish("lobe", "The lobe", words, figure, ("svg",))


def implied(fit: Fit) -> tuple[Array, Array]:
    """D as each pair says it, and the difference angle in degrees; 0 where the base alone is more than was measured."""
    data, prediction = fit.data, fit.prediction
    total = fit.predict(data.wi, data.wo)
    base = np.zeros_like(total)
    if prediction.base is not None:
        base = prediction.base.kernel(data.wi[:, 2], data.wo[:, 2])[:, None] * prediction.diffuse
    # where the base is most of what is seen, a pair says nothing of the lobe
    lobe = np.maximum(total - base, 1e-30)
    said = ((data.value - base) / lobe * lobe).sum(axis=1) / lobe.sum(axis=1)
    said = np.where(lobe.sum(axis=1) > 0.3 * total.sum(axis=1), said, 0.0)
    d = fit.ndf.d(turned(data.h, prediction.rotation))
    return np.maximum(said * d, 0.0), np.degrees(np.arccos(data.cos_d))


def draw_residuals(fit: Fit, source: Source, max_angle: float, other: Prediction | None) -> Plot:
    """Fit over data by half and difference angle."""
    wi, wo, measured, edges = _residual_pairs(fit, source, max_angle)
    shown = [(fit.model, fit.predict(wi, wo))]
    if other is not None:
        shown.append(("best GGX", other(wi, wo)))
    figure = new_figure(columns=len(shown))
    figure.set_figheight(4.0)
    panels = np.atleast_1d(figure.subplots(1, len(shown), sharey=True))
    theta_h, _, theta_d, _ = half_and_difference(wi, wo)
    places = np.degrees(theta_h), np.degrees(theta_d)
    for axes, (name, predicted) in zip(panels, shown):
        ratio = np.log2(np.maximum(predicted.mean(axis=1), 1e-12) / measured)
        total, _, _ = np.histogram2d(*places, bins=edges, weights=ratio)
        count, _, _ = np.histogram2d(*places, bins=edges)
        mean = np.ma.masked_where(count == 0, total / np.maximum(count, 1.0))
        mesh = axes.pcolormesh(np.sqrt(edges[0]), edges[1], mean.T, cmap="RdBu_r", vmin=-1.0, vmax=1.0, rasterized=True)
        axes.set_title(name, fontsize=10, color=INK, loc="left")
        axes.set_xticks(np.sqrt([1.0, 5.0, 15.0, 30.0, 50.0, 80.0]), ["1", "5", "15", "30", "50", "80"])
        axes.set_xlabel("half vector from the normal, degrees")
        style(axes)
        axes.grid(False)
    panels[0].set_ylabel("difference angle, degrees")
    bar = figure.colorbar(mesh, ax=list(panels))
    bar.set_ticks([-1.0, -0.5, 0.0, 0.5, 1.0], labels=["half or less", "0.71", "equal", "1.4", "double or more"])
    bar.set_label("fit over data", fontsize=9)
    words = (
        "Mean of the logarithm of fit over data; red is where the fit is brighter. A column of one color is the lobe, a row Fresnel, the upper right "
        "edge grazing angles."
    )
    return finish("residuals", "Residuals by half and difference angle", words, figure, ("svg",))


def _residual_pairs(fit: Fit, source: Source, max_angle: float) -> tuple[Array, Array, Array, tuple[Array, Array]]:
    """Directions, mean of what was measured there, and edges of bins in degrees: a dense grid of an isotropic file, or the pairs of the fit."""
    if source.evaluate is None or not fit.data.isotropic:
        measured = fit.data.value.mean(axis=1)
        good = measured > 0.0
        edges = 90.0 * np.linspace(0.0, 1.0, _BINS[0] + 1) ** 2, np.linspace(0.0, 90.0, _BINS[1] + 1)
        return fit.data.wi[good], fit.data.wo[good], measured[good], edges
    half, difference = 2 * _BINS[0], 3 * _BINS[1]
    grid = np.meshgrid(
        0.5 * np.pi * ((np.arange(half) + 0.5) / half) ** 2,
        0.5 * np.pi * (np.arange(difference) + 0.5) / difference,
        np.radians(_DIFFERENCE_AZIMUTHS),
        indexing="ij",
    )
    theta_h, theta_d, phi_d = (a.ravel() for a in grid)
    wi, wo = pair_of(theta_h, np.zeros_like(theta_h), theta_d, phi_d)
    inside = np.minimum(wi[:, 2], wo[:, 2]) > np.cos(np.radians(max_angle))
    wi, wo = wi[inside], wo[inside]
    measured = source.evaluate(wi, wo).mean(axis=1)
    good = measured > 0.0
    edges = 90.0 * np.linspace(0.0, 1.0, half + 1) ** 2, np.linspace(0.0, 90.0, difference + 1)
    return wi[good], wo[good], measured[good], edges


def draw_around(fit: Fit) -> Plot:
    """Of anisotropic data: what pairs say of D by the azimuth of the half vector."""
    figure = new_figure()
    axes = figure.add_subplot()
    said, _ = implied(fit)
    h = fit.data.h
    tilt = np.degrees(np.arccos(np.clip(h[:, 2], -1.0, 1.0)))
    azimuth = np.degrees(np.arctan2(h[:, 1], h[:, 0])) % 180.0
    for middle, color in zip((5.0, 15.0, 30.0, 45.0), (BLUE, GREEN, ORANGE, VERMILION)):
        near = (np.abs(tilt - middle) < 0.25 * middle) & (said > 0.0)
        if near.sum() >= 6:
            axes.plot(azimuth[near], said[near], ".", color=color, markersize=3, alpha=0.6)
        phi, t = np.radians(np.linspace(0.0, 180.0, 181)), np.radians(middle)
        line = np.stack([np.sin(t) * np.cos(phi), np.sin(t) * np.sin(phi), np.full_like(phi, np.cos(t))], axis=1)
        d = fit.ndf.d(turned(line, fit.prediction.rotation))
        axes.plot(np.degrees(phi), d, color=color, linewidth=1.4, label=f"{middle:g}° from the normal")
    _logarithmic(axes, "y")
    axes.set_xlabel("azimuth of the half vector, degrees")
    axes.set_ylabel("D, 1/sr")
    axes.legend(frameon=False, fontsize=8)
    style(axes)
    words = "The lobe around the normal: lines are the fit, dots what pairs within a quarter of that tilt say."
    return finish("around", "The lobe by azimuth", words, figure, ("svg",))


def draw_spheres(found: Spheres) -> Plot:
    """Data, fit and their ratio."""
    figure = new_figure(columns=2)
    figure.set_figheight(3.1)
    panels = figure.subplots(1, 3)
    titles = ("data", "fit", f"fit over data, 1/{MOST:g} blue to {MOST:g} red")
    for axes, image, title in zip(panels, (found.data, found.fit, found.difference), titles):
        axes.imshow(image, interpolation="nearest")
        axes.set_title(title, fontsize=9, color=INK)
        axes.set_axis_off()
    words = (
        "A light from the left above and one that grazes from the right, the same exposure on both; light that comes or goes where nothing was "
        "measured is left out of both, and gray is where nobody looked."
    )
    return finish("spheres", "Data beside fit", words, figure, ("png",))
