"""Rendering in passes: progress, bounded memory, a timing without compilation and an estimate of the noise.

A JIT variant renders all samples in one kernel launch that reports nothing until it ends and keeps all samples in
memory. So a render is divided into passes with seeds 0, 1, 2, … whose raw sums are added: the result is what one
pass with all samples would give. Two things need care:

* A film divides its sums by the weights of its samples. A particle tracer splats without weights and has divided by
  the number of its samples itself: its passes are averaged (all but alpha, in which it counts what it splats).
* A sampler with structure (stratified, low discrepancy) has it within a pass only. It renders in one pass as far as
  memory allows; :attr:`Rendering.structure` says where it did not.
"""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np

from .. import atomic_output
from ..errors import UserError, mitsuba_errors
from .graph import SceneGraph
from .timing import Timing

# Samples in one pass. More would hold more in memory (a JIT variant about 100 bytes for each) and report progress
# more rarely; fewer would spend a larger part on starting passes (about 5 ms each).
_PASS_JIT = 2**22
_PASS_SCALAR = 2**20
# For samplers with structure, which a division into passes weakens: only as much as memory asks for. A scalar
# variant keeps no samples.
_PASS_STRUCTURED = 2**25

# At least so many passes of a sampler without structure if there are enough samples: the first holds the
# compilation, and noise is estimated from the two halves.
_LEAST_PASSES = 4

IMAGE_ENDINGS = (".exr", ".png")

# Called after each pass with the samples per pixel that it added.
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Rendering:
    """A finished image with what was learned on the way.

    ``halves`` are two images of disjoint samples, with their samples per pixel; None if there was one pass only.
    ``structure`` is the class of a sampler whose samples are structured ("StratifiedSampler"), "" for independent
    ones: one pass has its whole structure, several have it within each pass only.
    """

    bitmap: Any
    spp: int
    passes: int
    timing: Timing
    structure: str
    halves: tuple[tuple[np.ndarray, int], tuple[np.ndarray, int]] | None

    def rgb(self) -> np.ndarray:
        """The image as an array (height, width, 3) of linear sRGB."""
        return to_rgb(self.bitmap)

    def sampling_note(self) -> str:
        """One sentence on what the sampler's structure means for this image; "" for independent samples."""
        if not self.structure:
            return ""
        name = re.sub(r"(?<!^)(?=[A-Z])", " ", self.structure).lower()  # "LowDiscrepancySampler"
        if self.passes > 1:
            return f"The {name} has its structure within each of {self.passes} passes only, as memory asks for."
        return f"The {name} keeps its structure in one pass, which tells nothing of its noise."

    @property
    def bands(self) -> int:
        """Of a spectral film, which is shown as their mean; 0 for a film of colors."""
        bands = _bands(self.bitmap)
        return 0 if bands is None else bands.shape[2]


class Plan(Sequence[int]):
    """The samples per pixel of each pass, of nearly equal size."""

    def __init__(self, spp: int, passes: int) -> None:
        self._passes = passes
        self._each, self._more = divmod(spp, passes)

    def __len__(self) -> int:
        return self._passes

    @overload
    def __getitem__(self, number: int) -> int: ...
    @overload
    def __getitem__(self, number: slice) -> Sequence[int]: ...
    def __getitem__(self, number: int | slice) -> int | Sequence[int]:
        if isinstance(number, slice):
            return [self[k] for k in range(*number.indices(self._passes))]
        if not 0 <= number < self._passes:
            raise IndexError(number)
        return self._each + (number < self._more)


