"""Plots of the images: their error against the setting, and their RMSE in equal time."""

from __future__ import annotations

import math
from typing import Any

from ..page.plot_style import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    VERMILION,
    Plot,
    file_part,
    finish,
    new_figure,
    style,
    upright,
    wrapped,
)
from . import DEFAULT_SETTING, advice
from .images import ImageStudy
from .study import Study

# Errors of images below this are not drawn: rounding of the arithmetic.
_BIAS_FLOOR = 1e-10

_COLORS = (BLUE, VERMILION, PURPLE, ORANGE, SKY, GREEN)
_MARKS = (("o", "\u25cf"), ("D", "\u25c6"), ("s", "\u25a0"), ("^", "\u25b2"))

_WORDS_BIAS = (
    "Images: below a dashed line, the noise of that many samples is larger. Hollow marks are no more than twice what the renders "
    "can tell from zero; bars are that floor."
)
_WORDS_TIME = (
    "RMSE (noise and bias) after equal time, divided by that of the default; bars are quartiles over repetitions."
)


def draw_images(study: Study, shape: str) -> list[Plot]:
    """Two plots of one shape, over all scenes and variants."""
    own = [images for images in study.images if images.shape == shape]
    title = next((one.shape.title for one in study.functions if one.shape.text == shape), shape)
    plots = []
    for name, panel, words in (("images", bias_panel, _WORDS_BIAS), ("equal-time", _equal_time_panel, _WORDS_TIME)):
        figure = new_figure()
        axes = figure.add_subplot()
        panel(axes, own)
        axes.set_title(wrapped(title), loc="left", fontsize=11, color=INK)
        plots.append(finish(f"{name}-{file_part(shape)}", title, words, figure))
    return plots


def bias_panel(axes: Any, studies: list[ImageStudy]) -> None:
    """The bias against the setting, and the noise that hides it."""
    settings = [row.setting for row in studies[0].rows if row.setting]
    ends: dict[str, tuple[float, str]] = {}
    for images, color, mark in _looks(studies):
        shown = []
        for setting in settings:
            row = images.row(setting)
            value = max(row.bias, row.floor)
            if value < _BIAS_FLOOR:
                continue
            shown.append((setting, value))
            bar = [[min(row.floor, 0.9 * value)], [row.floor]]
            face = color if row.bias > 2.0 * row.floor else "white"
            axes.errorbar(
                setting, value, yerr=bar, color=color, marker=mark, mfc=face, markersize=5, capsize=2, linewidth=1
            )
        if shown:
            axes.plot(*zip(*shown), color=color, linewidth=1, alpha=0.6)
            ends.setdefault(images.scene, (shown[0][1], color))
    axes.set_xscale("log")
    axes.set_yscale("log")
    for spp in advice.SAMPLES:
        level = min(images.row(0.0).noise(spp) for images in studies)
        if level > 0.0:
            axes.axhline(level, color=INK, linewidth=0.9, linestyle="--")
            axes.text(
                settings[-1] / 2, level * 1.1, f"noise, {spp} spp", fontsize=SMALL, color=INK, ha="right", va="bottom"
            )
    axes.axvline(DEFAULT_SETTING, color=GREEN, linewidth=1.2, linestyle=":")
    top = max([images.row(0.0).noise(advice.SAMPLES[0]) for images in studies] + [value for value, _ in ends.values()])
    axes.set_ylim(max(min(axes.get_ylim()[0], 1e-9), _BIAS_FLOOR), 20.0 * max(top, 1e-8))
    upright(axes, DEFAULT_SETTING, 0.03, "the default", GREEN)
    span = math.log10(settings[0] / settings[-1])
    axes.set_xlim(settings[0] * 10 ** (0.32 * span), settings[-1] / 3)
    _spread_labels(axes, settings[0], [(value, scene, color) for scene, (value, color) in ends.items()])
    _name_marks(axes, studies)
    axes.set_xlabel("setting, accuracy")
    step = 2 if len(settings) > 6 else 1
    axes.set_xticks(
        settings, [f"$10^{{{round(math.log10(s))}}}$" if k % step == 0 else "" for k, s in enumerate(settings)]
    )
    axes.minorticks_off()
    axes.set_ylabel("RMS error of the image / its mean luminance")
    style(axes)


