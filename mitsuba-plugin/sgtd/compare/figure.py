"""The picture of a comparison: left, right, their signed difference and the FLIP map, with labels and scales.

All four panels show the same pixels at the same size, one image pixel on one or more whole picture pixels unless the
image is larger than a panel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import require
from .difference import (
    FLIP_PIXELS_PER_DEGREE,
    STOPS_FLOOR,
    Comparison,
    luminance,
    to_display,
)

# A panel is at most so wide, and small images are enlarged by a whole factor towards it (picture pixels).
_PANEL = 720
_DPI = 100

# Lengths for a panel of this width; wider panels have everything larger, so that a picture shown at the width of a
# page stays legible.
_DESIGN_WIDTH = 480
_MARGIN = 24
_GAP = 36
_BAR = 84  # a color bar with its labels
_HEADER = 62
_CAPTION = 52  # two lines
_FOOTER_LINE = 23
_TEXT = 14
_SMALL = 11.5
_TITLE = 17

_INK = "#1c1c1c"
_FAINT = "#4a4a4a"

# Pixels that are not finite: a color that no scale has.
_BAD = np.array([1.0, 0.0, 1.0, 1.0])

# An enlarged image is no higher than this (picture pixels), however narrow it is.
_PANEL_HEIGHT = 1440

# The difference scale ends at this quantile of |difference|, rounded up to one of these (in stops).
_SCALE_QUANTILE = 0.995
_SCALE_STEPS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 20.0)


@dataclass(frozen=True)
class Labels:
    """The words in the picture; an image has a heading and a line below it."""

    title: str
    left: tuple[str, str]
    right: tuple[str, str]
    footer: tuple[str, ...]


def draw(path: Path, left: np.ndarray, right: np.ndarray, result: Comparison, labels: Labels) -> None:
    """Writes the picture as PNG. ``left`` and ``right`` are linear sRGB."""
    require("compare")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height, width = left.shape[:2]
    room = min(_PANEL / width, _PANEL_HEIGHT / height)
    factor = room if room < 1.0 else float(int(room))
    panel_width, panel_height = max(1, round(width * factor)), max(1, round(height * factor))
    unit = max(panel_width, _DESIGN_WIDTH) / _DESIGN_WIDTH
    margin, gap, header, caption, line = (unit * length for length in (_MARGIN, _GAP, _HEADER, _CAPTION, _FOOTER_LINE))
    column = max(panel_width, _DESIGN_WIDTH) + unit * _BAR
    row = panel_height + caption
    footer = explain(result) + labels.footer
    total_width = 2 * margin + 2 * column + gap
    total_height = header + 2 * row + gap / 2 + line * (len(footer) + 0.5) + margin

    figure = Figure(figsize=(total_width / _DPI, total_height / _DPI), dpi=_DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)

    def box(x: float, y: float, w: float, h: float) -> tuple[float, float, float, float]:
        """Pixels from the upper left corner to matplotlib's fractions from the lower left one."""
        return (x / total_width, 1 - (y + h) / total_height, w / total_width, h / total_height)

    def points(size: float) -> float:
        return unit * size * 72 / _DPI

    def write(x: float, y: float, room: float, text: str, size: float, color: str = _INK, bold: bool = False) -> None:
        place = (x / total_width, 1 - y / total_height)
        weight = "bold" if bold else "normal"
        words = figure.text(*place, text, fontsize=points(size), color=color, weight=weight, va="top")
        width = words.get_window_extent(canvas.get_renderer()).width
        if width > room:
            words.set_fontsize(points(size) * room / width)

    whole = total_width - 2 * margin
    write(margin, margin, whole, labels.title, _TITLE, bold=True)
    # One pixel that is not finite must be seen in an image that is shown smaller too.
    bad = [_widened(mask, math.ceil(1.0 / factor)) for mask in (*result.bad, result.bad[0] | result.bad[1])]
    panels = (*_image_panels(left, right, bad, result, labels), *_difference_panels(bad[2], result))
    for number, panel in enumerate(panels):
        x = margin + (number % 2) * (column + gap)
        y = header + (number // 2) * (row + gap / 2)
        write(x, y + unit * 4, column, panel.heading, _TEXT, bold=True)
        write(x, y + unit * 26, column, panel.words, _SMALL)
        axes = figure.add_axes(box(x, y + caption, panel_width, panel_height))
        axes.set_axis_off()
        shown = axes.imshow(
            panel.pixels,
            interpolation="nearest" if factor >= 1 else "antialiased",
            aspect="auto",
            cmap=panel.colors,
            vmin=panel.low,
            vmax=panel.high,
        )
        if panel.bad.any():
            axes.imshow(_BAD * panel.bad[..., None], interpolation="nearest", aspect="auto")
        if panel.ticks:
            place = box(x + panel_width + unit * 10, y + caption, unit * 14, panel_height)
            bar = figure.colorbar(shown, cax=figure.add_axes(place))
            bar.set_ticks([value for value, _ in panel.ticks], labels=[text for _, text in panel.ticks])
            bar.ax.tick_params(labelsize=points(_SMALL), colors=_INK)

    for number, text in enumerate(footer):
        y = total_height - margin / 2 - line * (len(footer) - number)
        write(margin, y, whole, text, _SMALL, color=_FAINT)
    figure.savefig(path, format="png", dpi=_DPI)


@dataclass(frozen=True)
class _Panel:
    """One of the four images; one with a color scale has ticks (value, text); ``bad`` pixels are not finite."""

    heading: str
    words: str
    pixels: np.ndarray
    bad: np.ndarray
    colors: str | None = None
    low: float | None = None
    high: float | None = None
    ticks: tuple[tuple[float, str], ...] = ()


def _image_panels(
    left: np.ndarray, right: np.ndarray, bad: list[np.ndarray], result: Comparison, labels: Labels
) -> tuple[_Panel, _Panel]:
    sides = ((labels.left, _finite(left), bad[0]), (labels.right, _finite(right), bad[1]))
    if not result.decades:
        first, second = (_Panel(*words, to_display(image, result.exposure.stops), mask) for words, image, mask in sides)
        return first, second
    low = math.log10(result.floor)
    high = low + result.decades
    ticks = tuple((float(k), f"$10^{{{k}}}$") for k in range(math.ceil(low), math.floor(high) + 1))
    first, second = (
        _Panel(*words, np.log10(np.maximum(luminance(image), result.floor)), mask, "viridis", low, high, ticks)
        for words, image, mask in sides
    )
    return first, second


def _difference_panels(bad: np.ndarray, result: Comparison) -> tuple[_Panel, _Panel]:
    scale = difference_scale(result.stops)
    stops = tuple((float(tick), f"{tick:+g}" if tick else "0") for tick in np.linspace(-scale, scale, 5))
    unit = tuple((tick / 5, f"{tick / 5:g}") for tick in range(6))
    between = "right against left, in stops of luminance"
    perceived = "perceived difference, 0 to 1"
    return (
        _Panel("Difference", between, result.stops, bad, "RdBu_r", -scale, scale, stops),
        _Panel(f"FLIP, mean {result.flip:.4f}", perceived, result.flip_map, bad, "magma", 0.0, 1.0, unit),
    )


def _widened(mask: np.ndarray, size: int) -> np.ndarray:
    """Each pixel of a mask as a square of this size, to the right and down."""
    wide = mask.copy()
    for down in range(size if mask.any() else 0):
        for right in range(size):
            wide[down:, right:] |= mask[: mask.shape[0] - down, : mask.shape[1] - right]
    return wide


def difference_scale(stops: np.ndarray) -> float:
    """The end of the difference scale: a round number that only few pixels exceed."""
    differences = np.abs(stops[stops != 0.0])  # pixels that are black on both sides do not decide
    level = float(np.quantile(differences, _SCALE_QUANTILE)) if differences.size else 0.0
    return next((step for step in _SCALE_STEPS if step >= level), _SCALE_STEPS[-1])


def explain(result: Comparison) -> tuple[str, ...]:
    """What the panels show, in numbers that a reader can check."""
    exceeding = float(np.mean(np.abs(result.stops) > difference_scale(result.stops)))
    clipped = f"; {exceeding:.1%} of the pixels exceed the scale" if exceeding >= 0.0005 else ""
    noise = "" if result.stops_noise is None else f"; noise alone: {result.stops_noise:.3f} stops RMS"
    rule = f", by the left image: {result.exposure.rule}" if result.exposure.rule else ""
    exposure = f"exposure {result.exposure.stops:+.2f} stops on both sides{rule}"
    images = f"Images: sRGB clipped at white, {exposure}."
    floor = f"{STOPS_FLOOR:.0%} of white"
    as_shown = "of the two images as shown"
    if result.decades:
        images = f"Images: luminance on a logarithmic scale of {result.decades} decades, the same for both."
        floor = "the lower end of the color scale of the images"
        as_shown = f"of the two images in sRGB, {exposure}"
    difference = (
        f"Difference: log2((R + e) / (L + e)) of luminance, e = {floor}; +1 stop is twice as bright{noise}{clipped}."
    )
    flip_noise = "" if result.flip_noise is None else f" Noise alone: {result.flip_noise:.4f}."
    flip = f"FLIP: {as_shown}, at {FLIP_PIXELS_PER_DEGREE:.0f} pixels per degree.{flip_noise}"
    lines = [images, difference, flip]
    if result.any_bad:
        left, right = result.not_finite
        lines.append(f"Magenta: not finite, {left} pixels left and {right} right; they are in no number.")
    return tuple(lines)


def ratio_text(value: float, reference: float) -> str:
    """ "x 1.06", or a dash where the reference is zero."""
    return f"× {value / reference:.3f}" if reference and math.isfinite(reference) else "–"


def _finite(image: np.ndarray) -> np.ndarray:
    return np.nan_to_num(image, nan=0.0, posinf=1e30, neginf=0.0)
