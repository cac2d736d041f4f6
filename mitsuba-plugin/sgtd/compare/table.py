"""The table of a comparison: on the terminal, as CSV and as JSON."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Optional

from ..scene.exchange import Pair
from ..scene.render import Rendering
from .difference import FLIP_PIXELS_PER_DEGREE, Comparison

Number = Optional[float]


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

    def rows(self) -> list[Row]:
        """The table, the same for every output."""
        left, right, result = self.left, self.right, self.result
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
            Row("time", left.seconds, right.seconds, None, _ratio(right.seconds, left.seconds), "s"),
            Row("time, compiling", left.first_pass_excess, right.first_pass_excess, unit="s"),
        ]
        if any(result.not_finite):
            rows.append(Row("pixels not finite", *map(float, result.not_finite)))
        return rows

    def verdict(self) -> str:
        """One sentence on the outcome."""
        result = self.result
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
            "materials": [asdict(exchange) for exchange in self.pair.exchanges],
            "exposure_stops": result.exposure,
            "flip_pixels_per_degree": FLIP_PIXELS_PER_DEGREE,
            "equal": result.equal,
            "largest_difference": result.largest_difference,
            "rows": [asdict(row) for row in self.rows()],
        }

    def print(self, console: Any) -> None:
        """The table on a rich console."""
        from rich.table import Table

        table = Table(title=f"{self.scene.name}: right against left", title_justify="left")
        table.add_column("", no_wrap=True)
        for name in ("left", "right", "between", "ratio"):
            table.add_column(name, justify="right")
        table.add_column("unit")
        for row in self.rows():
            numbers = (row.left, row.right, row.between, row.ratio)
            table.add_row(row.quantity, *("" if n is None else f"{n:.4g}" for n in numbers), row.unit)
        console.print(table)
        if self.verdict():
            console.print(self.verdict())


def _ratio(value: float, reference: float) -> Number:
    return value / reference if reference else None


def _plain(value: str | float) -> str | float:
    """JSON has no infinity."""
    return value if isinstance(value, str) or abs(value) < float("inf") else str(value)
