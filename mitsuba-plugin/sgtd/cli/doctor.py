"""``sgtd doctor``."""

from __future__ import annotations

import click

from .session import Bars, console_for_tables


@click.command("doctor", short_help="Say what works here, and how to mend what does not.")
def doctor_command() -> None:
    """Say what works on this machine, and how to mend what does not.

    The exit status is 0 if both plugins work at least in scalar_rgb.

    \b
    Example:
      sgtd doctor
    """
    from ..doctor import Diagnosis, diagnose, print_findings

    with Bars() as bars:
        found = Diagnosis(tuple(diagnose(bars.say)))
    console = console_for_tables()
    print_findings(found.findings, console)
    click.echo(found.verdict())
    if not found.usable:
        raise SystemExit(1)
