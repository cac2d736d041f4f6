"""Arguments that several commands share."""

from __future__ import annotations

from pathlib import Path

import click

# 2^±100 leaves every value that single precision holds within double precision.
_MOST_STOPS = 100

# Mitsuba counts samples per pixel in 32 bits.
_MOST_SAMPLES = 2**32 - 1


def _parameters(_context: click.Context, _option: click.Parameter, texts: tuple[str, ...]) -> dict[str, str]:
    """Reads ``-D name=value``."""
    parameters = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise click.BadParameter(f'"{text}": expected name=value, as in "-D bsdf=sgtdconductor"')
        if name in parameters:
            raise click.BadParameter(f"{name} is given twice")
        parameters[name] = value
    return parameters


def _integrator(
    _context: click.Context, _option: click.Parameter, text: str | None
) -> tuple[str, dict[str, bool | int | float | str]] | None:
    """Reads ``plugin[:name=value,...]``."""
    if text is None:
        return None
    plugin, _, rest = text.partition(":")
    settings: dict[str, bool | int | float | str] = {}
    for part in rest.split(",") if rest else ():
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or not name or not value or name in settings:
            raise click.BadParameter(f'"{text}": expected a plugin and its properties, as in "path:max_depth=8"')
        settings[name] = _typed(value)
    if not plugin:
        raise click.BadParameter(f'"{text}": expected the name of a plugin, as in "path" or "path:max_depth=8"')
    return plugin, settings


def _typed(text: str) -> bool | int | float | str:
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def _finite(_context: click.Context, _option: click.Parameter, value: float | None) -> float | None:
    """A number of stops that means something."""
    if value is not None and not abs(value) <= _MOST_STOPS:  # false for NaN too
        raise click.BadParameter(f"{value:g} is not between -{_MOST_STOPS} and {_MOST_STOPS} stops")
    return value


PATH = click.Path(path_type=Path)
SCENE = click.argument("scene", type=PATH, metavar="SCENE.xml")
VARIANT = click.option("--variant", help="Mitsuba variant (default: the first of CUDA, LLVM, scalar that runs).")
SPP = click.option("--spp", type=click.IntRange(1, _MOST_SAMPLES), help="Samples per pixel (default: the scene's).")
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
LENIENT = click.option(
    "--lenient", is_flag=True, help="Only warn of properties that no plugin asks for, as old scenes have them."
)
INTEGRATOR = click.option(
    "--integrator",
    callback=_integrator,
    metavar="PLUGIN[:NAME=VALUE,...]",
    help='Integrator instead of the scene\'s, as in "path:max_depth=8".',
)
EXPOSURE = click.option(
    "--exposure",
    type=float,
    callback=_finite,
    metavar="STOPS",
    help="Exposure of the picture (default: by the left image).",
)
