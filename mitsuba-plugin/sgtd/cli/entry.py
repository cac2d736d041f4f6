"""The group of commands, and the entry point."""

from __future__ import annotations

import sys

import click

from ..errors import UserError, one_line
from .accuracy import accuracy_command
from .compare import compare_command
from .doctor import doctor_command
from .explain import explain_command
from .fit import fit_command
from .gonio import gonio_command
from .ndf import ndf_command
from .render import render_command
from .study import study_command
from .surface import surface_command
from .sweep import sweep_command

_CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


def _version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        import sgtd

        click.echo(f"sgtd {sgtd.__version__}, for Mitsuba {', '.join(sgtd.MITSUBA_RELEASES)}")
        context.exit()


@click.group(context_settings=_CONTEXT, invoke_without_command=True)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_version,
    help="Say the version, and that of Mitsuba which it is built for.",
)
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


for command in (
    render_command,
    compare_command,
    accuracy_command,
    explain_command,
    surface_command,
    gonio_command,
    study_command,
    sweep_command,
    ndf_command,
    fit_command,
    doctor_command,
):
    cli.add_command(command)


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
