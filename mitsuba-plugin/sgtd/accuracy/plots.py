"""The plots: error against time, and error of images against the dial. Each is drawn as PNG and as SVG."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import DEFAULT_SETTING, advice, setting_text
from .errors import Spread
from .images import ImageStudy
from .stopwatch import Timing
from .study import FunctionStudy, Study

# Okabe and Ito, "Color universal design" (2008).
BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
INK, FAINT = "#1c1c1c", "#595959"

# Errors at or below this are drawn at this: what double precision can tell.
ERROR_FLOOR = 1e-16

# Errors of images below this are not drawn: rounding of the arithmetic.
_BIAS_FLOOR = 1e-10

_WIDTH, _HEIGHT = 4.6, 4.4
_SMALL = 9.0
_PNG_DPI = 160


@dataclass(frozen=True)
class Plot:
    """A drawn figure in both formats."""

    name: str
    title: str
    words: str
    png: bytes
    svg: bytes


def draw_all(study: Study) -> tuple[Plot, list[Plot], list[Plot]]:
    """The main plot, one per shape as functions, one per shape as images."""
    functions = [draw_functions(study, one) for one in study.functions]
    shapes = list(dict.fromkeys(images.shape for images in study.images))
    pictures = [draw_images(study, shape) for shape in shapes]
    return draw_main(study), functions, pictures


def draw_functions(study: Study, functions: FunctionStudy) -> Plot:
    """The worst error of G1 against ns per call."""
    figure = _figure(_WIDTH, _HEIGHT)
    axes = figure.add_subplot()
    _functions_panel(axes, study, functions)
    title = functions.shape.title
    axes.set_title(_wrapped(title), loc="left", fontsize=11, color=INK)
    words = "Down and to the left is better. Bars: quartiles over repetitions; the thin upright lines reach from the root mean square error to the worst."
    return _plot(f"functions-{functions.shape.slug}", title, words, figure)


def draw_images(study: Study, shape: str) -> Plot:
    """Bias of the images against the dial, with the noise that hides it."""
    own = [images for images in study.images if images.shape == shape]
    figure = _figure(_WIDTH, _HEIGHT)
    axes = figure.add_subplot()
    _images_panel(axes, own)
    title = _shape_title(study, shape)
    axes.set_title(_wrapped(title), loc="left", fontsize=11, color=INK)
    words = "Where a line is below the dashed ones, noise hides the error; hollow marks are at or below what the renders can tell from zero."
    return _plot(f"images-{_slug(shape)}", title, words, figure)


def draw_main(study: Study) -> Plot:
    """Both for the first shape, side by side."""
    figure = _figure(2 * _WIDTH, _HEIGHT)
    left, right = figure.subplots(1, 2)
    functions = study.functions[0]
    _functions_panel(left, study, functions)
    left.set_title("What accuracy costs in time", loc="left", fontsize=12, color=INK)
    shape = next((images.shape for images in study.images if images.shape == functions.shape.text), None)
    shape = shape or study.images[0].shape
    _images_panel(right, [images for images in study.images if images.shape == shape])
    right.set_title("What it buys in an image", loc="left", fontsize=12, color=INK)
    figure.suptitle(functions.shape.title, x=0.01, ha="left", fontsize=13, weight="bold", color=INK)
    return _plot("accuracy", functions.shape.title, "", figure)


def _functions_panel(axes: Any, study: Study, functions: FunctionStudy) -> None:
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
        _label(axes, left, functions.masking[group[0]].g1.largest, " … ".join(ends), BLUE, "left")
    for key in named:
        timing, errors = point(key)
        _label(axes, timing.median, errors.largest, key.replace(", ", ",\n"), VERMILION, "below")
    if quadrature:
        for key in {quadrature[0], quadrature[-1]}:
            timing, errors = point(key)
            nodes = key.split(", ")[1].split()[0]
            _label(axes, timing.median, errors.largest, nodes, FAINT, "above")
        middle = point(quadrature[len(quadrature) // 2])
        _label(axes, middle[0].high, middle[1].largest, "Gauss-Legendre,\nfixed number\nof nodes", FAINT, "below")

    reference = times[text, "lambda", "0.0"]
    axes.axvspan(reference.low, reference.high, color=GREEN, alpha=0.15, linewidth=0)
    axes.axvline(reference.median, color=GREEN, linewidth=1.2, linestyle=":")
    _upright(axes, reference.median, 0.42, "adaptive quadrature,\nthe reference", GREEN)
    axes.text(
        0.03,
        0.03,
        "tables of sgtd,\nby setting",
        transform=axes.transAxes,
        fontsize=_SMALL,
        color=BLUE,
        va="bottom",
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = axes.get_xlim()
    axes.set_xlim(low / 4.5, high * 1.6)
    axes.set_ylim(0.3 * ERROR_FLOOR, 8.0)
    axes.set_yticks([10.0**k for k in range(-16, 1, 2)])
    axes.set_xlabel("time of one Λ on one core, ns")
    axes.set_ylabel("relative error of G1: worst (mark), RMS (lower end)")
    _style(axes)


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


def _images_panel(axes: Any, studies: list[ImageStudy]) -> None:
    settings = [row.setting for row in studies[0].rows if row.setting]
    marks = ["o", "s", "D", "v", "P", "X"]
    colors = [BLUE, VERMILION, PURPLE, ORANGE, SKY, GREEN]
    ends = []
    for number, images in enumerate(studies):
        color, mark = colors[number % len(colors)], marks[number % len(marks)]
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
            ends.append((shown[0][1], f"{images.scene},\n{images.variant}", color))
    axes.set_xscale("log")
    axes.set_yscale("log")
    for spp in advice.SAMPLES:
        level = min(images.row(0.0).noise(spp) for images in studies)
        axes.axhline(level, color=INK, linewidth=0.9, linestyle="--")
        axes.text(
            settings[-1] / 2, level * 1.1, f"noise, {spp} spp", fontsize=_SMALL, color=INK, ha="right", va="bottom"
        )
    axes.axvline(DEFAULT_SETTING, color=GREEN, linewidth=1.2, linestyle=":")
    low = min([axes.get_ylim()[0], 1e-9])
    top = max(images.row(0.0).noise(advice.SAMPLES[0]) for images in studies)
    axes.set_ylim(max(low, _BIAS_FLOOR), 20.0 * top)
    _upright(axes, DEFAULT_SETTING, 0.03, "the default", GREEN)
    axes.set_xlim(settings[0] * 10 ** (0.42 * len(settings)), settings[-1] / 3)
    _spread_labels(axes, settings[0], ends)
    axes.set_xlabel("setting, accuracy")
    axes.set_xticks(settings, [f"$10^{{{round(math.log10(s))}}}$" for s in settings])
    axes.minorticks_off()
    axes.set_ylabel("RMS error of the image / its mean luminance")
    _style(axes)


def _spread_labels(axes: Any, x: float, ends: list[tuple[float, str, str]]) -> None:
    """Labels left of the first points, moved apart where they would cover each other."""
    if not ends:
        return
    low, high = (math.log10(limit) for limit in axes.get_ylim())
    step = 0.1 * (high - low)
    ordered = sorted(ends)
    middle = sum(math.log10(value) for value, _, _ in ordered) / len(ordered)
    place = middle - 0.5 * step * (len(ordered) - 1)
    for value, text, color in ordered:
        axes.annotate(
            text,
            (x, value),
            (x * 2.5, 10**place),
            fontsize=_SMALL,
            color=color,
            ha="right",
            va="center",
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 3},
        )
        place += step


def _label(axes: Any, x: float, y: float, text: str, color: str, side: str) -> None:
    offset, across, along = {
        "left": ((-5, 0), "right", "center"),
        "right": ((5, 0), "left", "center"),
        "above": ((0, 6), "center", "bottom"),
        "below": ((4, -4), "left", "top"),
    }[side]
    place = (x, _shown(y))
    style = {"textcoords": "offset points", "fontsize": _SMALL, "color": color}
    axes.annotate(text, place, offset, ha=across, va=along, **style)


def _upright(axes: Any, x: float, y: float, text: str, color: str) -> None:
    """Text along a vertical line, to its left; ``y`` is a part of the height."""
    transform = axes.get_xaxis_transform()
    axes.annotate(
        text, (x, y), (-3, 0), xycoords=transform, textcoords="offset points", rotation=90, fontsize=_SMALL, color=color,
        ha="right", va="bottom", linespacing=1.0,
    )  # fmt: skip


def _figure(width: float, height: float) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _style(axes: Any) -> None:
    axes.grid(True, which="major", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(labelsize=9, colors=INK)
    axes.xaxis.label.set(fontsize=10, color=INK)
    axes.yaxis.label.set(fontsize=10, color=INK)


def _plot(name: str, title: str, words: str, figure: Any) -> Plot:
    import matplotlib

    files = {}
    # paths for glyphs: no font is needed where the plot is shown; no date: equal numbers give equal files
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": name}):
        for kind, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
            buffer = io.BytesIO()
            figure.savefig(buffer, format=kind, dpi=_PNG_DPI, metadata=metadata)
            files[kind] = buffer.getvalue()
    return Plot(name, title, words, files["png"], files["svg"])


def picture_png(image: np.ndarray) -> bytes:
    """An image in [0, 1] as PNG, one pixel for one."""
    from matplotlib.image import imsave

    buffer = io.BytesIO()
    imsave(buffer, np.clip(image, 0.0, 1.0), format="png")
    return buffer.getvalue()


def _shape_title(study: Study, shape: str) -> str:
    return next((one.shape.title for one in study.functions if one.shape.text == shape), shape)


def _wrapped(title: str) -> str:
    """At most two lines."""
    import textwrap

    return "\n".join(textwrap.wrap(title, 48))


def _slug(text: str) -> str:
    return "".join(c if c.isalnum() or c in ".-" else "-" for c in text).strip("-.")
