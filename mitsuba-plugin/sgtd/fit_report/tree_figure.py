"""The rows of the family as a picture: what was tried, how far each is off, and which is a special case of which."""

from __future__ import annotations

from dataclasses import dataclass

from ..fitting.rows import ROWS
from ..page.plot_style import INK, VERMILION, Plot, finish, new_figure

# Where rows stand: from few free parameters below to many above
_PLACES = {
    "beckmann": (1.0, 0.0),
    "ggx": (0.0, 0.0),
    "student": (0.0, 1.0),
    "gnd": (1.0, 1.0),
    "snd": (2.0, 1.0),
    "gtd": (0.0, 2.0),
    "std": (1.0, 2.0),
    "sgnd": (2.0, 2.0),
    "sgtd": (1.0, 3.0),
    "mixture": (3.1, 2.0),
    "tabulated": (3.1, 3.0),
}


@dataclass(frozen=True)
class Node:
    """A row, the lines below its name, and how good it is from 0 to 1."""

    name: str
    text: str
    good: float
    chosen: bool


def draw_tree(nodes: list[Node], words: str) -> Plot:
    from matplotlib import colormaps

    figure = new_figure(columns=2)
    figure.set_figheight(4.6)
    axes = figure.add_subplot()
    there = {node.name for node in nodes}
    for name in there & set(ROWS):
        for child in there & set(ROWS[name].children):
            (x, y), (u, v) = _PLACES[name], _PLACES[child]
            axes.plot([x, u], [y, v], color="#bbbbbb", linewidth=1.2, zorder=1)
    for node in nodes:
        x, y = _PLACES[node.name]
        axes.text(
            x,
            y,
            f"{node.name}\n{node.text}",
            ha="center",
            va="center",
            fontsize=8.5,
            zorder=2,
            color="white" if node.good > 0.7 else INK,
            bbox={
                "boxstyle": "round,pad=0.35",
                "facecolor": colormaps["Blues"](0.1 + 0.65 * node.good),
                "edgecolor": VERMILION if node.chosen else "#999999",
                "linewidth": 2.2 if node.chosen else 0.8,
            },
        )
    beside = any(_PLACES[name][0] > 3.0 for name in there)
    axes.set(xlim=(-0.6, 3.7 if beside else 2.6), ylim=(-0.5, 3.5 if max(_PLACES[n][1] for n in there) > 2.5 else 2.5))
    axes.set_yticks(range(4 if axes.get_ylim()[1] > 3.0 else 3))
    axes.set_yticklabels(["0", "1 or 2", "2 or 3", "4"][: len(axes.get_yticks())])
    axes.set_xticks([])
    axes.set_ylabel("free parameters of the shape", color=INK)
    for side in axes.spines.values():
        side.set_visible(False)
    return finish("tree", "The rows that were tried", words, figure, ("svg",))
