"""The page on many fits, and its table as CSV."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..atomic_output import AtomicOutput
from ..jobs import Outcome
from ..page.plot_style import BLUE, FAINT, INK, VERMILION, Plot, finish, new_figure, style
from ..page.template import data, load_template, number
from .names import REPORT, SPHERE

PAGE, TABLE = "summary.html", "summary.csv"
# Parameters that a table of many has room for
_COLUMNS = ("alpha", "alpha_u", "alpha_v", "rotation", "gamma", "p", "lambda", "shift")
# Models whose errors are compared over all files
_COMPARED = ("beckmann", "ggx", "student", "gnd", "gtd", "sgtd", "mixture", "tabulated")


def write(outcomes: Sequence[Outcome], folder: Path) -> None:
    """``summary.html`` and ``summary.csv``, from what all tasks have said."""
    done = [outcome for outcome in outcomes if not outcome.error]
    failed = [outcome for outcome in outcomes if outcome.error]
    with AtomicOutput(folder) as files:
        files.path(TABLE).write_text(_csv(done), encoding="utf-8")
        files.path(PAGE).write_text(_page(done, failed, folder), encoding="utf-8")


def _csv(done: Sequence[Outcome]) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("name", "file", "format", "model", "error", "over_ggx", *_COLUMNS, "seconds", "warnings"))
    for outcome in done:
        row = outcome.result
        numbers = [row["error"], row["over_ggx"], *(row["parameters"].get(name) for name in _COLUMNS), row["seconds"]]
        cells = ["" if x is None else f"{x:.9g}" for x in numbers]
        table.writerow((outcome.task.key, row["file"], row["format"], row["model"], *cells, "; ".join(row["warnings"])))
    return text.getvalue()


def _page(done: Sequence[Outcome], failed: Sequence[Outcome], folder: Path) -> str:
    template = load_template(Path(__file__).with_name("summary.html.j2"))
    rows = [_row(outcome) for outcome in sorted(done, key=lambda outcome: -(outcome.result["over_ggx"] or 1.0))]
    plots = [plot for plot in (_draw_errors(done), _draw_shapes(done)) if plot is not None]
    return template.render(
        count=len(done),
        failed=[(outcome.task.key, outcome.error) for outcome in failed],
        models=Counter(outcome.result["model"] for outcome in done).most_common(),
        means=_means(done),
        rows=rows,
        plots=plots,
        flagged=[(row["name"], row["warnings"]) for row in rows if any("retro" in w for w in row["warnings"])],
        has_spheres=any(row["sphere"] for row in rows),
    )


def _row(outcome: Outcome) -> dict[str, Any]:
    found = outcome.result
    sphere = Path(outcome.task.arguments["folder"]) / SPHERE
    parameters = found["parameters"]
    return {
        "name": outcome.task.key,
        "report": f"{outcome.task.key}/{REPORT}",
        "sphere": data("png", sphere.read_bytes()) if sphere.is_file() else "",
        "model": found["model"],
        "error": number(found["error"]),
        "over": "–" if found["over_ggx"] is None else f"{found['over_ggx']:.2f}",
        "alpha": _alphas(parameters),
        "gamma": _or_dash(parameters, "gamma"),
        "p": _or_dash(parameters, "p"),
        "unknown": ", ".join(found["not_identifiable"]),
        "bound": ", ".join(found["at_a_bound"]),
        "warnings": found["warnings"],
        "seconds": f"{found['seconds']:.1f}",
    }


def _alphas(parameters: dict[str, Any]) -> str:
    if parameters.get("alpha_u") is not None:
        return f"{number(parameters['alpha_u'])}, {number(parameters['alpha_v'])}"
    return number(parameters.get("alpha") or parameters.get("alpha_core"))


def _or_dash(parameters: dict[str, Any], name: str) -> str:
    if name not in parameters:
        return "–"
    return "∞" if parameters[name] is None else number(parameters[name])


def _means(done: Sequence[Outcome]) -> list[tuple[str, int, float, float]]:
    """Of each model: files that tried it, the geometric mean of its error over GGX's, and the share of files on which it is better by a tenth."""
    rows = []
    for name in _COMPARED:
        ratios = np.array(
            [
                errors[name] / errors["ggx"]
                for errors in (outcome.result["errors"] for outcome in done)
                if name in errors and errors.get("ggx")
            ]
        )
        if len(ratios) and name != "ggx":
            rows.append((name, len(ratios), float(np.exp(np.log(ratios).mean())), float((ratios < 0.9).mean())))
    return rows


def _draw_errors(done: Sequence[Outcome]) -> Plot | None:
    """Errors over GGX's, every model sorted by itself."""
    figure = new_figure()
    axes = figure.add_subplot()
    drawn = 0
    for name, color in (("student", FAINT), ("gtd", VERMILION), ("mixture", BLUE), ("tabulated", INK)):
        ratios = sorted(
            outcome.result["errors"][name] / outcome.result["errors"]["ggx"]
            for outcome in done
            if name in outcome.result["errors"] and outcome.result["errors"].get("ggx")
        )
        if len(ratios) > 1:
            axes.plot(np.linspace(0.0, 100.0, len(ratios)), ratios, color=color, label=name, linewidth=1.4)
            drawn += 1
    if not drawn:
        return None
    axes.axhline(1.0, color=INK, linewidth=0.6, linestyle=":")
    axes.set_xlabel("percent of the files")
    axes.set_ylabel("error over that of GGX")
    axes.set_ylim(0.0, None)
    axes.legend(frameon=False, fontsize=8)
    style(axes)
    return finish(
        "errors",
        "Errors over GGX's",
        "Each model sorted by itself: where its line is below 1, it is better than GGX.",
        figure,
    )


def _draw_shapes(done: Sequence[Outcome]) -> Plot | None:
    """Where the fitted shapes lie: the exponent of the tail against the shape of the peak."""
    points = []
    for outcome in done:
        parameters = outcome.result["parameters"]
        gamma, p = parameters.get("gamma"), parameters.get("p")
        if p is not None and "gamma" in parameters:
            points.append((p, 0.0 if gamma is None else 1.0 / gamma, outcome.task.key))
    if len(points) < 2:
        return None
    figure = new_figure()
    axes = figure.add_subplot()
    p = np.geomspace(0.15, 30.0, 200)
    axes.plot(p, 2.0 * p / 3.0, color=FAINT, linewidth=0.8, linestyle="--")
    axes.scatter([x for x, _, _ in points], [y for _, y, _ in points], color=VERMILION, s=14, zorder=3)
    axes.plot(1.0, 0.5, "x", color=INK, markersize=6)
    axes.annotate("GGX", (1.0, 0.5), (5, 4), textcoords="offset points", fontsize=8)
    axes.plot(1.0, 0.0, "x", color=INK, markersize=6)
    axes.annotate("Beckmann", (1.0, 0.0), (5, 4), textcoords="offset points", fontsize=8)
    axes.set_xscale("log")
    axes.set_xlabel("p")
    axes.set_ylabel("1/γ")
    low, high = min(min(x for x, _, _ in points), 0.8), max(max(x for x, _, _ in points), 1.25)
    axes.set(xlim=(0.8 * low, 1.25 * high), ylim=(-0.03, 1.1 * max(0.6, *(y for _, y, _ in points))))
    style(axes)
    words = "Shapes of the materials: heavy tails above, exponential ones at 0. Behind the dashed line Smith's masking does not exist (2 p γ ≤ 3)."
    return finish("shapes", "The shapes", words, figure)
