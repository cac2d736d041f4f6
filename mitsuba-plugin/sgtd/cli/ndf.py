"""``sgtd ndf``: a distribution as numbers, as a picture and as a table; or the distribution of what was measured."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..atomic_output import AtomicOutput
from ..errors import UserError
from .options import PATH
from .session import console_for_tables

if TYPE_CHECKING:
    from ..ndf import Ndf

_TABLES = (".csv", ".npz")
_QUANTITIES = ("D", "D_cos", "slope")


@click.command("ndf", short_help="Show a distribution, make it a table, or say how a height map is distributed.")
@click.argument("what", metavar="SHAPE|TABLE|HEIGHTS")
@click.option(
    "--alpha", type=float, help="Roughness of a shape (default 0.1); mean slope of a table (default: its own)."
)
@click.option(
    "--quantity", type=click.Choice(_QUANTITIES), help="What the values of a table are (default: what it says, or D)."
)
@click.option("--tail", type=click.Choice(["power", "cut"]), help="What lies beyond the last row of a table.")
@click.option("--tail-exponent", type=float, help="Exponent of that power, for the density of slopes.")
@click.option(
    "--resample", type=click.IntRange(2, 1000), metavar="NODES", help="Make a table of so many nodes; say its error."
)
@click.option(
    "--to", type=click.Choice(_QUANTITIES), default="slope", help="Quantity of the table that is written (CSV)."
)
@click.option("--level", is_flag=True, help="Of a height map: take off the tilt, the mean slope of the facets.")
@click.option(
    "--spacing",
    type=float,
    nargs=2,
    metavar="DX DY",
    help="Of a height map: distances of points, in the unit of heights (default: the file's).",
)
@click.option(
    "--gray",
    type=float,
    nargs=2,
    metavar="LOW HIGH",
    help="Of a height map of gray values: heights of black and white.",
)
@click.option("-o", "--output", type=PATH, help="Folder for ndf.csv, ndf.json and ndf.png.")
def ndf_command(
    what: str,
    alpha: float | None,
    quantity: str | None,
    tail: str | None,
    tail_exponent: float | None,
    resample: int | None,
    to: str,
    level: bool,
    spacing: tuple[float, float] | None,
    gray: tuple[float, float] | None,
    output: Path | None,
) -> None:
    """Show a distribution, make it a table, or say how the slopes of a height map are distributed.

    A SHAPE is a row of the family with its parameters, a TABLE a .csv or .npz file of it by angle or slope. D, D cos and the density of
    slopes are printed beside each other, with masking; the folder gets a picture, and with --resample a table that the plugins read.

    HEIGHTS are .npy, .exr, .png, .gsf, Gwyddion's ASCII matrices, meshes over a grid, and with sgtd[heights] the files of measuring
    instruments. Nothing is filtered, and what is changed is said.

    \b
    Examples:
      sgtd ndf student:gamma=1.6 --alpha 0.3 --resample 64 -o out/student
      sgtd ndf metal.csv --tail cut -o out/metal
      sgtd ndf measured.gsf --level -o out/measured
    """
    path = Path(what)
    if path.suffix.lower() in _TABLES:
        _show(_table(path, alpha, quantity, tail, tail_exponent), path.name, resample, to, output)
    elif path.exists():
        _heights(path, level, spacing, gray, output)
    else:
        from ..named_shape import parse_shape

        shape = parse_shape(what)
        roughness = 0.1 if alpha is None else alpha
        try:
            ndf = shape.ndf(roughness, roughness, 1e-8)
        except ValueError as error:
            raise UserError(str(error)) from error
        _show(ndf, f"{shape.title}, alpha = {roughness:g}", resample, to, output)


def _table(path: Path, alpha: float | None, quantity: str | None, tail: str | None, tail_exponent: float | None) -> Ndf:
    from ..ndf import Ndf

    try:
        return Ndf.from_file(
            path, quantity=quantity, tail=tail, tail_exponent=tail_exponent, alpha=alpha, accuracy=1e-8
        )
    except ValueError as error:
        raise UserError(str(error)) from error


def _show(ndf: Ndf, title: str, resample: int | None, to: str, output: Path | None) -> None:
    from rich.table import Table

    from ..distribution_picture import draw, numbers, resampling_error, write_table

    console = console_for_tables()
    click.echo(f"{title}: mean slope {ndf.mean_slope:.6g}, median {ndf.stretch[0] * float(ndf.quantile(0.5)):.6g}")
    if ndf.table is not None:
        exponent = ndf.table.tail_exponent
        tail = "cut behind the last node" if exponent is None else f"tail slope^-{exponent:.4g}"
        click.echo(f"a table of {len(ndf.table.slopes)} nodes, knee {ndf.table.knee:.4g}, {tail}")
    rows = numbers(ndf)
    shown = Table(box=None, pad_edge=False)
    for name in ("angle", "slope", "D", "D cos", "slope density", "share below", "Lambda", "G1"):
        shown.add_column(name, justify="right")
    for row in rows:
        shown.add_row(f"{row.angle:g}°", *(f"{value:.5g}" for value in list(asdict(row).values())[1:]))
    console.print(shown)
    result: dict[str, Any] = {
        "distribution": title,
        "mean_slope": ndf.mean_slope,
        "rows": [asdict(row) for row in rows],
    }
    table = ndf
    if resample is not None:
        table = ndf.resampled(resample)
        error = resampling_error(ndf, table)
        result["resampled"] = asdict(error)
        click.echo(
            f"{error.nodes} nodes: G1 within {error.g1:.2g}, D within {error.d:.2g} down to 1e-6 of its peak (worst at "
            f"{error.d_at:.3g}°), {error.variation:.2g} of the normals elsewhere"
        )
    if output is None:
        return
    with AtomicOutput(output) as files:
        files.path("ndf.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        draw(ndf, title, files.path("ndf.png"))
        if table.table is not None:
            write_table(table, files.path("ndf.csv"), to)
            write_table(table, files.path("ndf.npz"), to)
    click.echo(
        f"Distribution: {output / 'ndf.png'}" + (f", table: {output / 'ndf.csv'}" if table.table is not None else "")
    )


def _heights(
    heights: Path,
    level: bool,
    spacing: tuple[float, float] | None,
    gray: tuple[float, float] | None,
    output: Path | None,
) -> None:
    from ..microsurface import distribution, read_heights
    from ..microsurface.slope_table import print_slopes, write_slopes

    surface = read_heights(heights, spacing, level, gray)
    found = distribution(surface.slopes())
    for note in surface.notes:
        click.echo(f"sgtd: {note}", err=True)
    print_slopes(surface, found, console_for_tables())
    if output is not None:
        write_slopes(surface, found, heights.name, output)
        click.echo(f"Distribution: {output / 'ndf.csv'}; as a table for materials: {output / 'table.csv'}")
