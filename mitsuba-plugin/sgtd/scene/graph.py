"""A scene file as a graph of nodes, before any Mitsuba object exists.

The file is read by Mitsuba's own parser (``mi.parser``): parameters, included files, ``<path>`` tags and old file
versions mean here what they mean to Mitsuba. Nodes can then be edited, and the graph be built as often as needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import UserError, mitsuba_errors

# mi.parser.parse_file takes the scene's parameters as keyword arguments beside two of its own.
_PARSER_ARGUMENTS = ("config", "filename")


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
        with _file_resolver(self._resolver), mitsuba_errors():
            parser.transform_resolve(self._config, self._state)
            parser.transform_merge_equivalent(self._config, self._state)
            scene = parser.instantiate(self._config, self._state)
        if not isinstance(scene, mi.Scene):
            raise UserError(f"{self.path} describes no <scene>")
        return scene


def read_scene(path: Path, parameters: Mapping[str, str]) -> SceneGraph:
    """Reads a scene file with values for its ``$parameters``."""
    import mitsuba as mi

    if not path.exists():
        raise UserError(f"{path}: no such file")
    if path.is_dir():
        raise UserError(f"{path} is a folder, not a scene file")
    for name in _PARSER_ARGUMENTS:
        if name in parameters:
            raise UserError(f'a parameter cannot be called "{name}": Mitsuba\'s parser keeps that name for itself')

    config = mi.parser.ParserConfig(mi.variant())
    resolver = mi.FileResolver(mi.file_resolver())
    resolver.prepend(str(path.resolve().parent))
    with _file_resolver(resolver), mitsuba_errors():
        state = mi.parser.parse_file(config, str(path), **parameters)
        mi.parser.transform_upgrade(config, state)
    for node in state.nodes:
        # Samples are divided into passes here (scene/render.py); a second division inside must not contradict it.
        if node.type == mi.ObjectType.Integrator and "samples_per_pass" in node.props:
            del node.props["samples_per_pass"]
    return SceneGraph(path, state, config, resolver)


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
