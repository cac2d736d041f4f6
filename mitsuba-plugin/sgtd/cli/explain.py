"""``sgtd explain``."""

from __future__ import annotations

from pathlib import Path

import click

from .options import DEFINE, LENIENT, SCENE, VARIANT
from .session import Bars, console_for_tables, start_mitsuba


@click.command("explain", short_help="Say what each material costs, why, and what would be cheaper.")
@SCENE
@VARIANT
@LENIENT
@DEFINE
@click.option("--json", "as_json", is_flag=True, help="Write JSON instead of tables.")
@click.option(
    "--repetitions",
    type=click.IntRange(min=0),
    default=9,
    show_default=True,
    help="Pairs of timings; 0 measures no time.",
)
@click.option("--functions", is_flag=True, help="Time each kind of material by itself too.")
def explain_command(
    scene: Path,
    variant: str | None,
    lenient: bool,
    parameters: dict[str, str],
    as_json: bool,
    repetitions: int,
    functions: bool,
) -> None:
    """Say what each material of a scene costs, why, and what would be cheaper.

    First, how much longer a render of the scene takes than with Mitsuba's rough materials, measured now. For every
    material of this family: the node of the family's tree at which it runs, the effects that it has, its tables. For the
    scene: how many code paths its materials have.

    \b
    Examples:
      sgtd explain my_scene.xml
      sgtd explain scenes/spheres.xml -D bsdf=sgtdconductor -D distribution=student
      sgtd explain my_scene.xml --variant scalar_rgb --json
      sgtd explain my_scene.xml --functions
    """
    import json

    from ..explain.report import as_dict, explain, print_explanation
    from ..scene.graph import check_scene_file, read_scene

    check_scene_file(scene)
    start_mitsuba(variant)
    graph = read_scene(scene, parameters, lenient)
    with Bars() as bars:
        explanation = explain(graph, repetitions, functions, bars.add)
    if as_json:
        click.echo(json.dumps(as_dict(explanation), indent=2, allow_nan=False))
    else:
        print_explanation(explanation, console_for_tables())
