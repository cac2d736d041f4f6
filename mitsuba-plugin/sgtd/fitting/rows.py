"""The rows that are fitted, the tree that they make, and the coordinates in which each is searched.

================  ==============================  =====================================================================
parameter         variable                        why
================  ==============================  =====================================================================
``gamma``         s: 1/gamma = s min(1, 2 p / 3)  every s below 1 is a member with finite masking; 0 is gamma = inf
``p``             ln p                            its effect is one of proportions
``lambda``        itself
``shift``         itself                          0 is a limit that materials sit at
``alpha``         ln alpha
``alpha_u / v``   half of ln(alpha_u / alpha_v)   0 is isotropic
rotation          itself, radians
================  ==============================  =====================================================================
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..ndf import Ndf

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: s at which masking is still finite by a margin that single precision holds: 2 p gamma = 3.046
GREATEST_TAIL = 0.985

_LIMITS = {
    "s": (0.0, GREATEST_TAIL),
    "ln_p": (math.log(0.15), math.log(30.0)),
    "lambda": (-0.95, 0.95),
    "shift": (0.0, 30.0),
    "ln_alpha": (math.log(5e-4), math.log(3.0)),
    "ln_ratio": (-2.5, 2.5),
    "rotation": (-math.inf, math.inf),
}


@dataclass(frozen=True)
class Row:
    """A row by what it leaves free; ``children`` are the rows it has as special cases, one step down."""

    name: str
    free: tuple[str, ...]
    fixed: Mapping[str, float]
    children: tuple[str, ...]
    title: str

    @property
    def count(self) -> int:
        """Free parameters of the shape."""
        return len(self.free)


_SKEW = ("lambda", "shift")
ROWS: dict[str, Row] = {
    row.name: row
    for row in (
        Row("beckmann", (), {"s": 0.0, "ln_p": 0.0}, (), "Beckmann"),
        Row("ggx", (), {"s": 0.75, "ln_p": 0.0}, (), "GGX"),
        Row("student", ("s",), {"ln_p": 0.0}, ("ggx", "beckmann"), "Student"),
        Row("gnd", ("ln_p",), {"s": 0.0}, ("beckmann",), "GND"),
        Row("snd", _SKEW, {"s": 0.0, "ln_p": 0.0}, ("beckmann",), "SND"),
        Row("gtd", ("s", "ln_p"), {}, ("student", "gnd"), "GTD"),
        Row("std", ("s", *_SKEW), {"ln_p": 0.0}, ("student", "snd"), "STD"),
        Row("sgnd", ("ln_p", *_SKEW), {"s": 0.0}, ("gnd", "snd"), "SGND"),
        Row("sgtd", ("s", "ln_p", *_SKEW), {}, ("gtd", "std", "sgnd"), "SGTD"),
    )
}

#: other shapes from which a search begins, beside the children: the tails that measured lobes have, which no child is near to
_STARTS: dict[str, tuple[dict[str, float], ...]] = {
    "student": ({"s": 0.95},),
    "gtd": ({"s": 0.97, "ln_p": -0.9, "ln_alpha": -1.5}, {"s": 0.93, "ln_p": 0.2}),
    "gnd": ({"ln_p": -0.8, "ln_alpha": -1.0},),
    "snd": ({"shift": 0.7, "lambda": 0.0},),
    "std": ({"shift": 0.7, "lambda": 0.0},),
    "sgnd": ({"shift": 0.7, "lambda": 0.0},),
    "sgtd": ({"shift": 0.7, "lambda": 0.0},),
}


@dataclass(frozen=True)
class FamilySpace:
    """The variables of one row, at one roughness or two and a rotation of the frame."""

    row: Row
    anisotropic: bool = False

    @property
    def title(self) -> str:
        return self.row.name

    @property
    def names(self) -> tuple[str, ...]:
        return ("ln_alpha", *(("ln_ratio", "rotation") if self.anisotropic else ()), *self.row.free)

    @property
    def bounds(self) -> tuple[Array, Array]:
        low, high = np.transpose([_LIMITS[name] for name in self.names])
        return low, high

    def values(self, v: Array) -> dict[str, float]:
        """All variables, the fixed ones too."""
        both = {"ln_ratio": 0.0, "rotation": 0.0, "lambda": 0.0, "shift": 0.0, **self.row.fixed}
        return {**both, **dict(zip(self.names, map(float, v)))}

    def of(self, values: Mapping[str, float]) -> Array:
        """The variables of a member: of this row, if it is one."""
        return np.array([values[name] for name in self.names])

    def starts(self, values: Mapping[str, float]) -> list[Array]:
        """Where else to begin, given a child's variables: roughness is moved, the rest replaced."""
        found = []
        for start in _STARTS.get(self.row.name, ()):
            moved = {**values, **start, "ln_alpha": values["ln_alpha"] + start.get("ln_alpha", 0.0)}
            found.append(self.of(moved))
        return found

    def shape(self, v: Array) -> dict[str, float]:
        """The parameters as the plugins name them."""
        at = self.values(v)
        p = math.exp(at["ln_p"])
        inverse = at["s"] * min(1.0, 2.0 * p / 3.0)
        alpha, ratio = math.exp(at["ln_alpha"]), math.exp(at["ln_ratio"])
        result = {"gamma": 1.0 / inverse if inverse > 1e-9 else math.inf, "p": p}
        result |= {"lambda": at["lambda"], "shift": at["shift"]}
        return result | ({"alpha_u": alpha * ratio, "alpha_v": alpha / ratio} if self.anisotropic else {"alpha": alpha})

    def rotation(self, v: Array) -> float:
        return self.values(v)["rotation"]

    def ndf(self, v: Array, accuracy: float) -> Ndf:
        shape = self.shape(v)
        lam, gamma, p, shift = (shape.pop(name) for name in ("lambda", "gamma", "p", "shift"))
        return Ndf(gamma=gamma, p=p, lam=lam, shift=shift, accuracy=accuracy, **shape)  # type: ignore[arg-type]

    def properties(self, v: Array) -> dict[str, Any]:
        """What a scene says: the row, and what it leaves free."""
        shape = self.shape(v)
        row = self.row
        keep = {"s": "gamma", "ln_p": "p", "lambda": "lambda", "shift": "shift"}
        free = {keep[name]: shape[keep[name]] for name in row.free}
        if "gamma" in free and math.isinf(free["gamma"]):
            # a scene's row with an infinite gamma is the row without it
            free["gamma"] = 1e9
        alphas = {name: value for name, value in shape.items() if name.startswith("alpha")}
        # Mitsuba masks its own Beckmann by a fit: the same shape by another row is exact
        name = "gnd" if row.name == "beckmann" else row.name
        free = {"p": 1.0} if row.name == "beckmann" else free
        return {"distribution": name, **alphas, **free}


def ancestors(name: str) -> tuple[str, ...]:
    """All rows that have this one as a special case."""
    above = [row.name for row in ROWS.values() if name in row.children]
    return tuple(dict.fromkeys([*above, *(far for near in above for far in ancestors(near))]))
