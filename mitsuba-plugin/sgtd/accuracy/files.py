"""The command from end to end: measures, and writes all files or none."""

from __future__ import annotations

from pathlib import Path

from ..atomic_output import AtomicOutput
from ..errors import UserError
from . import page, plots, study, tables

REPORT = "report.html"


def make(
    folder: Path,
    shapes: tuple[str, ...],
    scenes: tuple[Path, ...],
    variants: tuple[str, ...],
    parameters: dict[str, str],
    seed: int,
    quick: bool,
    steps: study.Steps,
    lenient: bool = False,
) -> study.Study:
    """Measures and writes ``report.html``, the plots, and the numbers as JSON and CSV into the folder."""
    _check_imports()
    with AtomicOutput(folder) as files:
        result = study.run(shapes, scenes, variants, parameters, seed, quick, steps, lenient)
        done = steps("writing", 1)
        main, functions, pictures = plots.draw_all(result)
        for plot in (main, *functions, *(plot for pair in pictures for plot in pair)):
            files.path(f"{plot.name}.png").write_bytes(plot.png)
            files.path(f"{plot.name}.svg").write_bytes(plot.svg)
        top = [functions[0], *(pair[0] for pair in pictures[:1])]
        files.path(REPORT).write_text(page.render(result, top, functions, pictures), encoding="utf-8")
        tables.write(result, files.path)
        done(1)
    return result


def _check_imports() -> None:
    """What the report needs beyond rendering, before anything is measured."""
    for module, package in (("scipy", "scipy"), ("jinja2", "jinja2"), ("matplotlib", "matplotlib")):
        try:
            __import__(module)
        except ImportError as error:
            raise UserError(f"the package {package} is missing: pip install {package}") from error
