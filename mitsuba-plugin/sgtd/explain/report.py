"""The explanation of a scene: put together, on the terminal, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from .._core import Shape
from ..scene.exchange import ORIGINALS
from ..scene.graph import SceneGraph
from .advice import advise, advise_scene
from .cost import Cost, count_code_paths, measure_costs
from .material import Material, explain_material

# Gets the name of a step and its length, and returns the call that advances it.
Steps = Callable[[str, int], Callable[[int], None]]


@dataclass(frozen=True)
class Other:
    """A material of another plugin."""

    id: str
    plugin: str
    place: str

    @property
    def exchangeable(self) -> bool:
        return self.plugin in ORIGINALS.values()


@dataclass(frozen=True)
class Explained:
    """A material of this family with what was measured and what is advised."""

    material: Material
    costs: tuple[Cost, ...]
    advice: tuple[str, ...]
    shares_tables_with: tuple[str, ...]


@dataclass(frozen=True)
class Explanation:
    """All that can be said of a scene."""

    scene: str
    variant: str
    materials: tuple[Explained, ...]
    others: tuple[Other, ...]
    code_paths: int | None
    table_bytes: int
    advice: tuple[str, ...]


def explain(graph: SceneGraph, repetitions: int, steps: Steps) -> Explanation:
    """Explains every BSDF of the scene in the current variant; 0 repetitions leave out the timing."""
    import mitsuba as mi

    # Mitsuba itself judges the file first, with its own messages
    scene = graph.copy().build()
    paths = count_code_paths(scene)
    del scene

    found = list(graph.bsdfs())
    ours = [(node, holders) for node, holders in found if node.props.plugin_name() in ORIGINALS]
    advance = steps("reading", len(ours))
    materials = []
    for node, holders in ours:
        materials.append(explain_material(graph, node, holders))
        advance(1)
    others = tuple(
        Other(str(node.props.id()) or "unnamed", node.props.plugin_name(), graph.place(node))
        for node, _ in found
        if node.props.plugin_name() not in ORIGINALS
    )

    scalar = mi.variant().startswith("scalar_")
    advance = steps("timing", len(materials))
    costs: dict[tuple[Any, ...], tuple[Cost, ...]] = {}
    explained = []
    bytes_of: dict[tuple[Any, ...], int] = {}
    for material in materials:
        # numbers do not change traced code; scalar code multiplies some exponents out
        key = (*material.structure(), material.node_shape if scalar else None, material.accuracy_asked == 0.0)
        if repetitions > 0 and key not in costs:
            costs[key] = measure_costs(material, repetitions)
        same = [m.id for m in materials if m is not material and _tables_key(m) == _tables_key(material)]
        if material.tables:
            bytes_of[_tables_key(material)] = material.tables.bytes
        else:
            same = []
        advice = advise(material, scalar)
        explained.append(Explained(material, costs.get(key, ()), tuple(advice), tuple(same)))
        advance(1)
    return Explanation(
        scene=str(graph.path),
        variant=mi.variant(),
        materials=tuple(explained),
        others=others,
        code_paths=paths,
        table_bytes=sum(bytes_of.values()),
        advice=tuple(advise_scene(materials, paths, scalar)),
    )


def _tables_key(material: Material) -> tuple[Any, ...]:
    return (material.node_shape, material.accuracy_asked, material.on("visible normals"))


def as_dict(explanation: Explanation) -> dict[str, Any]:
    """The explanation in plain values."""
    return {
        "scene": explanation.scene,
        "variant": explanation.variant,
        "code_paths": explanation.code_paths,
        "table_bytes": explanation.table_bytes,
        "advice": list(explanation.advice),
        "materials": [_material(entry) for entry in explanation.materials],
        "others": [{**asdict(other), "exchangeable": other.exchangeable} for other in explanation.others],
    }


def _material(entry: Explained) -> dict[str, Any]:
    material = entry.material
    return {
        "id": material.id,
        "plugin": material.plugin,
        "place": material.place,
        "inside": list(material.holders),
        "distribution": material.row,
        "properties": dict(material.properties),
        "defaults": list(material.defaulted),
        "shape": _numbers(dict(zip(("gamma", "p", "lam", "shift"), material.shape.numbers()))),
        "node": material.node,
        "shifted": material.node_shape.shift > 0.0,
        "code": material.builtin or "tables",
        "why": material.why,
        "alpha_scale": material.alpha_scale,
        "effects": [asdict(effect) for effect in material.effects],
        "table_bytes": material.tables.bytes if material.tables else 0,
        "build_seconds": material.tables.build_seconds if material.tables else 0.0,
        "accuracy_asked": material.accuracy_asked,
        "accuracy_reached": material.tables.accuracy_reached if material.tables else None,
        "loss_table_bytes": material.losses.bytes if material.losses else 0,
        "loss_error": material.losses.error if material.losses else None,
        "shares_tables_with": list(entry.shares_tables_with),
        "costs": [asdict(cost) for cost in entry.costs],
        "advice": list(entry.advice),
    }


def _numbers(values: dict[str, float]) -> dict[str, Any]:
    """JSON has no infinity."""
    return {name: value if math.isfinite(value) else str(value) for name, value in values.items()}


def print_explanation(explanation: Explanation, console: Any) -> None:
    """One table per material, then the scene."""
    from rich.table import Table

    for entry in explanation.materials:
        table = Table(title=_title(entry.material), title_justify="left", show_header=False, title_style="bold")
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        for name, text in _lines(entry):
            table.add_row(name, text)
        console.print(table)
    for line in _scene_lines(explanation):
        console.print(line, highlight=False, soft_wrap=True)


def _title(material: Material) -> str:
    inside = f", inside {', '.join(material.holders)}" if material.holders else ""
    return f"{material.id}: {material.plugin}{inside}, {material.place}"


def _lines(entry: Explained) -> list[tuple[str, str]]:
    material = entry.material
    written = ", ".join(f"{name} = {value}" for name, value in material.properties.items())
    defaults = ", ".join(material.defaulted)
    lines = [
        ("written", f"{written or 'nothing'} (by default: {defaults})" if defaults else written),
        ("shape", _words(material.shape)),
        ("runs at", _node(material)),
        ("because", material.why),
        ("on", "; ".join(f"{e.name} ({e.words})" for e in material.effects if e.on) or "nothing"),
        ("off", ", ".join(e.name for e in material.effects if not e.on) or "nothing"),
    ]
    if material.tables:
        tables = material.tables
        shared = f" (shared with {', '.join(entry.shares_tables_with)})" if entry.shares_tables_with else ""
        lines += [
            ("tables", f"{tables.bytes} bytes{shared}, built in {1e3 * tables.build_seconds:.2f} ms"),
            ("error of G1", f"{tables.accuracy_reached:.2g}, {material.accuracy_asked:g} permitted"),
        ]
    else:
        lines.append(("tables", "none: nothing to build"))
    if material.losses:
        lines.append(("losses", f"{material.losses.bytes} bytes, error of E {material.losses.error:.2g}"))
    lines.append(("cost", "\n".join(cost.words() for cost in entry.costs) or "not measured"))
    lines.append(("cheaper", "\n".join(entry.advice) or "nothing"))
    return lines


def _words(shape: Shape) -> str:
    return f"gamma = {shape.gamma:g}, p = {shape.p:g}, lambda = {shape.lam:g}, shift = {shape.shift:g}"


def _node(material: Material) -> str:
    text = material.node + (", shifted" if material.node_shape.shift > 0.0 else "")
    return text if material.alpha_scale == 1.0 else f"{text}, at a roughness of {material.alpha_scale:g} times alpha"


def _scene_lines(explanation: Explanation) -> list[str]:
    lines = []
    name = explanation.scene
    count = len(explanation.materials)
    if count == 0 and not explanation.others:
        lines.append(f"{name} has no materials: there is nothing to explain.")
    elif count == 0:
        lines.append(f"{name} has no material of this family ({', '.join(ORIGINALS)}).")
    else:
        lines.append(f"{name}: {count} of this family, {explanation.table_bytes} bytes of tables in all.")
    exchangeable = [other for other in explanation.others if other.exchangeable]
    for other in exchangeable:
        ours = next(ours for ours, theirs in ORIGINALS.items() if theirs == other.plugin)
        lines.append(
            f"  {other.id}: {other.plugin}, {other.place}, could be exchanged for {ours}: the same code at first"
        )
    rest = [other.plugin for other in explanation.others if not other.exchangeable]
    if rest:
        kinds = ", ".join(f"{rest.count(plugin)} × {plugin}" for plugin in dict.fromkeys(rest))
        lines.append(f"  others: {kinds}")
    if explanation.code_paths is not None and (count or explanation.others):
        lines.append(
            f"Code paths of materials in {explanation.variant}: {explanation.code_paths}, counted in a compiled kernel. Rays that hit "
            "different ones side by side pay for each; materials that differ in numbers alone share one."
        )
    elif count:
        lines.append(f"Code paths do not count in {explanation.variant}: each ray runs its own material alone.")
    lines += [f"  {text}" for text in explanation.advice]
    return lines
