"""The command line ``sgtd``: options and messages. What the commands do is in the modules that they name."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, final

import click

from .errors import UserError, mitsuba_errors, one_line

_CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@click.group(context_settings=_CONTEXT, invoke_without_command=True)
@click.pass_context
def cli(context: click.Context) -> None:
    """The SGTD family of microfacet distributions in Mitsuba 3.

    \b
    Examples:
      sgtd compare scenes/spheres.xml -o out/spheres --set distribution=student --set gamma=1.6
      sgtd render scenes/spheres.xml -o spheres.png -D bsdf=sgtdconductor -D distribution=std
      sgtd explain scenes/spheres.xml -D bsdf=sgtdconductor
      sgtd doctor
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def _parameters(_context: click.Context, _option: click.Parameter, texts: tuple[str, ...]) -> dict[str, str]:
    """Reads ``-D name=value``."""
    parameters = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise click.BadParameter(f'"{text}": expected name=value, as in "-D bsdf=sgtdconductor"')
        parameters[name] = value
    return parameters


_PATH = click.Path(path_type=Path)
_SCENE = click.argument("scene", type=_PATH, metavar="SCENE.xml")
_VARIANT = click.option("--variant", help="Mitsuba variant (default: the first of CUDA, LLVM, scalar that runs).")
_SPP = click.option("--spp", type=click.IntRange(min=1), help="Samples per pixel (default: the scene's).")
_SENSOR = click.option("--sensor", type=click.IntRange(min=0), default=0, help="Which camera, counted from 0.")
_DEFINE = click.option(
    "-D",
    "--define",
    "parameters",
    multiple=True,
    callback=_parameters,
    metavar="NAME=VALUE",
    help="Value of a $NAME in the scene; may be given several times.",
)


@cli.command("render")
@_SCENE
@click.option("-o", "--output", type=_PATH, required=True, help="Image to write: .exr (linear floats) or .png (sRGB).")
@_VARIANT
@_SPP
@_SENSOR
@_DEFINE
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
    from .render import render_file
    from .scene_graph import read_scene

    _start_mitsuba(variant)
    graph = read_scene(scene, parameters)
    with _Bars() as bars:
        result = render_file(graph, output, sensor, spp, lambda length: bars.add("rendering", length))
    click.echo(f"{output}: {result.spp} samples per pixel in {result.seconds + result.first_pass_excess:.1f} s")


@cli.command("compare", short_help="Compare Mitsuba's rough materials with ours in any scene.")
@_SCENE
@click.option("-o", "--output", type=_PATH, required=True, help="Folder for the images, the picture and the table.")
@click.option(
    "-s",
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Shape of the right side: distribution, gamma, p, lambda, shift, mu, masking; may be given several times.",
)
@_VARIANT
@_SPP
@_SENSOR
@_DEFINE
@click.option("--exposure", type=float, metavar="STOPS", help="Exposure of the picture (default: by the left image).")
@click.option("-l", "--log", is_flag=True, help="Show luminance on a logarithmic scale.")
def compare_command(
    scene: Path,
    output: Path,
    settings: tuple[str, ...],
    variant: str | None,
    spp: int | None,
    sensor: int,
    parameters: dict[str, str],
    exposure: float | None,
    log: bool,
) -> None:
    """Compare Mitsuba's rough materials (left) with ours (right) in any scene.

    Every roughconductor of the scene is exchanged for an sgtdconductor of the same metal and roughness, and every
    roughdielectric for an sgtddielectric of the same indices; --set moves their shape away from the scene's own
    distribution. A material of ours that the scene has already is compared the other way round: it is shown on the
    right, and on the left the nearest of Mitsuba's.

    \b
    Examples:
      sgtd compare scenes/spheres.xml -o out/spheres --set distribution=student --set gamma=1.6
      sgtd compare scenes/lobe.xml -o out/lobe --log --set gamma=1.8 --set p=0.8 --set shift=1
      sgtd compare scenes/glass.xml -o out/glass --set distribution=student --set gamma=1.7
      sgtd compare my_scene.xml -o out/mine --set lambda=0.4 --spp 64 -D resolution=512

    Writes left.exr, right.exr, comparison.png, comparison.csv and comparison.json.
    """
    from .compare import PICTURE, compare_scene
    from .exchange import parse_settings
    from .scene_graph import read_scene

    shape = parse_settings(settings)
    _start_mitsuba(variant)
    graph = read_scene(scene, parameters)
    with _Bars() as bars:
        report = compare_scene(graph, output, shape, parameters, sensor, spp, exposure, log, bars.add)
    console = _console()
    for left, right, count in report.pair.summary():
        console.print(f"{count} × {left}  →  {right}", highlight=False, soft_wrap=True)
    report.print(console)
    click.echo(f"Picture: {output / PICTURE}")


