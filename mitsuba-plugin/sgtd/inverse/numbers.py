"""The logarithms of a table's values, or of a mixture's weights and roughnesses, as what an optimizer moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

#: Lists of numbers that can be recovered, by the names that ``mi.traverse`` shows.
LISTS = ("values", "weights", "alphas")
# Of these a common factor says nothing: the greatest number is held.
_PROPORTIONS = ("values", "weights")


class Numbers:
    """The unknown numbers of ``values``, ``weights`` and ``alphas``, from given ones on; each is called ``values[3]`` or the like.

    A number of 0 stays 0. Of ``values`` and of ``weights`` the greatest is held, as only proportions count.
    """

    def __init__(self, start: Mapping[str, ArrayLike]) -> None:
        self.start: dict[str, Array] = {}
        unknown: list[str] = []
        for name, given in start.items():
            numbers = np.array(given, dtype=np.float64)
            if numbers.ndim != 1 or not np.isfinite(numbers).all() or numbers.min() < 0.0 or not numbers.any():
                raise ValueError(f"{name}: must be a list of finite numbers of at least 0, one of them positive")
            self.start[name] = numbers
            held = int(np.argmax(numbers)) if name in _PROPORTIONS else -1
            unknown += [f"{name}[{k}]" for k in np.flatnonzero(numbers) if k != held]
        if not unknown:
            raise ValueError("there is nothing to recover: one number that is not 0 says no more than that it is one")
        self.unknown = tuple(unknown)
        self.fixed: dict[str, float] = {}

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Variables have none."""
        return np.full(len(self.unknown), -np.inf), np.full(len(self.unknown), np.inf)

    def from_parameters(self, parameters: Mapping[str, float]) -> Array:
        """The logarithms of these numbers."""
        return np.log([parameters[name] for name in self.unknown])

    def to_parameters(self, variables: Sequence[float] | Array) -> dict[str, float]:
        """The unknown numbers."""
        return dict(zip(self.unknown, np.exp(np.asarray(variables)).tolist()))

    def jacobian(self, variables: Array) -> Array:
        """d number (row) / d variable (column)."""
        return np.diag(np.exp(variables))


def flat(lists: Mapping[str, Array]) -> dict[str, float]:
    """All numbers of lists, by their names."""
    return {f"{name}[{k}]": float(number) for name, numbers in lists.items() for k, number in enumerate(numbers)}


def gathered(lists: Mapping[str, Array], numbers: Mapping[str, float]) -> dict[str, Array]:
    """The same lists with other numbers in them."""
    result = {}
    for name, given in lists.items():
        result[name] = np.array([numbers.get(f"{name}[{k}]", number) for k, number in enumerate(given)])
    return result
