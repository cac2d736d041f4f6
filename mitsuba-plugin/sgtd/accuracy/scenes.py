"""Scenes for the images: any scene file with one shape and one setting of the dial, at a size that can be afforded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import PLUGIN_DIR
from ..errors import UserError, mitsuba_errors
from ..named_shape import NamedShape, make_shape
from ..scene.exchange import PARTNERS, exchange
from ..scene.graph import SceneGraph, read_scene

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
    folders = (PLUGIN_DIR / "scenes", Path("scenes"))
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
    """The shapes that a scene's own sgtdconductors and sgtddielectrics have, as far as their parameters are numbers."""
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
