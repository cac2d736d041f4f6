"""A distribution as JSON holds it: what a sidecar says of the one that its surface was made for."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..ndf import Ndf


def describe(ndf: Ndf) -> dict[str, Any]:
    """The arguments it was made of; arrays become lists, members of a mixture are described themselves."""
    return {"distribution": ndf.distribution, **{name: _plain(value) for name, value in ndf._given.items()}}


def restore(found: dict[str, Any]) -> Ndf:
    """The distribution again."""
    rest = {name: value for name, value in found.items() if name != "distribution"}
    if found.get("distribution") == "tabulated":
        return Ndf.tabulated(**rest)
    if found.get("distribution") == "mixture":
        return Ndf.mixture([(weight, restore(part)) for weight, part in rest.pop("parts")], **rest)
    return Ndf(**found)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return describe(value) if isinstance(value, Ndf) else value
