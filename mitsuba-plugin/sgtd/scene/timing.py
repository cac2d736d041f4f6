"""How long a rendering took: without compilation, with quartiles, and in no more digits than they allow."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Optional

Quartiles = Optional[tuple[float, float]]

# Compilation shows where the first pass took longer than the others by this many times their whole spread.
_COMPILING_BEYOND_SPREAD = 2.0

# Significant digits of a time that was measured once, and the most of any other.
_DIGITS_ONCE = 2
_DIGITS_MOST = 4


@dataclass(frozen=True)
class Timing:
    """The seconds of each pass with its samples per pixel, in order.

    ``compiles`` says that this variant traces and compiles in its first pass, so that only the others are timed.
    """

    passes: tuple[tuple[float, int], ...]
    compiles: bool

    @property
    def elapsed(self) -> float:
        """All passes together, compilation included."""
        return sum(seconds for seconds, _ in self.passes)

    @property
    def compiling_is_included(self) -> bool:
        """There was a single pass, so that compilation is part of ``seconds``."""
        return self.compiles and len(self.passes) == 1

    @property
    def speeds(self) -> list[float]:
        """Seconds for one sample per pixel, of each pass that has no compilation in it."""
        timed = self.passes[1:] if self.compiles and len(self.passes) > 1 else self.passes
        return [seconds / samples for seconds, samples in timed]

    @property
    def seconds(self) -> float:
        """All samples at the median speed."""
        return statistics.median(self.speeds) * self._samples

    @property
    def quartiles(self) -> Quartiles:
        """All samples at the quartiles of the speed; None where fewer than three passes were timed."""
        found = quartiles(self.speeds)
        return found and (found[0] * self._samples, found[1] * self._samples)

    @property
    def compiling(self) -> float | None:
        """What the first pass took on top of its samples; None where that cannot be told from the spread of the others."""
        speeds = self.speeds
        if not self.compiles or len(speeds) < 2:
            return None
        first, samples = self.passes[0]
        excess = first - statistics.median(speeds) * samples
        spread = (max(speeds) - min(speeds)) * samples
        return excess if excess > _COMPILING_BEYOND_SPREAD * spread else None

    @property
    def _samples(self) -> int:
        return sum(samples for _, samples in self.passes)


def quartiles(values: Sequence[float]) -> Quartiles:
    """The lower and the upper quartile; None of fewer than three values."""
    if len(values) < 3:
        return None
    low, _, high = statistics.quantiles(values, n=4, method="inclusive")
    return low, high


def ratios(right: Timing, left: Timing) -> list[float]:
    """Of the passes that took turns: right / left."""
    return [a / b for a, b in zip(right.speeds, left.speeds) if b > 0.0]


def decimals(value: float, spread: Quartiles) -> int:
    """The decimal places that are worth writing: down to the first digit of the distance between the quartiles."""
    if value == 0.0 or not math.isfinite(value):
        return 0
    magnitude = math.floor(math.log10(abs(value)))
    most = _DIGITS_MOST - 1 - magnitude
    if spread is None:
        return _DIGITS_ONCE - 1 - magnitude
    distance = spread[1] - spread[0]
    return most if distance <= 0.0 else min(most, max(-math.floor(math.log10(distance)), -magnitude))


def seconds_text(timing: Timing) -> str:
    """ "1.23 s (1.20 to 1.28)", or "1.2 s" where there are no quartiles."""
    seconds, spread = timing.seconds, timing.quartiles
    places = decimals(seconds, spread)
    if spread is None:
        return f"{fixed(seconds, places)} s"
    return f"{fixed(seconds, places)} s ({fixed(spread[0], places)} to {fixed(spread[1], places)})"


def fixed(value: float, places: int) -> str:
    """With so many decimal places; a negative number of them rounds to tens, hundreds, ..."""
    return f"{round(value, places):.{max(places, 0)}f}"
