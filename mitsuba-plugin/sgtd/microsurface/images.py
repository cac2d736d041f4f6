"""Height maps as images: EXR holds single precision, PNG 16 bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UserError, mitsuba_errors
from .height_map import HeightMap


def read_image(path: Path, sidecar: dict[str, Any]) -> HeightMap:
    import mitsuba as mi

    if path.suffix.lower() in (".tif", ".tiff"):
        from PIL import Image

        with Image.open(path) as image:
            pixels = np.asarray(image)
    else:
        with mitsuba_errors(str(path)):
            bitmap = mi.Bitmap(str(path))
        pixels = np.array(bitmap)
    notes: tuple[str, ...] = ()
    if pixels.ndim == 3:
        if pixels.shape[2] > 1:
            notes = (f"the first of {pixels.shape[2]} channels is the height",)
        pixels = pixels[:, :, 0]
    if pixels.dtype.kind == "u":
        heights_of = sidecar.get("png")
        if not heights_of:
            raise UserError(
                f"{path}: what heights its gray values are is not known: give --gray LOW HIGH, the heights of black and white, "
                "in the unit of the spacing"
            )
        low, high = float(heights_of["low"]), float(heights_of["high"])
        steps = float(np.iinfo(pixels.dtype).max)
        heights = low + (high - low) * (pixels.astype(np.float64) / steps)
        return HeightMap(
            heights, notes=(*notes, f"gray values of {8 * pixels.dtype.itemsize} bits: heights in {steps:g} steps")
        )
    spacing, periodic = None, None
    if path.suffix.lower() == ".exr":
        metadata = bitmap.metadata()
        if "dx" in metadata and "dy" in metadata:
            spacing = (float(metadata["dx"]), float(metadata["dy"]))
        if "periodic" in metadata:
            periodic = bool(metadata["periodic"])
        if pixels.dtype == np.float16:
            notes = (*notes, "half floats: heights have 11 bits, which moves slopes of heavy tails by up to 11 %")
    return HeightMap(pixels.astype(np.float64), spacing, periodic, notes)


def write_exr(path: Path, surface: HeightMap) -> None:
    """One channel of single precision, with its spacing."""
    import mitsuba as mi

    bitmap = mi.Bitmap(surface.heights.astype(np.float32)[:, :, np.newaxis])
    metadata = bitmap.metadata()
    if surface.spacing:
        metadata["dx"], metadata["dy"] = surface.spacing
    metadata["periodic"] = int(bool(surface.periodic))
    bitmap.write(str(path))


def write_normals(path: Path, normals: np.ndarray[Any, Any]) -> None:
    """A map of normals as Mitsuba's ``normalmap`` reads it raw: (n + 1) / 2 in single precision."""
    import mitsuba as mi

    mi.Bitmap((0.5 + 0.5 * normals).astype(np.float32)).write(str(path))


def gray_values(surface: HeightMap) -> tuple[np.ndarray[Any, Any], float, float]:
    """Heights as 16 bits, and the heights of 0 and 65535."""
    low, high = float(surface.heights.min()), float(surface.heights.max())
    span = high - low if high > low else 1.0
    return np.rint((surface.heights - low) / span * 65535.0).astype(np.uint16), low, low + span


def write_png(path: Path, surface: HeightMap) -> None:
    """Gray values of 16 bits."""
    import mitsuba as mi

    values, _, _ = gray_values(surface)
    mi.Bitmap(values[:, :, np.newaxis]).write(str(path))
