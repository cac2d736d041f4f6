"""Writers of files of measured reflectance, from the descriptions of the formats: independent of the package's readers."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np


def direction(theta: float, phi: float) -> tuple[float, float, float]:
    return math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)


def write_merl(path: Path, reflectance) -> None:
    """``reflectance(wi, wo)`` takes (n, 3) arrays and returns (n, 3); cells below the horizon are -1."""
    th, td, pd = np.meshgrid(np.arange(90), np.arange(90), np.arange(180), indexing="ij")
    th, td, pd = (a.ravel() for a in (np.radians((th + 0.5) ** 2 / 90.0), np.radians(td + 0.5), np.radians(pd + 0.5)))
    d = np.stack([np.sin(td) * np.cos(pd), np.sin(td) * np.sin(pd), np.cos(td)])
    # the frame of the half vector in the plane y = 0
    wi = np.stack([np.cos(th) * d[0] + np.sin(th) * d[2], d[1], np.cos(th) * d[2] - np.sin(th) * d[0]], axis=1)
    wo = np.stack([-np.cos(th) * d[0] + np.sin(th) * d[2], -d[1], np.cos(th) * d[2] + np.sin(th) * d[0]], axis=1)
    above = (wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)
    values = np.full((len(th), 3), -1.0)
    values[above] = reflectance(wi[above], wo[above]) * [1500.0, 1500.0 / 1.15, 1500.0 / 1.66]
    with path.open("wb") as file:
        file.write(struct.pack("<3i", 90, 90, 180))
        for plane in range(3):
            file.write(np.ascontiguousarray(values[:, plane], "<f8").tobytes())


def write_utia(path: Path, reflectance) -> None:
    grid = [direction(math.radians(15 * t), math.radians(7.5 * p)) for t in range(6) for p in range(48)]
    views = np.array(grid)
    rows = [reflectance(np.broadcast_to(np.array(light), views.shape), views) for light in grid]
    with path.open("wb") as file:
        for plane in range(3):
            for row in rows:
                file.write(struct.pack(f"<{len(views)}d", *row[:, plane]))


def write_tensors(path: Path, fields: dict[str, np.ndarray]) -> None:
    """A tensor file, version 1.0."""
    codes = {"uint8": 1, "float32": 10, "float64": 11}
    header = 12 + 6 + sum(2 + len(name) + 2 + 1 + 8 + 8 * a.ndim for name, a in fields.items())
    offset, entries, content = header, [], []
    for name, array in fields.items():
        entry = (
            struct.pack("<H", len(name))
            + name.encode()
            + struct.pack("<HBQ", array.ndim, codes[str(array.dtype)], offset)
        )
        entries.append(entry + struct.pack(f"<{array.ndim}Q", *array.shape))
        content.append(np.ascontiguousarray(array).tobytes())
        offset += len(content[-1])
    path.write_bytes(b"tensor_file\0" + struct.pack("<BBI", 1, 0, len(fields)) + b"".join(entries + content))


def rgl_fields(phi: np.ndarray, theta: np.ndarray, seed: int, wavelengths=None) -> dict[str, np.ndarray]:
    """Smooth tables of no material in particular, with all fields that Mitsuba asks for."""
    rng = np.random.default_rng(seed)
    lights, channels = (len(phi), len(theta)), 3 if wavelengths is None else len(wavelengths)
    vndf = np.exp(rng.normal(0.0, 0.3, (*lights, 9, 8)))
    table = np.exp(rng.normal(0.0, 0.3, (*lights, channels, 6, 6)))
    fields = {
        "description": np.frombuffer(b"no material", np.uint8),
        "phi_i": phi,
        "theta_i": theta,
        # an isotropic material has no azimuth, which Mitsuba relies on
        "sigma": np.exp(rng.normal(0.0, 0.1, (5, 7) if len(phi) > 2 else (1, 7))) * np.ones((5, 1)),
        "ndf": np.exp(rng.normal(0.0, 0.3, (5, 6))),
        "vndf": vndf,
        "luminance": table.mean(axis=2),
        "rgb" if wavelengths is None else "spectra": table,
        "jacobian": np.ones(1, np.uint8),
    }
    if wavelengths is not None:
        fields["wavelengths"] = wavelengths
    return {name: a if a.dtype == np.uint8 else np.asarray(a, np.float32) for name, a in fields.items()}
