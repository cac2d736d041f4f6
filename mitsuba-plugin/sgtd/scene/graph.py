"""A scene file as a graph of nodes, before any Mitsuba object exists.

The file is read by Mitsuba's own parser (``mi.parser``): parameters, included files, ``<path>`` tags and old file
versions mean here what they mean to Mitsuba. Nodes can then be edited, and the graph be built as often as needed.
"""

from __future__ import annotations

import difflib
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import UserError, mitsuba_errors

# mi.parser.parse_file takes the scene's parameters as keyword arguments beside two of its own.
_PARSER_ARGUMENTS = ("config", "filename")

# The names in "Found unused parameters: - $width=3 ...".
_UNUSED = re.compile(r"- \$(\w+)=")

# Mitsuba's integrators that are written in Python.
_TRACED_INTEGRATORS = ("prb", "prb_basic", "prb_projective", "prbvolpath", "direct_projective", "volprim_rf_basic")

# An include of an include of ...: as deep as Mitsuba's parser goes.
_INCLUDE_DEPTH = 15

_FILMS = ("hdrfilm", "specfilm")
_CROP = ("crop_width", "crop_height", "crop_offset_x", "crop_offset_y")
_FILM_SIZE = (768, 576)  # Mitsuba's own default


class SceneGraph:
    """The parsed nodes of one scene file, in the current variant of Mitsuba."""

    def __init__(self, path: Path, state: Any, config: Any, resolver: Any) -> None:
        self.path = path
        self._state = state
        self._config = config
        self._resolver = resolver

    def copy(self) -> SceneGraph:
        """A second graph; editing it leaves this one as it is."""
        import mitsuba as mi

        return SceneGraph(self.path, mi.parser.ParserState(self._state), self._config, self._resolver)

    @property
    def name(self) -> str:
        """What to call the scene: the file's name, with that of its folder where the file's says nothing."""
        return f"{self.path.resolve().parent.name}/{self.path.name}" if self.path.stem == "scene" else self.path.name

    def plugins(self, kind: Any) -> dict[str, int]:
        """The plugins of one kind (``mi.ObjectType.BSDF``) in the scene with their numbers, in the order of the file."""
        counts: dict[str, int] = {}
        for node in self._state.nodes:
            if node.type == kind:
                counts[node.props.plugin_name()] = counts.get(node.props.plugin_name(), 0) + 1
        return counts

    def require_integrator(self) -> None:
        """Raises an error if there is nothing to render the scene with."""
        import mitsuba as mi

        if not self.plugins(mi.ObjectType.Integrator):
            raise UserError(
                f'{self.path}: the scene has no integrator; add <integrator type="path"/> to it, '
                "or name one: --integrator path"
            )

    def use_integrator(self, plugin: str, settings: Mapping[str, Any]) -> None:
        """Renders with this integrator, whatever the scene has."""
        import mitsuba as mi

        props = mi.Properties(plugin)
        for name, value in settings.items():
            props[name] = value
        root = self._state.root
        for name in root.props.keys():
            node = self.referred(root.props[name])
            if node is not None and node.type == mi.ObjectType.Integrator:
                props.set_id(node.props.id())
                node.props = props
                return
        node = mi.parser.SceneNode()
        node.type = mi.ObjectType.Integrator
        node.props = props
        node.file_index, node.offset = root.file_index, root.offset
        # the list moves its nodes as it grows: what was taken from it before is gone
        self._state.nodes.append(node)
        self._state.root.props["integrator_of_the_user"] = mi.Properties.ResolvedReference(len(self._state.nodes) - 1)

    def shrink(self, pixels: int) -> tuple[int, int]:
        """Lowers the resolution to about so many pixels, proportions kept; a film with a crop window stays. Returns width and height."""
        size = (0, 0)
        for film in _FILMS:
            for node in self.materials(film):  # nodes by plugin, whatever their kind
                size = _shrink(node.props, pixels)
        return size

    def materials(self, plugin: str) -> Iterator[Any]:
        """Each node that is this plugin, wherever it is nested, in the order of the file."""
        for node in self._state.nodes:
            if node.props.plugin_name() == plugin:
                yield node

    def bsdfs(self) -> Iterator[tuple[Any, list[Any]]]:
        """Each BSDF node with the BSDF nodes that hold it (twosided, blendbsdf, ...), in the order of the file."""
        import mitsuba as mi

        found = [node for node in self._state.nodes if node.type == mi.ObjectType.BSDF]
        held = [[self.referred(node.props[name]) for name in node.props.keys()] for node in found]
        for node in found:
            holders = [holder for holder, inner in zip(found, held) if any(other is node for other in inner)]
            yield node, holders

    def referred(self, value: Any) -> Any:
        """The node that a property refers to; None if it is a plain value."""
        import mitsuba as mi

        if isinstance(value, mi.Properties.ResolvedReference):
            return self._state.nodes[value.index()]
        if isinstance(value, mi.Properties.Reference):
            return next((node for node in self._state.nodes if node.props.id() == value.id()), None)
        return None

    def place(self, node: Any) -> str:
        """Where a node stands: "scene.xml (line 3, col 7)"."""
        import mitsuba as mi

        return mi.parser.file_location(self._state, node)

    def build(self) -> Any:
        """The Mitsuba scene. The graph is used up: build a copy to keep it.

        Meshes are not merged, which ``mi.load_file`` would do: a merged scene has its shapes in the order of their
        addresses in memory, so that two builds of one file choose their lights in a different order.
        """
        import mitsuba as mi

        parser = mi.parser
        try:
            with _file_resolver(self._resolver), mitsuba_errors():
                parser.transform_resolve(self._config, self._state)
                parser.transform_merge_equivalent(self._config, self._state)
                scene = parser.instantiate(self._config, self._state)
        except UserError as error:
            raise UserError(f"{error}{_mend(str(error), mi.variant())}") from error
        if not isinstance(scene, mi.Scene):
            raise UserError(f"{self.path} describes no <scene>")
        return scene


