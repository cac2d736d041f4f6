from collections.abc import Sequence
from typing import Annotated, overload

import numpy
from numpy.typing import NDArray


steep: float = 38.0

default_accuracy: float = 1e-05

least_alpha: float = 0.0001

class Shape:
    """Shape of a distribution at unit roughness."""

    def __init__(self, gamma: float, p: float, lam: float, shift: float) -> None: ...

    @property
    def gamma(self) -> float: ...

    @property
    def p(self) -> float: ...

    @property
    def lam(self) -> float: ...

    @property
    def shift(self) -> float: ...

    def numbers(self) -> tuple[float, float, float, float]:
        """(gamma, p, lambda, shift)"""

    def __eq__(self, other: object, /) -> bool: ...

    def __hash__(self) -> int: ...

    def __reduce__(self) -> tuple[type[Shape], tuple[float, float, float, float]]: ...

def shape_of_row(row: str, gamma: float | None = None, p: float | None = None, lam: float | None = None, shift: float | None = None) -> tuple[Shape, float]:
    """
    The shape of a named row of the family, and the factor on every roughness given with it.
    """

class Node:
    """The node of the family's tree at which a shape runs."""

    @property
    def name(self) -> str: ...

    @property
    def shape(self) -> Shape: ...

    @property
    def alpha_scale(self) -> float: ...

    @property
    def closed_form(self) -> bool: ...

def lowest_node(shape: Shape) -> Node:
    """The lowest node that the numbers of a shape allow."""

def code_path(row: str, shape: Shape, bounded: bool = False) -> str:
    """
    What evaluates a material of that row: "ggx" or "beckmann", Mitsuba's own code, or "tables".
    """

def check_roughness(alpha_u: float, alpha_v: float) -> None: ...

def first_of_wrong_length(w: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], tolerance: float) -> int:
    """
    Index of the first row of w whose length differs from 1 by more than the tolerance.
    """

def first_outside(x: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], low: float, high: float) -> int:
    """Index of the first number of x that is not in [low, high]."""

class TableSource:
    """A table as the user gives it."""

    def __init__(self, places: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], by_angles: bool, values: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], quantity: str = 'D', tail: str = 'power', tail_exponent: float | None = None, knee: float | None = None, path: str = '') -> None: ...

    @staticmethod
    def read(path: str, quantity: str = '', tail: str = '', tail_exponent: float | None = None) -> TableSource:
        """From a .csv or .npz file; what is left out is what the file says."""

    @property
    def places(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]: ...

    @property
    def by_angles(self) -> bool: ...

    @property
    def values(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]: ...

    @property
    def quantity(self) -> str: ...

    @property
    def tail(self) -> str: ...

    @property
    def tail_exponent(self) -> float | None: ...

    @property
    def knee(self) -> float | None: ...

    @property
    def path(self) -> str: ...

class Radial:
    """
    What a distribution is made from: a member of the family, a table, or a mixture of these.
    """

    @staticmethod
    def family(shape: Shape) -> Radial: ...

    @staticmethod
    def table(source: TableSource) -> Radial: ...

    @staticmethod
    def mixture(parts: Sequence[tuple[float, float, Radial]]) -> Radial:
        """Weights, roughnesses and distributions."""

    def resampled(self, nodes: int) -> Radial:
        """The same as a table of so many nodes."""

    @property
    def is_family(self) -> bool: ...

    @property
    def is_table(self) -> bool: ...

    @property
    def width(self) -> float:
        """The roughness at which a table or mixture is as it was given."""

    @property
    def key(self) -> bytes: ...

    @property
    def slopes(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]: ...

    @property
    def slope_densities(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]: ...

    @property
    def knee(self) -> float: ...

    @property
    def tail_exponent(self) -> float:
        """0 if the table is cut."""

