"""Climbs the family's tree: every row starts from its fitted children and keeps each as a candidate, so that none is worse than its child."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UserError
from .measurement import Measurement, has_azimuths
from .problem import Model, Problem
from .rows import ROWS, FamilySpace, ancestors
from .spaces import MixtureSpace, Space, TableSpace, table_space

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

AUTO = tuple(ROWS)
BEYOND = ("mixture", "tabulated")
NODES = 20
# Roughness that the lowest rows begin with
_ALPHAS = (0.02, 0.08, 0.25, 0.6)
_FIRST_STEPS = 25
# A table is searched in so many steps: its last ones gain nothing that a picture shows
_TABLE_STEPS = 25
_AZIMUTHS = (0.0, np.pi / 4.0, np.pi / 2.0, 3.0 * np.pi / 4.0)

# Blocks of directions that are left out together: neighbors in angle are no independent witnesses
_BLOCKS = (8, 4)
_FOLDS = 4
# In-sample gain below which a cross-validation is not worth its time
_LEAST_GAIN = 1e-3


@dataclass
class Fitted:
    """One distribution, fitted: variables ``x`` of its problem, and how far it is off."""

    space: Space
    problem: Problem
    x: Array
    cost: float
    #: of each block, the mean square that directions have which were left out of the fit; None if that was not asked for
    held_out: Array | None = None

    @property
    def name(self) -> str:
        return self.space.title

    @property
    def error(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(2.0 * self.cost / self.problem.target.size))


class Climb:
    """The rows of one measurement, each fitted once, lower ones first."""

    def __init__(
        self, data: Measurement, model: Model, weights: Array | None = None, anisotropic: bool | None = None
    ) -> None:
        self.data, self.model, self.weights = data, model, weights
        self.anisotropic = has_azimuths(data) if anisotropic is None else anisotropic
        self.found: dict[str, Fitted] = {}

    def problem(self, space: Space) -> Problem:
        return Problem(self.data, self.model, space, self.weights)

    def fit(self, name: str) -> Fitted:
        """A row with all rows below it, a table or a mixture."""
        if name not in self.found:
            if name == "tabulated":
                self.found[name] = self._table()
            elif name == "mixture":
                self.found[name] = self._mixture()
            elif name in ROWS:
                self.found[name] = self._row(name)
            else:
                raise UserError(f'model "{name}" is unknown: choose auto, {", ".join((*ROWS, *BEYOND))}')
        return self.found[name]

    def _row(self, name: str) -> Fitted:
        row = ROWS[name]
        space = FamilySpace(row, self.anisotropic)
        problem = self.problem(space)
        if not row.children:
            return self._lowest(space, problem)
        children = [self.fit(child) for child in row.children]
        kept: list[tuple[float, Array]] = []
        starts: list[Array] = []
        for child in children:
            values = child.space.values(child.x[: child.problem.count])  # type: ignore[union-attr]
            rest = child.x[child.problem.count :]
            # a child is a member of this row: the same numbers, hence the same cost
            here = np.concatenate([space.of(values), rest])
            kept.append((child.cost, here))
            starts.append(here)
        best = min(children, key=lambda child: child.cost)
        values = best.space.values(best.x[: best.problem.count])  # type: ignore[union-attr]
        starts += [np.concatenate([v, best.x[best.problem.count :]]) for v in space.starts(values)]
        return self._best(space, problem, starts, kept)

    def _best(self, space: Space, problem: Problem, starts: Sequence[Array], kept: list[tuple[float, Array]]) -> Fitted:
        """A few steps from every start, then the best of them to its end; those that are kept are candidates as they are."""
        tried = sorted((problem.search(x, 8, 1e-3) for x in starts), key=lambda found: found[1])
        x, cost = problem.search(tried[0][0])
        if len(tried) > 1 and tried[1][1] < 1.5 * tried[0][1]:
            other, its_cost = problem.search(tried[1][0])
            x, cost = (other, its_cost) if its_cost < cost else (x, cost)
        for its_cost, other in kept:
            if its_cost <= cost:
                x, cost = other, its_cost
        problem.settle(x)
        return Fitted(space, problem, x, cost)

    def _lowest(self, space: FamilySpace, problem: Problem) -> Fitted:
        colors, base = problem.start()
        starts = []
        for alpha in _ALPHAS:
            around = [np.array([0.3, angle]) for angle in _AZIMUTHS[:2]] if self.anisotropic else [np.empty(0)]
            starts += [np.concatenate([[np.log(alpha)], turn, colors, base]) for turn in around]
        others = [fitted for fitted in self.found.values() if not ROWS[fitted.name].children]
        starts += [fitted.x for fitted in others]
        return self._best(space, problem, starts, [])

    def _table(self) -> Fitted:
        below = min((self.fit(name) for name in ("gtd", "student")), key=lambda fitted: fitted.cost)
        for fitted in self.found.values():
            below = fitted if fitted.cost < below.cost and fitted.name in ROWS else below
        shape = below.x[: below.problem.count]
        ndf = below.space.ndf(shape, 1e-3)
        steepest = float(np.quantile(np.sqrt(1.0 / self.data.h[:, 2] ** 2 - 1.0), 0.995))
        space = table_space(ndf, steepest, NODES, self.anisotropic)
        problem = self.problem(space)
        start = space.of(ndf)
        if self.anisotropic:
            start[1] = below.space.rotation(shape)
        x, cost = problem.search(np.concatenate([start, below.x[below.problem.count :]]), _TABLE_STEPS, 1e-4)
        return Fitted(space, problem, x, cost)

    def _mixture(self) -> Fitted:
        if self.anisotropic:
            raise UserError("a mixture has one roughness: choose a row or tabulated for data with azimuths")
        student = self.fit("student")
        space = MixtureSpace()
        problem = self.problem(space)
        values = student.space.values(student.x[: student.problem.count])  # type: ignore[union-attr]
        rest = student.x[student.problem.count :]
        starts = [np.concatenate([v, rest]) for v in space.starts(values)]
        # without a haze it is Student's
        alone = np.concatenate([[values["ln_alpha"], 0.0, -9.0, values["s"], values["s"]], rest])
        return self._best(space, problem, starts, [(problem.cost(alone), alone)])


def blocks(data: Measurement) -> NDArray[np.int64]:
    """Number of the block of each direction: by the angle of the half vector, and of the light to it."""
    theta = np.arccos(np.clip(data.h[:, 2], 0.0, 1.0))
    within = np.arccos(data.cos_d)
    rows, columns = _BLOCKS
    ranks = [
        np.argsort(np.argsort(a, kind="stable"), kind="stable") * n // len(a)
        for a, n in ((theta, rows), (within, columns))
    ]
    return np.asarray(ranks[0] * columns + ranks[1], dtype=np.int64)


def cross_validate(fitted: Fitted, block: NDArray[np.int64]) -> Array:
    """Of each block, the mean square of its residuals after a fit to the other folds; fits start from that to all."""
    numbers = np.unique(block)
    # neighbors in angle go to different folds, so that none has to be extrapolated far
    fold_of = {number: (number // _BLOCKS[1] + number) % _FOLDS for number in numbers}
    fold = np.array([fold_of[number] for number in block])
    squares = np.zeros(len(block))
    problem = fitted.problem
    for k in range(_FOLDS):
        weights = (fold != k).astype(np.float64)
        if not weights.any() or weights.all():
            continue
        part = Problem(problem.data.only(fold != k), problem.model, problem.space)
        steps = _TABLE_STEPS if isinstance(fitted.space, TableSpace) else _FIRST_STEPS
        x, _ = part.search(fitted.x, steps, 1e-3)
        problem.settle(x)
        residual = problem.residual(x).reshape(problem.target.shape)
        squares[fold == k] = (residual[fold == k] ** 2).mean(axis=1)
    problem.settle(fitted.x)
    return np.array([squares[block == number].mean() for number in numbers])


def better(one: Array, other: Array) -> float:
    """By how many standard errors the second is better than the first, over blocks."""
    gain = one - other
    error = float(gain.std(ddof=1) / np.sqrt(len(gain)))
    return float(gain.mean() / error) if error > 0.0 else 0.0


def select(climb: Climb, names: Sequence[str] = AUTO, beyond: Sequence[str] = BEYOND) -> str:
    """Fits all, and climbs: the row whose every parameter pays, then the table or the mixture if they do."""
    for name in names:
        climb.fit(name)
    for name in beyond:
        if not (name == "mixture" and climb.anisotropic):
            climb.fit(name)
    block = blocks(climb.data)

    def held_out(name: str) -> Array:
        fitted = climb.found[name]
        if fitted.held_out is None:
            fitted.held_out = cross_validate(fitted, block)
        return fitted.held_out

    def pays(name: str, current: str) -> bool:
        if climb.found[name].cost > (1.0 - _LEAST_GAIN) * climb.found[current].cost:
            return False
        return better(held_out(current), held_out(name)) > 1.0

    leaves = [name for name in names if not ROWS[name].children]
    current = min(leaves, key=lambda name: climb.found[name].cost)
    while True:
        above = [name for name in ancestors(current) if name in climb.found]
        above.sort(key=lambda name: (ROWS[name].count, climb.found[name].cost))
        step = next((name for name in above if pays(name, current)), None)
        if step is None:
            break
        current = step
    for name in beyond:
        if name in climb.found and pays(name, current):
            current = name
    return current
