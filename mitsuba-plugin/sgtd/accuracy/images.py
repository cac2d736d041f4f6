"""What a setting does to an image of any scene file with one shape: its bias, its noise, its time.

All settings of one scene and shape are rendered in batches that take turns: batch k has seed k for every setting. The
sampler does not depend on the dial, so two settings draw the same paths, and the difference between an image and the
reference (accuracy 0) of the same batch is free of nearly all noise. With d_k that difference and B batches,

    bias^2  = |mean_k d_k|^2 - mean_pixels(var_k d_k) / B        noise of the difference, taken off
    floor^2 =                  mean_pixels(var_k d_k) / B        what the batches cannot tell from zero

The RMSE of an image adds its noise to that bias. Noise is measured without a reference, as half the squared difference
of two renders that differ in their seeds alone: |i_k - i_(k+1)|^2 / 2.

Everything is over all pixels and channels of linear sRGB, divided by the mean luminance of the reference.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .. import PACKAGE_DIR
from ..compare.difference import exposure_for, flip, luminance, to_display
from ..errors import UserError, mitsuba_errors
from ..named_shape import NamedShape, make_shape
from ..scene.exchange import PARTNERS, exchange
from ..scene.graph import SceneGraph, read_scene
from ..scene.render import sensor_of, to_rgb
from . import DEFAULT_SETTING
from .function_timing import Timing

# The scenes of the default report: highlights from a distance, and a floor seen along its length.
DEFAULT_SCENES = ("spheres.xml", "grazing.xml")

# Integrators that can hide the lights that the camera sees directly.
_HIDING = ("path", "direct", "volpath", "volpathmis")

# At most so many different shapes of a user's scene are measured as functions.
_MOST_OWN_SHAPES = 4


@dataclass(frozen=True)
class SceneFile:
    """A scene file, read in the current variant."""

    path: Path
    graph: SceneGraph
    size: tuple[int, int]

    @property
    def name(self) -> str:
        return self.path.stem

    def build(self, shape: NamedShape | None, setting: float, visible: bool = True) -> Any:
        """The scene with all rough materials of this shape (None: as in the file) at this setting."""
        settings = dict(shape.settings) if shape else {}
        pair = exchange(self.graph, settings)
        for node in _materials(pair.right):
            node.props["accuracy"] = setting
            if not visible:
                node.props["sample_visible"] = False
        return pair.right.build()


def default_scenes() -> tuple[Path, ...]:
    """The project's scenes: installed with the package, or in the checkout around it."""
    folders = (PACKAGE_DIR / "scenes", Path("scenes"))
    for folder in folders:
        if all((folder / name).is_file() for name in DEFAULT_SCENES):
            return tuple(folder / name for name in DEFAULT_SCENES)
    raise UserError("the default scenes are missing: name a scene file with --scene")


def load(path: Path, parameters: dict[str, str], pixels: int, lenient: bool = False) -> SceneFile:
    """Reads a scene and lowers its resolution to about so many pixels; proportions stay.

    Lights are hidden from the camera: the edge of a lamp that is seen directly has more noise than everything that a
    material does.
    """
    graph = read_scene(path, parameters, lenient)
    size = graph.shrink(pixels)
    for integrator in _HIDING:
        for node in graph.materials(integrator):
            node.props["hide_emitters"] = True
    return SceneFile(path, graph, size)


def _materials(graph: SceneGraph) -> Iterator[Any]:
    """Each node that is one of our plugins."""
    for plugin in PARTNERS.values():
        yield from graph.materials(plugin)


def has_own_shapes(scene: SceneFile) -> bool:
    """Whether the scene has one of our plugins already."""
    return any(True for _ in _materials(scene.graph))


def own_shapes(scene: SceneFile) -> list[NamedShape]:
    """The shapes that a scene's own materials of this family have, as far as their parameters are numbers."""
    found: dict[str, NamedShape] = {}
    for node in _materials(scene.graph):
        with mitsuba_errors(scene.graph.place(node)):
            shape = _shape_of(node.props)
        if shape:
            found.setdefault(shape.text, shape)
    return list(found.values())[:_MOST_OWN_SHAPES]


