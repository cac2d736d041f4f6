"""A fit as a material: a dictionary for Mitsuba, and an XML file that a scene includes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ..errors import UserError
from .fresnel import Fresnel
from .problem import Prediction
from .spaces import Space

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def properties(space: Space, shape: Array, found: Prediction) -> dict[str, Any]:
    """Plugin and properties; colors are tuples of one or three numbers."""
    interface = found.interface
    result: dict[str, Any] = {"type": "sgtdplastic" if found.base is not None else "sgtdconductor"}
    result |= space.properties(shape)
    if found.masking != "separable":
        result["masking"] = found.masking
    if found.base is not None:
        result |= {"int_ior": float(interface.eta[0]), "ext_ior": 1.0, "diffuse_reflectance": tuple(found.diffuse)}
        result["specular_reflectance"] = tuple(interface.factor)
    else:
        result |= {"eta": tuple(interface.eta), "k": tuple(interface.k)}
        if not np.array_equal(interface.factor, np.ones_like(interface.factor)):
            result["specular_reflectance"] = tuple(interface.factor)
    return result


def to_dict(given: dict[str, Any]) -> dict[str, Any]:
    """For ``mi.load_dict``."""
    return {name: _color(value) if isinstance(value, tuple) else value for name, value in given.items()}


def _color(value: tuple[float, ...]) -> dict[str, Any]:
    if len(value) == 1:
        return {"type": "uniform", "value": float(value[0])}
    return {"type": "rgb", "value": [float(x) for x in value]}


def to_xml(given: dict[str, Any], notes: tuple[str, ...] = (), name: str = "material") -> str:
    """A scene of one material, for ``<include filename="material.xml"/>`` and ``<ref id="material"/>``."""
    lines = ['<scene version="3.0.0">', *(f"    <!-- {_comment(note)} -->" for note in notes)]
    lines.append(f"    <bsdf type={quoteattr(given['type'])} id={quoteattr(name)}>")
    for key, value in given.items():
        if key != "type":
            lines.append(f"        {_element(key, value)}")
    return "\n".join([*lines, "    </bsdf>", "</scene>"]) + "\n"


def _element(key: str, value: Any) -> str:
    name = quoteattr(key)
    if isinstance(value, tuple):
        if len(value) == 1:
            return f'<spectrum name={name} value="{value[0]:.9g}"/>'
        return f'<rgb name={name} value="{", ".join(f"{x:.9g}" for x in value)}"/>'
    if isinstance(value, str):
        return f"<string name={name} value={quoteattr(value)}/>"
    return f'<float name={name} value="{value:.9g}"/>'


def _comment(text: str) -> str:
    return escape(text).replace("--", "- -")


def check_channels(count: int, title: str) -> None:
    if count not in (1, 3):
        raise UserError(
            f"{title}: {count} channels; a material is gray or has red, green and blue: reduce the spectrum to one or three channels first"
        )


__all__ = ["Fresnel", "check_channels", "properties", "to_dict", "to_xml"]
