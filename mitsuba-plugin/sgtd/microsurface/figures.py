"""Plots of a comparison of a surface with its models."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..page.plot_style import BLUE, FAINT, GREEN, INK, ORANGE, PURPLE, SKY, VERMILION, Plot, finish, new_figure, style
from .comparison import WORDS, Comparison, View
from .goniometer import Scattered

_ORDERS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)


def draw_all(found: Comparison) -> list[Plot]:
    """Energies, masking, and one plot of directions for each direction of light."""
    return [draw_energies(found), draw_masking(found), *(draw_directions(found, view) for view in found.views)]


def draw_energies(found: Comparison) -> Plot:
    figure = new_figure()
    axes = figure.add_subplot()
    thetas = [view.theta for view in found.views]
    for order in range(found.views[0].setup.bins.orders):
        color = _ORDERS[order % len(_ORDERS)]
        totals = np.array([view.mesh.scattered.total(None, order) for view in found.views])
        last = order == found.views[0].setup.bins.orders - 1
        label = f"{order + 1} facet{'s' if order else ''}{' and more' if last else ''}"
        axes.errorbar(
            thetas, totals[:, 0], 3.0 * totals[:, 1], color=color, marker="o", markersize=4, linewidth=1.2, label=label
        )
        walks = [view.walk.scattered.total(None, order)[0] for view in found.views if view.walk]
        if walks:
            axes.plot(thetas, walks, color=color, linestyle=":", marker="x", markersize=5)
    for masking, line in (("separable", "--"), ("height_correlated", "-.")):
        key = ("target" if found.ndf else "mesh", masking)
        values = [view.single[key].total()[0] for view in found.views]
        axes.plot(thetas, values, color=INK, linewidth=1.0, linestyle=line, label=f"Smith, {WORDS[masking]}")
    axes.set_yscale("log")
    axes.set_xlabel("θ of the light, degrees")
    axes.set_ylabel("energy, share of what came")
    axes.legend(frameon=False, fontsize=8)
    style(axes)
    words = (
        "Energy by the number of facets that light met: solid on the surface (bars are three standard errors), dotted in the random walk "
        "on Smith's model, black what Smith's single scattering has of the first order."
    )
    return finish("energies", "Energy by number of facets", words, figure)


def draw_masking(found: Comparison) -> Plot:
    figure = new_figure()
    axes = figure.add_subplot()
    cosines = found.views[0].setup.bins.cosines
    middles = (np.arange(cosines) + 0.5) / cosines
    axes.axhline(1.0, color=FAINT, linewidth=1.0)
    for view, color in zip(found.views, _ORDERS * 20):
        share, error, area = view.seen
        g1 = view.g1["mesh"]
        shown = area > 1e-4
        axes.errorbar(
            middles[shown],
            share[shown] / g1,
            3.0 * error[shown] / g1,
            color=color,
            marker="o",
            markersize=3,
            linewidth=1.0,
            label=f"{view.theta:g}°",
        )
    axes.set_xlabel("cosine between light and facet")
    axes.set_ylabel("what is seen of facets, over Smith's G1")
    axes.legend(frameon=False, fontsize=8, title="θ")
    style(axes)
    words = "Masking by facet over the mean masking of the surface: 1 everywhere in Smith's model. Bars are three standard errors."
    return finish("masking", "Masking by facet", words, figure)


def draw_directions(found: Comparison, view: View) -> Plot:
    """Energy per solid angle in the plane of incidence, and by elevation."""
    figure = new_figure(columns=2)
    left, right = figure.subplots(1, 2)
    orders = view.setup.bins.orders
    hemispheres = (0, 1) if found.material.kind == "dielectric" else (0,)
    key = ("target" if found.ndf else "mesh", "height_correlated")
    for axes, in_plane in ((left, True), (right, False)):
        for hemisphere in hemispheres:
            dash = "-" if hemisphere == 0 else "--"
            what = "" if hemisphere == 0 else ", transmitted"
            _line(
                axes,
                view,
                view.mesh.scattered,
                hemisphere,
                slice(0, 1),
                in_plane,
                BLUE,
                dash,
                f"surface, 1 facet{what}",
            )
            _line(
                axes,
                view,
                view.single[key],
                hemisphere,
                slice(0, 1),
                in_plane,
                VERMILION,
                dash,
                f"Smith, 1 facet{what}",
            )
            if orders > 1:
                more = slice(1, None)
                _line(
                    axes,
                    view,
                    view.mesh.scattered,
                    hemisphere,
                    more,
                    in_plane,
                    GREEN,
                    dash,
                    f"surface, 2 and more{what}",
                )
            if orders > 1 and view.walk:
                walk = f"random walk, 2 and more{what}"
                _line(axes, view, view.walk.scattered, hemisphere, slice(1, None), in_plane, ORANGE, dash, walk)
        lobe = view.lobes.get("height_correlated")
        if orders > 1 and lobe:
            _line(axes, view, lobe, 0, slice(1, None), in_plane, PURPLE, "-", "lobe, 2 and more")
        style(axes)
    left.set_xlabel("degrees in the plane of incidence, light from the left")
    left.set_ylabel("energy per solid angle")
    right.set_xlabel("polar angle, degrees")
    right.set_ylabel("energy per degree, all azimuths")
    right.legend(frameon=False, fontsize=8)
    title = f"Where it goes, θ = {view.theta:g}°"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, color=INK)
    return finish(f"directions-{view.theta:g}".replace(".", "_"), title, "", figure)


def _line(
    axes: Any,
    view: View,
    scattered: Scattered,
    hemisphere: int,
    orders: slice,
    in_plane: bool,
    color: str,
    dash: str,
    label: str,
) -> None:
    bins = view.setup.bins
    energy = scattered.directions(hemisphere, orders)
    middles = 90.0 * (np.arange(bins.polar) + 0.5) / bins.polar
    look = {"color": color, "linestyle": dash, "linewidth": 1.2, "label": label}
    if not in_plane:
        axes.plot(middles, energy.sum(axis=1) * bins.polar / 90.0, **look)
        return
    per_angle = energy / bins.solid_angles()[:, None]
    # azimuths beside that of the light and beside the opposite one
    turn = (view.setup.phi / 360.0 + 0.5) * bins.azimuths
    near = [int(math.floor(turn - 0.5)) % bins.azimuths, int(math.floor(turn + 0.5)) % bins.azimuths]
    far = [(k + bins.azimuths // 2) % bins.azimuths for k in near]
    backward, forward = (per_angle[:, k].mean(axis=1) for k in (near, far))
    x, y = np.concatenate([-middles[::-1], middles]), np.concatenate([backward[::-1], forward])
    axes.plot(x, y, **look)
    if label.startswith("surface"):
        variance = (scattered.errors()[hemisphere, orders].mean(axis=-1) ** 2).sum(axis=0)
        per_angle = np.sqrt(variance) / bins.solid_angles()[:, None]
        backward, forward = (np.hypot(*per_angle[:, k].T) / 2.0 for k in (near, far))
        error = 3.0 * np.concatenate([backward[::-1], forward])
        axes.fill_between(x, y - error, y + error, color=color, alpha=0.2, linewidth=0)
