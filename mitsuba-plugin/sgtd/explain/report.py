"""The explanation of a scene: put together, on the terminal, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from .._core import Shape
from ..errors import UserError
from ..scene.exchange import NEVER_EXCHANGED, ORIGINALS
from ..scene.graph import SceneGraph
from .advice import advise, advise_scene
from .cost import Cost, count_code_paths, measure_costs, measure_scene
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
    render: Cost | None
    not_rendered: str
    materials: tuple[Explained, ...]
    others: tuple[Other, ...]
    code_paths: int | None
    table_bytes: int
    advice: tuple[str, ...]


def explain(graph: SceneGraph, repetitions: int, functions: bool, steps: Steps) -> Explanation:
    """Explains every BSDF of the scene in the current variant; 0 repetitions leave out the timing, ``functions`` times each material."""
    import mitsuba as mi

    # Mitsuba itself judges the file first, with its own messages
    scene = graph.copy().build()
    paths = count_code_paths(scene)
    has_camera = bool(scene.sensors())
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
    advance = steps("timing", len(materials) + 1)
    render, not_rendered = None, ""
    if materials and repetitions > 0:
        try:
            if not has_camera:
                raise UserError("the scene has no sensor")
            render = measure_scene(graph, repetitions)
        except UserError as error:
            not_rendered = str(error)
    advance(1)
    costs: dict[tuple[Any, ...], tuple[Cost, ...]] = {}
    explained = []
    bytes_of: dict[tuple[Any, ...], int] = {}
    for material in materials:
        # numbers do not change traced code; scalar code multiplies some exponents out
        key = (*material.structure(), material.key if scalar else None, material.accuracy_asked == 0.0)
        if functions and repetitions > 0 and key not in costs:
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
        render=render,
        not_rendered=not_rendered,
        materials=tuple(explained),
        others=others,
        code_paths=paths,
        table_bytes=sum(bytes_of.values()),
        advice=tuple(advise_scene(materials, paths, scalar)),
    )


def _tables_key(material: Material) -> tuple[Any, ...]:
    return (material.key, material.accuracy_asked, material.on("visible normals"))


def as_dict(explanation: Explanation) -> dict[str, Any]:
    """The explanation in plain values."""
    return {
        "scene": explanation.scene,
        "variant": explanation.variant,
        "render": asdict(explanation.render) if explanation.render else None,
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
        "shape": None
        if material.shape is None
        else _numbers(dict(zip(("gamma", "p", "lam", "shift"), material.shape.numbers()))),
        "node": material.node,
        "shifted": material.node_shape is not None and material.node_shape.shift > 0.0,
        "code": material.builtin or "tables",
        "why": material.why,
        "alpha_scale": material.alpha_scale,
        "effects": [asdict(effect) for effect in material.effects],
        "table_bytes": material.tables.bytes if material.tables else 0,
        "build_seconds": material.tables.build_seconds if material.tables else 0.0,
        "accuracy_asked": material.accuracy_asked,
        "accuracy_reached": material.tables.accuracy_reached if material.tables else None,
        "missing_energy_table_bytes": material.missing_energy.bytes if material.missing_energy else 0,
        "missing_energy_error": material.missing_energy.error if material.missing_energy else None,
        "shares_tables_with": list(entry.shares_tables_with),
        "costs": [asdict(cost) for cost in entry.costs],
        "advice": list(entry.advice),
    }


def _numbers(values: dict[str, float]) -> dict[str, Any]:
    """JSON has no infinity."""
    return {name: value if math.isfinite(value) else str(value) for name, value in values.items()}


def print_explanation(explanation: Explanation, console: Any) -> None:
    """What a render takes, one table per kind of material, then the scene."""
    from rich.table import Table

    for line in _first_lines(explanation):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for entries in _alike(explanation.materials):
        table = Table(title=_title(entries), title_justify="left", show_header=False, title_style="bold")
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        for name, text in (*_written(entries), *_lines(entries[0])):
            table.add_row(name, text)
        console.print(table)
    for line in _scene_lines(explanation):
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _first_lines(explanation: Explanation) -> list[str]:
    cost = explanation.render
    if cost is None:
        return [f"A render was not timed: {explanation.not_rendered}."] if explanation.not_rendered else []
    times = f"{cost.ratio:.2f} times (quartiles {cost.low:.2f} to {cost.high:.2f})"
    return [f"A render of {explanation.scene} takes {times} as long as with {cost.against}: {cost.what}."]


def _alike(materials: tuple[Explained, ...]) -> list[list[Explained]]:
    """Materials of which the same is to be said are told of once."""
    groups: dict[tuple[Any, ...], list[Explained]] = {}
    for entry in materials:
        # equal shapes have equal tables, but were timed one by one
        said = (line for line in _lines(entry) if line[0] != "tables")
        groups.setdefault((entry.material.plugin, entry.material.holders, entry.material.defaulted, *said), []).append(
            entry
        )
    return list(groups.values())


def _title(entries: list[Explained]) -> str:
    material = entries[0].material
    inside = f", inside {', '.join(material.holders)}" if material.holders else ""
    if len(entries) > 1:
        return f"{len(entries)} × {material.plugin}{inside}: {_names([entry.material.id for entry in entries])}"
    return f"{material.id}: {material.plugin}{inside}, {material.place}"


def _names(names: list[str]) -> str:
    """Names in a row, those without one counted."""
    known = [name for name in names if name != "unnamed"]
    unnamed = len(names) - len(known)
    return ", ".join([*known, *([f"{unnamed} unnamed"] if unnamed > 1 else ["unnamed"] * unnamed)])


def _written(entries: list[Explained]) -> list[tuple[str, str]]:
    """What the file says: what all of these materials have, then what each has of its own."""
    materials = [entry.material for entry in entries]
    first = materials[0]
    common = {
        name: value
        for name, value in first.properties.items()
        if all(m.properties.get(name) == value for m in materials)
    }
    defaults = f" (by default: {', '.join(first.defaulted)})" if first.defaulted else ""
    lines = [("written", f"{_assignments(common) or 'nothing'}{defaults}")]
    if len(materials) > 1:
        for material in materials:
            own = {name: value for name, value in material.properties.items() if name not in common}
            lines.append(("", f"{material.id}: {_assignments(own) or 'nothing more'}, {material.place}"))
    return lines


def _assignments(properties: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in properties.items())


def _lines(entry: Explained) -> list[tuple[str, str]]:
    material = entry.material
    lines = [
        *((("shape", _words(material.shape)),) if material.shape is not None else ()),
        ("runs at", _node(material)),
        ("because", material.why),
        ("on", "; ".join(f"{e.name} ({e.words})" for e in material.effects if e.on) or "nothing"),
        ("off", ", ".join(e.name for e in material.effects if not e.on) or "nothing"),
    ]
    if material.tables:
        tables = material.tables
        # whoever shares them says the same, so that the two can be told of together
        names = sorted({material.id, *entry.shares_tables_with})
        shared = f" (one for {', '.join(names)})" if len(names) > 1 else ""
        lines += [
            ("tables", f"{tables.bytes} bytes{shared}, built in {1e3 * tables.build_seconds:.2g} ms"),
            ("error of G1", f"{tables.accuracy_reached:.2g}, {material.accuracy_asked:g} permitted"),
        ]
    else:
        lines.append(("tables", "none: nothing to build"))
    if material.missing_energy:
        lines.append(
            ("missing energy", f"{material.missing_energy.bytes} bytes, error of E {material.missing_energy.error:.2g}")
        )
    if entry.costs:
        lines.append(("by itself", "\n".join(cost.words() for cost in entry.costs)))
    lines.append(("cheaper", "\n".join(entry.advice) or "nothing"))
    return lines


def _words(shape: Shape) -> str:
    return f"gamma = {shape.gamma:g}, p = {shape.p:g}, lambda = {shape.lam:g}, shift = {shape.shift:g}"


def _node(material: Material) -> str:
    if material.node_shape is None:
        return material.node
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
    for ours, plugin in ORIGINALS.items():
        found = [other for other in explanation.others if other.plugin == plugin]
        if found:
            who = _names([other.id for other in found])
            where = found[0].place + (f" and {len(found) - 1} more" if len(found) > 1 else "")
            lines.append(f"  {who}: {plugin}, {where}, could be exchanged for {ours}: the same code at first")
    rest = [other.plugin for other in explanation.others if not other.exchangeable]
    for plugin in dict.fromkeys(rest):
        why = f", never exchanged: {NEVER_EXCHANGED[plugin]}" if plugin in NEVER_EXCHANGED else ""
        lines.append(f"  {rest.count(plugin)} × {plugin}{why}")
    if explanation.code_paths is not None and (count or explanation.others):
        lines.append(
            f"Code paths of materials in {explanation.variant}: {explanation.code_paths}, counted in a compiled kernel. Rays that hit "
            "different ones side by side pay for each; materials that differ in numbers alone share one."
        )
    elif count:
        lines.append(f"Code paths do not count in {explanation.variant}: each ray runs its own material alone.")
    lines += [f"  {text}" for text in explanation.advice]
    return lines
