"""Many files at once: each a task of its own, with results that are kept as they come, and one page on all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from .. import jobs
from ..errors import UserError
from ..jobs import Advance, Outcome, Task
from . import summary
from .names import FILES
from .options import Options

RESULTS = "fits.jsonl"


def fit_files(
    paths: Sequence[Path],
    folder: Path,
    options: Options,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[str, int], Advance] = lambda _name, _length: None,
) -> list[Outcome]:
    """Fits every file into a folder of its own below ``folder`` and writes ``summary.html`` and ``summary.csv``.

    What was fitted before with the same options, and stands in its folder, is not fitted again.
    """
    todo = tasks(paths, folder, options)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        outcomes = jobs.run(
            todo,
            folder / RESULTS,
            workers=workers,
            scheduler=scheduler,
            advance=progress("fitting", len(todo)),
            still_valid=is_there,
        )
    except OSError as error:
        raise UserError(f"cannot write into {folder}: {error.strerror or error}") from error
    summary.write(outcomes, folder)
    return outcomes


def tasks(paths: Sequence[Path], folder: Path, options: Options) -> list[Task]:
    """One for each file; a file that has changed since is another task."""
    made, names = [], folder_names(paths)
    for path, name in zip(paths, names):
        try:
            known = path.stat()
        except OSError:
            raise UserError(f"{path}: there is no such file") from None
        arguments: dict[str, Any] = {
            "path": str(path.resolve()),
            "folder": str((folder / name).resolve()),
            "options": options.as_json(),
            "stamp": [known.st_size, known.st_mtime_ns],
        }
        made.append(Task(name, f"{__name__}:fit_task", arguments))
    return made


def folder_names(paths: Sequence[Path]) -> list[str]:
    """The names of the files without their endings, with a number where two are alike."""
    used: set[str] = set()
    names = []
    for path in paths:
        name, count = path.stem, 1
        while name in used:
            count += 1
            name = f"{path.stem}-{count}"
        used.add(name)
        names.append(name)
    return names


def fit_task(path: str, folder: str, options: dict[str, Any], stamp: list[int]) -> dict[str, Any]:
    """What a worker does; ``stamp`` tells versions of a file apart."""
    from .one import fit_file

    return fit_file(path, folder, options)


def is_there(outcome: Outcome) -> bool:
    """Has nobody removed what a task wrote?"""
    folder = Path(outcome.task.arguments["folder"])
    return all((folder / name).is_file() for name in FILES)
