"""``sgtd compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .options import DEFINE, EXPOSURE, INTEGRATOR, LENIENT, PATH, SCENE, SENSOR, SPP, VARIANT
from .session import Bars, console_for_tables, open_scene, start_mitsuba


@click.command("compare", short_help="Compare Mitsuba's rough materials with ours in any scene.")
@SCENE
@click.option("-o", "--output", type=PATH, required=True, help="Folder for the images, the picture and the table.")
@click.option(
    "-s",
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Shape of the right side: distribution, gamma, p, lambda, shift, mu, masking; may be given several times.",
)
@VARIANT
@SPP
@SENSOR
@INTEGRATOR
@LENIENT
@DEFINE
@EXPOSURE
@click.option("-l", "--log", is_flag=True, help="Show luminance on a logarithmic scale.")
def compare_command(
    scene: Path,
    output: Path,
    settings: tuple[str, ...],
    variant: str | None,
    spp: int | None,
    sensor: int,
    integrator: tuple[str, dict[str, Any]] | None,
    lenient: bool,
    parameters: dict[str, str],
    exposure: float | None,
    log: bool,
) -> None:
    """Compare Mitsuba's rough materials (left) with ours (right) in any scene.

    Every roughconductor of the scene is exchanged for an sgtdconductor of the same metal and roughness, every
    roughdielectric for an sgtddielectric of the same indices, and every roughplastic for an sgtdplastic; --set moves
    their shape away from the scene's own distribution. A material of ours that the scene has already is compared the other way round: it is shown on the
    right, and on the left the nearest of Mitsuba's.

    \b
    Examples:
      sgtd compare scenes/spheres.xml -o out/spheres --set distribution=student --set gamma=1.6
      sgtd compare scenes/lobe.xml -o out/lobe --log --set gamma=1.8 --set p=0.8 --set shift=1
      sgtd compare scenes/glass.xml -o out/glass --set distribution=student --set gamma=1.7
      sgtd compare my_scene.xml -o out/mine --set lambda=0.4 --spp 64 -D resolution=512

    Writes left.exr, right.exr, comparison.png, comparison.csv and comparison.json.
    """
    from .. import atomic_output
    from ..compare import FILES, PICTURE, compare_scene
    from ..scene.exchange import parse_settings
    from ..scene.graph import check_scene_file

    check_scene_file(scene)
    shape = parse_settings(settings)
    atomic_output.check(output, FILES)
    start_mitsuba(variant)
    graph = open_scene(scene, parameters, integrator, lenient)
    with Bars() as bars:
        report = compare_scene(graph, output, shape, parameters, sensor, spp, exposure, log, bars.add)
    console = console_for_tables()
    for left, right, count in report.pair.summary():
        console.print(f"{count} × {left}  →  {right}", highlight=False, soft_wrap=True)
    report.print(console)
    click.echo(f"Picture: {output / PICTURE}")
