"""The distributions of the family over numpy arrays."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from os import PathLike
from typing import TYPE_CHECKING, Any, Callable, NamedTuple, SupportsFloat

import numpy as np

from . import _core

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

# How far the length of a direction may be from 1: single precision after a few operations.
_UNIT_TOLERANCE = 1e-4

_DEFAULT_ALPHA = 0.1

# What a table or a mixture, which has no shape of the family, is told apart by.
_NO_SHAPE = 'distribution "{row}" has no {name}: it is given by its numbers'
_MASKINGS = ("separable", "height_correlated")


class Nodes(NamedTuple):
    """What a table is made of: slopes along x, densities of slopes there up to a factor, the knee (a slope), and the exponent of the tail,
    or None where the table is cut."""

    slopes: Array
    densities: Array
    knee: float
    tail_exponent: float | None


class Ndf:
    """A normal distribution of the SGTD family at given roughness.

    With the slope ``t = tan(theta)`` of a normal along its azimuth ``phi``, and the stretched radial slope
    ``x = t sqrt((cos(phi) / alpha_u)^2 + (sin(phi) / alpha_v)^2)``::

        D = A f(x) / (pi alpha_u alpha_v cos(theta)^4)
        f(x) = (1 + u / (gamma - 1))^(-gamma),  u = (|x - shift| / (1 +- lam))^(2 p)

    with + where x exceeds the shift; ``gamma = inf`` means ``f = exp(-u)``. What is left out is GGX at a roughness of 0.1.

    All arguments are keywords, and mean what the plugins' properties of the same names mean (``lam`` is their ``lambda``):

    ================  =======================================================================================================
    ``distribution``  row of the family: sgtd (the default, with all parameters free), gtd, sgnd, std, gnd, snd, student,
                      hyper_cauchy (``alpha`` is that of the literature: sqrt((gamma - 1) / 2) times the one above),
                      beckmann, ggx. A parameter that the row fixes is refused.
    ``gamma``         tail, above 1 or ``inf``: 2 as GGX, inf as Beckmann; 2 p gamma exceeds 3. Default 2.
    ``p``             kurtosis, 0.1 to 100: above 1 flatter, below 1 more peaked. Default 1.
    ``lam``           skew, -0.9999 to 0.9999: positive widens the outer side. Default 0.
    ``shift``         radius of a ring of slopes over the roughness, 0 to 10000. Default 0.
    ``mu``            the same as a slope, ``shift = mu / alpha``: instead of ``shift``, and with ``alpha`` alone
    ``alpha``         roughness, 1e-6 to 1e6. Default 0.1.
    ``alpha_u`` …     and ``alpha_v``, instead of ``alpha``: roughness along x and along y; give both
    ``accuracy``      permitted relative error of :meth:`g1`, 0 to 0.1. Default 1e-5, as the plugins'. 0 computes masking on
                      every call, to 1e-12: 30 to some hundred times slower.
    ================  =======================================================================================================

    Directions are unit vectors in the local frame, where z is the normal of the surface, in arrays of shape (..., 3). Arguments
    of one call are broadcast against each other as NumPy does it; results have the shape that remains without the last axis.
    Densities are per solid angle. Bad arguments raise ``ValueError`` in the plugins' words.

    A distribution that is no member of the family is made by :meth:`tabulated`, :meth:`from_file` or :meth:`mixture`, and has all
    methods.

    Calls release the interpreter lock and run on all cores, also in the child of a fork. Objects can be copied and pickled; equal
    ones share their tables.
    """

    def __init__(
        self,
        *,
        distribution: str = "sgtd",
        gamma: SupportsFloat | None = None,
        p: SupportsFloat | None = None,
        lam: SupportsFloat | None = None,
        shift: SupportsFloat | None = None,
        mu: SupportsFloat | None = None,
        alpha: SupportsFloat | None = None,
        alpha_u: SupportsFloat | None = None,
        alpha_v: SupportsFloat | None = None,
        accuracy: SupportsFloat = _core.default_accuracy,
    ) -> None:
        named = dict(gamma=gamma, p=p, lam=lam, shift=shift, mu=mu, alpha=alpha, alpha_u=alpha_u, alpha_v=alpha_v)
        numbers = {name: _number(name, value) for name, value in named.items() if value is not None}
        self._accuracy = _number("accuracy", accuracy)
        self._given: dict[str, Any] = {"distribution": distribution, **numbers, "accuracy": self._accuracy}
        self._row = str(distribution).lower()
        self._alpha = _roughness(numbers)
        gamma, p, lam = (numbers.get(name) for name in ("gamma", "p", "lam"))
        # the factor does not depend on the shift
        _, scale = _core.shape_of_row(self._row, gamma, p, lam)
        self._stretch = (scale * self._alpha[0], scale * self._alpha[1])
        self._shape, _ = _core.shape_of_row(self._row, gamma, p, lam, _shift(numbers, self._stretch[0]))
        self._radial = _core.Radial.family(self._shape)
        self._core = _core.Ndf.get(self._radial, self._accuracy)
        self._maker: Callable[..., Ndf] = type(self)

    @classmethod
    def tabulated(
        cls,
        *,
        angles: ArrayLike | None = None,
        slopes: ArrayLike | None = None,
        values: ArrayLike,
        quantity: str = "D",
        tail: str = "power",
        tail_exponent: SupportsFloat | None = None,
        knee: SupportsFloat | None = None,
        alpha: SupportsFloat | None = None,
        alpha_u: SupportsFloat | None = None,
        alpha_v: SupportsFloat | None = None,
        accuracy: SupportsFloat = _core.default_accuracy,
    ) -> Ndf:
        """A distribution from a table of 2 to 1000 rows.

        =================  ======================================================================================================
        ``angles`` …       or ``slopes``: angles from the normal in degrees, below 90, or their tangents, ascending. Below the
                           first one the density of slopes is constant.
        ``values``         values there, up to a common factor; zeros are allowed.
        ``quantity``       what they are: ``"D"``, ``"D_cos"`` (D cos(theta), what a picture of the microsurface from above
                           counts) or ``"slope"`` (D cos(theta)^4, the density of slopes).
        ``tail``           beyond the last row: ``"power"`` of the slope, or ``"cut"``. The choice is a part of the model: at
                           grazing angles it moves masking by up to one half.
        ``tail_exponent``  exponent of that power for the density of slopes, above 3 (GGX has 4); that of the last two rows if
                           it is left out
        ``knee``           slope k: between two rows, ln f is linear in ln(k^2 + x^2). Chosen where the table is straightest.
        ``alpha``          mean slope of the distribution. Left out, the table is as it was given; another value stretches its
                           slopes until their mean is that, so twice the ``alpha`` is twice the slope everywhere.
        ``alpha_u`` …      and ``alpha_v``: the same along x and y
        =================  ======================================================================================================
        """
        if (angles is None) == (slopes is None):
            raise ValueError('give either "angles" (in degrees) or "slopes" (their tangents)')
        given_places: Any = slopes if angles is None else angles
        places = _list("slopes" if angles is None else "angles", given_places)
        numbers = _list("values", values)
        given = dict(
            angles=angles if angles is None else places,
            slopes=slopes if slopes is None else places,
            values=numbers,
            quantity=quantity,
            tail=tail,
            tail_exponent=tail_exponent,
            knee=knee,
        )
        source = _core.TableSource(
            places,
            angles is not None,
            numbers,
            str(quantity),
            str(tail),
            None if tail_exponent is None else _number("tail_exponent", tail_exponent),
            None if knee is None else _number("knee", knee),
        )
        return cls._of("tabulated", _core.Radial.table(source), cls.tabulated, given, alpha, alpha_u, alpha_v, accuracy)

    @classmethod
    def from_file(
        cls,
        filename: str | PathLike[str],
        *,
        quantity: str | None = None,
        tail: str | None = None,
        tail_exponent: SupportsFloat | None = None,
        alpha: SupportsFloat | None = None,
        alpha_u: SupportsFloat | None = None,
        alpha_v: SupportsFloat | None = None,
        accuracy: SupportsFloat = _core.default_accuracy,
    ) -> Ndf:
        """A table from a .csv or .npz file: see :meth:`tabulated`; what is given here comes before what the file says.

        Two columns, or two arrays, named ``angle`` or ``slope``, and ``D``, ``D_cos``, ``slope_density`` or ``value``; a CSV without
        names has angles first. Lines ``# tail: cut``, ``# tail_exponent: 4`` and ``# knee: 0.3`` of a CSV, or arrays of one number
        ``tail_cut``, ``tail_exponent`` and ``knee`` of an npz, say the rest.
        """
        exponent = None if tail_exponent is None else _number("tail_exponent", tail_exponent)
        source = _core.TableSource.read(str(filename), quantity or "", tail or "", exponent)
        given = {
            "angles" if source.by_angles else "slopes": source.places,
            "values": source.values,
            "quantity": source.quantity,
            "tail": source.tail,
            "tail_exponent": source.tail_exponent,
            "knee": source.knee,
        }
        return cls._of("tabulated", _core.Radial.table(source), cls.tabulated, given, alpha, alpha_u, alpha_v, accuracy)

    @classmethod
    def mixture(
        cls,
        parts: Iterable[tuple[SupportsFloat, Ndf]],
        *,
        alpha: SupportsFloat | None = None,
        alpha_u: SupportsFloat | None = None,
        alpha_v: SupportsFloat | None = None,
        accuracy: SupportsFloat = _core.default_accuracy,
    ) -> Ndf:
        """A weighted sum of distributions, pairs ``(weight, ndf)`` with one roughness each: a core and a haze.

        Weights are shares of the normals as seen from above (of D cos(theta)) up to a common factor. ``alpha`` is the mean slope
        of the sum: left out, the members have the roughness that they have; another value stretches all of them together.
        """
        members = [(_number("weight", weight), ndf) for weight, ndf in parts]
        for _, ndf in members:
            if ndf._stretch[0] != ndf._stretch[1]:
                raise ValueError(
                    "a member of the mixture has two roughnesses: give members one alpha, and the mixture alpha_u and alpha_v"
                )
        radial = _core.Radial.mixture([(weight, ndf._stretch[0], ndf._radial) for weight, ndf in members])
        given = dict(parts=members)
        return cls._of("mixture", radial, cls.mixture, given, alpha, alpha_u, alpha_v, accuracy)

    @classmethod
    def _of(
        cls,
        row: str,
        radial: _core.Radial,
        maker: Callable[..., Ndf],
        given: dict[str, Any],
        alpha: SupportsFloat | None,
        alpha_u: SupportsFloat | None,
        alpha_v: SupportsFloat | None,
        accuracy: SupportsFloat,
    ) -> Ndf:
        """One that is no member of the family."""
        named = dict(alpha=alpha, alpha_u=alpha_u, alpha_v=alpha_v)
        numbers = {name: _number(name, value) for name, value in named.items() if value is not None}
        self = cls.__new__(cls)
        self._row = row
        self._accuracy = _number("accuracy", accuracy)
        self._given = {name: value for name, value in given.items() if value is not None}
        self._given |= {**numbers, "accuracy": self._accuracy}
        self._maker = maker
        self._alpha = self._stretch = _roughness(numbers, radial.width)
        self._radial = radial
        self._core = _core.Ndf.get(radial, self._accuracy)
        return self

    def resampled(self, nodes: int) -> Ndf:
        """The same distribution as a table of so many nodes, 2 to 1000, placed where they are worth most.

        64 nodes keep G1 within 1e-3 and D within 1e-2 for most distributions: see ``sgtd ndf --resample``.
        """
        table = self._radial.resampled(nodes)
        # the table was made at unit roughness
        alpha_u, alpha_v = (stretch * table.width for stretch in self._stretch)
        return type(self).tabulated(
            slopes=table.slopes,
            values=table.slope_densities,
            quantity="slope",
            knee=table.knee,
            tail="power" if table.tail_exponent else "cut",
            tail_exponent=table.tail_exponent or None,
            **(dict(alpha=alpha_u) if alpha_u == alpha_v else dict(alpha_u=alpha_u, alpha_v=alpha_v)),
            accuracy=self._accuracy,
        )

    def __repr__(self) -> str:
        name = {"tabulated": "Ndf.tabulated", "mixture": "Ndf.mixture"}.get(self._row, "Ndf")
        return f"{name}({', '.join(f'{key}={_short(value)}' for key, value in self._given.items())})"

    def __reduce__(self) -> tuple[Any, ...]:
        return functools.partial(self._maker, **self._given), ()

    @property
    def table(self) -> Nodes | None:
        """The nodes of a table at its roughness; None for anything else. The first node is at 0."""
        radial = self._radial
        if not radial.is_table:
            return None
        factor = self._stretch[0] / radial.width
        return Nodes(radial.slopes * factor, radial.slope_densities, radial.knee * factor, radial.tail_exponent or None)

    @property
    def stretch(self) -> tuple[float, float]:
        """What a stretched slope of 1 is as a slope, along x and along y: the roughness, with a factor for ``hyper_cauchy``."""
        return self._stretch

    @property
    def mean_slope(self) -> float:
        """Mean slope along x of D cos(theta) without the azimuth: of a table or a mixture, its ``alpha``."""
        return self._core.mean * self._stretch[0]

    @property
    def distribution(self) -> str:
        """Row of the family as it was given, or ``tabulated`` or ``mixture``."""
        return self._row

    @property
    def gamma(self) -> float:
        """Tail."""
        return self._family("gamma").gamma

    @property
    def p(self) -> float:
        """Kurtosis."""
        return self._family("p").p

    @property
    def lam(self) -> float:
        """Skew."""
        return self._family("lam").lam

    @property
    def shift(self) -> float:
        """Radius of the ring over the roughness."""
        return self._family("shift").shift

    @property
    def alpha_u(self) -> float:
        """Roughness along x, as it was given."""
        return self._alpha[0]

    @property
    def alpha_v(self) -> float:
        """Roughness along y, as it was given."""
        return self._alpha[1]

    @property
    def accuracy(self) -> float:
        """The permitted relative error of :meth:`g1`."""
        return self._accuracy

    @property
    def accuracy_reached(self) -> float:
        """The relative error of :meth:`g1` that was measured when the tables were made."""
        return self._core.accuracy_reached

    @property
    def normalization(self) -> float:
        """The factor A: ``1 / (2 A)`` is the integral of ``x f(x)`` over x >= 0."""
        return self._core.normalization

    @property
    def node(self) -> str:
        """The row of the family at which the shape runs: the lowest that its numbers allow."""
        return _core.lowest_node(self._shape).name if self._radial.is_family else self._row

    @property
    def table_bytes(self) -> int:
        """Memory of the tables."""
        return self._core.table_bytes

    def d(self, m: ArrayLike) -> Array:
        """The distribution D of normals ``m`` (..., 3), per solid angle: the integral of D cos(theta) is 1. 0 below the surface."""
        return self._eval("d", m=m)

    def lambda_(self, w: ArrayLike) -> Array:
        """Smith's Lambda for a direction ``w`` (..., 3): masked over visible projected area, from 0 to infinity."""
        return self._eval("lambda", w=w)

    def g1(self, w: ArrayLike) -> Array:
        """Smith's masking of a direction ``w`` (..., 3), ``1 / (1 + Lambda)``, with a relative error of at most ``accuracy``."""
        return self._eval("g1", w=w)

    def g2(self, wi: ArrayLike, wo: ArrayLike, masking: str = "separable") -> Array:
        """Masking and shadowing of two directions ``wi`` and ``wo`` (..., 3) on the same side.

        ``"separable"`` is ``G1(wi) G1(wo)``, ``"height_correlated"`` is ``1 / (1 + Lambda(wi) + Lambda(wo))``.
        """
        name = str(masking).lower()
        if name not in _MASKINGS:
            raise ValueError(f'masking "{masking}" is unknown: choose one of {", ".join(_MASKINGS)}')
        return self._eval(f"g2_{name}", wi=wi, wo=wo)

    def pdf(self, wi: ArrayLike, m: ArrayLike, visible: bool = True, bounded: bool = False) -> Array:
        """Density per solid angle of the normals ``m`` (..., 3) that :meth:`sample` draws for a view ``wi`` (..., 3)."""
        return self._eval(f"pdf_{_normals(visible, bounded)}", wi=wi, m=m)

    def sample(self, wi: ArrayLike, u: ArrayLike, visible: bool = True, bounded: bool = False) -> tuple[Array, Array]:
        """Draws normals: those visible from ``wi`` (..., 3), or all of D cos(theta), by random numbers ``u`` (..., 2) in [0, 1).

        ``bounded`` leaves out visible normals that reflect the view below the horizon: all of them for one roughness, those beyond
        a radius for two. Use it for reflections; refraction needs the others as well.

        Returns normals (..., 3) and their densities (...), which are those of :meth:`pdf`; a density of 0 marks a sample that no
        reflection can use.
        """
        views = _directions("wi", wi)
        numbers = _vectors("u", u, 2)
        if _core.first_outside(numbers, 0.0, np.nextafter(1.0, 0.0)) < numbers.size:
            raise ValueError("u: all numbers must be in [0, 1)")
        shape, views, numbers = _together(wi=views, u=numbers)
        query = f"sample_{_normals(visible, bounded)}"
        normals, pdf = np.split(self._core.eval(query, *self._stretch, views, numbers), [views.size])
        return normals.reshape((*shape, 3)), pdf.reshape(shape)

    def gradient(self, quantity: str, w: ArrayLike | None = None) -> dict[str, Array]:
        """Derivatives of a quantity by the parameters of the shape, at a fixed roughness: see below for those of a table or a mixture.

        ``quantity`` is ``"d"`` (of normals ``w``), ``"lambda"`` (of directions ``w``) or ``"normalization"`` (A, without ``w``).
        The result has an array (...) for each of ``gamma``, ``inv_gamma`` (1/gamma, which has a derivative at gamma = inf), ``p``,
        ``lam`` and ``shift``. Derivatives of A and Lambda are computed under the integral on every call, whatever the accuracy, to 1e-9 of the
        greater of the derivative and the quantity; those by ``shift`` at 0 are one-sided. At a cusp of f (w at the shift, p <= 1/2), where there may be
        none, D is given those of A alone.

        A table has ``"d"`` and ``"lambda"`` by its ``values``, an array (..., number of values); a value of 0 stays 0, its derivative is given as 0, and the
        knee is held. A mixture has them by ``weights`` and ``alphas`` of its parts, (..., number of parts) each. Only proportions of values and of weights
        count, and at a fixed roughness only those of ``alphas``.
        """
        queries = {"d": "d_gradient", "lambda": "lambda_gradient", "normalization": "normalization_gradient"}
        name = str(quantity).lower()
        if name not in queries:
            raise ValueError(f'quantity "{quantity}" is unknown: choose one of {", ".join(queries)}')
        if self._row == "hyper_cauchy":
            raise ValueError(
                'distribution "hyper_cauchy" changes the roughness with gamma, and derivatives are those at a fixed one: use "student"'
            )
        if (w is None) != (name == "normalization"):
            raise ValueError(f"w: {'directions are missing' if w is None else 'the normalization takes no directions'}")
        directions = _directions("w", (0.0, 0.0, 1.0) if w is None else w)
        if not self._radial.is_family:
            return self._by_numbers(name, directions)
        values = self._core.eval(queries[name], *self._stretch, directions).reshape((*directions.shape[:-1], 4))
        if name == "normalization":
            values = values * self.normalization
        inverse, p, lam, shift = np.moveaxis(values, -1, 0)
        # 1/gamma^2 is 0 at infinity
        return {"gamma": -inverse / self.gamma**2, "inv_gamma": inverse, "p": p, "lam": lam, "shift": shift}

    def _by_numbers(self, quantity: str, w: Array) -> dict[str, Array]:
        """From derivatives by logarithms to those by the numbers of a table or a mixture."""
        if quantity == "normalization":
            raise ValueError(
                f'distribution "{self._row}" has no derivatives of its normalization, as f is normalized by the greatest value: choose d or lambda'
            )
        count = self._core.count_of_numbers
        by = self._core.by_numbers(quantity, *self._stretch, w).reshape((*w.shape[:-1], count))
        if self._row == "tabulated":
            values = self._given["values"]
            return {"values": np.divide(by, values, out=np.zeros_like(by), where=values > 0.0)}
        members = self._given["parts"]
        by_weight, by_alpha = np.split(by, 2, axis=-1)
        weights, alphas = np.transpose([(weight, ndf.alpha_u) for weight, ndf in members])
        return {"weights": by_weight / weights, "alphas": by_alpha / alphas}

    def profile(self, x: ArrayLike) -> Array:
        """f at stretched radial slopes ``x`` >= 0 of any shape: 1 at the shift."""
        return self._eval_numbers("profile", "x", x, math.inf)

    def cdf(self, x: ArrayLike) -> Array:
        """Probability under D cos(theta) that the stretched radial slope is below ``x`` >= 0; relative error at most 1e-12."""
        return self._eval_numbers("cdf", "x", x, math.inf)

    def sf(self, x: ArrayLike) -> Array:
        """``1 - cdf(x)``, to the same relative error in the tail."""
        return self._eval_numbers("sf", "x", x, math.inf)

    def quantile(self, u: ArrayLike) -> Array:
        """The x with ``cdf(x) = u``, for ``u`` in [0, 1]."""
        return self._eval_numbers("quantile", "u", u, 1.0)

    def isf(self, s: ArrayLike) -> Array:
        """The x with ``sf(x) = s``, for ``s`` in [0, 1]: exact in the tail, where ``1 - s`` is 1."""
        return self._eval_numbers("isf", "s", s, 1.0)

    def _family(self, name: str) -> _core.Shape:
        if not self._radial.is_family:
            raise AttributeError(_NO_SHAPE.format(row=self._row, name=name))
        return self._shape

    def _eval(self, query: str, **directions: ArrayLike) -> Array:
        """A function of the core's table over one or two arrays of directions."""
        shape, *arrays = _together(**{name: _directions(name, values) for name, values in directions.items()})
        return self._core.eval(query, *self._stretch, *arrays).reshape(shape)

    def _eval_numbers(self, query: str, name: str, values: ArrayLike, high: float) -> Array:
        array = _array(name, values)
        if _core.first_outside(array, 0.0, high) < array.size:
            raise ValueError(f"{name}: all numbers must be between 0 and {high:g}")
        return self._core.eval(query, *self._stretch, array).reshape(array.shape)


