"""``sgtd.fit``: from reflectance to a material."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UserError, require
from ..ndf import Ndf
from . import fresnel, material
from .measurement import Measurement, measurement, usable
from .problem import BASES, LOSSES, MASKINGS, Model, Prediction
from .rows import ROWS
from .tree import AUTO, BEYOND, Climb, Fitted, select
from .uncertainty import Uncertainty, uncertainty

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

#: A fit leaves this much of what a constant leaves where light comes back to its source, and this much more than elsewhere: no microfacets
_BACKWARD = 0.25
_FACTOR = 3.0
# Degrees between light and view that count as backward, and the shift of the half vector from the normal that makes it no highlight
_BACK_ANGLE, _OFF_NORMAL = 15.0, 20.0


@dataclass(frozen=True)
class Score:
    """One row that was tried."""

    model: str
    error: float
    relative: float
    #: root mean square of what was left out of the fit; NaN if that was not asked for
    held_out: float
    parameters: int
    seconds: float
    chosen: bool


@dataclass(frozen=True)
class Fit:
    """What :func:`fit` found."""

    #: the row, ``tabulated`` or ``mixture``
    model: str
    #: how reflectance was modelled
    setting: Model
    #: of the shape and the frame, as the plugins name them; the rotation in degrees
    parameters: dict[str, float]
    #: root mean square of the residuals in the loss that was asked for
    error: float
    scores: tuple[Score, ...]
    uncertainty: Uncertainty
    prediction: Prediction
    #: plugin and properties
    properties: dict[str, Any]
    #: what was used
    data: Measurement
    #: what one should know of data and fit
    warnings: tuple[str, ...]
    fitted: dict[str, Fitted]

    @property
    def ndf(self) -> Ndf:
        """The distribution."""
        return self.prediction.ndf

    def predict(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Reflectance (n, channels) per steradian that the material has, without the cosine; ``wi`` and ``wo`` (n, 3)."""
        return self.prediction(np.asarray(wi, dtype=np.float64), np.asarray(wo, dtype=np.float64))

    def to_dict(self) -> dict[str, Any]:
        """The material for ``mi.load_dict``."""
        return material.to_dict(self.properties)

    def to_xml(self) -> str:
        """The material as a file for ``<include>``."""
        notes = [f"{self.data.title}: {self.model} by sgtd fit, error {self.error:.4g} ({self.setting.loss})"]
        rotation = self.parameters.get("rotation", 0.0)
        if rotation:
            notes.append(
                f"alpha_u lies {rotation:.4g} degrees counterclockwise from the x axis of the data: turn the tangents (the UV) of the surface by that much"
            )
        return material.to_xml(self.properties, tuple([*notes, *self.warnings]))

    def as_json(self) -> str:
        """Everything but the data."""
        uncertain = self.uncertainty
        content = {
            "model": self.model,
            "setting": asdict(self.setting),
            "error": self.error,
            "parameters": {
                p.name: {k: _jsonable(v) for k, v in asdict(p).items() if k != "name"} for p in uncertain.parameters
            },
            "not_identifiable": list(uncertain.unknown),
            "correlations": {"names": list(uncertain.names), "matrix": np.round(uncertain.correlations, 6).tolist()},
            "material": {k: list(v) if isinstance(v, tuple) else v for k, v in self.properties.items()},
            "data": {
                "title": self.data.title,
                "pairs": len(self.data.value),
                "channels": list(self.data.channels),
                "notes": list(self.data.notes),
            },
            "warnings": list(self.warnings),
            "scores": [{k: _jsonable(v) for k, v in asdict(score).items()} for score in self.scores],
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _jsonable(value: Any) -> Any:
    return (
        None
        if isinstance(value, float) and math.isnan(value)
        else "inf"
        if value == math.inf or value == 1e308
        else value
    )


def fit(
    wi: ArrayLike,
    wo: ArrayLike,
    value: ArrayLike,
    *,
    model: str | Sequence[str] = "auto",
    base: str = "diffuse",
    fresnel: str = "schlick",
    loss: str = "log",
    max_angle: float = 80.0,
    masking: str = "separable",
    anisotropic: bool | None = None,
    title: str = "data",
    channels: tuple[str, ...] = (),
) -> Fit:
    """Fits a material to reflectance ``value`` (n,) or (n, channels), per steradian and without the cosine, for light from ``wi`` and views
    along ``wo``, unit vectors (n, 3) with z along the normal.

    ================  =========================================================================================================
    ``model``         ``"auto"`` climbs the family's tree and takes what cross-validation pays for; or a row, ``"tabulated"``,
                      ``"mixture"``
    ``base``          ``"diffuse"``: a plastic; ``"none"``: a metal, whose lobe is all there is
    ``fresnel``       ``"schlick"``: one number for each channel, the reflectance along the normal, with Fresnel's equations of the real index
                      that has it (at least 1.3); ``"dielectric"``: one index and a factor for each channel; ``"conductor"``: a complex index
                      for each channel, with ``base="none"``
    ``loss``          of value times cosine v: ``"log"`` is ln(1 + v), ``"cbrt"`` the cube root, ``"l2"`` v itself
    ``max_angle``     degrees from the normal up to which directions count
    ``masking``       ``"separable"`` or ``"height_correlated"``
    ``anisotropic``   two roughnesses and a rotation; by default if light comes from several azimuths and two are better by cross-validation
    ================  =========================================================================================================

    Raises ``UserError``, a ``ValueError``, for arguments that mean nothing and data that cannot be fitted.
    """
    return fit_measurement(
        measurement(wi, wo, value, title=title, channels=channels),
        model=model,
        setting=Model(base, fresnel, loss, masking),
        max_angle=max_angle,
        anisotropic=anisotropic,
    )


def check(setting: Model, model: str | Sequence[str]) -> tuple[str, ...]:
    """The names that are to be fitted."""
    for name, given, known in (
        ("base", setting.base, BASES),
        ("fresnel", setting.fresnel, fresnel.KINDS),
        ("loss", setting.loss, LOSSES),
        ("masking", setting.masking, MASKINGS),
    ):
        if given not in known:
            raise UserError(f'{name} "{given}" is unknown: choose {", ".join(known)}')
    if setting.base == "diffuse" and setting.fresnel == "conductor":
        raise UserError('a conductor has no diffuse base: give base "none", or another fresnel')
    names = (model,) if isinstance(model, str) else tuple(model)
    for name in names:
        if name != "auto" and name not in ROWS and name not in BEYOND:
            raise UserError(f'model "{name}" is unknown: choose auto, {", ".join((*ROWS, *BEYOND))}')
    return names


def fit_measurement(
    data: Measurement,
    *,
    model: str | Sequence[str] = "auto",
    setting: Model = Model(),
    max_angle: float = 80.0,
    anisotropic: bool | None = None,
) -> Fit:
    """:func:`fit` of data that were read from a file."""
    require("fit")
    names = check(setting, model)
    material.check_channels(data.value.shape[1], data.title)
    used = usable(data, max_angle)
    climb = _Timed(used, setting, anisotropic)
    if names == ("auto",):
        chosen = select(climb, AUTO, BEYOND)
    else:
        for name in names:
            climb.fit(name)
        chosen = min(names, key=lambda name: climb.found[name].cost)
    best = climb.found[chosen]
    prediction = best.problem.prediction(best.x)
    uncertain = uncertainty(best)
    shape = best.x[: best.problem.count]
    parameters = {p.name: p.value for p in uncertain.parameters}
    return Fit(
        chosen,
        setting,
        parameters,
        best.error,
        _scores(climb, chosen),
        uncertain,
        prediction,
        material.properties(best.space, shape, prediction),
        used,
        (*used.notes, *_warnings(best, prediction, climb)),
        climb.found,
    )


class _Timed(Climb):
    """Knows how long each row took, without those below it."""

    def __init__(self, data: Measurement, model: Model, anisotropic: bool | None) -> None:
        super().__init__(data, model, anisotropic=anisotropic)
        self.seconds: dict[str, float] = {}

    def fit(self, name: str) -> Fitted:
        known = name in self.found
        inner = sum(self.seconds.values())
        start = time.perf_counter()
        found = super().fit(name)
        if not known:
            self.seconds[name] = time.perf_counter() - start - (sum(self.seconds.values()) - inner)
        return found


def _scores(climb: _Timed, chosen: str) -> tuple[Score, ...]:
    reference = climb.found.get("ggx") or min(climb.found.values(), key=lambda fitted: len(fitted.x))
    rows = []
    for name, fitted in climb.found.items():
        held_out = float("nan") if fitted.held_out is None else float(np.sqrt(fitted.held_out.mean()))
        relative = fitted.error / reference.error if reference.error > 0.0 else 1.0
        rows.append(
            Score(name, fitted.error, relative, held_out, len(fitted.x), climb.seconds.get(name, 0.0), name == chosen)
        )
    return tuple(rows)


def _warnings(best: Fitted, prediction: Prediction, climb: Climb) -> list[str]:
    found = []
    text = backward(best)
    if text:
        found.append(text)
    gtd = climb.found.get("gtd")
    if gtd is not None and gtd.space.values(gtd.x[: gtd.problem.count])["s"] > 0.98:  # type: ignore[union-attr]
        found.append(
            "the tail is as flat as Smith's masking admits (2 p gamma = 3): it ends somewhere beyond the data, and a table that is cut there may serve better"
        )
    return found


def backward(fitted: Fitted) -> str:
    """One sentence if light comes back to its source as from no microfacet; else nothing.

    A highlight is bright where the half vector is near the normal. Around the light's own direction, away from the normal, a lobe of microfacets
    has next to nothing: residuals that are high there, on one side and not in the rest of oblique directions, are retro-reflection.
    """
    data, problem = fitted.problem.data, fitted.problem
    between = np.degrees(2.0 * np.arccos(data.cos_d))
    tilt = np.degrees(np.arccos(np.clip(data.h[:, 2], 0.0, 1.0)))
    back = (between < _BACK_ANGLE) & (tilt > _OFF_NORMAL)
    rest = (between >= 2.0 * _BACK_ANGLE) & (tilt > _OFF_NORMAL)
    if back.sum() < 4 or rest.sum() < 4:
        return ""
    measured = data.value.mean(axis=1)
    predicted = problem.value(fitted.x).mean(axis=1)
    excess = (measured - predicted)[back].mean()
    level = np.median(measured[rest])
    gone = excess / max(measured[back].mean(), 1e-12)
    around = float(np.abs((measured - predicted)[rest]).mean() / max(level, 1e-12))
    ratio = measured[back].mean() / max(level, 1e-12)
    if gone > _BACKWARD and ratio > 1.5 and excess / max(level, 1e-12) > _FACTOR * min(around, 0.3):
        return (
            f"the data are retro-reflective: towards the light (within {_BACK_ANGLE:g}°, off the normal) they are {ratio:.2g} times as bright as at other oblique "
            f"angles, and the fit lacks {100 * gone:.0f} % of that; no distribution of microfacets reflects light back to its source, so none fits these data"
        )
    return ""
