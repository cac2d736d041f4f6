"""``sgtd surface``."""

from __future__ import annotations

from pathlib import Path

import click

from .lists import CommandWithLists, Numbers
from .options import PATH
from .session import Bars


@click.command("surface", cls=CommandWithLists, short_help="Make a surface whose facets have a given distribution.")
@click.option(
    "--shape", required=True, metavar="ROW[:NAME=VALUE,...]|TABLE", help='As "student:gamma=1.7", or a .csv or .npz.'
)
@click.option(
    "--alpha",
    type=Numbers(1e-6, 1e6, (1, 2)),
    help="Roughness, or those along x and y (default: 0.3; of a table, its own).",
)
@click.option("-n", "size", type=click.IntRange(16, 16384), default=512, show_default=True, help="Points along a side.")
@click.option(
    "--correlation",
    type=float,
    default=8.0,
    show_default=True,
    help="Correlation length in points; thin rings want 16.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all random numbers.")
@click.option(
    "--tolerance",
    type=float,
    default=1e-3,
    show_default=True,
    help="Kolmogorov–Smirnov distance of slopes at which it stops.",
)
@click.option("--steps", type=click.IntRange(min=1), default=200, show_default=True, help="Steps at the most.")
@click.option(
    "-o",
    "--output",
    "outputs",
    type=PATH,
    multiple=True,
    required=True,
    help="File: .npy, .ply, .obj, .exr, .gsf, .png; may be given several times.",
)
@click.option("--normals", type=PATH, help="Map of facet normals too, as floats: an .exr for Mitsuba's normalmap.")
def surface_command(
    shape: str,
    alpha: tuple[float, ...] | None,
    size: int,
    correlation: float,
    seed: int,
    tolerance: float,
    steps: int,
    outputs: tuple[Path, ...],
    normals: Path | None,
) -> None:
    """Make a surface whose facets have a given distribution: a periodic height map, or a mesh of it.

    Beside each file NAME.json says what was asked for and what was reached, and NAME-picture.png shows the heights, and the slopes over
    their target. Meshes have no vertex normals: shade them with face normals.

    \b
    Examples:
      sgtd surface --shape student:gamma=1.7 --alpha 0.4 -o out/student.npy
      sgtd surface --shape ggx --alpha 0.4 0.1 -n 1024 --tolerance 3e-4 -o out/brushed.ply -o out/brushed.exr
      sgtd surface --shape gnd:shift=5,p=1 --alpha 0.1 --correlation 16 -o out/ring.gsf
    """
    from ..atomic_output import AtomicOutput
    from ..errors import UserError, require
    from ..microsurface import files, generate
    from ..microsurface.images import write_normals
    from ..microsurface.pictures import draw_surface
    from ..named_shape import parse_shape
    from ..ndf import Ndf

    require("report")
    files.check_endings(list(outputs))
    if normals is not None and normals.suffix.lower() != ".exr":
        raise UserError(f"--normals {normals}: normals are floats, which an .exr holds")
    try:
        if Path(shape).suffix.lower() in (".csv", ".npz"):
            u, v = (alpha[0], alpha[-1]) if alpha else (None, None)
            ndf = Ndf.from_file(shape, alpha_u=u, alpha_v=v)
            title = Path(shape).name
        else:
            named = parse_shape(shape)
            alpha = alpha or (0.3,)
            ndf, title = named.ndf(alpha[0], alpha[-1], 1e-5), named.title
    except ValueError as error:
        raise UserError(str(error)) from error
    with Bars() as bars:
        made = generate(
            ndf,
            n=size,
            correlation=correlation,
            seed=seed,
            tolerance=tolerance,
            steps=steps,
            advance=bars.add("making", steps),
        )
    made.save(*outputs, tolerance=tolerance)
    rough = f"α = {', '.join(f'{a:.3g}' for a in dict.fromkeys((ndf.alpha_u, ndf.alpha_v)))}"
    plot = draw_surface(made, ndf, f"{title}, {rough}: {size} × {size} points, seed {seed}")
    for beside in dict.fromkeys(path.with_name(f"{path.stem}-picture.png") for path in outputs):
        with AtomicOutput(beside.parent) as pictures:
            pictures.path(beside.name).write_bytes(plot.png)
    if normals is not None:
        with AtomicOutput(normals.parent) as pictures:
            write_normals(pictures.path(normals.name), made.normals())
    reached = made.info["reached"]
    click.echo(
        f"{', '.join(map(str, outputs))}: KS {reached['ks']:.2g}, TV {reached['tv']:.2g} (independent facets: "
        f"{reached['tv_independent']:.2g}), worst of 100 bins {100 * reached['worst_bin']:.2g} % off"
    )
    for note in made.notes:
        click.echo(f"sgtd: warning: {note}", err=True)
