"""``sgtd gonio``."""

from __future__ import annotations

from pathlib import Path

import click

from .lists import CommandWithLists, Numbers
from .options import PATH
from .session import Bars, console_for_tables, start_mitsuba


@click.command("gonio", cls=CommandWithLists, short_help="Measure light on a surface, and judge Smith's model by it.")
@click.argument("heights", type=PATH, metavar="SURFACE")
@click.option(
    "--theta",
    "thetas",
    type=Numbers(0.0, 89.9),
    default="0,30,60,80",
    show_default=True,
    help="Polar angles of the light.",
)
@click.option("--phi", type=float, default=0.0, show_default=True, help="Azimuth of the light, in degrees.")
@click.option("--material", metavar="NAME", help='A metal by Mitsuba\'s name, as "Au" (default: a mirror).')
@click.option("--ior", type=float, help="Glass of this index over the outside's; below 1, light comes from inside.")
@click.option(
    "--orders", type=click.IntRange(1, 64), default=4, show_default=True, help="Numbers of facets told apart."
)
@click.option("--walks", type=click.IntRange(1000), default=500_000, show_default=True, help="For each angle.")
@click.option("--polar", type=click.IntRange(2, 360), default=30, show_default=True, help="Bins of the polar angle.")
@click.option("--azimuths", type=click.IntRange(2, 720), default=24, show_default=True, help="Bins of the azimuth.")
@click.option("--shape", metavar="ROW[:NAME=VALUE,...]", help="The model's distribution (default: the sidecar's).")
@click.option("--alpha", type=Numbers(1e-6, 1e6, (1, 2)), help="Its roughness, or those along x and y, with --shape.")
@click.option("--level", is_flag=True, help="Take off the tilt of a measured map.")
@click.option("--mirror", is_flag=True, help="Make a measured map periodic by its mirror images.")
@click.option("--spacing", type=float, nargs=2, metavar="DX DY", help="Distances of points (default: the file's).")
@click.option("--gray", type=float, nargs=2, metavar="LOW HIGH", help="Heights of black and white of an image.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all random numbers.")
@click.option("-o", "--output", type=PATH, default="out/gonio", show_default=True, help="Folder to write.")
def gonio_command(
    heights: Path,
    thetas: tuple[float, ...],
    phi: float,
    material: str | None,
    ior: float | None,
    orders: int,
    walks: int,
    polar: int,
    azimuths: int,
    shape: str | None,
    alpha: tuple[float, ...] | None,
    level: bool,
    mirror: bool,
    spacing: tuple[float, float] | None,
    gray: tuple[float, float] | None,
    seed: int,
    output: Path,
) -> None:
    """Measure light on a surface facet by facet, and judge Smith's model by it.

    Energy by number of facets, masking by facet and directions, with standard errors, beside Smith's model of the surface's own slopes
    and of the distribution it was made for, the multiple_scattering lobe, and the random walk.

    \b
    Examples:
      sgtd gonio out/student.npy --theta 0 30 60 80 -o out/student
      sgtd gonio out/brushed.ply --theta 60 --phi 90 --material Au -o out/gold
      sgtd gonio out/student.npy --ior 1.5 -o out/glass
      sgtd gonio measured.gsf --level --mirror -o out/measured

    Writes report.html, plots as PNG and SVG, gonio.json, effects.csv, masking.csv and bins.csv.
    """
    from .. import atomic_output
    from ..errors import UserError, require
    from ..microsurface import read_heights
    from ..microsurface.goniometer import Bins, Material
    from ..microsurface.report import REPORT, make
    from ..microsurface.tables import print_effects
    from ..named_shape import parse_shape

    require("report")
    if (shape is None) != (alpha is None):
        raise UserError("--shape and --alpha go together: the distribution that the surface is compared with")
    surface = read_heights(heights, spacing, level, gray)
    if mirror and not surface.periodic:
        surface = surface.mirrored()
    ndf = surface.ndf
    if shape is not None and alpha is not None:
        ndf = parse_shape(shape).ndf(alpha[0], alpha[-1], 1e-5)
    surface.core  # noqa: B018  (says what is wrong with it before anything is started)
    atomic_output.check(output, (REPORT,))
    start_mitsuba("scalar_rgb")
    facets = Material.of(material, ior)
    with Bars() as bars:
        found = make(
            surface,
            heights.name,
            ndf,
            thetas,
            output,
            phi=phi,
            material=facets,
            bins=Bins(polar, azimuths, orders),
            walks=walks,
            seed=seed,
            progress=bars.add,
        )
    for note in (*surface.notes, *found.notes):
        click.echo(f"sgtd: {note}", err=True)
    print_effects(found, console_for_tables())
    click.echo(f"Report: {output / REPORT}")