def _shape_of(props: Any) -> NamedShape | None:
    row = str(props["distribution"]).lower() if "distribution" in props else "sgtd"
    values = {name: props[name] for name in ("gamma", "p", "lambda", "shift", "mu") if name in props}
    if not all(isinstance(value, (int, float)) for value in values.values()):
        return None  # rendering will say what is wrong with it
    mu = values.pop("mu", None)
    if mu is not None:
        alpha = props.get("alpha", 0.1)
        if not isinstance(alpha, (int, float)) or alpha <= 0.0:
            return None
        values["shift"] = mu / (alpha * make_shape(row, values).alpha_scale)
    return make_shape(row, values)


# Seeds of the renders at equal time, apart from those of the batches.
_EQUAL_TIME_SEED = 10_000

# No render has more samples than this: a JIT variant holds them all in memory.
_MOST_SAMPLES = 2**24

# An 8-bit display has this many steps.
_STEPS = 255.0


@dataclass(frozen=True)
class Plan:
    """How much is rendered."""

    batches: int
    spp: int
    equal_time_repetitions: int
    equal_time_budget: float  # seconds that all renders at equal time may take together
    seed: int


@dataclass
class ImageRow:
    """One setting, or D cos sampling; errors relative to the mean luminance of the reference.

    D cos sampling draws other paths than the reference, so its images cannot be paired: it has no ``bias`` (it is
    unbiased by construction: the density reported is that of the draw), no ``steps_8bit`` and no ``flip`` (NaN).
    """

    setting: float
    visible: bool
    bias: float
    floor: float
    steps_8bit: float
    flip: float
    flip_noise: float
    noise_per_sample: float
    rmse_equal_spp: Timing
    seconds_per_spp: Timing
    equal_time_spp: int = 0
    rmse_equal_time: Timing | None = None

    def noise(self, spp: int) -> float:
        """Monte Carlo noise at so many samples per pixel."""
        return self.noise_per_sample / math.sqrt(spp)


@dataclass
class ImageStudy:
    """All settings of one scene, shape and variant. ``reference`` and ``coarsest`` are images for the page."""

    scene: str
    shape: str
    variant: str
    size: tuple[int, int]
    batches: int
    spp: int
    equal_time_seconds: float
    exposure: float
    rows: list[ImageRow]
    dcos: ImageRow
    reference: np.ndarray = field(repr=False)
    coarsest: np.ndarray = field(repr=False)

    def row(self, setting: float) -> ImageRow:
        return next(row for row in self.rows if row.setting == setting)


class _Renderer:
    """One scene; each call renders with a seed of its own."""

    def __init__(self, scene: Any) -> None:
        self._scene = scene
        self._camera = sensor_of(scene, 0)
        self._film = self._camera.film()
        self.pixels = int(np.prod(self._film.crop_size()))

    def __call__(self, seed: int, spp: int) -> tuple[np.ndarray, float, int]:
        """The image in linear sRGB, the seconds that rendering took, and the samples (some samplers round them up)."""
        start = time.perf_counter()
        with mitsuba_errors("while rendering"):
            integrator = self._scene.integrator()
            integrator.render(self._scene, self._camera, seed=seed, spp=spp, develop=True, evaluate=True)
            bitmap = self._film.bitmap()
        seconds = time.perf_counter() - start
        image = np.nan_to_num(to_rgb(bitmap), nan=0.0, posinf=0.0, neginf=0.0)
        return image, seconds, int(self._camera.sampler().sample_count())


