"""``sgtd accuracy``."""

from __future__ import annotations

from pathlib import Path

import click

from .options import DEFINE, LENIENT, PATH
from .session import Bars, console_for_tables, start_mitsuba


@click.command("accuracy", short_help="Show what accuracy costs in time.")
@click.option(
    "--shape",
    "shapes",
    multiple=True,
    metavar="ROW[:NAME=VALUE,...]",
    help="Shape to measure; may be given several times (default: three of different kinds).",
)
@click.option(
    "--scene",
    "scenes",
    type=PATH,
    multiple=True,
    metavar="SCENE.xml",
    help="Scene to render; may be given several times (default: spheres and a grazing view).",
)
@click.option(
    "--variant",
    "variants",
    multiple=True,
    help="Mitsuba variant; may be given several times (default: the one that compare takes, and scalar_rgb).",
)
@click.option("-o", "--output", type=PATH, default="out/accuracy", show_default=True, help="Folder to write.")
@click.option("--seed", type=click.IntRange(0, 2**31), default=0, show_default=True, help="Of all random numbers.")
@click.option("--quick", is_flag=True, help="A small run, to see that everything works.")
@LENIENT
@DEFINE
def accuracy_command(
    shapes: tuple[str, ...],
    scenes: tuple[Path, ...],
    variants: tuple[str, ...],
    output: Path,
    seed: int,
    quick: bool,
    lenient: bool,
    parameters: dict[str, str],
) -> None:
    """Show what accuracy costs in time: for functions, and for images.

    The property "accuracy" is swept from 1e-1 to 1e-10 and 0 (quadrature). A scene of your own keeps its
    sgtdconductors, sgtddielectrics and sgtdplastics unless --shape is given; Mitsuba's rough materials are exchanged for the shapes.

    \b
    Examples:
      sgtd accuracy -o out/accuracy
      sgtd accuracy --scene my_scene.xml -o out/mine
      sgtd accuracy --shape student:gamma=1.7 --shape sgtd:gamma=3,p=0.8,lambda=0.2 -o out/shapes

    Writes report.html, plots as PNG and SVG, accuracy.json, functions.csv and images.csv.
    """
    from .. import atomic_output
    from ..errors import require

    require("report")
    from ..accuracy.output import REPORT, make, print_tables
    from ..scene.graph import check_scene_file

    for scene in scenes:
        check_scene_file(scene)
    atomic_output.check(output, (REPORT,))
    names = [start_mitsuba(name) for name in dict.fromkeys(variants or (None,))]
    if not variants:
        names.append("scalar_rgb")
    with Bars() as bars:
        result = make(output, shapes, scenes, tuple(dict.fromkeys(names)), parameters, seed, quick, bars.add, lenient)
    print_tables(result, console_for_tables())
    click.echo(f"Report: {output / REPORT}")
