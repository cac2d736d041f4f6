"""The numbers of a comparison: JSON, CSV, a table on the terminal, and what they say in words."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .comparison import Comparison, Effect
from .goniometer import Scattered

EFFECTS_CSV, BINS_CSV, MASKING_CSV, JSON = "effects.csv", "bins.csv", "masking.csv", "gonio.json"


def effect_rows(found: Comparison) -> list[dict[str, Any]]:
    """One row per direction of light, effect and model."""
    return [
        {
            "theta": one.theta,
            "effect": one.effect,
            "model": one.model,
            "surface": one.surface,
            "expected": one.expected,
            "difference": one.difference,
            "relative": None if math.isnan(one.relative) else one.relative,
            "standard_error": one.error,
            "significant": one.significant,
        }
        for one in found.effects
    ]


def worst(found: Comparison) -> list[Effect]:
    """Of each effect and model, the direction of light at which the model is off most."""
    rows: dict[tuple[str, str], Effect] = {}
    for one in found.effects:
        key = (one.effect, one.model)
        if key not in rows or abs(one.difference) > abs(rows[key].difference):
            rows[key] = one
    return list(rows.values())


def sentences(found: Comparison) -> list[str]:
    """Where and by how much Smith's model fails, the greatest failures of each kind first."""
    said = []
    rows = worst(found)

    def of(effect: str, model: str) -> Effect | None:
        return next((one for one in rows if one.effect == effect and one.model == model), None)

    mean = of("mean masking", "Smith, target")
    if mean:
        said.append(
            f"Mean masking tests nothing about Smith: on a periodic surface it is Smith's G1 of its own slopes. That of the target "
            f"differs from it by {100 * mean.relative:+.2g} % at {mean.theta:g}°: so far the surface is from its target."
        )
    for name in ("facets turned away", "facets that face it"):
        one = of(f"masking, {name}", "Smith, mesh")
        if one:
            much = f"{one.surface / one.expected:.2f} of Smith's G1 at {one.theta:g}°"
            said.append(
                f"Of {name} from the light, {much} is seen." if "away" in name else f"Of {name}, {much} is seen."
            )
    for effect in ("energy, 1 facet", "energy, 1 facet transmitted"):
        models = [one for one in rows if one.effect == effect]
        if models:
            listing = "; ".join(f"{one.model}: {one.difference:+.3f} at {one.theta:g}°" for one in models)
            said.append(f"{effect.capitalize()}, model less surface where it is greatest: {listing}.")
    more = [one for one in rows if one.effect == "energy, 2 and more facets"]
    if more:
        listing = "; ".join(f"{one.model}: {one.difference:+.3f} at {one.theta:g}°" for one in more)
        said.append(f"Energy of all further orders, model less surface: {listing}.")
    directions = [one for one in rows if one.effect.startswith("directions") and one.difference > 0.0]
    if directions:
        listing = "; ".join(
            f"{one.effect.split(', ')[1]}, {one.model}: {one.difference:.3f} at {one.theta:g}°" for one in directions
        )
        said.append(f"Part of the light that goes elsewhere (total variation): {listing}.")
    return said


def write(found: Comparison, path_of: Callable[[str], Path]) -> None:
    """Writes the four files; ``path_of(name)`` says where."""
    _csv(path_of(EFFECTS_CSV), effect_rows(found))
    _csv(path_of(MASKING_CSV), _masking_rows(found))
    _write_bins(path_of(BINS_CSV), found)
    path_of(JSON).write_text(json.dumps(as_dict(found), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def as_dict(found: Comparison) -> dict[str, Any]:
    """Everything but the bins of directions."""
    first = found.views[0].setup
    return {
        "surface": {**found.surface.info, "points": list(found.surface.heights.shape[::-1])},
        "material": {
            "name": found.material.name,
            "kind": found.material.kind,
            "eta": found.material.eta,
            "k": found.material.k,
        },
        "phi": first.phi,
        "walks": first.walks,
        "seed": first.seed,
        "notes": [*found.surface.notes, *found.notes],
        "sentences": sentences(found),
        "views": [
            {
                "theta": view.theta,
                "g1": view.g1,
                "lost": view.mesh.lost,
                "mean_bounces": view.mesh.mean_bounces,
                "energy_by_order": [
                    [view.mesh.scattered.total(h, o) for o in range(first.bins.orders)] for h in (0, 1)
                ],
            }
            for view in found.views
        ],
        "effects": effect_rows(found),
    }


def _masking_rows(found: Comparison) -> list[dict[str, Any]]:
    rows = []
    for view in found.views:
        share, error, area = view.seen
        n = len(share)
        for k in range(n):
            if area[k] > 0.0:
                row = {
                    "theta": view.theta,
                    "cosine_from": k / n,
                    "cosine_to": (k + 1) / n,
                    "share_of_facing_area": area[k],
                }
                rows.append({**row, "seen": share[k], "standard_error": error[k], "g1_mesh": view.g1["mesh"]})
    return rows


def _write_bins(path: Path, found: Comparison) -> None:
    """One row per direction of light, source, hemisphere, order and bin that has light."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(
            ("theta", "source", "hemisphere", "facets", "polar_from", "polar_to", "azimuth_from", "azimuth_to")
            + ("solid_angle", "red", "green", "blue", "error_red", "error_green", "error_blue")
        )
        for view in found.views:
            sources: dict[str, Scattered] = {"surface": view.mesh.scattered}
            if view.walk:
                sources["random walk"] = view.walk.scattered
            sources.update({f"Smith {model} {masking}": s for (model, masking), s in view.single.items()})
            sources.update({f"lobe {masking}": s for masking, s in view.lobes.items()})
            bins = view.setup.bins
            solid = bins.solid_angles()
            for name, scattered in sources.items():
                errors = scattered.errors()
                for h, o, p, a in np.argwhere(scattered.energy.sum(axis=-1) > 0.0):
                    edges = (90 * p / bins.polar, 90 * (p + 1) / bins.polar)
                    turns = (360 * a / bins.azimuths - 180, 360 * (a + 1) / bins.azimuths - 180)
                    numbers = (*edges, *turns, solid[p], *scattered.energy[h, o, p, a], *errors[h, o, p, a])
                    side = "reflected" if h == 0 else "transmitted"
                    table.writerow((f"{view.theta:g}", name, side, o + 1, *(f"{x:.6g}" for x in numbers)))


def _csv(path: Path, rows: list[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]) if rows else [])
        table.writeheader()
        for row in rows:
            table.writerow({name: f"{value:.9g}" if isinstance(value, float) else value for name, value in row.items()})


def print_effects(found: Comparison, console: Any) -> None:
    """Every effect where it is greatest."""
    from rich.table import Table

    table = Table(title="Where the model is off most", title_justify="left")
    for name in ("effect", "model", "θ", "surface", "model has", "off by", "3 σ"):
        table.add_column(name, justify="left" if name in ("effect", "model") else "right")
    for one in worst(found):
        numbers = (f"{one.theta:g}°", f"{one.surface:.4f}", f"{one.expected:.4f}", f"{one.difference:+.4f}")
        table.add_row(one.effect, one.model, *numbers, f"{3 * one.error:.4f}", style="" if one.significant else "dim")
    console.print(table)
    for sentence in sentences(found):
        console.print(sentence, highlight=False, soft_wrap=True)
