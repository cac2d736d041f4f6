"""The gallery of the README: each effect off and on, same light, with what it costs underneath. Run by ``make gallery``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from rich.progress import Progress
from sgtd.interleaved_timing import ratios, render_clock

SIZE = 192
ROW = 3


class Effect(NamedTuple):
    """A name, what is written under either picture, and the material's properties without and with the effect."""

    name: str
    captions: tuple[str, str]
    off: dict[str, Any]
    on: dict[str, Any]


SILVER = {"type": "sgtdconductor", "material": "Ag"}
GLASS = {"type": "sgtddielectric", "alpha": 0.1}
EFFECTS = (
    Effect(
        "tail",
        ("gamma inf", "gamma 1.6"),
        {**SILVER, "alpha": 0.15, "gamma": float("inf")},
        {**SILVER, "alpha": 0.15, "gamma": 1.6},
    ),
    Effect(
        "kurtosis",
        ("p 1", "p 4"),
        {**SILVER, "alpha": 0.3, "gamma": 4.0},
        {**SILVER, "alpha": 0.3, "gamma": 4.0, "p": 4.0},
    ),
    Effect(
        "shift",
        ("shift 0", "shift 3"),
        {**SILVER, "alpha": 0.1, "gamma": 4.0},
        {**SILVER, "alpha": 0.1, "gamma": 4.0, "shift": 3.0},
    ),
    Effect(
        "skew",
        ("lambda 0", "lambda 0.8"),
        {**SILVER, "alpha": 0.15, "gamma": 4.0, "shift": 1.0},
        {**SILVER, "alpha": 0.15, "gamma": 4.0, "shift": 1.0, "lambda": 0.8},
    ),
    Effect(
        "anisotropy",
        ("alpha 0.2, 0.2", "alpha 0.4, 0.05"),
        {**SILVER, "alpha": 0.2, "gamma": 3.0},
        {**SILVER, "alpha_u": 0.4, "alpha_v": 0.05, "gamma": 3.0},
    ),
    Effect(
        "correlation of masking and shadowing",
        ("separable", "height_correlated"),
        {**SILVER, "alpha": 1.0, "gamma": 1.9},
        {**SILVER, "alpha": 1.0, "gamma": 1.9, "masking": "height_correlated"},
    ),
    Effect(
        "multiple scattering",
        ("single", "multiple"),
        {"type": "sgtdconductor", "material": "Au", "alpha": 1.0, "gamma": 1.9},
        {"type": "sgtdconductor", "material": "Au", "alpha": 1.0, "gamma": 1.9, "multiple_scattering": True},
    ),
    Effect(
        "visible normals, 8 samples per pixel",
        ("D cos", "visible"),
        {**SILVER, "alpha": 1.0, "gamma": 1.9, "sample_visible": False},
        {**SILVER, "alpha": 1.0, "gamma": 1.9},
    ),
    Effect(
        "transmission",
        ("sgtdconductor", "sgtddielectric"),
        {**SILVER, "alpha": 0.1, "gamma": 1.9},
        {**GLASS, "gamma": 1.9},
    ),
)


def scene(material: dict[str, Any]) -> object:
    """A sphere on a checkered floor, a bright disk and a dim sky."""
    import mitsuba as mi

    move = mi.ScalarTransform4f()
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 8},
            "sensor": {
                "type": "perspective",
                "fov": 26,
                "to_world": move.look_at([0, -5.4, 2.0], [0, 0, 0.93], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "gaussian"}},
            },
            "sky": {"type": "constant", "radiance": 0.25},
            "sun": {
                "type": "disk",
                "to_world": move.look_at([-4, -3, 6], [0, 0, 1], [0, 1, 0]).scale(0.55),
                "emitter": {"type": "area", "radiance": 90.0},
            },
            "floor": {
                "type": "rectangle",
                "to_world": move.scale(12),
                "bsdf": {
                    "type": "diffuse",
                    "reflectance": {
                        "type": "checkerboard",
                        "color0": 0.35,
                        "color1": 0.08,
                        "to_uv": move.scale([30, 30, 1]),
                    },
                },
            },
            # its poles lie on a horizontal axis, so that the tangents of an anisotropic material are seen from the side
            "sphere": {
                "type": "sphere",
                "to_world": move.translate([0, 0, 1]).rotate([1, 0, 0], 90),
                "bsdf": material,
            },
        }
    )


def displayed(scene: object, spp: int) -> np.ndarray:
    """8-bit sRGB."""
    import mitsuba as mi

    return np.array(mi.util.convert_to_bitmap(mi.render(scene, spp=spp, seed=1)))[..., :3]


@click.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("docs/gallery.png"),
    show_default=True,
)
@click.option("--repetitions", default=9, show_default=True, help="Pairs of renders from which a cost is taken.")
def main(output: Path, repetitions: int) -> None:
    """Renders all effects, measures what they cost, and writes one picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    import sgtd  # noqa: F401 - registers the plugins

    rows = -(-len(EFFECTS) // ROW)
    figure = plt.figure(figsize=(ROW * 3.9, rows * 2.45), dpi=100, facecolor="white")
    with Progress(transient=True) as progress:
        task = progress.add_task("gallery", total=len(EFFECTS))
        for k, effect in enumerate(EFFECTS):
            pair = [scene(effect.off), scene(effect.on)]
            costs = ratios(render_clock(pair[1], 32), render_clock(pair[0], 32), repetitions)
            spp = 8 if "8 samples" in effect.name else 512
            for side, (one, caption) in enumerate(zip(pair, effect.captions)):
                left, bottom = (k % ROW + 0.02 + 0.475 * side) / ROW, 1 - (k // ROW + 0.83) / rows
                axes = figure.add_axes((left, bottom, 0.465 / ROW, 0.73 / rows))
                axes.imshow(displayed(one, spp))
                axes.set_axis_off()
                text = f"{caption}\ntime × {np.median(costs):.2f}" if side else caption
                axes.text(0.5, -0.03, text, transform=axes.transAxes, ha="center", va="top", fontsize=9)
                if not side:
                    axes.text(0.0, 1.03, effect.name, transform=axes.transAxes, va="bottom", fontsize=10, weight="bold")
            progress.advance(task)
    output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(output)
    print(f"{output}: time of the whole render, on against off, median of {repetitions} pairs")


if __name__ == "__main__":
    main()
