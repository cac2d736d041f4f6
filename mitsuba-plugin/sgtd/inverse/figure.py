"""What a recovery did, as a picture: target, start, result, their difference, and each parameter along the way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import require
from .recover import Recovery

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure(recovery: Recovery, truth: Mapping[str, float] | None = None) -> Figure:
    """Draws a recovery; ``truth``, where it is known, is drawn as dashed lines."""
    require("fit")
    from matplotlib.figure import Figure as NewFigure

    names = list(recovery.parameters)
    drawn = NewFigure(figsize=(12.0, 6.4), layout="constrained")
    halves: Any = drawn.subfigures(2, 1, height_ratios=(1.15, 1.0))
    top, bottom = halves
    white = float(np.percentile(recovery.target, 99.0)) or 1.0
    panels = top.subplots(1, 4)
    pictures = (("target", recovery.target), ("start", recovery.start), ("result", recovery.image))
    for axes, (title, image) in zip(panels, pictures):
        axes.imshow(_displayed(image, white))
        axes.set_title(title)
    floor = 1e-3 * recovery.target.mean()
    difference = np.log2((recovery.image + floor) / (recovery.target + floor)).mean(axis=-1)
    shown: Any = panels[3].imshow(difference, cmap="RdBu_r", vmin=-0.25, vmax=0.25)
    panels[3].set_title("result / target")
    top.colorbar(shown, ax=panels[3], shrink=0.8, label="stops")
    for axes in panels:
        axes.set_axis_off()
    traces = bottom.subplots(1, len(names) + 1)
    count = range(len(recovery.steps))
    for axes, name in zip(traces, names):
        axes.plot(count, [step.parameters[name] for step in recovery.steps], marker=".", color="#2a6f97")
        if truth and name in truth:
            axes.axhline(truth[name], color="black", linestyle="--", linewidth=1.0)
        axes.set_title(f"{name} = {recovery.parameters[name]:.4g}")
        axes.set_xlabel("step")
    traces[-1].semilogy(count, [step.error for step in recovery.steps], marker=".", color="#9b2226")
    traces[-1].set_title("residual (log)")
    traces[-1].set_xlabel("step")
    for axes in traces:
        axes.grid(alpha=0.3)
        axes.locator_params(axis="x", integer=True)
    return drawn


def _displayed(image: np.ndarray, white: float) -> np.ndarray:
    """For the screen; one channel is gray."""
    color = np.clip(image[..., :3] / white, 0.0, 1.0)
    color = np.where(color <= 0.0031308, 12.92 * color, 1.055 * color ** (1.0 / 2.4) - 0.055)
    return np.repeat(color, 3, axis=-1) if color.shape[-1] == 1 else color
