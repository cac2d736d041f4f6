"""``sgtd fit``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .options import PATH
from .session import Bars, console_for_tables

if TYPE_CHECKING:
    from ..jobs import Outcome


@click.command("fit", short_help="Fit a material to measured reflectance, or a distribution to a height map.")
@click.argument("files", type=PATH, metavar="DATA...", nargs=-1, required=True)
@click.option(
    "--model",
    "models",
    multiple=True,
    metavar="auto|ROW|tabulated|mixture",
    help="auto climbs the family's tree; several times: the best of these (default: auto).",
)
@click.option(
    "--base",
    type=click.Choice(["none", "diffuse"]),
    default="diffuse",
    show_default=True,
    help="What lies below the facets: nothing (a metal), or a diffuse base (a plastic).",
)
@click.option(
    "--fresnel",
    type=click.Choice(["schlick", "dielectric", "conductor"]),
    default="schlick",
    show_default=True,
    help="What facets reflect; a conductor needs --base none.",
)
@click.option(
    "--loss",
    type=click.Choice(["log", "cbrt", "l2"]),
    default="log",
    show_default=True,
    help="What counts of value × cosine: ln(1 + v), the cube root, or v.",
)
@click.option(
    "--max-angle",
    type=click.FloatRange(5.0, 89.9),
    default=80.0,
    show_default=True,
    help="Degrees from the normal up to which directions count.",
)
@click.option(
    "--masking", type=click.Choice(["separable", "height_correlated"]), default="separable", show_default=True
)
@click.option(
    "--anisotropic/--isotropic",
    default=None,
    help="Two roughnesses and a rotation, or one (default: two if the sample was turned and it pays).",
)
@click.option("--level", is_flag=True, help="Of a height map: take off the tilt, the mean slope of the facets.")
@click.option(
    "--spacing",
    type=float,
    nargs=2,
    metavar="DX DY",
    help="Of a height map: distances of points, in the unit of heights (default: the file's).",
)
@click.option(
    "--gray",
    type=float,
    nargs=2,
    metavar="LOW HIGH",
    help="Of a height map of gray values: heights of black and white.",
)
@click.option("--jobs", type=click.IntRange(1), help="Processes for several files (default: one for each core).")
@click.option(
    "--scheduler", metavar="ADDRESS", help="Of a Dask cluster, whose workers see the same files; needs sgtd[dask]."
)
@click.option("-o", "--output", type=PATH, default="out/fit", show_default=True, help="Folder to write.")
def fit_command(
    files: tuple[Path, ...],
    models: tuple[str, ...],
    jobs: int | None,
    scheduler: str | None,
    output: Path,
    **rest: Any,
) -> None:
    """Fit a material to measured reflectance: MERL .binary, RGL .bsdf, UTIA .bin, CSV, npz; or a distribution to a map of heights.

    One file: OUT gets material.xml, fit.json, scores.csv and report.html. Several: each gets a folder, on all cores or on a cluster, and OUT
    summary.html and summary.csv; the same command goes on where it was stopped.

    \b
    Examples:
      sgtd fit brass.binary --base none --fresnel conductor -o out/brass
      sgtd fit scan.csv --model gtd --max-angle 75 -o out/scan
      sgtd fit merl/*.binary --jobs 4 -o out/merl
      sgtd fit rgl/*.bsdf --scheduler tcp://head:8786 -o /shared/rgl
      sgtd fit measured.npy --spacing 0.5 0.5 --level -o out/surface

    In CSV the first line names the columns: theta_i, phi_i, theta_o, phi_o and channels, or theta_i and a signed theta_o.
    """
    from .. import atomic_output
    from ..errors import UserError, require
    from ..fit_report import Options, fit_files
    from ..fit_report.names import FILES, REPORT
    from ..fit_report.one import fit_file
    from ..fit_report.summary import PAGE
    from ..fitting.reflectance import check

    require("fit")
    if scheduler is not None:
        require("dask")
    options = Options(model=models or ("auto",), **rest)
    check(options.setting, options.model)
    if len(files) == 1 and scheduler is None:
        atomic_output.check(output, FILES)
        with Bars() as bars:
            bars.say(f"fits of {files[0].name}")
            found = fit_file(str(files[0]), str(output), options.as_json())
        _print_one(found)
        click.echo(f"Material: {output / 'material.xml'}, report: {output / REPORT}")
        return
    with Bars() as bars:
        outcomes = fit_files(files, output, options, workers=jobs, scheduler=scheduler, progress=bars.add)
    _print_many(outcomes)
    click.echo(f"Summary: {output / PAGE}")
    failed = [outcome for outcome in outcomes if outcome.error]
    if failed:
        raise UserError(f"{len(failed)} of {len(outcomes)} files were not fitted, the first: {failed[0].error}")


def _print_one(found: dict[str, Any]) -> None:
    from rich.table import Table

    for note in found["warnings"]:
        click.echo(f"sgtd: {note}", err=True)
    table = Table(box=None, pad_edge=False)
    for name in ("model", "error", "over GGX"):
        table.add_column(name, justify="left" if name == "model" else "right")
    ggx = found["errors"].get("ggx")
    for name, error in sorted(found["errors"].items(), key=lambda pair: pair[1]):
        mark = " ←" if name == found["model"] else ""
        table.add_row(name + mark, f"{error:.4g}", f"{error / ggx:.3f}" if ggx else "–")
    if "log_likelihoods" in found:
        table = Table(box=None, pad_edge=False)
        table.add_column("model")
        table.add_column("log-likelihood a facet", justify="right")
        for name, value in sorted(found["log_likelihoods"].items(), key=lambda pair: -pair[1]):
            table.add_row(name + (" ←" if name == found["model"] else ""), f"{value:.5f}")
    console_for_tables().print(table)
    told = ", ".join(f"{name} = {'∞' if x is None else f'{x:.4g}'}" for name, x in found["parameters"].items())
    click.echo(f"{found['model']}: {told}")
    if found["not_identifiable"]:
        click.echo(f"The data do not tell {', '.join(found['not_identifiable'])}.")


def _print_many(outcomes: list[Outcome]) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for name in ("name", "model", "error", "over GGX", "s"):
        table.add_column(name, justify="left" if name in ("name", "model") else "right")
    for outcome in outcomes:
        if not outcome.error:
            found = outcome.result
            over = "–" if found["over_ggx"] is None else f"{found['over_ggx']:.3f}"
            table.add_row(outcome.task.key, found["model"], f"{found['error']:.4g}", over, f"{found['seconds']:.1f}")
    console_for_tables().print(table)