def _number(name: str, value: SupportsFloat) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: {value!r} is not a number") from None


def _short(value: Any) -> str:
    """A value of an argument, in a line."""
    if isinstance(value, np.ndarray):
        return np.array2string(value, threshold=6, edgeitems=2, separator=", ", precision=4)
    return repr(value)


def _list(name: str, values: ArrayLike) -> Array:
    array = _array(name, values)
    if array.ndim != 1:
        raise ValueError(f"{name}: its shape is {array.shape}; it must be a list of numbers")
    return array


def _roughness(given: dict[str, float], default: float = _DEFAULT_ALPHA) -> tuple[float, float]:
    """Along x and y: the plugins' rules, but for 0, which they take as 1e-4."""
    u, v = "alpha_u" in given, "alpha_v" in given
    if u != v:
        missing = "alpha_v" if u else "alpha_u"
        raise ValueError(f'parameter "{missing}" is missing: give both alpha_u and alpha_v, or alpha alone')
    if u and "alpha" in given:
        raise ValueError(
            'parameters "alpha" and "alpha_u", "alpha_v" are given together: choose alpha alone, or the other two'
        )
    if u:
        alpha = given["alpha_u"], given["alpha_v"]
        _core.check_roughness(*alpha)
        return alpha
    single = given.get("alpha", default)
    try:
        _core.check_roughness(single, single)
    except ValueError as error:
        raise ValueError(str(error).replace('"alpha_u"', '"alpha"')) from None
    return single, single


