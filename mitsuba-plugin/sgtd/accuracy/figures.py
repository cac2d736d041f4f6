"""The figures: the error of masking against the time of a call, that of images against the setting, and their RMSE in equal time."""

from __future__ import annotations

import math
from typing import Any

from ..page.plot_style import (
    BLUE,
    FAINT,
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
    label,
    new_figure,
    style,
    upright,
    wrapped,
)
from . import DEFAULT_SETTING, advice, setting_text
from .function_errors import Spread
from .function_timing import Timing
from .images import ImageStudy
from .study import FunctionStudy, Study

# Errors at or below this are drawn at this: what double precision can tell.
ERROR_FLOOR = 1e-16

_WORDS = (
    "Masking: down and to the left is better. Marks are the worst error, lines down from them end at the root mean square; bars "
    "across are quartiles of the time."
)


def draw_functions(study: Study, functions: FunctionStudy) -> Plot:
    """One shape."""
    figure = new_figure()
    axes = figure.add_subplot()
    functions_panel(axes, study, functions)
    title = functions.shape.title
    axes.set_title(wrapped(title), loc="left", fontsize=11, color=INK)
    return finish(f"functions-{functions.shape.slug}", title, _WORDS, figure)


def functions_panel(axes: Any, study: Study, functions: FunctionStudy) -> None:
    text = functions.shape.text
    times = study.one.nanoseconds

    def point(key: str) -> tuple[Timing, Spread]:
        return times[text, "lambda", key], functions.masking[key].g1

    tables = [str(setting) for setting in study.settings if setting]
    quadrature = [key for key in functions.masking if key.startswith("Gauss")]
    named = [key for key in functions.masking if key not in quadrature and key not in map(str, study.settings)]
    for keys, color, mark in ((tables, BLUE, "o"), (quadrature, FAINT, "^"), (named, VERMILION, "s")):
        points = [point(key) for key in keys]
        for timing, errors in points:
            _mark(axes, timing, errors, color, mark)
        if keys is not named:
            line = ([timing.median for timing, _ in points], [_shown(errors.largest) for _, errors in points])
            axes.plot(*line, color=color, linewidth=1, alpha=0.45)

    # Settings that give the same table, or nearly, share a label
    groups: list[list[str]] = []
    for key in tables:
        level = math.log10(_shown(functions.masking[key].g1.largest))
        if groups and abs(math.log10(_shown(functions.masking[groups[-1][0]].g1.largest)) - level) < 0.45:
            groups[-1].append(key)
        else:
            groups.append([key])
    for group in groups:
        left = min(point(key)[0].low for key in group)
        ends = dict.fromkeys((setting_text(float(group[0])), setting_text(float(group[-1]))))
        label(axes, left, _shown(functions.masking[group[0]].g1.largest), " … ".join(ends), BLUE, "left")
    for key in named:
        timing, errors = point(key)
        label(
            axes,
            timing.median,
            _shown(errors.largest),
            key.replace(", ", ",\n"),
            VERMILION,
            "above" if errors.largest < 1e-12 else "below",
        )
    if quadrature:
        nodes = [key.split(", ")[1].split()[0] for key in (quadrature[0], quadrature[-1])]
        timing, errors = point(quadrature[0])
        label(
            axes,
            timing.median,
            _shown(errors.largest),
            f"Gauss-Legendre,\n{nodes[0]} to {nodes[1]} nodes",
            FAINT,
            "above",
        )

    reference = times[text, "lambda", "0.0"]
    axes.axvspan(reference.low, reference.high, color=GREEN, alpha=0.15, linewidth=0)
    axes.axvline(reference.median, color=GREEN, linewidth=1.2, linestyle=":")
    over = {"transform": axes.get_xaxis_transform(), "fontsize": SMALL, "color": GREEN}
    axes.text(reference.low, 0.99, "accuracy 0, \nthe reference ", ha="right", va="top", **over)
    axes.text(
        0.03,
        0.03,
        "tables of sgtd,\nby setting",
        transform=axes.transAxes,
        fontsize=SMALL,
        color=BLUE,
        va="bottom",
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = axes.get_xlim()
    axes.set_xlim(low * (low / high) ** 0.3, high * 1.6)  # room for labels on the left
    axes.set_ylim(0.3 * ERROR_FLOOR, 1e4)
    axes.set_yticks([10.0**k for k in range(-16, 1, 2)])
    axes.set_xlabel("time of one Λ on one core, ns")
    axes.set_ylabel("relative error of G1: worst (mark), RMS (lower end)")
    style(axes)


def _mark(axes: Any, timing: Timing, errors: Spread, color: str, mark: str) -> None:
    """The worst error, a line down to the largest RMS, and the quartiles of the time."""
    worst = _shown(errors.largest)
    rms = _shown(max(errors.rms.values(), default=worst))
    spread = [[timing.median - timing.low], [timing.high - timing.median]]
    axes.plot([timing.median] * 2, [min(rms, worst), worst], color=color, linewidth=1)
    axes.errorbar(
        [timing.median], [worst], xerr=spread, color=color, marker=mark, markersize=5, capsize=2, linewidth=1.2
    )


def _shown(error: float) -> float:
    """Where an error is drawn: more than 1 says no more than 1."""
    return max(min(error, 1.0), ERROR_FLOOR)


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


def draw_all(study: Study) -> tuple[Plot, list[Plot], list[list[Plot]]]:
    """The main plot; one per shape as functions; some per shape as images."""
    functions = [draw_functions(study, one) for one in study.functions]
    shapes = list(dict.fromkeys(images.shape for images in study.images))
    return draw_main(study), functions, [draw_images(study, shape) for shape in shapes]


def draw_main(study: Study) -> Plot:
    """Functions and images of the first shape, side by side."""
    figure = new_figure(columns=2)
    left, right = figure.subplots(1, 2)
    functions = study.functions[0]
    functions_panel(left, study, functions)
    left.set_title("What accuracy costs in time", loc="left", fontsize=11, color=INK)
    shape = next((images.shape for images in study.images if images.shape == functions.shape.text), None)
    shape = shape or study.images[0].shape
    bias_panel(right, [images for images in study.images if images.shape == shape])
    right.set_title("What it buys in an image", loc="left", fontsize=11, color=INK)
    figure.suptitle(functions.shape.title, x=0.01, ha="left", fontsize=12, weight="bold", color=INK)
    return finish("accuracy", functions.shape.title, "", figure)