class Ndf:
    """A distribution with its tables."""

    @overload
    @staticmethod
    def get(radial: Radial, accuracy: float, visible: bool = True) -> Ndf: ...

    @overload
    @staticmethod
    def get(shape: Shape, accuracy: float, visible: bool = True) -> Ndf: ...

    @property
    def normalization(self) -> float: ...

    @property
    def accuracy_reached(self) -> float: ...

    @property
    def steepness(self) -> float: ...

    @property
    def mean(self) -> float:
        """Mean of the stretched slope."""

    @property
    def by_odds(self) -> bool:
        """Are visible normals tabulated over the odds of the profile?"""

    @property
    def table_bytes(self) -> int: ...

    def missing_energy(self, correlated: bool, alpha_u: float | None = None, alpha_v: float | None = None) -> tuple[int, float]:
        """
        (bytes, error of E that was measured) of the table of what single scattering loses.
        """

    @property
    def count_of_numbers(self) -> int:
        """Values of a table, or weights and then roughnesses of a mixture."""

    def by_numbers(self, quantity: str, alpha_u: float, alpha_v: float, w: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
        """
        Derivatives of "d" or "lambda" by the logarithms of all numbers, a row for each direction.
        """

    def eval(self, query: str, alpha_u: float, alpha_v: float, first: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], second: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)] | None = None) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
        """A function of the core's table of queries over arrays, by its name."""

class Watch:
    """How far a long call is; `stop` ends it."""

    def __init__(self) -> None: ...

    @property
    def done(self) -> int:
        """Steps or walks."""

    @property
    def distance(self) -> float:
        """
        Kolmogorov-Smirnov distance that the last step of a generator began with.
        """

    def stop(self) -> None: ...

class SlopeAgreement:
    """How near slopes are to a distribution."""

    @property
    def ks(self) -> float:
        """Kolmogorov-Smirnov distance of the radial slopes."""

    @property
    def tv(self) -> float:
        """
        Total variation over 64 x 32 bins of equal probability, radius and azimuth.
        """

    @property
    def tv_independent(self) -> float:
        """What as many independent facets have of it, on average."""

    @property
    def worst_bin(self) -> float:
        """Greatest relative error of 100 radial bins of equal probability."""

    @property
    def mean_error(self) -> float:
        """Mean length of the slopes over that of the target, less 1."""

def slope_agreement(ndf: Ndf, alpha_u: float, alpha_v: float, slopes: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> SlopeAgreement:
    """Distances of slopes, packed x, y, from a distribution."""

class Goniometer:
    """What a virtual goniometer measures."""

    def __init__(self, wi: Sequence[float], material: str, eta: Sequence[float], k: Sequence[float], orders: int, polar: int, azimuths: int, cosines: int, walks: int, seed: int) -> None: ...

    def reflectance(self, cosines: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
        """
        What a facet reflects of light from outside at each cosine, three colors in a row.
        """

def measure_model(ndf: Ndf, alpha_u: float, alpha_v: float, goniometer: Goniometer, watch: Watch) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
    """
    Walks on Smith's model of a surface; the numbers are those of Microsurface.measure.
    """

class Microsurface:
    """A periodic surface made of facets."""

    def __init__(self, nx: int, ny: int, dx: float, dy: float, heights: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> None: ...

    @staticmethod
    def generate(ndf: Ndf, size: int, correlation: float, seed: int, tolerance: float, steps: int, watch: Watch) -> Microsurface: ...

    def heights(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
        """x first"""

    def slopes(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
        """Of all facets, packed x, y: lower and upper of each cell in turn."""

    def projected_areas(self, w: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
        """
        Area of all facets that face a direction, seen from there, per area of the tile.
        """

    def areas_by_cosine(self, goniometer: Goniometer) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
        """The same for its view, by the cosine between view and normal."""

    def measure(self, goniometer: Goniometer, watch: Watch) -> Annotated[NDArray[numpy.float64], dict(shape=(None,))]:
        """
        Walks, lost, sums of bounces and of their squares; first facets by cosine; energies by (hemisphere, order, polar, azimuth, color); sums of their squares.
        """
