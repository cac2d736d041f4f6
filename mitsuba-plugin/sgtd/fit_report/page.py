"""The page on one fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..fitting import Fit
from ..fitting.uncertainty import Parameter
from ..measured import Source
from ..page.template import data, load_template, number
from .options import Options

_LOSSES = {
    "log": "ln(1 + value · cos θ)",
    "cbrt": "the cube root of value · cos θ, over its root mean square",
    "l2": "value · cos θ, over its root mean square",
}


def report(found: Fit, source: Source, summary: Mapping[str, Any], options: Options, plots: Mapping[str, Any]) -> str:
    """One file of HTML that needs nothing else."""
    template = load_template(
        Path(__file__).with_name("report.html.j2"), svg_of_png=lambda plot: data("png", plot.png), value=_value
    )
    uncertain = found.uncertainty
    return template.render(
        title=found.data.title,
        kind=source.kind,
        found=found,
        loss=_LOSSES[options.loss],
        options=options,
        sentences=_sentences(found, summary),
        alarms=[w for w in found.warnings if _is_alarm(w)],
        notes=[w for w in found.warnings if not _is_alarm(w)],
        plots=plots,
        parameters=uncertain.parameters,
        names=uncertain.names,
        correlations=[[round(float(x), 2) for x in row] for row in uncertain.correlations],
        scores=sorted(found.scores, key=lambda score: score.error),
        xml=found.to_xml(),
        seconds=summary["seconds"],
        pairs=len(found.data.value),
    )


def _is_alarm(text: str) -> bool:
    return text.startswith("the data are retro-reflective") or "no fit can" in text or "more than all" in text


def _sentences(found: Fit, summary: Mapping[str, Any]) -> list[str]:
    over = summary["over_ggx"]
    sentences = [
        f"{_title(found.model)}, off by {number(found.error)} (root mean square)" + _beside_ggx(found, over) + "."
    ]
    known = [p for p in found.uncertainty.parameters if p.status == "known"]
    shape = [p for p in known if p.name in ("alpha", "alpha_u", "alpha_v", "gamma", "p", "lambda", "shift", "rotation")]
    if shape:
        sentences.append("Known from the data: " + ", ".join(f"{p.name} = {_value(p.value)}" for p in shape) + ".")
    unknown = found.uncertainty.unknown
    if unknown:
        sentences.append(f"Not known within 5 %: {', '.join(unknown)}.")
    bound = [p.name for p in found.uncertainty.parameters if p.status == "at a bound"]
    if bound:
        sentences.append(f"At a bound: {', '.join(bound)}.")
    return sentences


def _title(model: str) -> str:
    return {"tabulated": "A free table", "mixture": "A mixture of two of Student’s"}.get(model, f"The row {model}")


def _beside_ggx(found: Fit, over: float | None) -> str:
    if over is None or found.model == "ggx":
        return ""
    return f", {over:.2f} of what GGX is off by"


def _value(x: float) -> str:
    """A parameter as a reader wants it."""
    if not math.isfinite(x) or abs(x) > 1e300:
        return "∞"
    return number(x, 4)


def interval(p: Parameter) -> str:
    return f"{_value(p.low)} – {_value(p.high)}"
