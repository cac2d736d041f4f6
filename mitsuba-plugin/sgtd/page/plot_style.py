"""What all plots share: size, colors, labels, and the two formats that they are saved in."""

from __future__ import annotations

import io
import textwrap
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import require

# Okabe and Ito, "Color Universal Design" (2008).
BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
INK, FAINT = "#1c1c1c", "#595959"

# Inches and points: a plot as wide as a phone still has letters of 8 pixels.
_WIDTH, _HEIGHT = 4.6, 4.4
SMALL = 9.0
_PNG_DPI = 160


@dataclass(frozen=True)
class Plot:
    """A drawn figure in both formats; ``words`` say how to read it."""

    name: str
    title: str
    words: str
    png: bytes
    svg: bytes


def new_figure(columns: int = 1) -> Any:
    """An empty figure, as wide as so many plots."""
    require("report")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(columns * _WIDTH, _HEIGHT), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def finish(name: str, title: str, words: str, figure: Any, kinds: tuple[str, ...] = ("png", "svg")) -> Plot:
    """Saves in memory; a page that shows one kind needs no other."""
    import matplotlib

    files = {"png": b"", "svg": b""}
    # Paths for glyphs: no font is needed where the plot is shown. No date: equal numbers give equal files.
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": name}):
        for kind, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
            if kind not in kinds:
                continue
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


def style(axes: Any) -> None:
    """Faint grid, two spines."""
    axes.grid(True, which="major", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(labelsize=SMALL, colors=INK)
    axes.xaxis.label.set(fontsize=10, color=INK)
    axes.yaxis.label.set(fontsize=10, color=INK)


def label(axes: Any, x: float, y: float, text: str, color: str, side: str) -> None:
    """Text beside a point."""
    offset, across, along = {
        "left": ((-5, 0), "right", "center"),
        "right": ((6, 0), "left", "center"),
        "above": ((-4, 6), "left", "bottom"),
        "below": ((4, -4), "left", "top"),
    }[side]
    look = {"textcoords": "offset points", "fontsize": SMALL, "color": color}
    axes.annotate(text, (x, y), offset, ha=across, va=along, **look)


def upright(axes: Any, x: float, y: float, text: str, color: str) -> None:
    """Text along a vertical line, to its left; ``y`` is a part of the height."""
    look = {"textcoords": "offset points", "fontsize": SMALL, "color": color, "rotation": 90, "linespacing": 1.0}
    axes.annotate(text, (x, y), (-3, 0), xycoords=axes.get_xaxis_transform(), ha="right", va="bottom", **look)


def wrapped(title: str) -> str:
    """A title on lines that a plot can hold."""
    return "\n".join(textwrap.wrap(title, 46))


def file_part(text: str) -> str:
    """A text as part of a file name."""
    return "".join(c if c.isalnum() or c in ".-" else "-" for c in text).strip("-.")