@cli.command("accuracy", short_help="Show what accuracy costs in time.")
@click.option(
    "--shape",
    "shapes",
    multiple=True,
    metavar="ROW[:NAME=VALUE,...]",
    help="Shape to measure; may be given several times (default: three of different kinds).",
)
@click.option(
    "--scene",
    "scenes",
    type=_PATH,
    multiple=True,
    metavar="SCENE.xml",
    help="Scene to render; may be given several times (default: spheres and a grazing view).",
)
@click.option(
    "--variant",
    "variants",
    multiple=True,
    help="Mitsuba variant; may be given several times (default: the one that compare takes, and scalar_rgb).",
)
@click.option("-o", "--output", type=_PATH, default=Path("out/accuracy"), show_default=True, help="Folder to write.")
@click.option("--seed", type=click.IntRange(0, 2**31), default=0, show_default=True, help="Of all random numbers.")
@click.option("--quick", is_flag=True, help="A small run, to see that everything works.")
@_DEFINE
def accuracy_command(
    shapes: tuple[str, ...],
    scenes: tuple[Path, ...],
    variants: tuple[str, ...],
    output: Path,
    seed: int,
    quick: bool,
    parameters: dict[str, str],
) -> None:
    """Show what accuracy costs in time: for functions, and for images.

    The property "accuracy" is swept from 1e-1 to 1e-10 and 0 (quadrature). A scene of your own keeps its
    sgtdconductors and sgtddielectrics unless --shape is given; Mitsuba's rough materials are exchanged for the shapes.

    \b
    Examples:
      sgtd accuracy -o out/accuracy
      sgtd accuracy --scene my_scene.xml -o out/mine
      sgtd accuracy --shape student:gamma=1.7 --shape sgtd:gamma=3,p=0.8,lambda=0.2 -o out/shapes

    Writes report.html, plots as PNG and SVG, accuracy.json, functions.csv and images.csv.
    """
    from .accuracy.files import REPORT, make
    from .accuracy.tables import print_tables

    names = [_start_mitsuba(name) for name in dict.fromkeys(variants or (None,))]
    if not variants:
        names.append("scalar_rgb")
    with _Bars() as bars:
        result = make(output, shapes, scenes, tuple(dict.fromkeys(names)), parameters, seed, quick, bars.add)
    print_tables(result, _console())
    click.echo(f"Report: {output / REPORT}")


@cli.command("explain", short_help="Say what each material costs, why, and what would be cheaper.")
@_SCENE
@_VARIANT
@_DEFINE
@click.option("--json", "as_json", is_flag=True, help="Write JSON instead of tables.")
@click.option(
    "--repetitions",
    type=click.IntRange(min=0),
    default=9,
    show_default=True,
    help="Pairs of timings per kind of material; 0 measures no time.",
)
def explain_command(
    scene: Path, variant: str | None, parameters: dict[str, str], as_json: bool, repetitions: int
) -> None:
    """Say what each material of a scene costs, why, and what would be cheaper.

    For every material of this family: the node of the family's tree at which it runs, the effects that it has, its
    tables, and its time against roughconductor, measured now. For the scene: how many code paths its materials have.

    \b
    Examples:
      sgtd explain my_scene.xml
      sgtd explain scenes/spheres.xml -D bsdf=sgtdconductor -D distribution=student
      sgtd explain my_scene.xml --variant scalar_rgb --json
    """
    import json

    from .explain.report import as_dict, explain, print_explanation
    from .scene_graph import read_scene

    _start_mitsuba(variant)
    graph = read_scene(scene, parameters)
    with _Bars() as bars:
        explanation = explain(graph, repetitions, bars.add)
    if as_json:
        click.echo(json.dumps(as_dict(explanation), indent=2, allow_nan=False))
    else:
        print_explanation(explanation, _console())


@cli.command("doctor", short_help="Say what works here, and how to mend what does not.")
def doctor_command() -> None:
    """Say what works on this machine, and how to mend what does not.

    The exit status is 0 if both plugins work at least in scalar_rgb.

    \b
    Example:
      sgtd doctor
    """
    from .doctor import Diagnosis, diagnose, print_findings

    with _Bars() as bars:
        found = Diagnosis(tuple(diagnose(bars.say)))
    console = _console()
    print_findings(found.findings, console)
    click.echo(found.verdict())
    if not found.usable:
        raise SystemExit(1)


def _start_mitsuba(requested: str | None) -> str:
    """Sets the variant, puts the plugin on Mitsuba's search path, and returns the variant's name."""
    from .variants import choose

    with mitsuba_errors():
        import mitsuba as mi

        import sgtd

        sgtd.register()
        variant, remark = choose(requested)
        mi.set_variant(variant)
        mi.set_log_level(mi.LogLevel.Warn)
    if remark:
        click.echo(f"sgtd: {remark}", err=True)
    return variant


def _console() -> Any:
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=100)


@final
class _Bars:
    """Progress bars on the error stream; nothing is drawn where that is not a terminal."""

    def __enter__(self) -> _Bars:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description:<10}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def add(self, name: str, length: int) -> Any:
        """A bar of this length; the result advances it."""
        task = self._progress.add_task(name, total=length)
        return lambda done: self._progress.advance(task, done)

    def say(self, what: str) -> None:
        """A bar without a length, for steps that are not counted."""
        for task in self._progress.task_ids:
            self._progress.remove_task(task)
        self._progress.add_task(f"trying {what}", total=None)


def main(arguments: list[str] | None = None) -> None:
    """Entry point: a mistake of the user ends in one line on the error stream and a status that is not 0."""
    try:
        status = cli.main(args=arguments, prog_name="sgtd", standalone_mode=False)
    except click.ClickException as error:
        _fail(error.format_message(), error.exit_code)
    except UserError as error:
        _fail(str(error), 1)
    except (click.Abort, KeyboardInterrupt):
        _fail("interrupted", 130)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(message: str, status: int) -> None:
    click.echo(f"sgtd: {one_line(message)}", err=True)
    sys.exit(status)


if __name__ == "__main__":
    main()
