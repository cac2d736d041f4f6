"""Rendering in passes: progress, bounded memory, a timing without compilation and an estimate of the noise.

A JIT variant renders all samples in one kernel launch that reports nothing until it ends and keeps all samples in
memory. So a render is divided into passes with seeds 0, 1, 2, … whose raw sums are added in the film: the result
is what one pass with all samples would give, except that a sampler with structure (stratified, low discrepancy)
keeps its structure within a pass only.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..atomic_output import AtomicOutput
from ..errors import UserError, mitsuba_errors
from .graph import SceneGraph

# Samples in one pass. More would hold more in memory (a JIT variant about 100 bytes for each) and report progress
# more rarely; fewer would spend a larger part on starting passes (about 5 ms each).
_PASS_JIT = 2**22
_PASS_SCALAR = 2**20
# For samplers with structure, which a division into passes weakens: only as much as memory asks for.
_PASS_STRUCTURED = 2**25

# At least so many passes if there are enough samples: the first holds the compilation, and noise is
# estimated from the two halves.
_LEAST_PASSES = 4

IMAGE_ENDINGS = (".exr", ".png")

# Called after each pass with the samples per pixel that it added.
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Rendering:
    """A finished image with what was learned on the way.

    ``halves`` are two images of disjoint samples, with their samples per pixel; None if there was one pass only.
    ``seconds`` is the time for all samples at the median speed of the passes after the first, so without
    compilation; ``first_pass_excess`` is what the first pass took on top of that: tracing and compiling.
    """

    bitmap: Any
    spp: int
    passes: int
    seconds: float
    first_pass_excess: float
    halves: tuple[tuple[np.ndarray, int], tuple[np.ndarray, int]] | None

    def rgb(self) -> np.ndarray:
        """The image as an array (height, width, 3) of linear sRGB."""
        return to_rgb(self.bitmap)


def plan_passes(pixels: int, spp: int, structured: bool, scalar: bool) -> list[int]:
    """Divides the samples per pixel into passes of nearly equal size."""
    limit = _PASS_STRUCTURED if structured else _PASS_SCALAR if scalar else _PASS_JIT
    count = max(-(-pixels * spp // limit), _LEAST_PASSES)
    count = min(count, spp)
    each, more = divmod(spp, count)
    return [each + 1] * more + [each] * (count - more)


def sample_count(scene: Any, sensor: int, requested: int | None) -> int:
    """The samples per pixel that a render will have."""
    return requested or sensor_of(scene, sensor).sampler().sample_count()


def sensor_of(scene: Any, index: int) -> Any:
    """One of the scene's sensors."""
    sensors = scene.sensors()
    if not 0 <= index < len(sensors):
        raise UserError(f"sensor {index} does not exist: the scene has {len(sensors)}, counted from 0")
    return sensors[index]


class PassRenderer:
    """Renders a scene pass by pass, so that several scenes can take turns."""

    def __init__(self, scene: Any, sensor: int, spp: int) -> None:
        import mitsuba as mi

        self._scene = scene
        self._camera = sensor_of(scene, sensor)
        self._film = self._camera.film()
        self._sampler = self._camera.sampler()
        self._integrator = scene.integrator()
        if self._integrator is None:
            raise UserError("the scene has no integrator")
        width, height = self._film.crop_size()
        structured = self._sampler.class_name() != "IndependentSampler"
        self.plan = plan_passes(width * height, spp, structured, mi.variant().startswith("scalar_"))
        self._sums: list[Any] = [0.0, 0.0]
        self._samples = [0, 0]
        self._timings: list[tuple[float, int]] = []

    def render_pass(self, number: int) -> int:
        """Renders one pass of the plan, with its number as the seed; returns its samples per pixel as planned."""
        start = time.perf_counter()
        with mitsuba_errors("while rendering"):
            size = self.plan[number]
            self._integrator.render(self._scene, self._camera, seed=number, spp=size, develop=True, evaluate=True)
            raw = np.array(self._film.develop(raw=True), dtype=np.float64)
        seconds = time.perf_counter() - start
        actual = self._sampler.sample_count()
        self._sums[number % 2] = self._sums[number % 2] + raw
        self._samples[number % 2] += actual
        self._timings.append((seconds, actual))
        return size

    def result(self) -> Rendering:
        """The image of all passes so far."""
        total = sum(self._samples)
        speeds = [seconds / samples for seconds, samples in self._timings]
        speed = statistics.median(speeds[1:] or speeds)
        first_seconds, first_samples = self._timings[0]
        halves = None
        if len(self._timings) > 1:
            a, b = (to_rgb(self._developed(part)) for part in self._sums)
            halves = ((a, self._samples[0]), (b, self._samples[1]))
        return Rendering(
            bitmap=self._developed(self._sums[0] + self._sums[1]),
            spp=total,
            passes=len(self._timings),
            seconds=speed * total,
            first_pass_excess=max(0.0, first_seconds - speed * first_samples),
            halves=halves,
        )

    def _developed(self, raw: np.ndarray) -> Any:
        """What the film makes of raw sums (they carry their weights), in its own pixel format."""
        import mitsuba as mi

        with mitsuba_errors("while developing the film"):
            self._film.prepare(self._integrator.aov_names())
            block = mi.ImageBlock(mi.TensorXf(raw.astype(np.float32)), self._film.crop_offset())
            self._film.put_block(block)
            return self._film.bitmap()


def render(scenes: Sequence[Any], sensor: int, spp: int, progress: Progress) -> list[Rendering]:
    """Renders scenes with ``spp`` samples per pixel each (a structured sampler may round them up).

    The scenes take turns, pass by pass: what else runs on the machine then slows all of them alike, and their times
    can be compared.
    """
    renderers = [PassRenderer(scene, sensor, spp) for scene in scenes]
    for number in range(len(renderers[0].plan)):
        for renderer in renderers:
            progress(renderer.render_pass(number))
    return [renderer.result() for renderer in renderers]


def to_rgb(bitmap: Any) -> np.ndarray:
    """Any bitmap that a film develops, as linear sRGB in double precision."""
    import mitsuba as mi

    if bitmap.pixel_format() == mi.Bitmap.PixelFormat.MultiChannel:
        bitmap = bitmap.split()[0][1]
    rgb = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    return np.array(rgb, dtype=np.float64)


def save(bitmap: Any, path: Path) -> None:
    """Writes a bitmap: EXR in full floats with all channels, PNG as 8-bit sRGB."""
    import mitsuba as mi

    with mitsuba_errors(f"cannot write {path}"):
        if path.suffix == ".png":
            if bitmap.pixel_format() == mi.Bitmap.PixelFormat.MultiChannel:
                bitmap = bitmap.split()[0][1]
            bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, srgb_gamma=True)
        bitmap.write(str(path))


def render_file(
    graph: SceneGraph,
    output: Path,
    sensor: int,
    spp: int | None,
    started: Callable[[int], Progress],
) -> Rendering:
    """Renders a scene into an image file. ``started`` gets the samples per pixel and returns the progress call."""
    if output.suffix.lower() not in IMAGE_ENDINGS:
        raise UserError(f"{output}: the name must end in {' or '.join(IMAGE_ENDINGS)}")
    if output.is_dir():
        raise UserError(f"{output} is a folder: give the name of an image file")
    with AtomicOutput(output.parent) as files:
        scene = graph.build()
        count = sample_count(scene, sensor, spp)
        (result,) = render([scene], sensor, count, started(count))
        save(result.bitmap, files.path(output.name))
    return result
