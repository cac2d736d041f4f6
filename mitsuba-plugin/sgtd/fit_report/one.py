"""One file of reflectance: read, fitted, and written as a folder that is whole or not there."""

from __future__ import annotations

import csv
import io
import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..atomic_output import AtomicOutput
from ..fitting import Fit, fit_measurement
from ..measured import HEIGHTS, Source, kind_of, read
from ..page.plot_style import Plot, picture_png
from . import figures, page
from .heights import fit_heights_file
from .names import JSON, MATERIAL, REPORT, SCORES, SPHERE
from .options import Options
from .scans import scans
from .sphere import Spheres, render
from .tree_figure import Node, draw_tree


def fit_file(path: str, folder: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Fits one file and writes its folder; the result is what a page on many says of it."""
    chosen = Options.of(options)
    start = time.perf_counter()
    place = Path(path)
    if kind_of(place) == HEIGHTS:
        return fit_heights_file(place, Path(folder), chosen)
    source = read(place)
    found = fit_measurement(
        source.data,
        model=chosen.model,
        setting=chosen.setting,
        max_angle=chosen.max_angle,
        anisotropic=chosen.anisotropic,
    )
    seconds = time.perf_counter() - start
    spheres = _spheres(found, source)
    summary = _summary(found, place, source.kind, seconds)
    with AtomicOutput(Path(folder)) as files:
        files.path(MATERIAL).write_text(found.to_xml(), encoding="utf-8")
        files.path(JSON).write_text(_json(found, summary, chosen), encoding="utf-8")
        files.path(SCORES).write_text(scores_csv(found), encoding="utf-8")
        if spheres is not None:
            files.path(SPHERE).write_bytes(_side_by_side(spheres))
        text = page.report(found, source, summary, chosen, _plots(found, source, chosen, spheres))
        files.path(REPORT).write_text(text, encoding="utf-8")
    return summary


def _spheres(found: Fit, source: Source) -> Spheres | None:
    return None if source.evaluate is None else render(source.evaluate, found.predict)


def _plots(found: Fit, source: Source, options: Options, spheres: Spheres | None) -> dict[str, Any]:
    other = figures.reference(found)
    lines = scans(found, source, options.max_angle)
    return {
        "spheres": None if spheres is None else figures.draw_spheres(spheres),
        "scans": figures.draw_scans(found, lines, other) if lines else None,
        "parity": figures.draw_parity(found),
        "lobe": figures.draw_lobe(found, other),
        "around": figures.draw_around(found) if found.ndf.alpha_u != found.ndf.alpha_v else None,
        "residuals": figures.draw_residuals(found, source, options.max_angle, other),
        "tree": _tree(found) if len(found.scores) > 1 else None,
    }


def _tree(found: Fit) -> Plot:
    errors = [math.log(max(score.error, 1e-300)) for score in found.scores]
    low, high = min(errors), max(errors)
    nodes = []
    for score, error in zip(found.scores, errors):
        held = "" if math.isnan(score.held_out) else f"\nleft out {score.held_out:.3g}"
        good = (high - error) / (high - low) if high > low else 1.0
        nodes.append(Node(score.model, f"{score.error:.3g} ({score.relative:.2f})" + held, good, score.chosen))
    words = (
        "Every row with its error, in brackets over that of GGX, and where it was asked for the error of directions that were left out of the fit. "
        "Lines go to special cases. The framed one is the material."
    )
    return draw_tree(nodes, words)


def _side_by_side(spheres: Spheres) -> bytes:
    import numpy as np

    return picture_png(np.concatenate([spheres.data, spheres.fit], axis=1))


def _summary(found: Fit, path: Path, kind: str, seconds: float) -> dict[str, Any]:
    """What stands in a table of many fits; plain JSON."""
    errors = {score.model: score.error for score in found.scores}
    ggx = errors.get("ggx")
    over = found.error / ggx if ggx else None
    return {
        "file": str(path),
        "format": kind,
        "model": found.model,
        "error": found.error,
        "over_ggx": over,
        "errors": errors,
        "parameters": {k: v if math.isfinite(v) and abs(v) < 1e300 else None for k, v in found.parameters.items()},
        "not_identifiable": list(found.uncertainty.unknown),
        "at_a_bound": [p.name for p in found.uncertainty.parameters if p.status == "at a bound"],
        "pairs": len(found.data.value),
        "warnings": list(found.warnings),
        "seconds": round(seconds, 3),
    }


def _json(found: Fit, summary: Mapping[str, Any], options: Options) -> str:
    from .. import __version__

    content = json.loads(found.as_json())
    first = {"file": summary["file"], "format": summary["format"], "sgtd": __version__, "options": options.as_json()}
    return json.dumps({**first, **content, "seconds": summary["seconds"]}, indent=1, allow_nan=False) + "\n"


def scores_csv(found: Fit) -> str:
    """A line for each row that was tried."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        ("model", "error", "relative_to_ggx", "error_of_what_was_left_out", "variables", "seconds", "chosen")
    )
    for score in sorted(found.scores, key=lambda score: score.error):
        held = "" if math.isnan(score.held_out) else f"{score.held_out:.9g}"
        row = (score.model, f"{score.error:.9g}", f"{score.relative:.6g}", held)
        table.writerow((*row, score.parameters, f"{score.seconds:.3f}", "yes" if score.chosen else ""))
    return text.getvalue()
