"""The contact sheet: all images of a sweep at one exposure, in the order of its axes."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from ..compare.difference import Exposure, exposure_for, to_display
from .result import Sweep

# Inches: a column of a sheet, and the most columns and rows that a picture can hold
_COLUMN, _LABEL = 2.4, 0.45
_MOST = 24


def draw_sheet(sweep: Sweep, path: Path, stops: float | None = None) -> Exposure:
    """Writes the sheet as PNG and returns its exposure, by default that of all images together.

    The last axis runs across. The one before it runs down; of further axes, each combination is a block of rows.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    *others, across = sweep.axes
    columns = len(across.values)
    rows = len(sweep.cells) // columns
    images = [cell.image for cell in sweep.cells if cell.image is not None]
    exposure = Exposure(stops, "") if stops is not None else exposure_for(np.concatenate(images, axis=0))
    height, width = images[0].shape[:2]
    figure = Figure(figsize=(_COLUMN * columns + _LABEL, (_COLUMN * height / width) * rows + 0.8), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    labels = [
        ", ".join(f"{axis.name} = {text}" for axis, text in zip(others, texts))
        for texts in itertools.product(*(axis.texts() for axis in others))
    ]
    for row, column in itertools.product(range(rows), range(columns)):
        axes, cell = grid[row][column], sweep.cells[row * columns + column]
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_visible(False)
        if cell.image is None:
            axes.text(0.5, 0.5, "no image", ha="center", va="center", transform=axes.transAxes, color="#d55e00")
        else:
            axes.imshow(to_display(np.nan_to_num(cell.image), exposure.stops), interpolation="lanczos")
        if row == 0:
            axes.set_title(f"{across.name} = {across.texts()[column]}", fontsize=10)
        if column == 0 and others:
            axes.set_ylabel(labels[row], fontsize=10)
    how = f"exposure {exposure.stops:+.3g} stops for all" + (f": {exposure.rule}" if exposure.rule else "")
    figure.supxlabel(
        f"{sweep.scene.name}, {sweep.variant}, {sweep.cells[0].spp or '?'} samples per pixel; {how}",
        fontsize=8,
        color="#595959",
    )
    figure.savefig(path, dpi=100, metadata={"Software": None})
    return exposure
