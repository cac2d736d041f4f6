"""Both sides of a comparison: rendered with the same samples, measured, and written into a folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..atomic_output import AtomicOutput
from ..errors import UserError, one_line, require
from ..scene.exchange import Pair, exchange
from ..scene.graph import SceneGraph
from ..scene.render import Progress, render, sample_count, save
from ..scene.timing import seconds_text
from .difference import compare_images
from .figure import Labels, draw, ratio_text
from .table import Report

PICTURE = "comparison.png"
IMAGES = ("left.exr", "right.exr")
FILES = (*IMAGES, PICTURE, "comparison.csv", "comparison.json")

# Gets the name of a step and its length, and returns the call that advances it.
Steps = Callable[[str, int], Progress]


def compare_scene(
    graph: SceneGraph,
    folder: Path,
    settings: dict[str, str | float],
    parameters: dict[str, str],
    sensor: int = 0,
    spp: int | None = None,
    exposure: float | None = None,
    log: bool = False,
    steps: Steps | None = None,
) -> Report:
    """Renders both sides with the same samples, measures, and writes ``FILES`` into the folder."""
    import mitsuba as mi

    require("compare")
    graph.require_integrator()
    pair = exchange(graph, settings)
    steps = steps or _silent
    undrawn: Exception | None = None
    with AtomicOutput(folder) as files:
        # Both are built before any rendering, so that a refused shape shows at once.
        scenes = [pair.left.build(), pair.right.build()]
        count = sample_count(scenes[0], sensor, spp)
        left, right = render(scenes, sensor, count, steps("rendering", 2 * count))
        del scenes
        for name, rendering in zip(IMAGES, (left, right)):
            save(rendering.bitmap, files.path(name))

        done = steps("comparing", 2)
        try:
            result = compare_images(left, right, exposure, log)
            done(1)
            size = left.bitmap.size()
            report = Report(
                scene=graph.path,
                name=graph.name,
                parameters=parameters,
                settings=settings,
                variant=mi.variant(),
                mitsuba=mi.__version__,
                width=int(size[0]),
                height=int(size[1]),
                pair=pair,
                left=left,
                right=right,
                result=result,
            )
            draw(files.path(PICTURE), left.rgb(), right.rgb(), result, labels(report))
            report.write_csv(files.path("comparison.csv"))
            report.write_json(files.path("comparison.json"))
            done(1)
        except Exception as error:
            # What was rendered is kept, and nothing that an earlier run said of other images beside it.
            undrawn = error
            rest = tuple(name for name in FILES if name not in IMAGES)
            files.discard(*rest)
            for name in rest:
                (folder / name).unlink(missing_ok=True)
    if undrawn:
        raise UserError(
            f"the images are rendered ({' and '.join(str(folder / name) for name in IMAGES)}), "
            f"but not compared: {one_line(undrawn)}"
        ) from undrawn
    return report


def labels(report: Report) -> Labels:
    """The words of the picture."""
    result, left, right = report.result, report.left, report.right
    numbers = (
        f"Mean luminance {result.mean_left:.4g} and {result.mean_right:.4g} "
        f"({ratio_text(result.mean_right, result.mean_left)}).  RMSE {result.rmse:.3g}"
    )
    if result.rmse_noise is not None:
        numbers += f" (noise alone {result.rmse_noise:.2g}, beyond noise {result.rmse_beyond_noise:.3g})"
    numbers += "."
    compiling = "compiling included" if left.timing.compiling_is_included else "without compiling"
    how = f"Mitsuba {report.mitsuba}, {report.variant}, {left.spp} samples per pixel, same seeds."
    how += f"  Time {seconds_text(left.timing)} and {seconds_text(right.timing)}"
    how += f", {compiling}." if left.timing.compiles else "."
    bands = f"The film has {left.bands} spectral bands: their mean is shown and measured." if left.bands else ""
    # what is not finite is explained beside its color
    verdict = "" if result.any_bad else report.verdict()
    return Labels(
        title=f"{report.name}: the same materials and roughness, another distribution of microfacets",
        left=side_text(report.pair, "left"),
        right=side_text(report.pair, "right"),
        footer=tuple(line for line in (numbers, how, left.sampling_note(), bands, verdict) if line),
    )


def side_text(pair: Pair, side: str) -> tuple[str, str]:
    """What the materials of one side are: ("left: roughconductor, 4 materials", "3 × ggx; 1 × beckmann")."""
    counts: dict[str, int] = {}
    for entry in pair.exchanges:
        name = entry.left if side == "left" else entry.right
        counts[name] = counts.get(name, 0) + 1
    plugins = sorted({name.split(", ")[0] for name in counts})
    number = len(pair.exchanges)
    heading = f"{side}: {' and '.join(plugins)}" + (f", {number} materials" if number > 1 else "")
    ordered = sorted(counts.items(), key=lambda item: -item[1])
    # the heading says which plugin, unless there are two
    kinds = [(name.split(", ", 1)[1] if len(plugins) == 1 else name, count) for name, count in ordered]
    if len(kinds) == 1:
        return heading, kinds[0][0]
    shapes = [f"{count} × {shape}" for shape, count in kinds[:3]]
    if len(kinds) > 3:
        shapes.append(f"{len(kinds) - 3} other kinds")
    return heading, "; ".join(shapes)


def _silent(_name: str, _length: int) -> Progress:
    return lambda _done: None