def study(
    file: SceneFile,
    shape: NamedShape | None,
    settings: tuple[float, ...],
    plan: Plan,
    variant: str,
    progress: Callable[[int], None],
) -> ImageStudy:
    """Renders and measures; ``progress`` is called ``steps(settings, plan)`` times."""
    renderers = {(setting, True): _Renderer(file.build(shape, setting)) for setting in settings}
    renderers[DEFAULT_SETTING, False] = _Renderer(file.build(shape, DEFAULT_SETTING, visible=False))
    keys = list(renderers)
    for key in keys:  # compiles, and fills caches
        renderers[key](plan.seed, 1)

    images: dict[tuple[float, bool], list[np.ndarray]] = {key: [] for key in keys}
    seconds: dict[tuple[float, bool], list[float]] = {key: [] for key in keys}
    random = np.random.default_rng(plan.seed)
    for batch in range(plan.batches):
        for k in random.permutation(len(keys)):
            image, took, spp = renderers[keys[k]](plan.seed + batch, plan.spp)
            images[keys[k]].append(image)
            seconds[keys[k]].append(took / spp)
            progress(1)

    reference = np.array(images[0.0, True])
    level = max(float(luminance(reference.mean(axis=0)).mean()), 1e-30)
    exposure = exposure_for(reference.mean(axis=0)).stops
    rows = {key: _row(key, np.array(images[key]), reference, level, exposure, spp, seconds[key]) for key in keys}

    slowest = max(rows[key].seconds_per_spp.median for key in keys)
    affordable = plan.equal_time_budget / (len(keys) * plan.equal_time_repetitions * slowest)
    budget = slowest * max(1, min(plan.spp, int(affordable)))
    most = max(plan.spp, _MOST_SAMPLES // renderers[keys[0]].pixels)
    for key in keys:
        rows[key].equal_time_spp = min(max(1, round(budget / rows[key].seconds_per_spp.median)), most)
    renders: dict[tuple[float, bool], list[np.ndarray]] = {key: [] for key in keys}
    counts = dict.fromkeys(keys, 1)
    for repetition in range(plan.equal_time_repetitions):
        for k in random.permutation(len(keys)):
            key = keys[k]
            image, _, counts[key] = renderers[key](plan.seed + _EQUAL_TIME_SEED + repetition, rows[key].equal_time_spp)
            renders[key].append(image)
            progress(1)
    for key in keys:
        rows[key].equal_time_spp = counts[key]
        rows[key].rmse_equal_time = _rmse(np.array(renders[key]), rows[key].bias, level)

    return ImageStudy(
        scene=file.name,
        shape=shape.text if shape else "as in the file",
        variant=variant,
        size=(reference.shape[2], reference.shape[1]),
        batches=plan.batches,
        spp=spp,
        equal_time_seconds=budget,
        exposure=exposure,
        rows=[rows[setting, True] for setting in settings],
        dcos=rows[DEFAULT_SETTING, False],
        reference=reference.mean(axis=0),
        coarsest=np.mean(images[settings[0], True], axis=0),
    )


def steps(settings: tuple[float, ...], plan: Plan) -> int:
    """The renders of one study."""
    return (len(settings) + 1) * (plan.batches + plan.equal_time_repetitions)


def _row(
    key: tuple[float, bool],
    images: np.ndarray,
    reference: np.ndarray,
    level: float,
    exposure: float,
    spp: int,
    seconds: list[float],
) -> ImageRow:
    batches = len(images)
    difference = images - reference
    floor2 = float(np.mean(difference.var(axis=0, ddof=1))) / batches
    bias2 = float(np.mean(np.square(difference.mean(axis=0)))) - floor2
    shown, wanted = (to_display(stack.mean(axis=0), exposure) for stack in (images, reference))
    even, odd = (to_display(reference[k::2].mean(axis=0), exposure) for k in (0, 1))
    variance = float(np.mean(images.var(axis=0, ddof=1)))
    bias = math.sqrt(max(0.0, bias2)) / level
    return ImageRow(
        setting=key[0],
        visible=key[1],
        bias=bias if key[1] else 0.0,
        floor=math.sqrt(floor2) / level,
        steps_8bit=float(np.abs(shown - wanted).max()) * _STEPS if key[1] else math.nan,
        flip=flip(wanted, shown)[1] if key[1] else math.nan,
        flip_noise=flip(even, odd)[1],
        noise_per_sample=math.sqrt(variance * spp) / level,
        rmse_equal_spp=_rmse(images, bias if key[1] else 0.0, level),
        seconds_per_spp=Timing.of(seconds),
    )


def _rmse(images: np.ndarray, bias: float, level: float) -> Timing:
    """Noise of one render with the bias, from each pair of neighboring seeds."""
    squares = 0.5 * np.mean(np.square(np.diff(images, axis=0)), axis=(1, 2, 3)) / level**2
    return Timing.of(list(np.sqrt(squares + bias**2)))
