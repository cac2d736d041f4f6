"""What a step of inverse rendering costs, as ratios measured in one run: four gradients of the shape over that of alpha alone, and how
much of a step goes into new tables. Run by ``make bench``.

A step moves the parameters, updates them, renders with ``prb`` and goes backwards, as an optimizer does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from render import Row, has_llvm
from sgtd.interleaved_timing import ratios

MEMBER = {"gamma": 1.9, "p": 1.2, "lambda": 0.2, "shift": 0.4, "alpha": 0.3}
# Names in traverse(): a roughness is a texture there
KEYS = {name: f"ball.bsdf.{name}" for name in MEMBER} | {"alpha": "ball.bsdf.alpha.value"}
SIZE, SAMPLES, REPETITIONS = 256, 16, 11


def scene(fov: float) -> Any:
    """A ball on a floor under an even sky, three bounces; it covers the picture if the field of view is small."""
    import mitsuba as mi

    look = mi.ScalarTransform4f().look_at([0, -4, 1], [0, 0, 0], [0, 0, 1])
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "prb", "max_depth": 4},
            "sensor": {"type": "perspective", "fov": fov, "to_world": look, "film": film},
            "light": {"type": "constant"},
            "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, -1]).scale(4)},
            "ball": {"type": "sphere", "bsdf": {"type": "sgtdconductor", "material": "Au", **MEMBER}},
        }
    )


def step(fov: float, names: tuple[str, ...], updates: list[float]) -> Callable[[int], float]:
    """Seconds of a step with gradients of these parameters; appends the share that the update takes."""
    import drjit as dr
    import mitsuba as mi

    made = scene(fov)
    params = mi.traverse(made)

    def run(turn: int) -> float:
        start = time.perf_counter()
        for name in names:
            moved = mi.Float(MEMBER[name] * (1.0 + 1e-3 * np.sin(turn)))
            dr.enable_grad(moved)
            params[KEYS[name]] = moved
        params.update()
        dr.sync_thread()
        updated = time.perf_counter()
        dr.backward(dr.mean(mi.render(made, params, spp=SAMPLES, seed=turn)))
        dr.eval([dr.grad(params[KEYS[name]]) for name in names])
        dr.sync_thread()
        end = time.perf_counter()
        updates.append((updated - start) / (end - start))
        return end - start

    return run


def main() -> None:
    """Prints both rows for both scenes."""
    if not has_llvm():
        sys.exit("LLVM cannot be loaded: gradients need a variant of Dr.Jit")
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    for where, fov in (("a ball", 35.0), ("covered", 8.0)):
        shares: list[float] = []
        against = ratios(step(fov, tuple(MEMBER), shares), step(fov, ("alpha",), []), REPETITIONS)
        Row(f"step with four gradients of the shape, {where}", "step with alpha alone", "<= 1.3").print(against)
        Row(f"new tables and their derivatives, {where}", "the step", "<= 0.05").print(shares[1:])


if __name__ == "__main__":
    main()
