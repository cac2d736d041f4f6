"""``sgtd sweep``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .options import DEFINE, EXPOSURE, INTEGRATOR, LENIENT, PATH, SCENE, SENSOR, SPP, VARIANT
from .session import Bars, start_mitsuba


@click.command("sweep", short_help="Render a scene over a grid of settings.")
@SCENE
@click.option(
    "-s",
    "--set",
    "settings",
    multiple=True,
    required=True,
    metavar="NAME=VALUES",
    help="A list (1.6,2,4), a range (0.1:0.5:5), or one at equal ratios (0.01:1:5:log); once for each setting.",
)
@click.option("--seeds", type=click.IntRange(1, 1000), default=1, show_default=True, help="Images of each combination.")
@click.option(
    "-o", "--output", type=PATH, required=True, help="Folder for the images, the sheet, the table and the page."
)
@click.option("--workers", type=click.IntRange(1), help="Processes (default: 1, which renders on all cores).")
@click.option(
    "--scheduler", metavar="ADDRESS", help="Of a Dask cluster, whose workers see the same files; needs sgtd[dask]."
)
@VARIANT
@SPP
@SENSOR
@INTEGRATOR
@LENIENT
@DEFINE
@EXPOSURE
def sweep_command(
    scene: Path,
    settings: tuple[str, ...],
    seeds: int,
    output: Path,
    workers: int | None,
    scheduler: str | None,
    variant: str | None,
    spp: int | None,
    sensor: int,
    integrator: tuple[str, dict[str, Any]] | None,
    lenient: bool,
    parameters: dict[str, str],
    exposure: float | None,
) -> None:
    """Render a scene over a grid of settings: a contact sheet, a table and a page.

    A setting is a property of the rough materials (gamma, p, lambda, shift, alpha, distribution, ...), which are exchanged for ours
    where they are Mitsuba's, or a $NAME of the scene. The last one runs across the sheet. Images are kept as they come:
    the same command goes on where it was stopped, and with more values renders only those.

    \b
    Examples:
      sgtd sweep scenes/spheres.xml --set gamma=1.6,2,4,inf --set alpha=0.1:0.5:5 -o out/sweep
      sgtd sweep scenes/lobe.xml --set shift=0:4:5 --set p=0.5:4:4:log --seeds 4 -o out/rings
      sgtd sweep scene.xml --set gamma=1.5:4:16 --scheduler tcp://head:8786 -o /shared/sweep

    Writes images/*.exr, sheet.png, sweep.csv, sweep.html and sweep.jsonl.
    """
    from .. import atomic_output, sweep
    from ..errors import UserError, require
    from ..scene.graph import scene_defaults

    require("compare")
    require("report")
    defaults = scene_defaults(scene)
    axes = [sweep.parse_axis(text, defaults) for text in settings]
    for axis in axes:
        if axis.name in parameters:
            raise UserError(f"{axis.name} is given by -D and by --set: give it once")
    atomic_output.check(output, sweep.FILES)
    chosen = start_mitsuba(variant)
    todo = sweep.tasks(
        output,
        scene,
        axes,
        seeds,
        parameters=parameters,
        variant=chosen,
        sensor=sensor,
        spp=spp,
        integrator=integrator,
        lenient=lenient,
    )
    with Bars() as bars:
        made, failed = sweep.make(
            output,
            scene,
            chosen,
            axes,
            seeds,
            todo,
            exposure=exposure,
            workers=workers,
            scheduler=scheduler,
            progress=bars.add,
        )
    images = len(todo) - len(failed)
    if images:
        click.echo(f"{images} images of {len(made.cells)} combinations. Page: {output / sweep.PAGE}")
    if failed:
        raise UserError(
            f"{len(failed)} of {len(todo)} images failed, the first ({failed[0].task.key}): {failed[0].error}"
        )
