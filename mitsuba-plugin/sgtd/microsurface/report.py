"""``sgtd gonio`` from end to end: measures, and writes all files or none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..atomic_output import AtomicOutput
from ..ndf import Ndf
from ..page.plot_style import Plot
from ..page.template import data, load_template
from . import tables
from .comparison import Comparison, compare
from .figures import draw_all
from .goniometer import Bins, Material
from .pictures import draw_surface
from .surface import Surface
from .watching import Advance

REPORT = "report.html"


def make(
    surface: Surface,
    title: str,
    ndf: Ndf | None,
    thetas: Sequence[float],
    folder: Path,
    *,
    phi: float,
    material: Material,
    bins: Bins,
    walks: int,
    seed: int,
    progress: Callable[[str, int], Advance],
) -> Comparison:
    """Measures and writes ``report.html``, the plots, and the numbers as JSON and CSV into the folder."""
    with AtomicOutput(folder) as files:
        found = compare(
            surface, ndf, thetas, phi=phi, material=material, bins=bins, walks=walks, seed=seed, progress=progress
        )
        plots = draw_all(found)
        heights = draw_surface(surface, ndf, title)
        for plot in (heights, *plots):
            files.path(f"{plot.name}.png").write_bytes(plot.png)
            files.path(f"{plot.name}.svg").write_bytes(plot.svg)
        files.path(REPORT).write_text(_page(found, title, heights, plots), encoding="utf-8")
        tables.write(found, files.path)
    return found


def _page(found: Comparison, title: str, heights: Plot, plots: list[Plot]) -> str:
    template = load_template(Path(__file__).with_name("gonio.html.j2"), svg_of_png=lambda plot: data("png", plot.png))
    setup = found.views[0].setup
    return template.render(
        title=title,
        material=found.material.name,
        walks=setup.walks,
        seed=setup.seed,
        sentences=tables.sentences(found),
        notes=[*found.surface.notes, *found.notes],
        surface=heights,
        plots=plots,
        has_target=found.ndf is not None,
        effects=[(view.theta, view.effects) for view in found.views],
    )
