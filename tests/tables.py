"""Tables and mixtures that the tests share: as users bring them, and as they are hard in one way each."""

from __future__ import annotations

import numpy as np


def listed(numbers) -> str:
    """A list as scenes have it."""
    return " ".join(repr(float(number)) for number in numbers)


def _noise():
    slopes = np.linspace(0.0, 2.0, 200)
    rng = np.random.default_rng(5)
    return dict(slopes=slopes, values=(1 + (slopes / 0.3) ** 2) ** -2 * rng.uniform(0.8, 1.2, 200), tail_exponent=4.0)


def _ring():
    slopes = np.linspace(0.0, 1.0, 24)
    return dict(slopes=slopes, values=np.where(slopes < 0.4, 0.0, np.exp(-8 * (slopes - 0.6) ** 2)), tail="cut")


def _measured():
    """A peak, a shoulder and a haze by angle, as a scan of a metal gives."""
    angles = np.array([0.0, 1, 2, 3, 5, 7, 10, 14, 20, 28, 38, 50, 65, 80, 88])
    cos = np.cos(np.radians(angles))
    slopes = np.tan(np.radians(angles))
    f = 40 * np.exp(-((slopes / 0.06) ** 2)) + 3 * (1 + (slopes / 0.15) ** 2) ** -2.2 + 0.01 * np.exp(-slopes)
    return dict(angles=angles, values=f / cos**4, quantity="D", tail="cut")


# Keyword arguments of sgtd.Ndf.tabulated; quantity is a density of slopes if it is not said.
TABLES = {
    "measured": _measured(),
    "noise": _noise(),
    "ring": _ring(),
    "giant": dict(slopes=[0.0, 3.0], values=[1.0, 1e-4], tail="cut"),
    "two": dict(slopes=[0.0, 0.5], values=[1.0, 0.2], tail_exponent=3.2),
    "step": dict(slopes=[0.0, 0.3, 0.300001, 1.0], values=[1.0, 1.0, 0.01, 0.01], tail="cut"),
}
TABLES = {name: {"quantity": "slope", **table} for name, table in TABLES.items()}

# Members of mixtures as the plugin reads them, and as keyword arguments of sgtd.Ndf.
MIXTURES = {
    "core and haze": [
        (0.7, dict(distribution="student", gamma=1.6, alpha=0.1)),
        (0.3, dict(distribution="gnd", p=2.0, alpha=0.5)),
    ],
    "ring and box": [
        (1.0, dict(gamma=1.9, p=1.3, lam=0.4, shift=2.0, alpha=0.15)),
        (2.0, dict(distribution="hyper_cauchy", gamma=2.6, alpha=0.05)),
        (0.2, dict(distribution="gnd", p=5.0, alpha=0.6)),
    ],
}


def plugin_table(table: dict) -> dict:
    """The same as properties of the plugin."""
    return {
        "distribution": "tabulated",
        **{name: listed(value) if name in ("slopes", "angles", "values") else value for name, value in table.items()},
    }


def plugin_mixture(parts) -> dict:
    members = (
        " ".join(
            f"{'lambda' if name == 'lam' else name}={value}" for name, value in {"weight": weight, **member}.items()
        )
        for weight, member in parts
    )
    return {"distribution": "mixture", "members": "; ".join(members)}


PLUGIN = {
    **{name: plugin_table(table) for name, table in TABLES.items()},
    **{name: plugin_mixture(parts) for name, parts in MIXTURES.items()},
}


def ndf_of(name: str, **more):
    """The array interface of one of them."""
    from sgtd import Ndf

    if name in TABLES:
        return Ndf.tabulated(**TABLES[name], **more)
    return Ndf.mixture([(weight, Ndf(**member)) for weight, member in MIXTURES[name]], **more)
