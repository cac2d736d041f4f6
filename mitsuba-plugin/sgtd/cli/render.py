"""``sgtd render``."""

from __future__ import annotations

from pathlib import Path

import click

from .options import DEFINE, PATH, SCENE, SENSOR, SPP, VARIANT
from .session import Bars, start_mitsuba


@click.command("render")
@SCENE
@click.option("-o", "--output", type=PATH, required=True, help="Image to write: .exr (linear floats) or .png (sRGB).")
@VARIANT
@SPP
@SENSOR
@DEFINE
def render_command(
    scene: Path, output: Path, variant: str | None, spp: int | None, sensor: int, parameters: dict[str, str]
) -> None:
    """Render a scene; sgtdconductor and sgtddielectric can be used in it.

    \b
    Examples:
      sgtd render scenes/spheres.xml -o spheres.png
      sgtd render scenes/spheres.xml -o spheres.exr --spp 512 --variant llvm_ad_spectral
      sgtd render scenes/spheres.xml -o out.png -D bsdf=sgtdconductor -D distribution=student
    """
    from ..scene.graph import read_scene
    from ..scene.render import render_file

    start_mitsuba(variant)
    graph = read_scene(scene, parameters)
    with Bars() as bars:
        result = render_file(graph, output, sensor, spp, lambda length: bars.add("rendering", length))
    click.echo(f"{output}: {result.spp} samples per pixel in {result.seconds + result.first_pass_excess:.1f} s")
