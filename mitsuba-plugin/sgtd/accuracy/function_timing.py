"""Nanoseconds per call, table bytes and build times, measured in a process of its own.

The number of threads of the core is fixed when a process starts, so each number of threads has its own process:
``python -m sgtd.accuracy.function_timing`` reads a job from its input and writes one line per repetition. Everything that is
measured takes its turn in every repetition, in an order drawn anew, so that whatever else the machine does falls on
all of it alike.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import UserError
from ..named_shape import parse_shape
from . import published
from .function_errors import uniform

_ALPHA = 0.3

# One measurement should take about so long: far above the resolution of the clock, below a time slice of the system.
_TARGET_SECONDS = 3e-3
_MOST_CALLS = 1_000_000


@dataclass(frozen=True)
class Timing:
    """Median and quartiles over the repetitions."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: list[float]) -> Timing:
        low, median, high = np.quantile(values, [0.25, 0.5, 0.75])
        return cls(float(median), float(low), float(high))


@dataclass(frozen=True)
class FunctionTimes:
    """What one process measured; keys are (shape, function, way)."""

    threads: int
    nanoseconds: dict[tuple[str, str, str], Timing]
    build_seconds: dict[tuple[str, str], Timing]
    table_bytes: dict[tuple[str, str], int]
    accuracy_reached: dict[tuple[str, str], float]


def measure(
    shapes: list[str],
    settings: tuple[float, ...],
    orders: tuple[int, ...],
    threads: int,
    repetitions: int,
    seed: int,
    progress: Callable[[int], None],
) -> FunctionTimes:
    """Runs the process for one number of threads."""
    job = {
        "shapes": shapes,
        "settings": settings,
        "orders": orders,
        "repetitions": repetitions,
        "seed": seed,
        "threads": threads,
    }
    # One pool alone: NumPy's own threads would disturb.
    environment = {**os.environ, "RAYON_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "sgtd.accuracy.function_timing"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, text=True, env=environment, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        try:
            process.stdin.write(json.dumps(job))
            process.stdin.close()
            answer = None
            for line in process.stdout:
                message = json.loads(line)
                if message == "done":
                    progress(1)
                else:
                    answer = message
            complaint = process.stderr.read().strip().splitlines()
        except BaseException:
            process.kill()
            raise
    if answer is None:
        raise UserError(f"the timing process failed: {complaint[-1] if complaint else 'no answer'}")

    def unpack(entries: list[Any], convert: Callable[[Any], Any]) -> dict[Any, Any]:
        return {tuple(entry[:-1]): convert(entry[-1]) for entry in entries}

    return FunctionTimes(
        threads=threads,
        nanoseconds=unpack(answer["nanoseconds"], Timing.of),
        build_seconds=unpack(answer["build"], Timing.of),
        table_bytes=unpack(answer["bytes"], int),
        accuracy_reached=unpack(answer["reached"], float),
    )


def _serve() -> None:
    """The process itself."""
    job = json.load(sys.stdin)
    random = np.random.default_rng(job["seed"])
    shapes = [parse_shape(text) for text in job["shapes"]]
    builds: dict[tuple[str, str], list[float]] = {}
    for _ in range(min(job["repetitions"], 5)):
        pairs = [(shape, setting) for shape in shapes for setting in job["settings"]]
        for k in random.permutation(len(pairs)):
            shape, setting = pairs[k]
            # nobody holds an equal object, so it is made anew
            start = time.perf_counter()
            ndf = shape.ndf(_ALPHA, _ALPHA, setting)
            builds.setdefault((shape.text, str(setting)), []).append(time.perf_counter() - start)
            del ndf

    w = uniform(random, _MOST_CALLS)
    m = shapes[0].ndf(_ALPHA, _ALPHA, 1e-3).sample(w, random.random((len(w), 2)), visible=False)[0]
    numbers = random.random((len(w), 2))
    sizes, reached = {}, {}
    calls: dict[tuple[str, str, str], Callable[[int], Any]] = {}
    for shape in shapes:
        for setting in job["settings"]:
            ndf = shape.ndf(_ALPHA, _ALPHA, setting)
            sizes[shape.text, str(setting)] = ndf.table_bytes
            reached[shape.text, str(setting)] = ndf.accuracy_reached
            for function, call in _core_calls(ndf, w, m, numbers).items():
                calls[shape.text, function, str(setting)] = call
        if job["threads"] == 1:  # NumPy has one thread
            for line in published.masking_lines(shape, tuple(job["orders"])):
                calls[shape.text, "lambda", line.name] = _masking_call(line, w)
            for line in published.profile_lines(shape):
                calls[shape.text, "d", line.name] = _density_call(line, m)

    counts = {key: _calibrate(call) for key, call in calls.items()}
    times: dict[tuple[str, str, str], list[float]] = {key: [] for key in calls}
    keys = list(calls)
    for _ in range(job["repetitions"]):
        for k in random.permutation(len(keys)):
            key, count = keys[k], counts[keys[k]]
            start = time.perf_counter()
            calls[key](count)
            times[key].append((time.perf_counter() - start) / count * 1e9)
        print('"done"', flush=True)
    answer = {
        "nanoseconds": [[*key, values] for key, values in times.items()],
        "build": [[*key, values] for key, values in builds.items()],
        "bytes": [[*key, value] for key, value in sizes.items()],
        "reached": [[*key, value] for key, value in reached.items()],
    }
    print(json.dumps(answer), flush=True)


def _core_calls(ndf: Any, w: np.ndarray, m: np.ndarray, numbers: np.ndarray) -> dict[str, Callable[[int], Any]]:
    """The core over arrays, without the check of unit length that sgtd.Ndf makes before."""
    core, alpha = ndf._core, ndf._stretch
    return {
        "lambda": lambda n: core.eval("lambda", *alpha, w[:n]),
        "d": lambda n: core.eval("d", *alpha, m[:n]),
        "sample": lambda n: core.eval("sample_visible", *alpha, w[:n], numbers[:n]),
    }


def _masking_call(line: published.Line, w: np.ndarray) -> Callable[[int], Any]:
    return lambda n: published.over_directions(line.evaluate, _ALPHA, _ALPHA, w[:n])


def _density_call(line: published.Line, m: np.ndarray) -> Callable[[int], Any]:
    return lambda n: published.density_over_normals(line.evaluate, 1.0, _ALPHA, _ALPHA, m[:n])


def _calibrate(call: Callable[[int], Any]) -> int:
    """How many calls take about the time aimed at."""
    count = 64
    while count < _MOST_CALLS:
        start = time.perf_counter()
        call(count)
        seconds = time.perf_counter() - start
        if seconds > 0.4 * _TARGET_SECONDS:
            break
        count = min(4 * count, _MOST_CALLS)
    return count


if __name__ == "__main__":
    _serve()