def _equal_time_panel(axes: Any, studies: list[ImageStudy]) -> None:
    """The RMSE that each setting reaches in the time of the others."""
    settings = [row.setting for row in studies[0].rows]
    places = list(range(len(settings) + 1))
    names = [f"$10^{{{round(math.log10(s))}}}$" if s else "0" for s in settings]
    if len(settings) > 6:
        names = [name if k % 2 == 0 or k == len(settings) - 1 else "" for k, name in enumerate(names)]
    highest, lowest = 1.0, 1.0
    for number, (images, color, mark) in enumerate(_looks(studies)):
        rows = [*images.rows, images.dcos]
        unit = images.row(DEFAULT_SETTING).rmse_equal_time.median or 1.0
        shift = 0.12 * (number - 0.5 * (len(studies) - 1))
        for place, row in zip(places, rows):
            timing = row.rmse_equal_time
            value = timing.median / unit
            bar = [[(timing.median - timing.low) / unit], [(timing.high - timing.median) / unit]]
            axes.errorbar(
                place + shift, value, yerr=bar, color=color, marker=mark, markersize=4.5, capsize=2, linewidth=1
            )
            highest, lowest = max(highest, timing.high / unit), min(lowest, timing.low / unit)
    axes.axhline(1.0, color=GREEN, linewidth=1.2, linestyle=":")
    axes.set_yscale("log")
    axes.set_ylim(max(0.8 * lowest, 1e-3), 1.6 * highest)
    ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if 0.8 * lowest <= tick <= 1.6 * highest]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xticks(places, [*names, "D cos"])
    scenes = list(dict.fromkeys(images.scene for images in studies))
    for k, scene in enumerate(scenes):
        color = next(color for images, color, _ in _looks(studies) if images.scene == scene)
        axes.text(0.03, 0.97 - 0.055 * k, scene, transform=axes.transAxes, fontsize=SMALL, color=color, va="top")
    _name_marks(axes, studies, top=0.97 - 0.055 * len(scenes))
    axes.set_xlabel("setting, accuracy; D cos sampling at the default")
    axes.set_ylabel("RMSE in equal time / that of the default")
    style(axes)


def _looks(studies: list[ImageStudy]) -> list[tuple[ImageStudy, str, str]]:
    """A color for each scene, a mark for each variant."""
    scenes = list(dict.fromkeys(images.scene for images in studies))
    variants = list(dict.fromkeys(images.variant for images in studies))
    return [
        (
            images,
            _COLORS[scenes.index(images.scene) % len(_COLORS)],
            _MARKS[variants.index(images.variant) % len(_MARKS)][0],
        )
        for images in studies
    ]


def _name_marks(axes: Any, studies: list[ImageStudy], top: float | None = None) -> None:
    """Which mark is which variant, in a corner."""
    variants = list(dict.fromkeys(images.variant for images in studies))
    words = "\n".join(f"{_MARKS[k % len(_MARKS)][1]} {name}" for k, name in enumerate(variants))
    y, along = (0.02, "bottom") if top is None else (top, "top")
    axes.text(0.03, y, words, transform=axes.transAxes, fontsize=SMALL, color=INK, va=along)


def _spread_labels(axes: Any, x: float, ends: list[tuple[float, str, str]]) -> None:
    """Labels left of the first points, moved apart where they would cover each other."""
    if not ends:
        return
    low, high = (math.log10(limit) for limit in axes.get_ylim())
    step = 0.06 * (high - low)
    ordered = sorted(ends)
    middle = sum(math.log10(value) for value, _, _ in ordered) / len(ordered)
    place = middle - 0.5 * step * (len(ordered) - 1)
    for value, text, color in ordered:
        place = max(place, math.log10(value)) if len(ordered) == 1 else place
        look = {"fontsize": SMALL, "color": color, "ha": "right", "va": "center"}
        arrow = {"arrowstyle": "-", "color": color, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 3}
        axes.annotate(text, (x, value), (x * 3.0, 10**place), arrowprops=arrow, **look)
        place += step
