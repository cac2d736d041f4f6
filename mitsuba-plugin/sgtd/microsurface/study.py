"""Many surfaces: shapes × roughness × seeds, each measured and compared with its model, and what they have in common.

The spread between seeds is the error of a statement about a *shape*; the error of the walks on one surface is smaller.
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..atomic_output import AtomicOutput
from ..errors import UserError
from ..jobs import Advance, Outcome, Task, run
from ..named_shape import parse_shape
from .comparison import compare
from .generate import generate
from .goniometer import Bins, Material
from .surface import Surface
from .tables import effect_rows

RESULTS, SURFACES, SUMMARY = "study.jsonl", "surfaces", "summary.csv"


def tasks(
    folder: Path,
    shapes: Sequence[str],
    alphas: Sequence[float],
    seeds: Sequence[int],
    *,
    n: int,
    correlation: float,
    tolerance: float,
    thetas: Sequence[float],
    walks: int,
    material: str | None,
    ior: float | None,
) -> list[Task]:
    """One for each surface."""
    made = []
    for shape in dict.fromkeys(shapes):
        parse_shape(shape)
        for alpha in dict.fromkeys(alphas):
            for seed in dict.fromkeys(seeds):
                surface = {"shape": shape, "n": n, "correlation": correlation, "tolerance": tolerance, "seed": seed}
                name = hashlib.sha256(json.dumps(surface, sort_keys=True).encode()).hexdigest()[:16]
                arguments = {
                    **surface,
                    "alpha": alpha,
                    "path": str((folder / SURFACES / f"{name}.npy").resolve()),
                    "thetas": list(thetas),
                    "walks": walks,
                    "material": material,
                    "ior": ior,
                }
                made.append(Task(f"{shape} alpha={alpha:g} seed={seed}", f"{__name__}:one_surface", arguments))
    return made


def one_surface(
    shape: str,
    alpha: float,
    seed: int,
    n: int,
    correlation: float,
    tolerance: float,
    path: str,
    thetas: Sequence[float],
    walks: int,
    material: str | None,
    ior: float | None,
) -> dict[str, Any]:
    """Makes the surface at unit roughness, or reads it where another roughness has made it, and compares it with its model."""
    named = parse_shape(shape)
    place = Path(path)
    if not place.is_file():
        unit = generate(named.ndf(1.0, 1.0, 1e-5), n=n, correlation=correlation, seed=seed, tolerance=tolerance)
        unit.save(place)
    unit = Surface.load(place)
    surface = unit.stretched(alpha, alpha)
    ndf = named.ndf(alpha, alpha, 1e-5)
    # energies and masking by facet: coarse bins of direction suffice
    found = compare(
        surface, ndf, thetas, material=Material.of(material, ior), bins=Bins(15, 12), walks=walks, seed=seed
    )
    return {"reached": unit.info["reached"], "effects": effect_rows(found)}


def make(
    folder: Path,
    todo: Sequence[Task],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[str, int], Advance],
) -> tuple[list[dict[str, Any]], list[Outcome]]:
    """Runs the tasks, writes ``summary.csv``, and returns its rows and what failed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        outcomes = run(
            todo, folder / RESULTS, workers=workers, scheduler=scheduler, advance=progress("surfaces", len(todo))
        )
    except OSError as error:
        raise UserError(f"cannot write into {folder}: {error.strerror or error}") from error
    rows = summary([outcome for outcome in outcomes if not outcome.error])
    if rows:
        with AtomicOutput(folder) as files, files.path(SUMMARY).open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            for row in rows:
                table.writerow({k: f"{v:.9g}" if isinstance(v, float) else v for k, v in row.items()})
    return rows, [outcome for outcome in outcomes if outcome.error]


def summary(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Means over seeds; ``spread`` is the standard error of the mean difference, from the differences between surfaces."""
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for outcome in outcomes:
        for effect in outcome.result["effects"]:
            where = outcome.task.arguments
            key = (where["shape"], where["alpha"], effect["theta"], effect["effect"], effect["model"])
            groups.setdefault(key, []).append(effect)
    rows = []
    for key, effects in groups.items():
        count = len(effects)
        mean = {name: sum(e[name] for e in effects) / count for name in ("surface", "expected", "difference")}
        square = sum((e["difference"] - mean["difference"]) ** 2 for e in effects)
        spread = math.sqrt(square / (count - 1) / count) if count > 1 else effects[0]["standard_error"]
        row = dict(zip(("shape", "alpha", "theta", "effect", "model"), key))
        rows.append({**row, "surfaces": count, **mean, "spread": spread})
    return rows
