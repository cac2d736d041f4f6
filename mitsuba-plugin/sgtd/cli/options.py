"""Arguments that several commands share."""

from __future__ import annotations

from pathlib import Path

import click


def _parameters(_context: click.Context, _option: click.Parameter, texts: tuple[str, ...]) -> dict[str, str]:
    """Reads ``-D name=value``."""
    parameters = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise click.BadParameter(f'"{text}": expected name=value, as in "-D bsdf=sgtdconductor"')
        parameters[name] = value
    return parameters


PATH = click.Path(path_type=Path)
SCENE = click.argument("scene", type=PATH, metavar="SCENE.xml")
VARIANT = click.option("--variant", help="Mitsuba variant (default: the first of CUDA, LLVM, scalar that runs).")
SPP = click.option("--spp", type=click.IntRange(min=1), help="Samples per pixel (default: the scene's).")
SENSOR = click.option("--sensor", type=click.IntRange(min=0), default=0, help="Which camera, counted from 0.")
DEFINE = click.option(
    "-D",
    "--define",
    "parameters",
    multiple=True,
    callback=_parameters,
    metavar="NAME=VALUE",
    help="Value of a $NAME in the scene; may be given several times.",
)
