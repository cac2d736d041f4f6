"""Draws the strips of docs/strips: for each property a ball and its distribution of normals at several values.

python docs/pictures.py [gamma p ...]     all strips, or these
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import mitsuba as mi
import numpy as np
import sgtd
from matplotlib.figure import Figure

matplotlib.rcParams["font.family"] = "DejaVu Sans"
FOLDER = Path(__file__).resolve().parent / "strips"
SIZE, SAMPLES, DECADES = 200, 256, 4.0
METAL = {"type": "sgtdconductor", "material": "Al"}
GLASS = {"type": "sgtddielectric", "int_ior": "bk7"}
PLASTIC = {"type": "sgtdplastic", "diffuse_reflectance": {"type": "rgb", "value": [0.1, 0.27, 0.36]}}

# What a strip shows: materials with their labels, and whether their distributions are drawn below
Entry = tuple[str, dict]


def metals(name: str, values: list, **rest) -> list[Entry]:
    return [
        (f"{name} = {'∞' if value == np.inf else value}", {**METAL, "alpha": 0.25, **rest, name: value})
        for value in values
    ]


STRIPS: dict[str, tuple[list[Entry], bool]] = {
    "alpha": (metals("alpha", [0.05, 0.1, 0.2, 0.4, 0.8], gamma=1.8), True),
    "gamma": (metals("gamma", [1.55, 1.8, 2.0, 4.0, np.inf]), True),
    "p": (metals("p", [0.4, 0.7, 1.0, 2.0, 8.0], distribution="gnd"), True),
    "lambda": (metals("lambda", [-0.6, -0.3, 0.0, 0.3, 0.6], gamma=4.0, shift=1.0), True),
    "shift": (metals("shift", [0.0, 0.5, 1.0, 2.0, 4.0], gamma=4.0, alpha=0.12), True),
    "anisotropy": (
        [
            (f"{u} along u, {v} along v", {**METAL, "gamma": 1.8, "alpha_u": u, "alpha_v": v})
            for u, v in ((0.05, 0.4), (0.1, 0.3), (0.2, 0.2), (0.3, 0.1), (0.4, 0.05))
        ],
        True,
    ),
    "masking": (
        [
            (f"{masking}, alpha = {alpha}", {**METAL, "gamma": 1.7, "alpha": alpha, "masking": masking})
            for alpha in (0.4, 1.0)
            for masking in ("separable", "height_correlated")
        ],
        False,
    ),
    "multiple_scattering": (
        [
            (
                f"{'on' if on else 'off'}, {metal}",
                {**METAL, "material": metal, "gamma": 1.8, "alpha": 0.9, "multiple_scattering": on},
            )
            for metal in ("Al", "Au")
            for on in (False, True)
        ],
        False,
    ),
    "tabulated": (
        [
            (
                "a plateau, cut",
                {**METAL, "distribution": "tabulated", "angles": "0 10 20 21", "values": "1 1 1 0.001", "tail": "cut"},
            ),
            (
                "two rings",
                {
                    **METAL,
                    "distribution": "tabulated",
                    "angles": "0 4 8 12 16 20 24",
                    "values": "0.01 1 0.01 0.01 0.6 0.01 0.001",
                    "tail": "cut",
                },
            ),
            (
                "a core and a haze",
                {
                    **METAL,
                    "distribution": "mixture",
                    "members": "weight=0.6 alpha=0.06 distribution=beckmann; weight=0.4 alpha=0.5 gamma=1.8",
                },
            ),
            (
                "a core and a ring",
                {
                    **METAL,
                    "distribution": "mixture",
                    "members": "weight=0.5 alpha=0.06 distribution=beckmann; weight=0.5 alpha=0.06 gamma=inf shift=6",
                },
            ),
        ],
        True,
    ),
    "glass": (
        [
            (f"gamma = {'∞' if g == np.inf else g}", {**GLASS, "alpha": 0.15, "gamma": g})
            for g in (1.6, 2.0, 4.0, np.inf)
        ],
        False,
    ),
    "plastic": (
        [
            (f"gamma = {'∞' if g == np.inf else g}", {**PLASTIC, "alpha": 0.2, "gamma": g})
            for g in (1.6, 2.0, 4.0, np.inf)
        ],
        False,
    ),
}


def ball(material: dict) -> np.ndarray:
    """A ball under a small lamp and a window, as sRGB."""
    look = mi.ScalarTransform4f().look_at
    window = look(origin=[-3.5, 1.5, 2.5], target=[0, 0, 0], up=[0, 1, 0]) @ mi.ScalarTransform4f().scale([0.9, 1.4, 1])
    lamp = look(origin=[2.5, 3.0, 2.5], target=[0, 0, 0], up=[0, 1, 0]) @ mi.ScalarTransform4f().scale(0.25)
    wall = mi.ScalarTransform4f().translate([0, 0, -4]) @ mi.ScalarTransform4f().scale(12)
    checks = {"type": "checkerboard", "color0": 0.25, "color1": 0.4, "to_uv": mi.ScalarTransform4f().scale([24, 24, 1])}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 8},
            "sensor": {
                "type": "perspective",
                "fov": 26,
                "to_world": look(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]),
                "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE},
                "sampler": {
                    "type": "independent",
                    "sample_count": SAMPLES * (8 if material["type"] == "sgtddielectric" else 1),
                },
            },
            "ball": {"type": "sphere", "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90), "material": material},
            "wall": {"type": "rectangle", "to_world": wall, "material": {"type": "diffuse", "reflectance": checks}},
            "sky": {"type": "constant", "radiance": 0.08},
            "window": {"type": "rectangle", "to_world": window, "light": {"type": "area", "radiance": 4.0}},
            "lamp": {"type": "rectangle", "to_world": lamp, "light": {"type": "area", "radiance": 60.0}},
        }
    )
    image = mi.render(scene, seed=1)
    return np.array(mi.Bitmap(image).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, srgb_gamma=True))


def distribution(material: dict) -> np.ndarray:
    """log10 of D over its peak, over the disc of normals: the radius is the sine of the angle to the surface's normal."""
    words = {k: v for k, v in material.items() if k not in ("type", "material", "lambda")}
    if "lambda" in material:
        words["lam"] = material["lambda"]
    if words.get("distribution") == "tabulated":
        angles, values = (np.array(words[name].split(), dtype=float) for name in ("angles", "values"))
        ndf = sgtd.Ndf.tabulated(angles=angles, values=values, tail=words["tail"])
    elif words.get("distribution") == "mixture":
        members = [dict(part.split("=") for part in text.split()) for text in words["members"].split(";")]
        number = {k: float for k in ("gamma", "alpha", "shift")}
        ndf = sgtd.Ndf.mixture(
            [
                (float(one["weight"]), sgtd.Ndf(**{k: number.get(k, str)(v) for k, v in one.items() if k != "weight"}))
                for one in members
            ]
        )
    else:
        ndf = sgtd.Ndf(**words)
    x, y = np.meshgrid(*(np.linspace(-1.0, 1.0, 240),) * 2)
    inside = x * x + y * y < 0.9999
    m = np.stack([x, y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=-1)[inside]
    log = np.full(x.shape, np.nan)
    d = ndf.d(m / np.linalg.norm(m, axis=-1, keepdims=True))
    log[inside] = np.log10(np.maximum(d / d.max(), 1e-30))
    return log


def draw(name: str, entries: list[Entry], with_distribution: bool) -> None:
    rows = 2 if with_distribution else 1
    figure = Figure(figsize=(2.1 * len(entries), 2.1 * rows + 0.4), layout="constrained")
    grid = figure.subplots(rows, len(entries), squeeze=False)
    for column, (label, material) in enumerate(entries):
        grid[0][column].imshow(ball(material), interpolation="lanczos")
        grid[0][column].set_title(label, fontsize=9.5)
        if with_distribution:
            grid[1][column].imshow(
                distribution(material), cmap="magma", vmin=-DECADES, vmax=0.0, interpolation="bilinear"
            )
    for axes in grid.ravel():
        axes.axis("off")
    figure.savefig(FOLDER / f"{name}.png", dpi=110, metadata={"Software": None})
    print(FOLDER / f"{name}.png")


if __name__ == "__main__":
    mi.set_variant("llvm_ad_rgb")
    sgtd.register()
    FOLDER.mkdir(exist_ok=True)
    for chosen in sys.argv[1:] or STRIPS:
        draw(chosen, *STRIPS[chosen])
