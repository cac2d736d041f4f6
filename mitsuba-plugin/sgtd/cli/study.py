"""``sgtd study``."""

from __future__ import annotations

from pathlib import Path

import click

from .lists import CommandWithLists, Numbers
from .options import PATH
from .session import Bars, console_for_tables


@click.command("study", cls=CommandWithLists, short_help="Judge Smith's model by many surfaces at once.")
@click.option(
    "--shape",
    "shapes",
    multiple=True,
    required=True,
    metavar="ROW[:NAME=VALUE,...]",
    help="May be given several times.",
)
@click.option("--alpha", "alphas", type=Numbers(1e-4, 1e3), default="0.5", show_default=True, help="Roughnesses.")
@click.option("--seeds", type=click.IntRange(1, 1000), default=3, show_default=True, help="Surfaces of each kind.")
@click.option(
    "--theta",
    "thetas",
    type=Numbers(0.0, 89.9),
    default="0,60,80",
    show_default=True,
    help="Polar angles of the light.",
)
@click.option("-n", "size", type=click.IntRange(16, 16384), default=512, show_default=True, help="Points along a side.")
@click.option("--correlation", type=float, default=8.0, show_default=True, help="Correlation length in points.")
@click.option(
    "--tolerance", type=float, default=1e-3, show_default=True, help="Distance (KS) of slopes from the shape."
)
@click.option("--walks", type=click.IntRange(1000), default=200_000, show_default=True, help="For each angle.")
@click.option("--material", metavar="NAME", help='A metal by Mitsuba\'s name, as "Au" (default: a mirror).')
@click.option("--ior", type=float, help="Glass of this index over the outside's.")
@click.option("--workers", type=click.IntRange(1), help="Processes (default: one for each core).")
@click.option(
    "--scheduler", metavar="ADDRESS", help="Of a Dask cluster, whose workers see the same files; needs sgtd[dask]."
)
@click.option("-o", "--output", type=PATH, default="out/study", show_default=True, help="Folder to write.")
def study_command(
    shapes: tuple[str, ...],
    alphas: tuple[float, ...],
    seeds: int,
    thetas: tuple[float, ...],
    size: int,
    correlation: float,
    tolerance: float,
    walks: int,
    material: str | None,
    ior: float | None,
    workers: int | None,
    scheduler: str | None,
    output: Path,
) -> None:
    """Judge Smith's model by many surfaces: shapes × roughnesses × seeds.

    Runs on all cores, or on a Dask cluster. Results are kept as they come: the same command goes on where it was stopped.

    \b
    Examples:
      sgtd study --shape beckmann --shape ggx --shape student:gamma=1.7 --alpha 0.2 0.5 --seeds 4 -o out/study
      sgtd study --shape ggx --alpha 0.1 0.3 1 --seeds 100 --scheduler tcp://head:8786 -o /shared/study

    Writes study.jsonl, summary.csv, and the surfaces at unit roughness.
    """
    from rich.table import Table

    from ..errors import UserError, require
    from ..microsurface import study

    require("report")
    todo = study.tasks(
        output,
        shapes,
        alphas,
        range(seeds),
        n=size,
        correlation=correlation,
        tolerance=tolerance,
        thetas=thetas,
        walks=walks,
        material=material,
        ior=ior,
    )
    with Bars() as bars:
        rows, failed = study.make(output, todo, workers=workers, scheduler=scheduler, progress=bars.add)
    shown = ("energy, 1 facet", "energy, 2 and more facets", "masking, facets turned away")
    table = Table(
        title="Surface, and what the model has beyond it: means over seeds ± standard error", title_justify="left"
    )
    for name in ("shape", "α", "θ", "effect", "model", "surface", "off by"):
        table.add_column(name, justify="right" if name in ("α", "θ", "surface", "off by") else "left")
    for row in rows:
        if row["effect"] in shown:
            numbers = (f"{row['surface']:.4f}", f"{row['difference']:+.4f} ± {row['spread']:.4f}")
            table.add_row(
                row["shape"], f"{row['alpha']:g}", f"{row['theta']:g}°", row["effect"], row["model"], *numbers
            )
    console_for_tables().print(table)
    click.echo(f"Summary: {output / study.SUMMARY}")
    if failed:
        raise UserError(
            f"{len(failed)} of {len(todo)} surfaces failed, the first ({failed[0].task.key}): {failed[0].error}"
        )
