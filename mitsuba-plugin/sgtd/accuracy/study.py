"""Runs everything that the report shows."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from .. import __version__
from ..named_shape import CLASSICS, DEFAULT_SHAPES, QUICK_SHAPES, NamedShape, parse_shape
from . import DEFAULT_SETTING, QUICK_SETTINGS, SETTINGS, advice, function_timing, images, published
from .function_errors import (
    MaskingErrors,
    PrecisionErrors,
    SamplingErrors,
    Spread,
    density_errors,
    masking_errors,
    material_errors,
    published_way,
    sampling_errors,
    table_way,
)

# Gets the name of a step and its length, and returns the call that advances it.
Steps = Callable[[str, int], Callable[[int], None]]


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    settings: tuple[float, ...]
    orders: tuple[int, ...]
    arguments: int
    repetitions: int
    pixels: int
    batches: int
    spp_scalar: int
    spp_jit: int
    equal_time_repetitions: int
    equal_time_budget: float


FULL = Effort(SETTINGS, published.ORDERS, 30_000, 25, 16_000, 6, 4, 8, 4, 8.0)
QUICK = Effort(QUICK_SETTINGS, (16, 64), 3_000, 3, 1_500, 3, 2, 4, 2, 1.0)


@dataclass
class FunctionStudy:
    """One shape, as functions. Keys of the dictionaries are settings as text ("1e-05"), or names of formulas."""

    shape: NamedShape
    masking: dict[str, MaskingErrors]
    density: dict[str, Spread]
    sampling: dict[str, SamplingErrors]
    dcos: SamplingErrors
    precision: dict[str, dict[float, PrecisionErrors]] = field(default_factory=dict)


@dataclass
class Study:
    """All that the report is made from."""

    settings: tuple[float, ...]
    seed: int
    quick: bool
    machine: dict[str, str]
    functions: list[FunctionStudy]
    clocks: dict[int, function_timing.FunctionTimes]
    images: list[images.ImageStudy]
    advice: list[advice.Advice]
    text: str
    seconds: float

    @property
    def one(self) -> function_timing.FunctionTimes:
        """The times on one core."""
        return self.clocks[1]

    @property
    def all(self) -> function_timing.FunctionTimes:
        """The times on all cores."""
        return self.clocks[max(self.clocks)]


def run(
    shape_texts: tuple[str, ...],
    scene_paths: tuple[Path, ...],
    variants: tuple[str, ...],
    parameters: dict[str, str],
    seed: int,
    quick: bool,
    steps: Steps,
    lenient: bool = False,
) -> Study:
    """Measures; everything that can be refused is refused before the first measurement."""
    import mitsuba as mi

    start = time.perf_counter()
    effort = QUICK if quick else FULL
    machine = _machine(variants)
    mi.set_variant(variants[0])
    paths = scene_paths or images.default_scenes()
    loaded = {path: images.load(path, parameters, effort.pixels, lenient) for path in paths}
    shapes, plan = _shapes(shape_texts, bool(scene_paths), loaded, quick)
    for path, shape in plan:  # one build of each, so that a scene without metals is refused now
        loaded[path].build(shape, DEFAULT_SETTING)

    measured = list(shapes)
    if not quick:
        known = {shape.numbers for shape in shapes}
        classics = [parse_shape(name) for name in CLASSICS]
        measured += [c for c in classics if c.numbers not in known]

    advance = steps("errors", len(measured) * 3)
    functions = [_functions(shape, effort, seed, variants, advance) for shape in measured]

    clocks = {}
    for threads in sorted({1, _cores()}):
        name = "times, 1 core" if threads == 1 else f"times, {threads} cores"
        advance = steps(name, effort.repetitions)
        texts = [shape.text for shape in measured]
        clocks[threads] = function_timing.measure(
            texts, effort.settings, effort.orders, threads, effort.repetitions, seed, advance
        )

    found = _images(plan, variants, parameters, effort, seed, steps, lenient)
    advices = advice.advise(found)
    if quick:
        text = advice.sentence_of_a_quick_run(advices)
    else:
        text = advice.sentence(advices, _costs(shapes, effort.settings, clocks[1]))
    return Study(
        settings=effort.settings,
        seed=seed,
        quick=quick,
        machine=machine,
        functions=functions,
        clocks=clocks,
        images=found,
        advice=advices,
        text=text,
        seconds=time.perf_counter() - start,
    )


def _shapes(
    texts: tuple[str, ...], users_scenes: bool, loaded: dict[Path, images.SceneFile], quick: bool
) -> tuple[list[NamedShape], list[tuple[Path, NamedShape | None]]]:
    """The shapes to measure as functions, and the pairs of scene and shape to render.

    Without --shape, a scene of the user's that has sgtdconductor already keeps its own shapes.
    """
    asked = [parse_shape(text) for text in dict.fromkeys(texts)]
    if asked or not users_scenes:
        every = asked or [parse_shape(text) for text in (QUICK_SHAPES if quick else DEFAULT_SHAPES)]
        return every, [(path, shape) for path in loaded for shape in every]
    defaults = [parse_shape(text) for text in (QUICK_SHAPES if quick else DEFAULT_SHAPES)]
    shapes: dict[str, NamedShape] = {}
    plan: list[tuple[Path, NamedShape | None]] = []
    for path, file in loaded.items():
        keeps = images.has_own_shapes(file)
        plan += [(path, None)] if keeps else [(path, shape) for shape in defaults]
        shapes.update({shape.text: shape for shape in (images.own_shapes(file) if keeps else ()) or defaults})
    return list(shapes.values()), plan


def _functions(
    shape: NamedShape, effort: Effort, seed: int, variants: tuple[str, ...], advance: Callable[[int], None]
) -> FunctionStudy:
    ways = {str(setting): table_way(shape, setting) for setting in effort.settings}
    ways |= {line.name: published_way(shape, line) for line in published.masking_lines(shape, effort.orders)}
    with np.errstate(all="ignore"):
        masking = masking_errors(shape, seed, effort.arguments, ways)
        advance(1)
        density = density_errors(shape, seed, effort.arguments, effort.settings)
        sampling = {str(k): sampling_errors(shape, seed, effort.arguments, k) for k in effort.settings}
        dcos = sampling_errors(shape, seed, effort.arguments, DEFAULT_SETTING, visible=False)
        advance(1)
        result = FunctionStudy(shape, masking, density, sampling, dcos)
        for variant in variants:
            result.precision[variant] = material_errors(shape, seed, effort.arguments, effort.settings, variant)
        advance(1)
    return result


def _images(
    plan: list[tuple[Path, NamedShape | None]],
    variants: tuple[str, ...],
    parameters: dict[str, str],
    effort: Effort,
    seed: int,
    steps: Steps,
    lenient: bool,
) -> list[images.ImageStudy]:
    import mitsuba as mi

    found = []
    for variant in variants:
        mi.set_variant(variant)
        spp = effort.spp_scalar if variant.startswith("scalar_") else effort.spp_jit
        amount = images.Plan(effort.batches, spp, effort.equal_time_repetitions, effort.equal_time_budget, seed)
        advance = steps(f"images, {variant}", len(plan) * images.steps(effort.settings, amount))
        for path, shape in plan:
            # read anew: a scene graph belongs to one variant
            file = images.load(path, parameters, effort.pixels, lenient)
            found.append(images.study(file, shape, effort.settings, amount, variant, advance))
    return found


def _costs(
    shapes: list[NamedShape], settings: tuple[float, ...], clock: function_timing.FunctionTimes
) -> dict[float, advice.Cost]:
    costs = {}
    for setting in settings:
        keys = [(shape.text, str(setting)) for shape in shapes]
        lookups = [clock.nanoseconds[text, "lambda", key] for text, key in keys]
        costs[setting] = advice.Cost(
            lookup=max(lookups, key=lambda timing: timing.median),
            table_bytes=max(clock.table_bytes[key] for key in keys),
            build_ms=1e3 * max(clock.build_seconds[key].median for key in keys),
        )
    return costs


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _machine(variants: tuple[str, ...]) -> dict[str, str]:
    import mitsuba as mi

    processor = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                processor = line.partition(":")[2].strip()
                break
    except OSError:
        pass
    return {
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "processor": processor,
        "cores": str(_cores()),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "mitsuba": mi.__version__,
        "sgtd": __version__,
        "variants": ", ".join(variants),
        "load before": f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "",
    }
