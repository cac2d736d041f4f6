"""What a user says about a fit, as JSON holds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Optional

from ..fitting import Model


@dataclass(frozen=True)
class Options:
    """Of reflectance: ``model``, ``base``, ``fresnel``, ``loss``, ``max_angle``, ``masking``, ``anisotropic``; of heights ``model``, ``level``,
    ``spacing``, ``gray``."""

    model: tuple[str, ...] = ("auto",)
    base: str = "diffuse"
    fresnel: str = "schlick"
    loss: str = "log"
    max_angle: float = 80.0
    masking: str = "separable"
    anisotropic: Optional[bool] = None
    level: bool = False
    spacing: Optional[tuple[float, float]] = None
    gray: Optional[tuple[float, float]] = None

    @property
    def setting(self) -> Model:
        """How reflectance is modelled."""
        return Model(self.base, self.fresnel, self.loss, self.masking)

    def as_json(self) -> dict[str, Any]:
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Options:
        plain: dict[str, Any] = {name: tuple(x) if isinstance(x, list) else x for name, x in given.items()}
        return cls(**plain)
