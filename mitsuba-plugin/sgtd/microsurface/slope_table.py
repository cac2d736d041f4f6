"""The distribution of slopes as a table: on the terminal, as CSV and JSON."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from ..atomic_output import AtomicOutput
from .distribution import SlopeDistribution
from .pictures import draw_surface
from .surface import Surface

_SHARES = (0.01, 0.1, 0.5, 0.9, 0.99, 0.999)


def as_dict(surface: Surface, found: SlopeDistribution) -> dict[str, Any]:
    """Everything but the bins."""
    lag = surface.lag_correlation()
    return {
        "facets": found.facets,
        "spacing": list(surface.spacing),
        "periodic": surface.periodic,
        "tilt": list(found.tilt),
        "alpha_u": found.alpha_u,
        "alpha_v": found.alpha_v,
        "rotation_degrees": found.rotation,
        "correlation_of_neighbors": lag,
        "notes": list(surface.notes),
    }


def print_slopes(surface: Surface, found: SlopeDistribution, console: Any) -> None:
    from rich.table import Table

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("facets", f"{found.facets}")
    table.add_row("mean slope along x, y", f"{found.tilt[0]:.4g}, {found.tilt[1]:.4g}")
    table.add_row("roughness along u, v", f"{found.alpha_u:.4g}, {found.alpha_v:.4g} (scaled to a mean slope of 1)")
    table.add_row("direction of u", f"{found.rotation:.3g}° from x")
    lag = surface.lag_correlation()
    table.add_row("correlation of neighbors", f"{lag:.2f}: so many facets say less than independent ones")
    above = 1.0 - np.concatenate([[0.0], np.cumsum(found.shares)])
    for share in _SHARES:
        slope = float(np.interp(-(1.0 - share), -above, found.edges))
        table.add_row(f"slope over roughness, {100 * share:g} % are below", f"{slope:.4g}")
    console.print(table)


def write_slopes(surface: Surface, found: SlopeDistribution, title: str, folder: Path) -> None:
    """``ndf.csv`` with the bins, ``table.csv`` for ``Ndf.from_file`` and the plugins, ``ndf.json`` with all else, ``ndf.png``."""
    with AtomicOutput(folder) as files:
        with files.path("ndf.csv").open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(("slope", "density", "from", "to", "share"))
            columns = (found.middles, found.density, found.edges[:-1], found.edges[1:], found.shares)
            rows.writerows([f"{value:.9g}" for value in row] for row in zip(*columns))
        files.path("table.csv").write_text(_table(found), encoding="utf-8")
        text = json.dumps(as_dict(surface, found), indent=1, allow_nan=False)
        files.path("ndf.json").write_text(text + "\n", encoding="utf-8")
        files.path("ndf.png").write_bytes(draw_surface(surface, surface.ndf, title).png)


def _table(found: SlopeDistribution) -> str:
    """Slopes and their density at the scale of the map: two roughnesses are the mean of both, and to be given beside the table."""
    scale = 0.5 * (found.alpha_u + found.alpha_v)
    known = found.density > 0.0
    lines = [f"# {found.facets} facets, alpha_u {found.alpha_u:.6g}, alpha_v {found.alpha_v:.6g}", "# tail: cut"]
    rows = zip(found.middles[known] * scale, found.density[known])
    return "\n".join([*lines, "slope,slope_density", *(f"{x:.9g},{f:.9g}" for x, f in rows)]) + "\n"
