"""What a command needs around it: a variant of Mitsuba, a console, progress bars."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import click

from ..errors import mitsuba_errors, one_line

if TYPE_CHECKING:
    from ..scene.graph import SceneGraph


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
    _send_warnings_to_the_error_stream()
    if remark:
        click.echo(f"sgtd: {remark}", err=True)
    return variant


def _send_warnings_to_the_error_stream() -> None:
    """Mitsuba itself writes them, in color, into the standard output, where they would be part of a result."""
    import mitsuba as mi

    said: set[str] = set()

    class Plain(mi.Formatter):  # type: ignore[misc]
        def format(self, _level: Any, _class: str | None, _file: str, _line: int, message: str) -> str:
            return message

    class ErrorStream(mi.Appender):  # type: ignore[misc]
        def append(self, level: Any, text: str) -> None:
            line = one_line(text)
            if line not in said:  # both sides of a comparison have the same to say
                said.add(line)
                word = "warning: " if level == mi.LogLevel.Warn else ""
                click.echo(f"sgtd: {word}{line}", err=True)

        def log_progress(self, *_: Any) -> None:
            pass

    logger = mi.logger()
    logger.clear_appenders()
    logger.set_formatter(Plain())
    logger.add_appender(ErrorStream())


def open_scene(
    path: Path, parameters: Mapping[str, str], integrator: tuple[str, Mapping[str, Any]] | None, lenient: bool
) -> SceneGraph:
    """The scene that the options of a command ask for."""
    from ..scene.graph import read_scene

    graph = read_scene(path, parameters, lenient)
    if integrator is not None:
        graph.use_integrator(*integrator)
    return graph


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
