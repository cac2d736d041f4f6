"""The picture of the README of a surface beside its material: near, from afar, and the highlight along the seam. Run by ``make microsurface``."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import click
import numpy as np
from rich.progress import Progress

SCENE = Path(__file__).parents[1] / "scenes" / "with_mesh" / "patch.xml"
ALPHA, POINTS = 0.2, 256

# Periods along x: near, facets are told apart; from afar, a pixel holds whole periods.
NEAR, FAR = 4, 256

# Rows of pixels in one point of the plot: pixels and periods beat.
_SMOOTHED = 9


def with_periods(periods: int) -> str:
    """The scene with so many periods along x, and twice as many along y."""
    step = 2.0 / periods
    instances = "".join(
        f'<shape type="instance"><ref id="surface"/><transform name="to_world"><scale value="$scale"/>'
        f'<translate x="{step * i:.9g}" y="{step * j - 2.0:.9g}"/></transform></shape>\n'
        for j in range(2 * periods)
        for i in range(periods)
    )
    text = SCENE.read_text(encoding="utf-8")
    return re.sub(r"<!-- periods -->.*<!-- end of periods -->", lambda _: instances, text, flags=re.S)


def rendered(mesh: Path, gamma: float, periods: int, size: int, spp: int) -> np.ndarray:
    import mitsuba as mi

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "patch.xml"
        path.write_text(with_periods(periods), encoding="utf-8")
        values = dict(mesh=mesh, scale=2.0 / periods / POINTS, gamma=gamma, alpha=ALPHA, width=size, height=size)
        scene = mi.load_file(str(path), **{name: str(value) for name, value in values.items()})
        return np.array(mi.render(scene, spp=spp, seed=1))[..., 0]


def halves(image: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Means over some columns on either side of the seam, for rows that both squares fill."""
    middle, rows = image.shape[1] // 2, slice(round(0.2 * image.shape[0]), round(0.91 * image.shape[0]))
    return image[rows, middle - columns : middle].mean(axis=1), image[rows, middle : middle + columns].mean(axis=1)


@click.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("docs/microsurface.png"),
    show_default=True,
)
@click.option("--size", default=400, show_default=True, help="Pixels along a side.")
@click.option("--spp", default=256, show_default=True)
@click.option("--gamma", default=1.7, show_default=True, help="Tail of the shape.")
@click.option("--variant", default="scalar_rgb", show_default=True)
def main(output: Path, size: int, spp: int, gamma: float, variant: str) -> None:
    """Makes the surface, renders both scales, and writes one picture."""
    import mitsuba as mi

    mi.set_variant(variant)
    import sgtd
    from sgtd.microsurface import generate
    from sgtd.page.plot_style import BLUE, INK, VERMILION, finish, new_figure, style

    ndf = sgtd.Ndf(distribution="student", gamma=gamma, alpha=ALPHA)
    with Progress(transient=True) as progress, tempfile.TemporaryDirectory() as folder:
        task = progress.add_task("patch", total=3)
        surface = generate(ndf, n=POINTS)
        mesh = Path(folder) / "S.ply"
        surface.save(mesh)
        progress.advance(task)
        images = []
        for periods in (NEAR, FAR):
            images.append(rendered(mesh, gamma, periods, size, spp))
            progress.advance(task)
    figure = new_figure(columns=3)
    panels = figure.subplots(1, 3)
    for axes, image, name in zip(panels, images, ("near: 4 × 8 periods", "from afar: 256 × 512 periods")):
        shown = np.clip(image / np.percentile(images[1], 99.5), 0.0, 1.0) ** (1 / 2.2)
        axes.imshow(shown, cmap="gray", vmin=0.0, vmax=1.0, interpolation="nearest")
        axes.set_title(name, loc="left", fontsize=10, color=INK)
        axes.text(0.02, 0.02, "sgtdconductor", color="white", transform=axes.transAxes, fontsize=9)
        axes.text(0.98, 0.02, "mesh of mirrors", color="white", transform=axes.transAxes, fontsize=9, ha="right")
        axes.set_axis_off()
    flat, rough = halves(images[1], size // 5)
    off = rough / flat - 1.0
    flat, rough = (np.convolve(x, np.full(_SMOOTHED, 1.0 / _SMOOTHED), mode="valid") for x in (flat, rough))
    rows = np.arange(len(flat)) + _SMOOTHED // 2
    panels[2].plot(rows, flat, color=VERMILION, label="sgtdconductor")
    panels[2].plot(rows, rough, color=BLUE, label="mesh", linewidth=1.0)
    panels[2].set_title("along the seam, from afar", loc="left", fontsize=10, color=INK)
    panels[2].set_xlabel(f"row of pixels, from the back to the front; means of {_SMOOTHED}")
    panels[2].set_ylabel("radiance")
    panels[2].set_ylim(bottom=0.0)
    panels[2].legend(frameon=False, fontsize=9)
    style(panels[2])
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_bytes(finish("microsurface", "", "", figure).png)
    print(
        f"{output}: mesh over material {1 + off.mean():.3f} on average, {1 + off[: len(off) // 4].mean():.3f} at the back, "
        f"{1 + off[-len(off) // 4 :].mean():.3f} at the front"
    )


if __name__ == "__main__":
    main()
