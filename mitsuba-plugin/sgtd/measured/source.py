"""What a file of measured reflectance becomes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Optional

from ..fitting.measurement import Measurement

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Source:
    """Pairs of directions that a fit uses, and where the format says what lies between them, a function that evaluates any pairs.

    ``evaluate`` takes directions ``wi`` and ``wo`` (n, 3) above the surface and returns reflectance (n, channels) per steradian without the
    cosine, NaN where nothing was measured. ``steps`` are those of polar angle and azimuth in degrees, where a file has a coarse grid of both and
    ``evaluate`` draws lines between its points.
    """

    kind: str
    data: Measurement
    evaluate: Optional[Callable[[Array, Array], Array]] = None
    steps: Optional[tuple[float, float]] = None