def plan_passes(pixels: int, spp: int, structured: bool, scalar: bool) -> Plan:
    """Divides the samples per pixel into passes."""
    if structured:
        count = 1 if scalar else -(-pixels * spp // _PASS_STRUCTURED)
    else:
        count = max(-(-pixels * spp // (_PASS_SCALAR if scalar else _PASS_JIT)), _LEAST_PASSES)
    return Plan(spp, min(max(count, 1), spp))


def sample_count(scene: Any, sensor: int, requested: int | None) -> int:
    """The samples per pixel that a render will have."""
    return requested or sensor_of(scene, sensor).sampler().sample_count()


def sensor_of(scene: Any, index: int) -> Any:
    """One of the scene's sensors."""
    sensors = scene.sensors()
    if not sensors:
        raise UserError("the scene has no sensor (camera)")
    if not 0 <= index < len(sensors):
        raise UserError(f"sensor {index} does not exist: the scene has {len(sensors)}, counted from 0")
    return sensors[index]


class PassRenderer:
    """Renders a scene pass by pass, so that several scenes can take turns."""

    def __init__(self, scene: Any, sensor: int, spp: int, seed: int = 0) -> None:
        import mitsuba as mi

        self._scene = scene
        self._camera = sensor_of(scene, sensor)
        self._film = self._camera.film()
        self._sampler = self._camera.sampler()
        self._integrator = scene.integrator()
        if self._integrator is None:
            raise UserError("the scene has no integrator")
        width, height = self._film.crop_size()
        name = str(self._sampler.class_name())
        self._structure = "" if name == "IndependentSampler" else name
        self._scalar = mi.variant().startswith("scalar_")
        self.plan = plan_passes(width * height, spp, bool(self._structure), self._scalar)
        # runs with other seeds have other seeds in every pass
        self._first_seed = seed * len(self.plan)
        self._sums: list[Any] = [0.0, 0.0]
        self._samples = [0, 0]
        self._averaged: np.ndarray = np.array([False])
        self._timings: list[tuple[float, int]] = []

    def render_pass(self, number: int) -> int:
        """Renders one pass of the plan, with a seed of its own; returns its samples per pixel as planned."""
        size = self.plan[number]
        with mitsuba_errors("while rendering"):
            while True:
                start = time.perf_counter()
                self._integrator.render(
                    self._scene, self._camera, seed=self._first_seed + number, spp=size, develop=True, evaluate=True
                )
                raw = np.array(self._film.develop(raw=True), dtype=np.float64)
                seconds = time.perf_counter() - start
                if not self._integrator.should_stop():
                    break
                # Mitsuba's own handler of SIGINT has cut the pass short. Python raises KeyboardInterrupt then, unless
                # the parent process has this one ignore the signal: so the samples that are missing are rendered.
                if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
                    raise KeyboardInterrupt
            actual = self._samples_of(size)
        self._averaged = self._channels_to_average(raw)
        self._sums[number % 2] = self._sums[number % 2] + np.where(self._averaged, raw * actual, raw)
        self._samples[number % 2] += actual
        self._timings.append((seconds, actual))
        return size

    def result(self) -> Rendering:
        """The image of all passes so far."""
        halves = None
        if len(self._timings) > 1:
            a, b = (to_rgb(self._developed(part, count)) for part, count in zip(self._sums, self._samples))
            halves = ((a, self._samples[0]), (b, self._samples[1]))
        total = sum(self._samples)
        return Rendering(
            bitmap=self._developed(self._sums[0] + self._sums[1], total),
            spp=total,
            passes=len(self._timings),
            timing=Timing(tuple(self._timings), compiles=not self._scalar),
            structure=self._structure,
            halves=halves,
        )

    def _samples_of(self, size: int) -> int:
        """What the sampler makes of a number of samples: some round it up. Differentiable integrators render with a
        clone of the sampler, so the sampler itself does not tell."""
        sampler = self._sampler.clone()
        sampler.set_sample_count(size)
        return int(sampler.sample_count())

    def _channels_to_average(self, raw: np.ndarray) -> np.ndarray:
        """Which channels of a film's sums have been divided by the samples: none where there are weights."""
        import mitsuba as mi

        # colors, alpha if the film has it, weight, and then what the integrator adds
        weight = raw.shape[2] - len(self._integrator.aov_names()) - 1
        averaged = np.full(raw.shape[2], not np.any(raw[..., weight]))
        if mi.has_flag(self._film.flags(), mi.FilmFlags.Alpha):
            averaged[weight - 1] = False
        return averaged

    def _developed(self, sums: np.ndarray, samples: int) -> Any:
        """What the film makes of raw sums, in its own pixel format."""
        import mitsuba as mi

        raw = np.where(self._averaged, sums / samples, sums)
        with mitsuba_errors("while developing the film"):
            self._film.prepare(self._integrator.aov_names())
            block = mi.ImageBlock(mi.TensorXf(raw.astype(np.float32)), self._film.crop_offset())
            self._film.put_block(block)
            return self._film.bitmap()


def render(scenes: Sequence[Any], sensor: int, spp: int, progress: Progress, seed: int = 0) -> list[Rendering]:
    """Renders scenes with ``spp`` samples per pixel each (a structured sampler may round them up).

    The scenes take turns, pass by pass: what else runs on the machine then slows all of them alike, and their times
    can be compared. Another ``seed`` has none of its samples in common.
    """
    renderers = [PassRenderer(scene, sensor, spp, seed) for scene in scenes]
    for number in range(len(renderers[0].plan)):
        for renderer in renderers:
            progress(renderer.render_pass(number))
    return [renderer.result() for renderer in renderers]


def to_rgb(bitmap: Any) -> np.ndarray:
    """Any bitmap that a film develops, as linear sRGB in double precision; bands of a spectral film as their mean."""
    import mitsuba as mi

    bands = _bands(bitmap)
    if bands is not None:
        return np.repeat(bands.mean(axis=2, keepdims=True), 3, axis=2)
    if bitmap.pixel_format() == mi.Bitmap.PixelFormat.MultiChannel:
        bitmap = bitmap.split()[0][1]
    rgb = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    return np.array(rgb, dtype=np.float64)


def _bands(bitmap: Any) -> np.ndarray | None:
    """The bands of a spectral film's bitmap (height, width, bands); None of one with colors."""
    import mitsuba as mi

    if bitmap.pixel_format() != mi.Bitmap.PixelFormat.MultiChannel:
        return None
    first = bitmap.split()[0][1]
    if first.pixel_format() != mi.Bitmap.PixelFormat.MultiChannel:
        return None
    width, height = first.size()
    return np.array(first, dtype=np.float64).reshape(height, width, -1)


def save(bitmap: Any, path: Path) -> None:
    """Writes a bitmap: EXR in full floats with all channels, PNG as 8-bit sRGB."""
    import mitsuba as mi

    with mitsuba_errors("the image cannot be written"):
        if path.suffix.lower() == ".png":
            if bitmap.pixel_format() == mi.Bitmap.PixelFormat.MultiChannel:
                bitmap = bitmap.split()[0][1]
            bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, srgb_gamma=True)
        bitmap.write(str(path))


def check_image_name(output: Path) -> None:
    """Raises an error if no image of this name can be written."""
    if output.suffix.lower() not in IMAGE_ENDINGS:
        raise UserError(f"{output}: the name must end in {' or '.join(IMAGE_ENDINGS)}")
    if output.is_dir():
        raise UserError(f"{output} is a folder: give the name of an image file")
    atomic_output.check(output.parent, (output.name,))


def render_file(
    graph: SceneGraph,
    output: Path,
    sensor: int,
    spp: int | None,
    started: Callable[[int], Progress],
) -> Rendering:
    """Renders a scene into an image file. ``started`` gets the samples per pixel and returns the progress call.

    An image that cannot be written as PNG is saved as EXR, and the error says so.
    """
    check_image_name(output)
    graph.require_integrator()
    with atomic_output.AtomicOutput(output.parent) as files:
        scene = graph.build()
        count = sample_count(scene, sensor, spp)
        (result,) = render([scene], sensor, count, started(count))
        refused = None
        try:
            save(result.bitmap, files.path(output.name))
        except UserError as error:
            if output.suffix.lower() == ".exr":
                raise
            refused = error
            files.discard(output.name)
            taken = (output.parent / f"{output.stem}.exr").exists()
            rescue = f"{output.name if taken else output.stem}.exr"
            save(result.bitmap, files.path(rescue))
    if refused:
        raise UserError(f"{output}: {refused}; it is saved as {output.with_name(rescue)}")
    return result
