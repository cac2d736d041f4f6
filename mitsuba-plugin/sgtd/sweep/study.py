"""Renders the grid as tasks that can run anywhere, and writes what they have in common."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..atomic_output import AtomicOutput
from ..errors import UserError, require
from ..jobs import Advance, Outcome, Task, run
from .grid import ROUGHNESS, Axis, Value, combinations, is_number
from .result import Cell, Sweep

RESULTS, IMAGES, SHEET, TABLE, PAGE = "sweep.jsonl", "images", "sheet.png", "sweep.csv", "sweep.html"
FILES = (SHEET, TABLE, PAGE)


def tasks(
    folder: Path,
    scene: Path,
    axes: Sequence[Axis],
    seeds: int,
    *,
    parameters: Mapping[str, str],
    variant: str,
    sensor: int,
    spp: int | None,
    integrator: tuple[str, Mapping[str, Any]] | None,
    lenient: bool,
) -> list[Task]:
    """One for each combination and seed."""
    changed = scene.stat().st_mtime_ns
    made = []
    for settings in combinations(axes):
        of_scene = {axis.name: str(settings[axis.name]) for axis in axes if axis.of_scene}
        # as texts, because JSON has no infinity
        of_materials = {name: str(value) for name, value in settings.items() if name not in of_scene}
        for seed in range(seeds):
            arguments = {
                "scene": str(scene.resolve()),
                # another version of the file is another task
                "changed": changed,
                "parameters": {**parameters, **of_scene},
                "settings": of_materials,
                "variant": variant,
                "sensor": sensor,
                "spp": spp,
                "seed": seed,
                "integrator": [integrator[0], dict(integrator[1])] if integrator else None,
                "lenient": lenient,
            }
            name = hashlib.sha256(json.dumps(arguments, sort_keys=True).encode()).hexdigest()[:16]
            path = str((folder / IMAGES / f"{name}.exr").resolve())
            key = ", ".join(f"{k}={v}" for k, v in settings.items()) + f", seed {seed}"
            made.append(Task(key.lstrip(", "), f"{__name__}:one_image", {**arguments, "path": path}))
    return made


def one_image(
    scene: str,
    changed: int,
    parameters: dict[str, str],
    settings: dict[str, str],
    variant: str,
    sensor: int,
    spp: int | None,
    seed: int,
    integrator: list[Any] | None,
    lenient: bool,
    path: str,
) -> dict[str, Any]:
    """Renders one image into ``path``. Materials of Mitsuba are exchanged for ours first, where there is a setting for them."""
    import mitsuba as mi

    import sgtd

    from ..scene.exchange import exchange
    from ..scene.graph import read_scene
    from ..scene.render import render, sample_count, save

    if mi.variant() != variant:
        mi.set_variant(variant)
    sgtd.register()
    mi.set_log_level(mi.LogLevel.Error)
    graph = read_scene(Path(scene), parameters, lenient)
    if integrator is not None:
        graph.use_integrator(*integrator)
    graph.require_integrator()
    if settings:
        values = {name: float(text) if is_number(name) else text for name, text in settings.items()}
        roughness = {name: float(values.pop(name)) for name in ROUGHNESS if name in values}
        graph = exchange(graph, values, roughness).right
    built = graph.build()
    count = sample_count(built, sensor, spp)
    (result,) = render([built], sensor, count, lambda _done: None, seed=seed)
    place = Path(path)
    with AtomicOutput(place.parent) as files:
        save(result.bitmap, files.path(place.name))
    return {"seconds": result.timing.elapsed, "spp": result.spp}


def make(
    folder: Path,
    scene: Path,
    variant: str,
    axes: Sequence[Axis],
    seeds: int,
    todo: Sequence[Task],
    *,
    exposure: float | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[str, int], Advance],
) -> tuple[Sweep, list[Outcome]]:
    """Runs the tasks that have no image yet, writes :data:`FILES`, and returns the sweep and what failed."""
    require("compare")
    require("report")
    from .page import write_page
    from .sheet import draw_sheet

    try:
        folder.mkdir(parents=True, exist_ok=True)
        # one process renders on all cores; several share them
        outcomes = run(
            todo, folder / RESULTS, workers=workers or 1, scheduler=scheduler, advance=progress("rendering", len(todo))
        )
    except OSError as error:
        raise UserError(f"cannot write into {folder}: {error.strerror or error}") from error
    grid = combinations(axes)
    cells = tuple(_cell(settings, outcomes[k * seeds : (k + 1) * seeds], folder) for k, settings in enumerate(grid))
    sweep = Sweep(scene, variant, tuple(axes), seeds, cells)
    failed = [outcome for outcome in outcomes if outcome.error]
    if any(cell.image is not None for cell in cells):
        with AtomicOutput(folder) as files:
            used = draw_sheet(sweep, files.path(SHEET), exposure)
            _write_table(sweep, files.path(TABLE))
            write_page(sweep, used, files.path(SHEET), files.path(PAGE))
    return sweep, failed


def _cell(settings: dict[str, Value], outcomes: Sequence[Outcome], folder: Path) -> Cell:
    import mitsuba as mi

    from ..compare.difference import luminance
    from ..scene.render import to_rgb

    errors = [outcome.error for outcome in outcomes if outcome.error]
    if errors:
        return Cell(settings, None, "", float("nan"), None, float("nan"), 0, errors[0])
    paths = [Path(outcome.task.arguments["path"]) for outcome in outcomes]
    images = [to_rgb(mi.Bitmap(str(path))) for path in paths]
    means = [float(np.nanmean(luminance(image))) for image in images]
    noise = float(np.std(means, ddof=1) / np.sqrt(len(means))) if len(means) > 1 else None
    seconds = float(np.median([outcome.result["seconds"] for outcome in outcomes]))
    spp = sum(outcome.result["spp"] for outcome in outcomes)
    file = f"{IMAGES}/{paths[0].name}" if len(paths) == 1 else ", ".join(f"{IMAGES}/{path.name}" for path in paths)
    return Cell(settings, np.mean(images, axis=0), file, float(np.mean(means)), noise, seconds, spp)


def _write_table(sweep: Sweep, path: Path) -> None:
    names = [axis.name for axis in sweep.axes]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow([*names, "seeds", "spp", "mean_luminance", "standard_error", "seconds", "images", "error"])
        for cell in sweep.cells:
            numbers = ["" if x is None else f"{x:.6g}" for x in (cell.luminance, cell.noise, cell.seconds)]
            table.writerow([*cell.settings.values(), sweep.seeds, cell.spp, *numbers, cell.file, cell.error])
