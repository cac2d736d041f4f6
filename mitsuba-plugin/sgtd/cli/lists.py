"""Options with several numbers: ``--theta 0 30 60``, which click alone has only in a fixed number."""

from __future__ import annotations

import math
from typing import Any

import click


class Numbers(click.ParamType):  # type: ignore[type-arg]
    """Finite numbers in a range, separated by commas."""

    name = "numbers"

    def __init__(self, least: float, most: float, count: tuple[int, int] = (1, 100), whole: bool = False) -> None:
        self.least, self.most, self.count, self.whole = least, most, count, whole

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        if isinstance(value, tuple):
            return value
        numbers = []
        for part in str(value).split(","):
            try:
                number = float(part)
            except ValueError:
                self.fail(f'"{part}" is not a number', param, ctx)
            if not (math.isfinite(number) and self.least <= number <= self.most):
                self.fail(f"{part} is not between {self.least:g} and {self.most:g}", param, ctx)
            if self.whole and number != int(number):
                self.fail(f"{part} is not a whole number", param, ctx)
            numbers.append(number)
        low, high = self.count
        if not low <= len(numbers) <= high:
            wanted = f"{low}" if low == high else f"{low} to {high}"
            self.fail(f"{len(numbers)} numbers were given, it takes {wanted}", param, ctx)
        return tuple(numbers)

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        return "NUMBER ..."


class CommandWithLists(click.Command):
    """Gives an option of type :class:`Numbers` all numbers that follow it."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        lists = {name for p in self.params if isinstance(p.type, Numbers) for name in p.opts}
        joined: list[str] = []
        k = 0
        while k < len(args):
            joined.append(args[k])
            k += 1
            if joined[-1] in lists:
                start = k
                while k < len(args) and _is_numbers(args[k]):
                    k += 1
                if k > start:
                    joined.append(",".join(args[start:k]))
        return super().parse_args(ctx, joined)


def _is_numbers(text: str) -> bool:
    try:
        [float(part) for part in text.split(",")]
    except ValueError:
        return False
    return True
