"""What reflections cost on three scenes: time, and variance times time, against roughconductor's GGX at equal roughness.

Two renders of equal time have errors whose squares are as the products of variance and time, so the product says what the time is worth. Both sides
are rendered alternately; medians and quartiles of the ratios of pairs. Run by ``make bench``.
"""

from __future__ import annotations

from typing import Any

import click
import numpy as np
from rich.progress import Progress
from sgtd.interleaved_timing import ratios, render_clock
from sgtd.scene.variants import probe

# A full SGTD; and a heavy tail, whose visible normals reflect below the horizon most
MATERIALS = {
    "full SGTD": {"gamma": 2.7, "p": 1.3, "lambda": 0.3, "shift": 0.4},
    "gamma 1.6": {"gamma": 1.6},
}


def sensor(size: int, origin: list[float], target: list[float], fov: float) -> dict[str, Any]:
    """A square picture without a filter, so that its pixels are independent."""
    import mitsuba as mi

    return {
        "type": "perspective",
        "fov": fov,
        "to_world": mi.ScalarTransform4f().look_at(origin, target, [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
    }


def spheres(material: dict[str, Any], size: int) -> dict[str, Any]:
    """Nine spheres on a diffuse floor under a lamp and a sky: most of the picture is something else."""
    import mitsuba as mi

    transform = mi.ScalarTransform4f()
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6},
        "sensor": sensor(size, [0, 4, 7], [0, 0, 0], 45),
        "sky": {"type": "constant", "radiance": 0.5},
        "lamp": {
            "type": "sphere",
            "center": [3, 6, 3],
            "radius": 0.5,
            "emitter": {"type": "area", "radiance": 40.0},
        },
        "floor": {
            "type": "rectangle",
            "to_world": transform.translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(20),
            "bsdf": {"type": "diffuse"},
        },
    }
    for k in range(9):
        scene[f"ball{k}"] = {
            "type": "sphere",
            "center": [2.2 * (k % 3 - 1), 0, 2.2 * (k // 3 - 1)],
            "bsdf": {**material, "alpha": 0.05 + 0.06 * k},
        }
    return scene


def covered(material: dict[str, Any], size: int) -> dict[str, Any]:
    """One sphere fills the picture, under a sky and a small light: every ray meets the material, and little else."""
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6},
        "sensor": sensor(size, [0, 0, 3], [0, 0, 0], 20),
        "sky": {"type": "constant"},
        "light": {"type": "point", "position": [1, 2, 3], "intensity": 5.0},
        "ball": {"type": "sphere", "bsdf": {**material, "alpha": 0.5}},
    }


def room(material: dict[str, Any], size: int) -> dict[str, Any]:
    """A closed room of the material, with six bounces: samples that are not lost are followed further."""
    import mitsuba as mi

    transform = mi.ScalarTransform4f()
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 7},
        "sensor": sensor(size, [0, 0, 0.9], [0, 0, -1], 70),
        "lamp": {
            "type": "rectangle",
            "to_world": transform.translate([0, 0.99, 0]).rotate([1, 0, 0], 90).scale(0.3),
            "emitter": {"type": "area", "radiance": 10.0},
        },
    }
    turns = {"floor": ([1, 0, 0], -90), "ceiling": ([1, 0, 0], 90), "left": ([0, 1, 0], 90), "right": ([0, 1, 0], -90)}
    turns |= {"back": ([0, 1, 0], 0), "front": ([0, 1, 0], 180)}
    places = {"floor": [0, -1, 0], "ceiling": [0, 1, 0], "left": [-1, 0, 0], "right": [1, 0, 0]}
    places |= {"back": [0, 0, -1], "front": [0, 0, 1]}
    for name, (axis, angle) in turns.items():
        scene[name] = {
            "type": "rectangle",
            "to_world": transform.translate(places[name]).rotate(axis, angle),
            "bsdf": {**material, "alpha": 0.4},
        }
    return scene


SCENES = {"spheres": spheres, "covered": covered, "room": room}


def variance(scene: object, spp: int) -> float:
    """Of a pixel, over the square of the mean of the image: from pairs of renders, the median of the pairs."""
    import mitsuba as mi

    found = []
    for seed in range(100, 106, 2):
        first, second = (np.array(mi.render(scene, spp=spp, seed=s), dtype=np.float64) for s in (seed, seed + 1))
        found.append(0.5 * np.mean((first - second) ** 2) / np.mean(first) ** 2)
    return float(np.median(found))


@click.command()
@click.option("--repetitions", default=9, show_default=True, help="Pairs of renders per row.")
def main(repetitions: int) -> None:
    """Prints time, and variance times time, as ratios."""
    import mitsuba as mi
    import sgtd  # noqa: F401 - registers the plugin

    variants = [("scalar_rgb", 96, 16)]
    if probe("llvm_ad_rgb").usable:
        variants.append(("llvm_ad_rgb", 256, 64))
    print(f"{'scene, variant, sgtdconductor':<44} {'time / roughconductor ggx':<30} variance x time")
    with Progress(transient=True) as progress:
        task = progress.add_task("equal time", total=len(variants) * len(SCENES) * len(MATERIALS))
        for variant, size, spp in variants:
            mi.set_variant(variant)
            for name, make in SCENES.items():
                metal = {"material": "Al"}
                theirs = mi.load_dict(make({"type": "roughconductor", "distribution": "ggx", **metal}, size))
                noise = variance(theirs, spp)
                for words, shape in MATERIALS.items():
                    ours = mi.load_dict(make({"type": "sgtdconductor", **metal, **shape}, size))
                    found = ratios(render_clock(ours, spp), render_clock(theirs, spp), repetitions)
                    low, middle, high = np.quantile(found, [0.25, 0.5, 0.75])
                    time = f"{middle:.3f} [{low:.3f}, {high:.3f}]"
                    print(
                        f"{name + ', ' + variant + ', ' + words:<44} {time:<30} {middle * variance(ours, spp) / noise:.2f}",
                        flush=True,
                    )
                    progress.advance(task)


if __name__ == "__main__":
    main()
