"""What the numbers of the functions say, in sentences; every number in them is measured."""

from __future__ import annotations

from . import DEFAULT_SETTING, setting_text
from .study import FunctionStudy, Study


def about_dial(study: Study) -> list[str]:
    """Whether the dial does what it promises, and what it costs."""
    return [*_cost(study), *_finest(study), *_broken(study), *_reported(study)]


def _cost(study: Study) -> list[str]:
    tables = [setting for setting in study.settings if setting]
    medians, quadrature = [], []
    for functions in study.functions:
        times = study.one.nanoseconds
        text = functions.shape.text
        medians += [times[text, "lambda", str(setting)].median for setting in tables]
        quadrature.append(times[text, "lambda", "0.0"].median / times[text, "lambda", str(DEFAULT_SETTING)].median)
    words = (
        f"A look-up takes {min(medians):.3g} to {max(medians):.3g} ns on one core, over all settings and shapes: a finer setting "
        f"makes the table longer, not the look-up. What costs time is quadrature on every call: "
        f"{min(quadrature):.0f} to {max(quadrature):.0f} times a look-up at {setting_text(DEFAULT_SETTING)}."
    )
    slower = [one for one in study.functions if _coarse_is_slower(study, one)]
    if slower:
        words += (
            " The coarsest table is not the fastest: its first cell is wide, so whether an argument falls into it is hard "
            "to predict for the processor."
        )
    return [words]


def _coarse_is_slower(study: Study, functions: FunctionStudy) -> bool:
    times, text = study.one.nanoseconds, functions.shape.text
    coarsest, default = (times[text, "lambda", str(k)] for k in (study.settings[0], DEFAULT_SETTING))
    return coarsest.low > 1.2 * default.high


def _finest(study: Study) -> list[str]:
    """Settings that change nothing any more."""
    tables = [setting for setting in study.settings if setting]
    floor = 0.0
    last = tables[-1]
    for functions in study.functions:
        text = functions.shape.text
        errors = functions.masking
        same = [
            k
            for k in tables
            if study.one.table_bytes[text, str(k)] == study.one.table_bytes[text, str(last)]
            and errors[str(k)].g1.largest == errors[str(last)].g1.largest
        ]
        last = max(last, max(same)) if functions is study.functions[0] else min(last, max(same))
        floor = max(floor, errors[str(tables[-1])].g1.largest)
    if last == tables[-1]:
        return []
    return [
        f"Settings finer than {setting_text(last)} give the table of {setting_text(last)}: its nodes are in single precision "
        f"and hold no more. The worst error that any finite setting reaches is {floor:.1e} (worst over the shapes). "
        f"Smaller errors take quadrature: accuracy 0."
    ]


def _broken(study: Study) -> list[str]:
    broken = []
    for functions in study.functions:
        reachable = functions.masking[str([k for k in study.settings if k][-1])].g1.largest
        for setting in study.settings:
            worst = functions.masking[str(setting)].g1.largest
            if setting and worst > setting and worst > reachable:
                broken.append(f"{functions.shape.title}: {worst:.1e} at {setting_text(setting)}")
    if not broken:
        return ["Every setting that a table in single precision can hold is kept at all arguments tried, random and hard."]
    return [f"A setting is exceeded here: {'; '.join(broken)}."]


def _reported(study: Study) -> list[str]:
    """What Ndf.accuracy_reached says against what was measured."""
    low = []
    for functions in study.functions:
        for setting in study.settings:
            key = (functions.shape.text, str(setting))
            worst = functions.masking[str(setting)].g1.largest
            if setting and worst > study.one.accuracy_reached[key]:
                ratio = worst / study.one.accuracy_reached[key]
                low.append(f"{functions.shape.title} at {setting_text(setting)} ({ratio:.2g} times)")
    if not low:
        return []
    return [f"The error exceeds what Ndf.accuracy_reached reports here: {'; '.join(low)}."]


def about_reference(study: Study) -> str:
    """How far quadrature is from closed forms, where there are any."""
    found = []
    for functions in study.functions:
        for way, errors in functions.masking.items():
            if "closed form" in way:
                found.append(f"{functions.shape.title}: {errors.g1.largest:.0e}")
    if not found:
        return "None of these shapes has a closed form for masking against which quadrature could be checked here."
    return f"Quadrature against closed forms, worst relative difference of G1: {'; '.join(found)}. So the reference can be trusted."


def about_precision(study: Study) -> str:
    """Single precision against double, where a variant of each kind was measured."""
    parts = []
    names = {variant for functions in study.functions for variant in functions.precision}
    for variant in sorted(names):
        worst = [
            functions.precision[variant][0.0].value
            for functions in study.functions
            if variant in functions.precision and not (functions.shape.is_ggx or functions.shape.is_beckmann)
        ]
        if worst:
            rms = max(spread.rms["random"] for spread in worst)
            parts.append(f"{variant}: {max(spread.worst['random'] for spread in worst):.1e} worst, {rms:.1e} RMS")
    return "; ".join(parts)
