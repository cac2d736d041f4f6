"""What a fit of slopes has found."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..fitting import material
from ..fitting.uncertainty import Parameter
from ..ndf import Ndf
from .climb import Fitted
from .likelihood import log_density

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class SlopeScore:
    """One row: log-likelihoods a sample, of all slopes, and of each half by a fit to the other (NaN if that was not asked for)."""

    model: str
    log_likelihood: float
    held_out: float
    parameters: int
    seconds: float
    chosen: bool


@dataclass(frozen=True)
class SlopeFit:
    """A row of the family with two roughnesses and the direction of the first of them."""

    title: str
    model: str
    ndf: Ndf
    #: degrees from x to the axis u of ``alpha_u``, counterclockwise
    rotation: float
    parameters: tuple[Parameter, ...]
    #: a sample, in nats per unit of slope squared
    log_likelihood: float
    scores: tuple[SlopeScore, ...]
    #: Kolmogorov–Smirnov distance between the lengths of the slopes and the distribution
    ks: float
    count: int
    tilt: tuple[float, float]
    notes: tuple[str, ...]
    fitted: Mapping[str, Fitted]

    def log_density(self, sx: ArrayLike, sy: ArrayLike) -> Array:
        """ln of the density of slopes."""
        x, y = (np.asarray(s, dtype=np.float64) for s in (sx, sy))
        logs = log_density(self.ndf, math.radians(self.rotation), np.hypot(x, y).ravel(), np.arctan2(y, x).ravel())
        return logs.reshape(np.broadcast_shapes(x.shape, y.shape))

    @property
    def properties(self) -> dict[str, Any]:
        """A mirror of this distribution: slopes do not say what a surface is made of."""
        fitted = self.fitted[self.model]
        return {"type": "sgtdconductor", "material": "none", **fitted.likelihood.space.properties(fitted.v)}

    def to_dict(self) -> dict[str, Any]:
        """The material for ``mi.load_dict``."""
        return material.to_dict(self.properties)

    def to_xml(self) -> str:
        """The material as a file for ``<include>``."""
        notes = [
            f"{self.title}: {self.model} by sgtd fit, KS {self.ks:.2g}",
            'a mirror: slopes do not say what the surface is made of. Write eta and k, or another material than "none"',
            f"alpha_u lies {self.rotation:.4g} degrees counterclockwise from x: turn the tangents (the UV) of the surface by that much",
        ]
        return material.to_xml(self.properties, tuple([*notes, *self.notes]))

    def as_json(self) -> str:
        """Everything but the slopes."""
        content = {
            "model": self.model,
            "parameters": {p.name: {k: v for k, v in asdict(p).items() if k != "name"} for p in self.parameters},
            "not_identifiable": [p.name for p in self.parameters if p.status == "not identifiable"],
            "log_likelihood": self.log_likelihood,
            "ks": self.ks,
            "slopes": self.count,
            "tilt": list(self.tilt),
            "notes": list(self.notes),
            "material": self.properties,
            "scores": [
                {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(score).items()}
                for score in self.scores
            ],
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"
