"""Timing of two sides that take turns: what a busy machine does to one it does to the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

Clock = Callable[[int], float]


def ratios(left: Clock, right: Clock, repetitions: int) -> list[float]:
    """Ratios left/right of seconds, the order changing from pair to pair; both clocks are told the number of the pair."""
    left(0), right(0)  # compiles
    found = []
    for turn in range(1, repetitions + 1):
        if turn % 2:
            a, b = left(turn), right(turn)
        else:
            b, a = right(turn), left(turn)
        found.append(a / b)
    return found


def render_clock(scene: Any, spp: int) -> Clock:
    """Seconds of one render, image in memory included; the turn is the seed."""
    import drjit as dr
    import mitsuba as mi

    def run(turn: int) -> float:
        start = time.perf_counter()
        image = mi.render(scene, spp=spp, seed=turn)
        dr.eval(image)
        dr.sync_thread()
        return time.perf_counter() - start

    return run
