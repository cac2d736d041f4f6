#!/usr/bin/env python3
"""Recovers the five parameters of a lobe from one picture of a lit sphere.

    python examples/recover_lobe.py                      Levenberg-Marquardt: about ten seconds
    python examples/recover_lobe.py --optimizer adam     stochastic gradients through the same variables, for comparison

Writes recovery.png (target, start, result, and the parameters along the way) into the output folder.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import sgtd
import sgtd.inverse

TRUTH = {"gamma": 1.8, "p": 1.3, "lambda": 0.25, "shift": 0.5, "alpha": 0.3}
START = {"gamma": 2.5, "p": 1.0, "lambda": 0.0, "shift": 0.3, "alpha": 0.15}
NOISE = 0.005


def sphere(size: int, **shape: Any) -> mi.Scene:
    """One lamp in a dark room: every pixel is one half vector of the lobe."""
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "luminance"}
    view = mi.ScalarTransform4f().look_at([0, -4, 1.2], [0, 0, 0], [0, 0, 1])
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "prb", "max_depth": 2},
            "sensor": {"type": "perspective", "fov": 30, "to_world": view, "film": film},
            "lamp": {"type": "directional", "direction": [-1.2, 4.0, -2.5], "irradiance": 3.0},
            "ball": {"type": "sphere", "bsdf": {"type": "sgtdconductor", **shape}},
        }
    )


def inside(scene: mi.Scene, size: int) -> np.ndarray:
    """Pixels that lie within the sphere: at the edge it is the samples that decide, not the lobe."""
    rows, columns = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    result = np.ones((size, size), bool)
    for x in (0.0, 0.5, 1.0):
        for y in (0.0, 0.5, 1.0):
            at = mi.Point2f(((columns + x) / size).ravel(), ((rows + y) / size).ravel())
            ray, _ = scene.sensors()[0].sample_ray(0.0, 0.0, at, mi.Point2f(0.5))
            result &= np.array(scene.ray_test(ray)).reshape(size, size)
    return result


def photograph(size: int, spp: int, **shape: Any) -> np.ndarray:
    """The target: other samples than those of the search, and the noise of a camera."""
    image = np.array(mi.render(sphere(size, **(shape or TRUTH)), spp=spp, seed=1000))
    return image * (1.0 + NOISE * np.random.default_rng(1).standard_normal(image.shape))


def adam(scene: mi.Scene, target: np.ndarray, mask: np.ndarray, spp: int, steps: int) -> dict[str, float]:
    """The same by Adam: all variables in one optimizer, each step with samples of its own."""
    variables = sgtd.inverse.Variables()
    optimizer = mi.ad.Adam(lr=0.05)
    for name, value in zip(variables.unknown, variables.from_parameters(START)):
        optimizer[name] = mi.Float(float(value))
    parameters = mi.traverse(scene)
    goal, weight = mi.TensorXf(target), mi.TensorXf(mask[..., None].astype(np.float32))
    floor = 1e-3 * float(target.mean())
    values = {}
    for step in range(steps):
        values = variables.to_parameters([optimizer[name] for name in variables.unknown], dr)
        for name, value in values.items():
            parameters[f"ball.bsdf.{'alpha.value' if name == 'alpha' else name}"] = value
        parameters.update()
        image = mi.render(scene, parameters, spp=spp, seed=step)
        residual = (dr.log(dr.maximum(image, 0.0) + floor) - dr.log(goal + floor)) * weight
        loss = dr.mean(dr.square(residual), axis=None)
        dr.backward(loss)
        optimizer.step()
        if step % 20 == 0:
            print(f"step {step}: loss {loss.array[0]:.4g}")
    return {name: float(np.array(value).item()) for name, value in values.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--optimizer", choices=("lm", "adam"), default="lm")
    parser.add_argument("--size", type=int, default=48, help="width and height of the picture (default: 48)")
    parser.add_argument("--spp", type=int, default=32, help="samples per pixel (default: 32)")
    parser.add_argument("--steps", type=int, default=0, help="at most (default: 60, for Adam 200)")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/recovery"), help="folder (default: out/recovery)"
    )
    arguments = parser.parse_args()
    mi.set_variant("cuda_ad_rgb", "llvm_ad_rgb")
    target = photograph(arguments.size, 16 * arguments.spp)
    scene = sphere(arguments.size, **START)
    mask = inside(scene, arguments.size)
    if arguments.optimizer == "adam":
        found = adam(scene, target, mask, arguments.spp, arguments.steps or 200)
        for name, value in found.items():
            print(f"{name:8} {value:.4f}, true {TRUTH[name]:.4f}")
        return
    recovery = sgtd.inverse.recover(
        scene,
        target,
        "ball.bsdf",
        START,
        spp=arguments.spp,
        mask=mask,
        max_steps=arguments.steps or 60,
        on_step=lambda step: print(f"residual {step.error:.4f}", {k: round(v, 4) for k, v in step.parameters.items()}),
    )
    for name, value in recovery.parameters.items():
        print(f"{name:8} {value:.4f} ± {recovery.deviations[name]:.4f}, true {TRUTH[name]:.4f}")
    arguments.output.mkdir(parents=True, exist_ok=True)
    sgtd.inverse.figure(recovery, TRUTH).savefig(arguments.output / "recovery.png", dpi=110)
    print(f"The picture: {arguments.output / 'recovery.png'}")


if __name__ == "__main__":
    main()
