"""``sgtd render``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .options import DEFINE, INTEGRATOR, LENIENT, PATH, SCENE, SENSOR, SPP, VARIANT
from .session import Bars, open_scene, start_mitsuba


@click.command("render")
@SCENE
@click.option("-o", "--output", type=PATH, required=True, help="Image to write: .exr (linear floats) or .png (sRGB).")
@VARIANT
@SPP
@SENSOR
@INTEGRATOR
@LENIENT
@DEFINE
def render_command(
    scene: Path,
    output: Path,
    variant: str | None,
    spp: int | None,
    sensor: int,
    integrator: tuple[str, dict[str, Any]] | None,
    lenient: bool,
    parameters: dict[str, str],
) -> None:
    """Render a scene; sgtdconductor, sgtddielectric and sgtdplastic can be used in it.

    \b
    Examples:
      sgtd render scenes/spheres.xml -o spheres.png
      sgtd render scenes/spheres.xml -o spheres.exr --spp 512 --variant llvm_ad_spectral
      sgtd render scenes/spheres.xml -o out.png -D bsdf=sgtdconductor -D distribution=student
    """
    from ..scene.graph import check_scene_file
    from ..scene.render import check_image_name, render_file

    check_scene_file(scene)
    check_image_name(output)
    start_mitsuba(variant)
    graph = open_scene(scene, parameters, integrator, lenient)
    with Bars() as bars:
        result = render_file(graph, output, sensor, spp, lambda length: bars.add("rendering", length))
    note = result.sampling_note() if result.passes > 1 else ""
    click.echo(f"{output}: {result.spp} samples per pixel in {result.timing.elapsed:.1f} s" + (note and f". {note}"))
