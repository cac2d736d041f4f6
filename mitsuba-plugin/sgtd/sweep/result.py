"""What a sweep has found."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .grid import Axis, Value


@dataclass(frozen=True)
class Cell:
    """One combination: the mean image of its seeds (None if a seed failed), what it measures, or why it has no image.

    ``noise`` is the standard error of the mean luminance from the spread of the seeds; None for a single one.
    """

    settings: dict[str, Value]
    image: np.ndarray[Any, Any] | None
    file: str
    luminance: float
    noise: float | None
    seconds: float
    spp: int
    error: str = ""


@dataclass(frozen=True)
class Sweep:
    """All combinations in order of the axes, the last of which runs fastest."""

    scene: Path
    variant: str
    axes: tuple[Axis, ...]
    seeds: int
    cells: tuple[Cell, ...]
