"""Heights as a file has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Optional

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Spacing = tuple[float, float]


@dataclass(frozen=True)
class HeightMap:
    """Heights row by row along y, the distances of points along x and y, and whether the map repeats, as far as it is known; ``notes`` say
    what reading has changed."""

    heights: Array
    spacing: Optional[Spacing] = None
    periodic: Optional[bool] = None
    notes: tuple[str, ...] = ()
