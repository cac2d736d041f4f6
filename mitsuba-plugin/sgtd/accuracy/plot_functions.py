"""Plots of the functions: the error of masking against the time of a call."""

from __future__ import annotations

import math
from typing import Any

from ..page.plot_style import BLUE, FAINT, GREEN, INK, SMALL, VERMILION, Plot, finish, label, new_figure, style, wrapped
from . import setting_text
from .function_errors import Spread
from .function_timing import Timing
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