def _shrink(props: Any, pixels: int) -> tuple[int, int]:
    width, height = (int(props[name]) if name in props else size for name, size in zip(("width", "height"), _FILM_SIZE))
    factor = math.sqrt(pixels / (width * height))
    if factor >= 1.0 or any(name in props for name in _CROP):
        return width, height
    size = max(1, round(width * factor)), max(1, round(height * factor))
    props["width"], props["height"] = size
    return size


def _mend(message: str, variant: str) -> str:
    """What could help against an error of Mitsuba's, to be said behind it."""
    if "unreferenced propert" in message:
        return " (for old scenes, --lenient only warns of those)"
    missing = re.search(r'Plugin "(\w+)" not found', message)
    if missing and variant.startswith("scalar_") and missing[1] in _TRACED_INTEGRATORS:
        return f" (it is for JIT variants, and this is {variant})"
    return ""


def check_scene_file(path: Path) -> None:
    """Raises an error if there is no file to read."""
    if not path.exists():
        raise UserError(f"{path}: no such file")
    if path.is_dir():
        raise UserError(f"{path} is a folder, not a scene file")


def read_scene(path: Path, parameters: Mapping[str, str], lenient: bool = False) -> SceneGraph:
    """Reads a scene file with values for its ``$parameters``.

    ``lenient`` turns Mitsuba's errors on properties that no plugin asks for, which old scenes have, into warnings.
    """
    import mitsuba as mi

    check_scene_file(path)
    for name in _PARSER_ARGUMENTS:
        if name in parameters:
            raise UserError(f'a parameter cannot be called "{name}": Mitsuba\'s parser keeps that name for itself')

    config = mi.parser.ParserConfig(mi.variant())
    if lenient:
        config.unused_properties = mi.LogLevel.Warn
    resolver = mi.FileResolver(mi.file_resolver())
    resolver.prepend(str(path.resolve().parent))
    with _file_resolver(resolver), mitsuba_errors():
        try:
            state = mi.parser.parse_file(config, str(path), **parameters)
        except RuntimeError as error:
            _explain_unused(path, str(error))
            raise
        mi.parser.transform_upgrade(config, state)
    graph = SceneGraph(path, state, config, resolver)
    for node in state.nodes:
        if node.type == mi.ObjectType.Integrator:
            # Samples are divided into passes here (render.py): a second division inside must not contradict it, and
            # a limit of time would hold for each pass and take samples from it.
            if "timeout" in node.props and node.props["timeout"] > 0:
                mi.Log(mi.LogLevel.Warn, f"{path}: the integrator's timeout is not kept: all samples are rendered")
            for name in ("samples_per_pass", "timeout"):
                if name in node.props:
                    del node.props[name]
    return graph


def scene_defaults(path: Path) -> dict[str, str]:
    """The ``$names`` of a scene file and of those that it includes, with their default values."""
    check_scene_file(path)
    return dict(_defaults(path, _INCLUDE_DEPTH))


def _explain_unused(path: Path, message: str) -> None:
    """Where Mitsuba refuses parameters that the scene does not have, an error that lists those that it has."""
    unused = _UNUSED.findall(message) if "unused parameter" in message else []
    if not unused:
        return
    defaults = scene_defaults(path)
    close = difflib.get_close_matches(unused[0], defaults, n=1)
    hint = f' (did you mean "{close[0]}"?)' if close else ""
    has = ", ".join(f"{name}={value}" for name, value in defaults.items())
    names = ", ".join(f"${name}" for name in unused)
    raise UserError(
        f"{path}: the scene has no {names}{hint}; {f'it has {has}' if has else 'it has no <default> at all'}"
    )


def _defaults(path: Path, depth: int) -> Iterator[tuple[str, str]]:
    """The names and values of the ``<default>`` tags of a file and those that it includes."""
    for element in _elements(path):
        if element.tag == "default":
            yield element.get("name", ""), element.get("value", "")
    for inner in _included(path, depth):
        yield from _defaults(inner, depth - 1)


def _included(path: Path, depth: int) -> Iterator[Path]:
    import mitsuba as mi

    for element in _elements(path) if depth else ():
        if element.tag == "include":
            inner = Path(str(mi.file_resolver().resolve(element.get("filename", ""))))
            if inner.is_file():
                yield inner


def _elements(path: Path) -> list[ElementTree.Element]:
    """All elements of an XML file; none of one that is not XML, of which Mitsuba's parser will say what is wrong."""
    try:
        return list(ElementTree.parse(path).iter())
    except (ElementTree.ParseError, OSError, ValueError):
        return []


@contextmanager
def _file_resolver(resolver: Any) -> Iterator[None]:
    """Lets Mitsuba look for files with this resolver within the block."""
    import mitsuba as mi

    before = mi.file_resolver()
    mi.set_file_resolver(resolver)
    try:
        yield
    finally:
        mi.set_file_resolver(before)
