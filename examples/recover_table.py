#!/usr/bin/env python3
"""Recovers a tabulated distribution of normals from one picture of a lit sphere.

    python examples/recover_table.py                     from a GGX lobe to sixteen rows of a table

The target is a metal with a narrow core and a haze, which no single lobe has. Writes table.png (target, start, result, and the table) and
table.csv (``filename`` of a material) into the output folder.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import sgtd
import sgtd.inverse
from recover_lobe import inside, photograph, sphere

ANGLES = np.array([0.0, 2.5, 5, 8, 11, 14, 18, 22, 27, 33, 39, 46, 54, 62, 71, 80])
ALPHA = 0.18
NORMALS = np.stack([np.sin(np.radians(ANGLES)), 0.0 * ANGLES, np.cos(np.radians(ANGLES))], axis=-1)


def densities() -> np.ndarray:
    """D at these angles: a Gaussian core and a haze with a long tail, half of the normals each."""
    parts = [
        (0.5, sgtd.Ndf(distribution="beckmann", alpha=0.1)),
        (0.5, sgtd.Ndf(distribution="student", gamma=1.7, alpha=0.4)),
    ]
    return np.asarray(sgtd.Ndf.mixture(parts).d(NORMALS))


def material(values: np.ndarray) -> dict[str, Any]:
    """The properties of a table with these values."""
    listed = lambda numbers: " ".join(repr(float(number)) for number in numbers)
    return {
        "distribution": "tabulated",
        "angles": listed(ANGLES),
        "values": listed(values),
        "quantity": "D",
        "tail_exponent": 3.4,
        "knee": ALPHA,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=64, help="width and height of the picture (default: 64)")
    parser.add_argument("--spp", type=int, default=32, help="samples per pixel (default: 32)")
    parser.add_argument("--steps", type=int, default=20, help="at most (default: 20)")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/table"), help="folder (default: out/table)")
    arguments = parser.parse_args()
    mi.set_variant("cuda_ad_rgb", "llvm_ad_rgb")
    truth = densities()
    target = photograph(arguments.size, 16 * arguments.spp, **material(truth))
    start = np.asarray(sgtd.Ndf(distribution="ggx", alpha=ALPHA).d(NORMALS))
    scene = sphere(arguments.size, **material(start))
    recovery = sgtd.inverse.recover(
        scene,
        target,
        "ball.bsdf",
        {"values": start},
        unknown=["values"],
        spp=arguments.spp,
        mask=inside(scene, arguments.size),
        max_steps=arguments.steps,
        on_step=lambda step: print(f"residual {step.error:.4f}"),
    )
    found = recovery.lists["values"]
    scale = truth[0] / found[0]
    for k, angle in enumerate(ANGLES):
        deviation = recovery.deviations.get(f"values[{k}]", 0.0)
        print(f"{angle:5.1f} degrees: {scale * found[k]:.4g} ± {scale * deviation:.1g}, true {truth[k]:.4g}")
    arguments.output.mkdir(parents=True, exist_ok=True)
    sgtd.inverse.figure(recovery, {"values": truth}).savefig(arguments.output / "table.png", dpi=110)
    np.savetxt(
        arguments.output / "table.csv",
        np.stack([ANGLES, scale * found], axis=-1),
        delimiter=",",
        header="angle,D",
        comments="",
    )
    print(f"The picture: {arguments.output / 'table.png'}")


if __name__ == "__main__":
    main()
