"""Columns by name as directions: ``theta_i``, ``phi_i``, ``theta_o``, ``phi_o`` and channels, or scans in the plane of incidence."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Optional

import numpy as np

from ..errors import UserError
from ..fitting.measurement import Measurement, measurement
from .half_difference import spherical

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Says where a row of the columns stands in its file
Place = Callable[[int], str]

_ANGLE = re.compile(
    r"(theta|phi)_?(?:(i|in|inc|incident|l|light)|(o|out|r|refl|reflected|s|scatter|v|view))?(?:_?(deg|degrees|rad|radians))?"
)
_UNITS = {"deg": 1.0, "degrees": 1.0, "rad": 180.0 / np.pi, "radians": 180.0 / np.pi}
#: names of channels that hold reflectance times the cosine of the view
_WITH_COSINE = ("ccbrdf", "brdf_cos", "brdfcos", "value_cos", "f_cos", "fcos", "brdf*cos")
_NEEDED = "theta_i, phi_i, theta_o, phi_o and channels; or theta_i, theta_o with the sign of its side, and channels"
# A sign convention is doubted if the other side is so many times as bright
_BRIGHTER = 2.0


def normal_name(text: str) -> str:
    """Lower case, units without brackets, no spaces."""
    plain = re.sub(r"[\[\]()°]", " ", text.strip().strip('"').lower()).strip()
    return re.sub(r"[\s\-]+", "_", plain)


def looks_like_header(names: list[str]) -> bool:
    return any(_angle(normal_name(name)) for name in names)


def _angle(name: str) -> Optional[tuple[str, Optional[str]]]:
    """``theta_i`` and the like, and the unit."""
    found = _ANGLE.fullmatch(name)
    if not found:
        return None
    kind, light, view, unit = found.groups()
    # a theta alone is that of the view
    return (f"{kind}_{'i' if light else 'o'}", unit)


def from_columns(path: Path, columns: Mapping[str, Array], told: Mapping[str, float], place: Place) -> Measurement:
    """``told`` are angles that the whole file shares, by name, and ``unit``: degrees in one unit of an angle."""
    angles: dict[str, Array] = {}
    units: set[float] = set()
    channels: dict[str, Array] = {}
    for label, values in columns.items():
        angle = _angle(normal_name(label))
        if angle is None:
            channels[label.strip().strip('"')] = values
            continue
        name, unit = angle
        if name in angles:
            raise UserError(f'{path}: two columns are {name}, the second is "{label}": leave one out')
        angles[name] = values
        if unit:
            units.add(_UNITS[unit])
    count = len(next(iter(columns.values())))
    for name in ("theta_i", "phi_i", "phi_o"):
        if name in told and name not in angles:
            angles[name] = np.full(count, told[name])
    for name in ("theta_i", "theta_o"):
        if name not in angles:
            raise UserError(f"{path}: no column {name}: name the columns in the first line: {_NEEDED}")
    if ("phi_i" in angles) and ("phi_o" not in angles):
        raise UserError(f"{path}: phi_i without phi_o: name the columns in the first line: {_NEEDED}")
    if not channels:
        raise UserError(f"{path}: no column with values: name the columns in the first line: {_NEEDED}")
    notes: list[str] = []
    scale = _unit(path, angles, units, told, notes)
    angles = {name: scale * a for name, a in angles.items()}
    values = np.stack(list(channels.values()), axis=1)
    for name in ("theta_i", "theta_o"):
        wrong = np.abs(angles[name]) > 180.0
        if wrong.any():
            row = int(np.argmax(wrong))
            raise UserError(
                f"{path}: {place(row)}: {name} is {angles[name][row]:.6g} degrees: polar angles are between -90 and 90 (180 from below)"
            )
    in_plane = "phi_o" not in angles
    turned = _turned_scans(angles) if in_plane else None
    if in_plane:
        # ASTM E2387: the mirror's side has the sign of theta_i; azimuth 180 is away from the light
        phi_i, phi_o = np.zeros(count), np.where(np.sign(angles["theta_o"]) * _side(angles["theta_i"]) >= 0, 180.0, 0.0)
        theta_i, theta_o = np.abs(angles["theta_i"]), np.abs(angles["theta_o"])
        notes.append("scans in the plane of incidence: views on the mirror's side have the sign of theta_i")
    else:
        phi_i, phi_o = angles.get("phi_i", np.zeros(count)), angles["phi_o"]
        theta_i, theta_o = angles["theta_i"], angles["theta_o"]
    wi, wo = (spherical(np.radians(t), np.radians(p)) for t, p in ((theta_i, phi_i), (theta_o, phi_o)))
    names = tuple(channels)
    if all(normal_name(name) in _WITH_COSINE for name in names):
        cos = wo[:, 2:]
        values = np.where(cos > 1e-3, values / np.where(cos > 1e-3, cos, 1.0), 0.0)
        notes.append(f"{', '.join(names)}: reflectance times the cosine of the view, which was divided out")
    notes += _mirror_side(wi, wo, values, turned)
    isotropic = "phi_i" not in angles
    order = _red_green_blue(names)
    if order is not None:
        values, names = values[:, order], ("R", "G", "B")
    return measurement(wi, wo, values, title=path.name, channels=names, isotropic=isotropic, notes=tuple(notes))


def _side(theta_i: Array) -> Array:
    """The sign of the light; one along the normal counts as positive."""
    return np.where(theta_i < 0.0, -1.0, 1.0)


def _turned_scans(angles: Mapping[str, Array]) -> str:
    return (
        "change the sign of theta_o"
        if (angles["theta_o"] < 0.0).any()
        else "give views towards the light a negative theta_o"
    )


def _unit(
    path: Path, angles: Mapping[str, Array], units: set[float], told: Mapping[str, float], notes: list[str]
) -> float:
    """Degrees in one unit of the angles, said by the file or by their size."""
    if len(units) > 1:
        raise UserError(f"{path}: some angles are in degrees and some in radians: give all of them in one unit")
    if units or "unit" in told:
        return units.pop() if units else told["unit"]
    most = max(float(np.abs(angles[name]).max()) for name in ("theta_i", "theta_o"))
    if most <= 0.5 * np.pi + 1e-6:
        notes.append(
            f"angles are taken as radians, because none of theta is above {most:.3g}: write theta_i_deg if they are degrees"
        )
        return _UNITS["rad"]
    notes.append("angles are taken as degrees")
    return 1.0


def _mirror_side(wi: Array, wo: Array, values: Array, turned: Optional[str]) -> list[str]:
    """A remark if what looks like the highlight lies on the side of the light: azimuths may be counted from the mirror direction."""
    oblique = (wi[:, 2] < 0.98) & (wo[:, 2] > 0.05)
    mirrored, same = wi * np.array([-1.0, -1.0, 1.0]), wi
    near = [oblique & (np.sum(wo * target, axis=1) > np.cos(np.radians(8.0))) for target in (mirrored, same)]
    if near[0].sum() < 2 or near[1].sum() < 2:
        return []
    forward, backward = (float(values[k].mean()) for k in near)
    if not backward > _BRIGHTER * forward:
        return []
    remedy = turned or "add 180 degrees to phi_o"
    return [
        f"around the direction of the light values are {backward / max(forward, 1e-12):.3g} times those around the mirror direction: either the "
        f"material is retro-reflective, or azimuths are counted from the mirror direction ({remedy})"
    ]


def _red_green_blue(names: tuple[str, ...]) -> Optional[list[int]]:
    """Places of red, green and blue, if the three channels are these."""
    if len(names) != 3:
        return None
    letters = [re.sub(r".*_", "", normal_name(name))[:1] for name in names]
    return [letters.index(k) for k in "rgb"] if sorted(letters) == ["b", "g", "r"] else None
