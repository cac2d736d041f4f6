"""``sgtd ndf``: the distribution of what is measured."""

from __future__ import annotations

from pathlib import Path

import click

from .options import PATH
from .session import console_for_tables


@click.command("ndf", short_help="Say how the slopes of a height map are distributed.")
@click.argument("heights", type=PATH, metavar="HEIGHTS")
@click.option("--level", is_flag=True, help="Take off the tilt, the mean slope of the facets.")
@click.option(
    "--spacing",
    type=float,
    nargs=2,
    metavar="DX DY",
    help="Distances of points, in the unit of heights (default: the file's).",
)
@click.option("-o", "--output", type=PATH, help="Folder for ndf.csv, ndf.json and ndf.png.")
def ndf_command(heights: Path, level: bool, spacing: tuple[float, float] | None, output: Path | None) -> None:
    """Say how the slopes of a height map are distributed.

    Reads .npy, .exr, .png, .gsf, Gwyddion's ASCII matrices, meshes over a grid, and with sgtd[heights] the files of measuring
    instruments. Nothing is filtered, and what is changed is said.

    \b
    Examples:
      sgtd ndf measured.gsf --level -o out/measured
      sgtd ndf heights.npy --spacing 0.5 0.5
    """
    from ..microsurface import distribution, read_heights
    from ..microsurface.slope_table import print_slopes, write_slopes

    surface = read_heights(heights, spacing, level)
    found = distribution(surface.slopes())
    for note in surface.notes:
        click.echo(f"sgtd: {note}", err=True)
    print_slopes(surface, found, console_for_tables())
    if output is not None:
        write_slopes(surface, found, heights.name, output)
        click.echo(f"Distribution: {output / 'ndf.csv'}")