def _shift(given: dict[str, float], alpha: float) -> float | None:
    """The shift, from mu if that was given; ``alpha`` is the roughness that the row makes of the user's."""
    if "mu" not in given:
        return given.get("shift")
    mu = given["mu"]
    if "shift" in given:
        raise ValueError('parameters "mu" and "shift" are given together: choose one (shift = mu / alpha)')
    if "alpha_u" in given:
        raise ValueError(
            'parameter "mu" is given, but needs "alpha" as one number (the shape depends on mu / alpha): give "shift" instead'
        )
    if not (math.isfinite(mu) and mu >= 0.0):
        raise ValueError(f'parameter "mu" is {mu:g}, but must be a finite number of at least 0')
    return mu / alpha


def _array(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name}: the type of its elements is {array.dtype}; it must be real numbers")
    return np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)


def _vectors(name: str, values: ArrayLike, size: int) -> Array:
    array = _array(name, values)
    if array.ndim == 0 or array.shape[-1] != size:
        raise ValueError(f"{name}: its shape is {array.shape}; it must be (..., {size})")
    return array


def _directions(name: str, values: ArrayLike) -> Array:
    """Unit vectors."""
    array = _vectors(name, values, 3)
    wrong = _core.first_of_wrong_length(array, _UNIT_TOLERANCE)
    if wrong < array.size // 3:
        place = ", ".join(str(index) for index in np.unravel_index(wrong, array.shape[:-1]))
        length = np.linalg.norm(array.reshape(-1, 3)[wrong])
        raise ValueError(f"{name}: direction{f' [{place}]' if place else ''} has length {length:g}; it must be 1")
    return array


def _together(**arrays: Array) -> tuple[Any, ...]:
    """The shape that the arrays have together without their last axes, and each of them in full."""
    try:
        shape = np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
    except ValueError:
        listing = ", ".join(f"{name} has {array.shape}" for name, array in arrays.items())
        raise ValueError(f"the shapes do not go together: {listing}") from None
    full = (np.broadcast_to(array, (*shape, array.shape[-1])) for array in arrays.values())
    return (shape, *(np.ascontiguousarray(array) for array in full))


def _normals(visible: bool, bounded: bool) -> str:
    """The core's name for the normals that are drawn."""
    if bounded and not visible:
        raise ValueError(
            "bounded=True and visible=False are given together: it is the visible normals that can be bounded"
        )
    return "reflecting" if bounded else "visible" if visible else "projected"
