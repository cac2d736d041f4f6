"""What a command needs around it: a variant of Mitsuba, a console, progress bars."""

from __future__ import annotations

from typing import Any, final

import click

from ..errors import mitsuba_errors


def start_mitsuba(requested: str | None) -> str:
    """Sets the variant, puts the plugin on Mitsuba's search path, and returns the variant's name."""
    from ..scene.variants import choose

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


def console_for_tables() -> Any:
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=100)


@final
class Bars:
    """Progress bars on the error stream; nothing is drawn where that is not a terminal."""

    def __enter__(self) -> Bars:
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
