"""The table of a comparison: on the terminal, as CSV and as JSON."""

from __future__ import annotations

import csv
import json
import math
import statistics
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Optional

from ..scene.exchange import Pair
from ..scene.render import Rendering
from ..scene.timing import Quartiles, decimals, quartiles, ratios
from .difference import FLIP_PIXELS_PER_DEGREE, Comparison

Number = Optional[float]

# A narrower terminal gets the table without its rules, with the unit beside the quantity.
_WIDE = 76

_COMPILING = "time, compiling"


@dataclass(frozen=True)
class Row:
    """One quantity: of each image, or between the two; ``ratio`` is right / left."""

    quantity: str
    left: Number = None
    right: Number = None
    between: Number = None
    ratio: Number = None
    unit: str = ""


@dataclass(frozen=True)
class Report:
    """All that a comparison found, and from what."""

    scene: Path
    name: str
    parameters: dict[str, str]
    settings: dict[str, str | float]
    variant: str
    mitsuba: str
    width: int
    height: int
    pair: Pair
    left: Rendering
    right: Rendering
    result: Comparison

    @property
    def integrator_has_channels(self) -> bool:
        """The integrator writes channels of its own beside the colors."""
        import mitsuba as mi

        return bool(self.left.bitmap.pixel_format() == mi.Bitmap.PixelFormat.MultiChannel)

    def rows(self) -> list[Row]:
        """The table, the same for every output."""
        result = self.result
        mean = result.mean_left
        rows = [
            Row(
                "mean luminance",
                result.mean_left,
                result.mean_right,
                result.mean_right - mean,
                _ratio(result.mean_right, mean),
                "linear",
            ),
            Row("RMSE", between=result.rmse, unit="linear"),
            Row("RMSE, noise alone", between=result.rmse_noise, unit="linear"),
            Row("RMSE, beyond noise", between=result.rmse_beyond_noise, unit="linear"),
            Row("RMSE / left mean", between=_ratio(result.rmse, mean)),
            Row("FLIP", between=result.flip),
            Row("FLIP, noise alone", between=result.flip_noise),
            *self._times(),
        ]
        if result.any_bad:
            rows.append(Row("pixels not finite", float(result.not_finite[0]), float(result.not_finite[1])))
        return rows

    def _times(self) -> list[Row]:
        """In no more digits than the spread allows; without a spread in two."""
        left, right = self.left.timing, self.right.timing
        found = ratios(right, left)
        between = statistics.median(found) if found else None
        name = "time, with compiling" if left.compiling_is_included else "time"
        lines = [Row(name, _round(left.seconds, left.quartiles), _round(right.seconds, right.quartiles), unit="s")]
        lines[0] = replace(lines[0], ratio=_round(between, quartiles(found)))
        if left.quartiles and right.quartiles:
            for which, quartile in enumerate(("lower", "upper")):
                a = _round(left.quartiles[which], left.quartiles)
                b = _round(right.quartiles[which], right.quartiles)
                spread = quartiles(found)
                ratio = _round(spread[which], spread) if spread else None
                lines.append(Row(f"time, {quartile} quartile", a, b, None, ratio, "s"))
        lines.append(Row(_COMPILING, _round(left.compiling, None), _round(right.compiling, None), unit="s"))
        return lines

    def verdict(self) -> str:
        """One sentence on the outcome."""
        result = self.result
        if result.any_bad:
            left, right = result.not_finite
            return f"Not finite: {_pixels(left)} of the left image and {_pixels(right)} of the right one."
        if result.black:
            return "Both images are black: no light reaches the camera" + (
                ", or the integrator renders no color." if self.integrator_has_channels else "."
            )
        if result.largest_difference == 0.0:
            return "No difference: the two images are equal in every pixel."
        if result.equal:
            return f"No difference but for rounding: no channel differs by more than {result.largest_difference:.1g}."
        if result.rmse_noise and (result.rmse_beyond_noise or 0.0) < 0.1 * result.rmse_noise:
            return "The difference is within the noise of this many samples."
        return ""

    def write_csv(self, path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(("quantity", "left", "right", "between", "ratio", "unit"))
            for row in self.rows():
                numbers = (row.left, row.right, row.between, row.ratio)
                table.writerow((row.quantity, *("" if n is None else f"{n:.9g}" for n in numbers), row.unit))

    def write_json(self, path: Path) -> None:
        path.write_text(json.dumps(self.as_dict(), indent=2, allow_nan=False) + "\n", encoding="utf-8")

    def as_dict(self) -> dict[str, Any]:
        """The report in plain values."""
        result = self.result
        return {
            "scene": str(self.scene),
            "parameters": self.parameters,
            "set": {name: _plain(value) for name, value in self.settings.items()},
            "variant": self.variant,
            "mitsuba": self.mitsuba,
            "size": [self.width, self.height],
            "samples_per_pixel": self.left.spp,
            "passes": self.left.passes,
            "sampler": self.left.sampling_note(),
            "materials": [asdict(exchange) for exchange in self.pair.exchanges],
            "exposure_stops": result.exposure.stops,
            "exposure_rule": result.exposure.rule,
            "flip_pixels_per_degree": FLIP_PIXELS_PER_DEGREE,
            "equal": result.equal,
            "largest_difference": result.largest_difference,
            "not_finite": list(result.not_finite),
            "rows": [{name: _plain(value) for name, value in asdict(row).items()} for row in self.rows()],
        }

    def print(self, console: Any) -> None:
        """The table on a rich console."""
        from rich.box import HEAVY_HEAD
        from rich.table import Table

        wide = console.width >= _WIDE
        table = Table(
            title=f"{self.name}: right against left",
            title_justify="left",
            box=HEAVY_HEAD if wide else None,
            pad_edge=wide,
        )
        table.add_column("", no_wrap=wide, overflow="fold")
        for name in ("left", "right", "between", "ratio"):
            table.add_column(name, justify="right", no_wrap=True)
        if wide:
            table.add_column("unit")
        for row in self.rows():
            numbers = (row.left, row.right, row.between, row.ratio)
            unit = f" ({row.unit})" if row.unit == "s" and not wide else ""
            # a dash: there is such a time, but it cannot be told apart
            blanks = ("–", "–", "", "") if row.quantity == _COMPILING else ("",) * 4
            texts = (blank if number is None else f"{number:.4g}" for number, blank in zip(numbers, blanks))
            cells = [row.quantity + unit, *texts]
            table.add_row(*cells, *([row.unit] if wide else []))
        console.print(table)
        for line in (self.verdict(), self.left.sampling_note()):
            if line:
                console.print(line, highlight=False)


def _pixels(count: int) -> str:
    return f"{count} pixel" + ("s" if count != 1 else "")


def _round(value: Number, spread: Quartiles) -> Number:
    return None if value is None else round(value, decimals(value, spread))


def _ratio(value: float, reference: float) -> Number:
    return value / reference if reference else None


def _plain(value: str | float | None) -> str | float | None:
    """JSON has neither infinity nor NaN."""
    return value if value is None or isinstance(value, str) or math.isfinite(value) else str(value)
