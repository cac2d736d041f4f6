"""What a recovery did, as a picture: target, start, result, their difference, and each parameter along the way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import require
from .recover import Recovery

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure(recovery: Recovery, truth: Mapping[str, Any] | None = None) -> Figure:
    """Draws a recovery; ``truth``, where it is known, is drawn as dashed lines. Lists of numbers are drawn as they were and are."""
    require("fit")
    from matplotlib.figure import Figure as NewFigure

    names = [] if recovery.lists else list(recovery.parameters)
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
    lists = list(recovery.lists)
    # a list is as wide as three parameters
    traces = np.atleast_1d(
        bottom.subplots(1, len(names) + len(lists) + 1, width_ratios=[*(1 for _ in names), *(3 for _ in lists), 1])
    )
    count = range(len(recovery.steps))
    for axes, name in zip(traces, lists):
        _draw_list(axes, recovery, name, truth)
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


def _draw_list(axes: Any, recovery: Recovery, name: str, truth: Mapping[str, Any] | None) -> None:
    found = recovery.lists[name]
    scale = 1.0
    if truth and name in truth:
        exact = np.asarray(truth[name], dtype=np.float64)
        # proportions of values and weights count alone
        if name != "alphas":
            scale = float(found.max() / exact[np.argmax(found)])
        axes.semilogy(scale * exact, color="black", linestyle="--", linewidth=1.0, label="truth")
    axes.semilogy(recovery.first_lists[name], color="#adb5bd", marker=".", label="start")
    relative = [recovery.deviations.get(f"{name}[{k}]", 0.0) / x if x else 0.0 for k, x in enumerate(found)]
    up = np.minimum(np.nan_to_num(relative, posinf=10.0), 10.0)
    error = np.stack([found * (1.0 - np.exp(-up)), found * np.expm1(np.minimum(up, 2.0))])
    axes.errorbar(range(len(found)), found, yerr=error, color="#2a6f97", marker="o", capsize=2.0, label="result")
    axes.set_title(name)
    axes.set_xlabel("row")
    axes.legend()


def _displayed(image: np.ndarray, white: float) -> np.ndarray:
    """For the screen; one channel is gray."""
    color = np.clip(image[..., :3] / white, 0.0, 1.0)
    color = np.where(color <= 0.0031308, 12.92 * color, 1.055 * color ** (1.0 / 2.4) - 0.055)
    return np.repeat(color, 3, axis=-1) if color.shape[-1] == 1 else color
