"""Levenberg–Marquardt on an image: from a target to the parameters of one material."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import require
from .numbers import LISTS, Numbers, flat, gathered
from .variables import NAMES, Variables

if TYPE_CHECKING:
    import mitsuba as mi
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

# Below this a shift, a skew and the roughness are one parameter: the skew waits.
_CLEAR_SHIFT = 0.05
# Of the target's mean: radiance below counts less and less, so that black pixels have a logarithm.
_FLOOR = 1e-3


@dataclasses.dataclass(frozen=True)
class Step:
    """One accepted point of the search."""

    parameters: dict[str, float]
    #: root mean square of the residuals of log radiance
    error: float


@dataclasses.dataclass(frozen=True)
class Recovery:
    """What :func:`recover` found."""

    #: of the unknown parameters; numbers of a list are called ``values[3]`` or the like
    parameters: dict[str, float]
    #: standard deviations, as the residuals and their derivatives have them; infinite for what the image does not tell
    deviations: dict[str, float]
    #: root mean square of the residuals of log radiance
    error: float
    steps: tuple[Step, ...]
    #: pixels, channels
    start: Array
    image: Array
    target: Array
    #: did the search end by itself?
    converged: bool
    #: number of renders, those with derivatives included
    renders: int
    #: the lists of numbers that were recovered, whole, and as they were
    lists: dict[str, Array] = dataclasses.field(default_factory=dict)
    first_lists: dict[str, Array] = dataclasses.field(default_factory=dict)

    def __str__(self) -> str:
        found = ", ".join(
            f"{name} = {value:.5g} ± {self.deviations[name]:.1g}" for name, value in self.parameters.items()
        )
        end = "" if self.converged else " (not converged)"
        return f"{found}; residual {self.error:.3g} in {len(self.steps) - 1} steps{end}"


class _Material:
    """A material of a scene as a function of its parameters."""

    def __init__(
        self,
        scene: mi.Scene,
        bsdf: str,
        variables: Variables | Numbers,
        render: Mapping[str, Any],
    ) -> None:
        import mitsuba as mi

        self.scene, self.render = scene, dict(render)
        self.parameters = mi.traverse(scene)
        self.unknown = variables.unknown
        #: lists of numbers as they are where nothing is unknown
        self.lists = variables.start if isinstance(variables, Numbers) else {}
        names = tuple(self.lists) or self.unknown
        self.keys = {name: f"{bsdf}.{'alpha.value' if name == 'alpha' else name}" for name in names}
        for name, key in self.keys.items():
            if key not in self.parameters:
                ends = (".gamma", ".inv_gamma", ".p", ".lambda", ".shift", *(f".{name}" for name in LISTS))
                known = sorted({k.rpartition(".")[0] for k in self.parameters.keys() if k.endswith(ends)})
                raise ValueError(
                    f'the scene has no parameter "{key}": "{bsdf}" must be a material of this package whose distribution leaves "{name}" '
                    f"free and whose alpha is one number; the scene has {', '.join(known) or 'none'}"
                )
        self.renders = 0

    def set(self, values: Mapping[str, float], gradient: bool) -> None:
        import drjit as dr
        import mitsuba as mi

        whole = gathered(self.lists, values)
        for name, key in self.keys.items():
            number = mi.Float(np.float32(whole[name])) if whole else mi.Float(float(values[name]))
            if gradient:
                dr.enable_grad(number)
            self.parameters[key] = number
        self.parameters.update()

    def image(self, values: Mapping[str, float]) -> Array:
        import mitsuba as mi

        self.set(values, gradient=False)
        self.renders += 1
        return np.array(mi.render(self.scene, **self.render), dtype=np.float64)

    def _direction(self, name: str, unknown: str) -> mi.Float:
        """The derivative of a parameter, or of a list of numbers, by the unknown."""
        import mitsuba as mi

        if name not in self.lists:
            return mi.Float(1.0 if name == unknown else 0.0)
        one = {k: 1.0 if k == unknown else 0.0 for k in flat(self.lists)}
        return mi.Float(np.float32(gathered(self.lists, one)[name]))

    def with_derivatives(self, values: Mapping[str, float]) -> tuple[Array, list[Array]]:
        """An image, and its derivative by each parameter."""
        import drjit as dr
        import mitsuba as mi

        self.set(values, gradient=True)
        image = mi.render(self.scene, self.parameters, **self.render)
        derivatives = []
        for unknown in self.unknown:
            for name, key in self.keys.items():
                dr.set_grad(self.parameters[key], self._direction(name, unknown))
            dr.clear_grad(image)
            # all of them, though one alone moves: an integrator looks at the gradients of all
            dr.enqueue(dr.ADMode.Forward, *(self.parameters[other] for other in self.keys.values()))
            dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearInterior)
            derivatives.append(np.array(dr.grad(image), dtype=np.float64))
        self.renders += 1 + len(derivatives)
        result = np.array(dr.detach(image), dtype=np.float64)
        self.set(values, gradient=False)
        return result, derivatives


def recover(
    scene: mi.Scene,
    target: ArrayLike,
    bsdf: str,
    start: Mapping[str, Any],
    *,
    unknown: Sequence[str] = NAMES,
    fixed: Mapping[str, float] | None = None,
    spp: int = 16,
    seed: int = 0,
    integrator: mi.Integrator | None = None,
    sensor: int = 0,
    mask: ArrayLike | None = None,
    max_steps: int = 60,
    tolerance: float = 1e-5,
    on_step: Callable[[Step], None] | None = None,
) -> Recovery:
    """Finds the parameters of a material with which a scene looks like ``target``.

    ``bsdf`` is the name of the material in ``mi.traverse(scene)``: an ``sgtdconductor`` or ``sgtddielectric`` in a variant with derivatives,
    with one roughness and without ``multiple_scattering``. ``unknown`` are the parameters to be found, from ``start`` on; ``fixed`` the values that the scene
    has for the others, as far as they are not those of GGX. A table's ``values``, or the ``weights`` and ``alphas`` of a mixture, are found from lists: ``unknown`` has these
    names alone, the greatest value or weight is held, numbers of 0 stay 0, and each unknown number takes a render with derivatives per step. ``target`` has the shape of the image that ``integrator`` makes of
    the scene with ``sensor``; pixels where ``mask`` is false do not count.

    The residual is log(radiance + floor), the floor 1e-3 of the target's mean: tails count as much as the peak. Every render has the same ``seed``, so that
    the residual is a smooth function; the noise of ``spp`` samples that it has in common is part of the answer, and ``deviations`` hold it. While the shift
    is below 0.05 the skew is held: the two and the roughness are one parameter there. The scene is left at the result.

    Raises ``ValueError`` for a target that does not fit or has bad values, for an unknown parameter that the scene lacks, and for a start that is no
    member of the family.
    """
    require("fit")
    from scipy.optimize import least_squares

    variables = _variables(unknown, fixed or {}, start)
    given = flat(variables.start) if isinstance(variables, Numbers) else start
    render: dict[str, Any] = {"spp": spp, "seed": seed, "sensor": sensor}
    if integrator is not None:
        render["integrator"] = integrator
    material = _Material(scene, bsdf, variables, render)
    first = material.image(variables.to_parameters(variables.from_parameters(given)))
    goal = _checked(target, first.shape)
    floor = _FLOOR * float(goal.mean())
    counts = np.ones(first.shape, bool) if mask is None else _spread(mask, first.shape)
    log_goal = np.log(goal[counts] + floor)
    steps: list[Step] = []
    seen: dict[bytes, tuple[Array, list[Array]]] = {}

    def at(v: Array) -> tuple[Array, list[Array]]:
        """The last point that was differentiated is asked for twice."""
        key = v.tobytes()
        if key not in seen:
            seen.clear()
            seen[key] = material.with_derivatives(variables.to_parameters(v))
        return seen[key]

    def residual(v: Array) -> Array:
        image = seen[v.tobytes()][0] if v.tobytes() in seen else material.image(variables.to_parameters(v))
        return np.log(np.maximum(image[counts], 0.0) + floor) - log_goal

    def jacobian(v: Array) -> Array:
        values = variables.to_parameters(v)
        image, derivatives = at(v)
        by_parameter = np.stack([d[counts] for d in derivatives], axis=1) / (image[counts] + floor)[:, None]
        by_variable = by_parameter @ variables.jacobian(v)
        if "lambda" in values and values.get("shift", variables.fixed.get("shift", 0.0)) < _CLEAR_SHIFT:
            by_variable[:, variables.unknown.index("lambda")] = 0.0
        step = Step({name: float(x) for name, x in values.items()}, float(np.sqrt(np.mean(residual(v) ** 2))))
        steps.append(step)
        if on_step:
            on_step(step)
        return by_variable

    found = least_squares(
        residual,
        variables.from_parameters(given),
        jacobian,
        bounds=variables.bounds,
        # logarithms have one scale; scaled by their derivatives, rows that are hardly seen hold the others back
        x_scale=1.0 if isinstance(variables, Numbers) else "jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=None,
        max_nfev=max_steps,
    )
    values = {name: float(x) for name, x in variables.to_parameters(found.x).items()}
    image = material.image(values)
    error = float(np.sqrt(np.mean(found.fun**2)))
    return Recovery(
        parameters=values,
        deviations=_deviations(variables, found.x, found.jac, found.fun),
        error=error,
        steps=tuple(steps),
        start=first,
        image=image,
        target=goal,
        converged=bool(found.status > 0),
        renders=material.renders,
        lists=gathered(material.lists, values),
        first_lists=dict(material.lists),
    )


def _variables(unknown: Sequence[str], fixed: Mapping[str, float], start: Mapping[str, Any]) -> Variables | Numbers:
    lists = [name for name in unknown if name in LISTS]
    if not lists:
        return Variables(unknown, **fixed)
    if len(lists) < len(unknown) or fixed:
        raise ValueError(
            f'parameter "{lists[0]}" is a list of numbers, which is recovered without others: leave {", ".join(LISTS)} alone in '
            "unknown, and fixed out"
        )
    missing = [name for name in lists if name not in start]
    if missing:
        raise ValueError(f'parameter "{missing[0]}" is missing: give a list to start from')
    return Numbers({name: start[name] for name in lists})


def _checked(target: ArrayLike, shape: tuple[int, ...]) -> Array:
    goal = np.array(target, dtype=np.float64)
    if goal.ndim == len(shape) - 1:
        goal = goal[..., None]
    if goal.shape != shape:
        raise ValueError(f"target: its shape is {goal.shape}, but the scene's image is {shape}")
    if not np.isfinite(goal).all() or goal.min() < 0.0 or not goal.any():
        raise ValueError("target: radiance must be finite and not negative, and not 0 everywhere")
    return goal


def _spread(mask: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    counts = np.array(mask, dtype=bool)
    if counts.shape == shape[:-1]:
        counts = np.repeat(counts[..., None], shape[-1], axis=-1)
    if counts.shape != shape or not counts.any():
        raise ValueError(
            f"mask: its shape is {counts.shape}; it must be that of the image, {shape[:-1]}, and true somewhere"
        )
    return counts


def _deviations(variables: Variables | Numbers, v: Array, jacobian: Array, residual: Array) -> dict[str, float]:
    """From the inverse of J^T J, in units of the parameters."""
    freedom = max(len(residual) - len(v), 1)
    known = np.linalg.norm(jacobian, axis=0) > 0.0
    deviations = np.full(len(v), np.inf)
    if known.any():
        part = jacobian[:, known]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            covariance = np.linalg.pinv(part.T @ part, rcond=1e-14) * (residual @ residual) / freedom
        full = np.zeros((len(v), len(v)))
        full[np.ix_(known, known)] = covariance
        by = variables.jacobian(v)
        deviations[known] = np.sqrt(np.maximum(np.diag(by @ full @ by.T), 0.0))[known]
    return dict(zip(variables.unknown, map(float, deviations)))
