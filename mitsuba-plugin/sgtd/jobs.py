"""Many independent tasks on the processes of this machine, or on a Dask cluster if its scheduler is named.

A task is a function by name and arguments that JSON can hold (numbers, texts, paths); its result is such a thing too. Results go to a file
of JSON lines as they come, so that a run that was stopped goes on where it was: tasks whose name and arguments stand in the file are not
run again, those that failed are.
"""

from __future__ import annotations

import importlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Optional

from .errors import UserError, one_line

Advance = Optional[Callable[[int], None]]


@dataclass(frozen=True)
class Task:
    """``function`` is ``package.module:name`` and takes the arguments as keywords; ``key`` tells tasks of one run apart."""

    key: str
    function: str
    arguments: dict[str, Any]

    def is_in(self, line: dict[str, Any]) -> bool:
        same = line.get("key") == self.key and line.get("function") == self.function
        return same and line.get("arguments") == json.loads(json.dumps(self.arguments))


@dataclass(frozen=True)
class Outcome:
    """The result of a task, or in one line why it has none."""

    task: Task
    result: Any = None
    error: str = ""


def run(
    tasks: Sequence[Task],
    file: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    advance: Advance = None,
    still_valid: Callable[[Outcome], bool] = lambda _outcome: True,
) -> list[Outcome]:
    """Runs what ``file`` does not have yet, and returns all outcomes in the order of the tasks.

    ``workers`` are processes of this machine, by default as many as it has cores; ``scheduler`` is the address of a Dask scheduler, whose
    workers must have this package and see the same files. A result that is there counts only if it is ``still_valid``: its files may be gone.
    """
    if len({task.key for task in tasks}) != len(tasks):
        raise UserError("two tasks have the same key")
    lines_of = _results(file)
    known = {
        task.key: outcome
        for task in tasks
        if (outcome := _found(task, lines_of.get(task.key, ()))) is not None and still_valid(outcome)
    }
    rest = [task for task in tasks if task.key not in known]
    if advance is not None and known:
        advance(len(known))
    if rest:
        _mend(file)
        with file.open("a", encoding="utf-8") as lines:
            for outcome in _on_dask(rest, scheduler) if scheduler else _on_processes(rest, workers):
                task = outcome.task
                line = {"key": task.key, "function": task.function, "arguments": task.arguments}
                line.update({"error": outcome.error} if outcome.error else {"result": outcome.result})
                lines.write(json.dumps(line, allow_nan=False) + "\n")
                lines.flush()
                known[task.key] = outcome
                if advance is not None:
                    advance(1)
    return [known[task.key] for task in tasks]


def call(function: str, arguments: dict[str, Any]) -> Any:
    """What a worker does."""
    module, _, name = function.partition(":")
    return getattr(importlib.import_module(module), name)(**arguments)


def _read(file: Path) -> Iterator[dict[str, Any]]:
    """All whole lines: the last one may have been cut off."""
    if file.is_file():
        with file.open(encoding="utf-8") as lines:
            for line in lines:
                try:
                    yield json.loads(line)
                except ValueError:
                    continue


def _results(file: Path) -> dict[str, list[dict[str, Any]]]:
    """Lines with a result, by key."""
    found: dict[str, list[dict[str, Any]]] = {}
    for line in _read(file):
        if isinstance(line, dict) and "result" in line:
            found.setdefault(str(line.get("key")), []).append(line)
    return found


def _found(task: Task, lines: Iterable[dict[str, Any]]) -> Outcome | None:
    for line in lines:
        if task.is_in(line):
            return Outcome(task, line["result"])
    return None


def _mend(file: Path) -> None:
    """Ends a line that was cut off, so that the next one begins on its own."""
    if file.is_file() and file.stat().st_size:
        with file.open("rb+") as content:
            content.seek(-1, os.SEEK_END)
            if content.read(1) != b"\n":
                content.write(b"\n")


def _one_thread() -> None:
    # read when the core starts its threads, at its first long call: cores are taken by other workers
    os.environ["RAYON_NUM_THREADS"] = "1"


def _on_processes(tasks: Sequence[Task], workers: int | None) -> Iterator[Outcome]:
    """A process that dies takes its pool with it. What was not done goes to a second pool, and if that dies too, each task to one of its own, so
    that a task which kills its process takes no other with it."""
    left: list[Task] = []
    yield from _on_pool(tasks, workers, left)
    if left:
        again: list[Task] = []
        yield from _on_pool(left, workers, again)
        for task in again:
            alone: list[Task] = []
            yield from _on_pool([task], 1, alone)
            if alone:
                yield Outcome(task, error="its process was killed; by the system, if memory was short")


def _on_pool(tasks: Sequence[Task], workers: int | None, lost: list[Task]) -> Iterator[Outcome]:
    """``lost`` gets the tasks that were running or waiting when a process died."""
    count = min(workers or os.cpu_count() or 1, len(tasks))
    initializer = _one_thread if count > 1 else None
    with ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=initializer) as pool:
        try:
            futures = {}
            try:
                for task in tasks:
                    futures[pool.submit(call, task.function, task.arguments)] = task
            except BrokenProcessPool:
                lost.extend(task for task in tasks if task not in futures.values())
            yield from _outcomes(futures, as_completed(futures), lost)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _on_dask(tasks: Sequence[Task], scheduler: str) -> Iterator[Outcome]:
    try:
        import distributed
    except ImportError as error:
        raise UserError("a scheduler is named, but distributed is not installed: pip install 'sgtd[dask]'") from error
    try:
        client = distributed.Client(scheduler, timeout=20)
    except (OSError, ValueError) as error:
        raise UserError(f"no Dask scheduler answers at {scheduler}: {one_line(error)}") from error
    with client:
        futures = {client.submit(call, task.function, task.arguments, pure=False): task for task in tasks}
        yield from _outcomes(futures, distributed.as_completed(futures))


def _outcomes(
    futures: dict[Any, Task], done: Iterable[Future[Any]], lost: list[Task] | None = None
) -> Iterator[Outcome]:
    for future in done:
        task = futures[future]
        try:
            outcome = Outcome(task, future.result())
            json.dumps(outcome.result, allow_nan=False)
        except BrokenProcessPool as error:
            if lost is None:
                outcome = Outcome(task, error=one_line(error))
            else:
                lost.append(task)
                continue
        except Exception as error:
            outcome = Outcome(task, error=one_line(error))
        yield outcome
