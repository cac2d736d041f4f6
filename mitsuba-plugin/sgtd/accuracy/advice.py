"""Which setting of the dial suffices: for an 8-bit display, and below the noise of so many samples per pixel."""

from __future__ import annotations

from dataclasses import dataclass

from . import DEFAULT_SETTING, setting_text
from .function_timing import Timing
from .images import ImageRow, ImageStudy

# Samples per pixel whose noise is compared with the bias.
SAMPLES = (64, 1024, 16384)

# A bias of this part of the noise adds half a percent to the RMSE: it has disappeared.
HIDDEN = 0.1

# Criteria in the order of the tables.
EIGHT_BIT = "8-bit"


def criteria() -> tuple[str, ...]:
    return (EIGHT_BIT, *(f"{spp} spp" for spp in SAMPLES))


@dataclass(frozen=True)
class Advice:
    """The coarsest setting that meets each criterion; None where not even the finest does."""

    shape: str
    settings: dict[str, float | None]

    @property
    def all_of_them(self) -> float | None:
        """The coarsest setting that meets every criterion."""
        values = list(self.settings.values())
        return None if any(value is None for value in values) else min(values, default=None)


def meets(row: ImageRow, criterion: str) -> bool:
    """Whether one setting of one study meets a criterion."""
    if criterion == EIGHT_BIT:
        return row.steps_8bit < 1.0
    return row.bias <= HIDDEN * row.noise(int(criterion.split()[0]))


def advise(studies: list[ImageStudy]) -> list[Advice]:
    """Advice per shape, over all scenes and variants measured."""
    result = []
    for shape in dict.fromkeys(study.shape for study in studies):
        own = [study for study in studies if study.shape == shape]
        result.append(Advice(shape, {name: _coarsest(own, name) for name in criteria()}))
    return result


def _coarsest(studies: list[ImageStudy], criterion: str) -> float | None:
    """The coarsest setting from which on all finer ones meet the criterion too."""
    found = None
    for setting in reversed([row.setting for row in studies[0].rows]):
        if not all(meets(study.row(setting), criterion) for study in studies):
            break
        found = setting
    return found


@dataclass(frozen=True)
class Cost:
    """What a setting costs, over the shapes: the slowest look-up, the largest table, the longest build."""

    lookup: Timing
    table_bytes: int
    build_ms: float


def sentence_of_a_quick_run(advices: list[Advice]) -> str:
    """A quick run has a few settings, samples and small images: what passes there is no recommendation."""
    passed = [f"{one.shape}: {'none' if one.all_of_them is None else setting_text(one.all_of_them)}" for one in advices]
    return (
        "A quick run shows that everything works here, and measures too little to say which setting is enough. "
        f"Its few pixels passed all tests from these settings on: {'; '.join(passed)}. Run it without --quick for an answer."
    )


def sentence(advices: list[Advice], costs: dict[float, Cost]) -> str:
    """What the default should be, and why."""
    if not advices:
        return ""
    needed = [advice.all_of_them for advice in advices]
    if any(value is None for value in needed):
        return (
            "For at least one shape some criterion is met at no setting: look at its table before trusting a default."
        )
    coarsest = min(needed)
    if coarsest == 0.0:
        return "Only quadrature meets every criterion for every shape: the tables are not accurate enough for these scenes."
    words = (
        f"For the shapes and scenes of this report, accuracy {setting_text(coarsest)} already passes every test: the error "
        f"is under one 8-bit step in every pixel, and below a tenth of the noise at up to {SAMPLES[-1]} samples per pixel."
    )
    default = setting_text(DEFAULT_SETTING)
    if coarsest == DEFAULT_SETTING:
        return f"{words} That is the default, and it should stay."
    if coarsest < DEFAULT_SETTING:
        return f"{words} The default, {default}, is coarser than that: it should become {setting_text(coarsest)}."
    a, b = costs[coarsest], costs[DEFAULT_SETTING]
    return (
        f"{words} The default should be {default}, which is {coarsest / DEFAULT_SETTING:.0f} times finer and leaves that margin to "
        f"scenes that magnify errors more than these. The margin costs {_lookup(a.lookup, b.lookup)}, tables of at most "
        f"{b.table_bytes / 1024:.1f} KiB instead of {a.table_bytes / 1024:.1f} KiB, and {b.build_ms:.2g} ms instead of "
        f"{a.build_ms:.2g} ms to make them, once per shape."
    )


def _lookup(coarse: Timing, fine: Timing) -> str:
    medians = f"{fine.median:.3g} ns against {coarse.median:.3g} ns"
    if fine.median <= coarse.median:
        return f"no time in the look-up ({medians} in the slowest shape)"
    if fine.low <= coarse.high:
        return f"no time in the look-up that could be told from scatter ({medians} in the slowest shape)"
    return f"time in the look-up ({medians} in the slowest shape)"
