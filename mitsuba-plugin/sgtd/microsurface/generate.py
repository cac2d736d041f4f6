"""Surfaces with facets of a given distribution."""

from __future__ import annotations

from .. import _core
from ..errors import UserError
from ..named_shape import parse_shape
from ..ndf import Ndf
from .described import describe
from .surface import Surface
from .watching import Advance, watched

# What a step is told of is the share of all steps that are permitted
STEPS = 200


def generate(
    shape: Ndf | str,
    *,
    alpha: float | tuple[float, float] | None = None,
    n: int = 512,
    correlation: float = 8.0,
    seed: int = 0,
    tolerance: float = 1e-3,
    steps: int = STEPS,
    advance: Advance = None,
) -> Surface:
    """A periodic surface of ``n × n`` points whose facet slopes have a distribution: an ``Ndf`` with its roughness, or a text such as
    "student:gamma=1.7" with the roughness ``alpha``, or those along x and y.

    ``correlation`` is the correlation length of the Gaussian field that it begins with, in points. Iteration ends when the
    Kolmogorov–Smirnov distance of the slopes is below ``tolerance`` and radius and azimuth together are as even as those of independent
    facets, or after ``steps``: what was reached is in ``info["reached"]``, and ``notes`` warn if it is not what was asked for. The same
    arguments give the same surface, whatever the number of threads.
    """
    ndf = _distribution(shape, alpha)
    if not 0 <= seed < 2**64:
        raise UserError(f"the seed is {seed}: it must be between 0 and 2⁶⁴ − 1")
    for name, count in (("size", n), ("steps", steps)):
        if count < 0:
            raise UserError(f"{name} is {count}: it must not be negative")
    try:
        made = watched(
            lambda watch: _core.Microsurface.generate(ndf._core, n, correlation, seed, tolerance, steps, watch), advance
        )
    except ValueError as error:
        raise UserError(str(error)) from error
    alpha_u, alpha_v = ndf.stretch
    surface = Surface(made.heights().reshape(n, n), (1.0, 1.0)).stretched(alpha_u, alpha_v)
    found = surface.agreement(ndf)
    reached = {name: getattr(found, name) for name in ("ks", "tv", "tv_independent", "worst_bin", "mean_error")}
    notes = []
    if found.ks > tolerance:
        notes.append(f"a distance (KS) of {found.ks:.2g} was reached, not {tolerance:g}: {_mend(ndf)}")
    elif found.tv > found.tv_independent:
        notes.append(
            f"radius and azimuth together are off by {found.tv:.2g} (TV), independent facets would be by "
            f"{found.tv_independent:.2g}: {_mend(ndf)}"
        )
    info = {
        "distribution": describe(ndf),
        "n": n,
        "correlation": correlation,
        "seed": seed,
        "tolerance": tolerance,
        "steps": steps,
        "reached": reached,
    }
    return Surface(surface.heights, surface.spacing, True, info, tuple(notes))


def _distribution(shape: Ndf | str, alpha: float | tuple[float, float] | None) -> Ndf:
    if isinstance(shape, Ndf):
        if alpha is not None:
            raise UserError("alpha is given beside an Ndf, which has its own")
        return shape
    if alpha is None:
        raise UserError(f'the shape "{shape}" needs a roughness: give alpha')
    alpha_u, alpha_v = alpha if isinstance(alpha, tuple) else (alpha, alpha)
    return parse_shape(shape).ndf(alpha_u, alpha_v, _core.default_accuracy)


def _mend(ndf: Ndf) -> str:
    ring = ndf.distribution not in ("tabulated", "mixture") and ndf.shift > 1.0
    return "thin rings want twice the correlation length" if ring else "more points have more room for tails"
