"""What the numbers of the functions say, in sentences; every number in them is measured."""

from __future__ import annotations

import math
import statistics

from . import DEFAULT_SETTING, setting_text
from .study import FunctionStudy, Study


def about_dial(study: Study) -> list[str]:
    """Whether the dial does what it promises, and what it costs."""
    return [*_cost(study), *_finest(study), *_broken(study), *_reported(study), *_sampling(study)]


def _cost(study: Study) -> list[str]:
    tables = [setting for setting in study.settings if setting]
    times = study.one.nanoseconds
    lookups = [times[one.shape.text, "lambda", str(k)] for one in study.functions for k in tables]
    medians = [timing.median for timing in lookups]
    defaults = [times[one.shape.text, "lambda", str(DEFAULT_SETTING)].median for one in study.functions]
    quadrature = [times[one.shape.text, "lambda", "0.0"].median for one in study.functions]
    ratios = [slow / fast for slow, fast in zip(quadrature, defaults)]
    words = [
        (
            f"A look-up of the table takes {_range(medians)} ns on one core over all settings and shapes, and accuracy 0 (a closed form for Student's shapes, quadrature for others) "
            f"{_range(ratios, 2)} times as long as a look-up at {setting_text(DEFAULT_SETTING)}."
        )
    ]
    if all(_finest_is_no_slower(study, one) for one in study.functions):
        words.append(
            "A finer setting makes the table longer, not the look-up: what costs time is to do without a table."
        )
    if any(_coarse_is_slower(study, one) for one in study.functions):
        words.append(
            "The coarsest tables are even slower than the finer ones: probably because their first cell is wide and the processor cannot "
            "predict whether the next argument falls into it."
        )
    busy = statistics.median((timing.high - timing.low) / timing.median for timing in lookups)
    if busy > 0.25:
        words.append(
            f"The machine was busy: half of these times scatter by more than {busy:.0%} between their quartiles, "
            f"so small differences among them mean nothing."
        )
    return [" ".join(words)]


def _range(values: list[float], digits: int = 3) -> str:
    """ "7.2 to 20.3", or one number where both ends read the same."""
    low, high = (f"{value:.{digits}g}" if value < 100 else f"{value:.0f}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _finest_is_no_slower(study: Study, functions: FunctionStudy) -> bool:
    times, text = study.one.nanoseconds, functions.shape.text
    coarsest, finest = (times[text, "lambda", str(k)] for k in (study.settings[0], study.settings[-2]))
    return finest.low <= 1.2 * coarsest.high


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
        (
            f"Settings finer than {setting_text(last)} give the table of {setting_text(last)}: its nodes are in single precision "
            f"and hold no more. The worst error that any finite setting reaches is {floor:.1e} (worst over the shapes). "
            f"Smaller errors take quadrature: accuracy 0."
        )
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
        return [
            "Every setting that a table in single precision can hold is kept at all arguments tried, random and hard."
        ]
    return [f"The worst error exceeds the setting here: {'; '.join(broken)}."]


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


def _sampling(study: Study) -> list[str]:
    """Visible normals against D cos."""
    key = str(DEFAULT_SETTING)
    variances = [
        one.dcos.variance / one.sampling[key].variance for one in study.functions if one.sampling[key].variance
    ]
    words = (
        f"Over all views, the weights of D cos sampling have more than {_round_down(min(variances, default=0.0))} times the "
        f"variance of those of visible-normal sampling, which the setting does not change."
    )
    pairs = [(one.dcos, one.row(DEFAULT_SETTING)) for one in study.images]
    equal_spp = [a.rmse_equal_spp.median / max(b.rmse_equal_spp.median, 1e-300) for a, b in pairs]
    equal_time = [a.rmse_equal_time.median / max(b.rmse_equal_time.median, 1e-300) for a, b in pairs]
    if pairs:
        words += (
            f" In these images the RMSE of D cos is {_range(equal_spp, 2)} times that of visible sampling at equal samples and "
            f"{_range(equal_time, 2)} times in equal time: little of the noise in these images comes "
            f"from how normals are drawn."
            if max(equal_time) < 1.3
            else f" In these images the RMSE of D cos is {_range(equal_spp, 2)} times that of visible sampling at equal samples "
            f"and {_range(equal_time, 2)} times in equal time."
        )
    return [words]


def _round_down(value: float) -> str:
    """One digit: "20000" for 20519."""
    return (
        f"{10.0 ** math.floor(math.log10(value)) * int(value / 10.0 ** math.floor(math.log10(value))):g}"
        if value > 0.0
        else "0"
    )


def about_reference(study: Study) -> str:
    """How far quadrature is from closed forms, where there are any."""
    found = []
    for functions in study.functions:
        for way, errors in functions.masking.items():
            if "closed form" in way:
                found.append(f"{functions.shape.title}: {errors.g1.largest:.0e}")
    if not found:
        return "None of these shapes has a closed form for masking against which quadrature could be checked here."
    return f"Accuracy 0 against published closed forms, worst relative difference of G1: {'; '.join(found)}. So the reference can be trusted."


def about_precision(study: Study) -> str:
    """Single precision against double, as far as variants allow."""
    parts = [
        (
            "Single against double precision: the wheel of Mitsuba has no variant in double precision. Scalar variants evaluate "
            "the core in double precision and round its results; JIT variants compute in single precision throughout."
        )
    ]
    for variant in dict.fromkeys(name for one in study.functions for name in one.precision):
        errors = [
            one.precision[variant]
            for one in study.functions
            # those run on Mitsuba's own code
            if variant in one.precision and not (one.shape.is_ggx or one.shape.is_beckmann)
        ]
        if not errors:
            continue
        worst = max(settings[0.0].value.worst["random"] for settings in errors)
        rms = max(settings[0.0].value.rms["random"] for settings in errors)
        words = (
            f"In {variant} a material at accuracy 0 is off by {worst:.1e} at worst and {rms:.1e} RMS, over the shapes"
        )
        enough = [
            k
            for k in study.settings
            if k and all(e[k].value.rms["random"] < 1.5 * e[0.0].value.rms["random"] for e in errors)
        ]
        if enough:
            words += f"; from {setting_text(enough[0])} on, a finer setting changes that by less than half"
        parts.append(words + ".")
    return " ".join(parts) if len(parts) > 1 else ""
