"""Which setting of the dial suffices: for an 8-bit display, and below the noise of so many samples per pixel."""

from __future__ import annotations

from dataclasses import dataclass

from . import DEFAULT_SETTING, setting_text
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


def sentence(advices: list[Advice], costs: dict[float, tuple[float, float, float]]) -> str:
    """What the default should be, and why.

    ``costs`` has for each setting the median ns of one Lambda, the table bytes and the build time in ms, each as the
    largest over the shapes.
    """
    if not advices:
        return ""
    needed = [advice.all_of_them for advice in advices]
    if any(value is None for value in needed):
        return "At least one shape meets no criterion at any setting: look at its table before trusting a default."
    coarsest = min(needed)
    if coarsest == 0.0:
        return "Only quadrature meets every criterion for every shape: the tables are not accurate enough for these scenes."
    parts = [
        f"For the shapes and scenes of this report, accuracy {setting_text(coarsest)} already passes every test: the error "
        f"is under one 8-bit step in every pixel, and below a tenth of the noise at up to {SAMPLES[-1]} samples per pixel."
    ]
    if coarsest not in costs or DEFAULT_SETTING not in costs:
        return parts[0]
    a, b = costs[coarsest], costs[DEFAULT_SETTING]
    price = (
        f"a look-up of {b[0]:.3g} ns instead of {a[0]:.3g} ns, tables of at most {b[1] / 1024:.1f} KiB instead of "
        f"{a[1] / 1024:.1f} KiB and {b[2]:.2g} ms instead of {a[2]:.2g} ms to build them, once per material"
    )
    if coarsest > DEFAULT_SETTING:
        decades = f"{coarsest / DEFAULT_SETTING:.0f} times"
        parts.append(
            f"The default should be {setting_text(DEFAULT_SETTING)}, which is {decades} finer: it costs {price}. That is next to "
            f"nothing, and it leaves a margin for scenes that magnify errors more than these."
        )
    elif coarsest == DEFAULT_SETTING:
        parts.append(f"That is the default, {setting_text(DEFAULT_SETTING)}, and it should stay.")
    else:
        parts.append(
            f"The default, {setting_text(DEFAULT_SETTING)}, is coarser than that: by these numbers it should become "
            f"{setting_text(coarsest)}."
        )
    return " ".join(parts)
