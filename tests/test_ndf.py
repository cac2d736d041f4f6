"""Is sgtd.Ndf right to the last digits, and does it refuse what it cannot answer?"""

import copy
import csv
import functools
import pickle
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import conftest
import numpy as np
import pytest
import scattering as sc
import sgtd
from family import KINDS, ROWS, named
from sgtd import _core

REFERENCE = Path(__file__).parent / "reference"

# Permitted relative error of each quantity at accuracy = 0.
TOLERANCE = {"A": 1e-13, "Af": 1e-13, "cdf": 1e-12, "sf": 1e-12, "Lambda": 1e-12}


@functools.cache
def reference(name):
    """{shape: {quantity: (arguments, values)}} of a file."""
    shapes = {}
    with open(REFERENCE / name, newline="") as file:
        for row in csv.DictReader(file):
            shape = tuple(float(row[key]) for key in ("gamma", "p", "lambda", "shift"))
            shapes.setdefault(shape, {}).setdefault(row["quantity"], []).append(
                (float(row["argument"] or 0), float(row["value"]))
            )
    return {
        shape: {q: tuple(map(np.array, zip(*rows))) for q, rows in quantities.items()}
        for shape, quantities in shapes.items()
    }


CASES = [(name, shape) for name in ("visible.csv", "profile.csv") for shape in reference(name)]


@functools.cache
def ndf_of(shape):
    gamma, p, lam, shift = shape
    return sgtd.Ndf(gamma=gamma, p=p, lam=lam, shift=shift, alpha=1.0, accuracy=0.0)


@functools.cache
def direction_of_slope(a):
    """A unit vector (x, 0, z) with z/x nearer to a than a rounding (2^-54 against 2^-53): the best of many neighbors, found in exact arithmetic."""
    x0 = 1.0 / np.hypot(1.0, a)
    best = None
    for step in np.random.default_rng(0).random(300) * 1e-7:
        x = x0 * (1.0 + step)
        exact = Fraction(a) * Fraction(x)
        z = float(exact)
        error = abs(Fraction(z) / exact - 1)
        if best is None or error < best[0]:
            best = (error, x, z)
    assert best[0] < Fraction(1, 2**54)
    return np.array([best[1], 0.0, best[2]])


def computed(ndf, quantity, argument):
    if quantity == "A":
        return np.full(argument.shape, ndf.normalization)
    if quantity == "Af":
        return ndf.normalization * ndf.profile(argument)
    if quantity == "Lambda":
        return ndf.lambda_(np.array([direction_of_slope(a) for a in argument]))
    return getattr(ndf, quantity)(argument)


@pytest.mark.parametrize("quantity", TOLERANCE)
@pytest.mark.parametrize(
    "name, shape", CASES, ids=lambda v: v if isinstance(v, str) else ",".join(f"{x:.10g}" for x in v)
)
def test_against_reference(name, shape, quantity):
    argument, expected = reference(name)[shape][quantity]
    error = sc.relative_error(computed(ndf_of(shape), quantity, argument), expected)
    i = error.argmax()
    conftest.measured(f"{quantity} in {name}", error, lambda worst: f"{shape}, argument {float(argument[worst])!r}")
    assert error[i] <= TOLERANCE[quantity], f"{quantity}({argument[i]!r}) = {expected[i]!r} is off by {error[i]:.2e}"


# -- inverses


@pytest.mark.parametrize("shape", reference("profile.csv"), ids=lambda v: ",".join(f"{x:.10g}" for x in v))
def test_quantile_and_cdf_are_inverse(shape):
    ndf = ndf_of(shape)
    u = np.array([1e-300, 1e-100, 1e-20, 1e-8, 1e-3, 0.1, 0.3, 0.5, 0.7, 0.9, 0.999, 1.0 - 1e-9])
    x = ndf.quantile(u)
    assert np.isfinite(x).all() and (np.diff(x) >= 0).all()
    # cdf(x) moves by more than 1e-11 between neighboring x where the distribution is narrow
    low, high = ndf.cdf(np.nextafter(x, 0.0)), ndf.cdf(np.nextafter(x, np.inf))
    error = np.maximum(np.maximum(low - u, u - high), 0.0) / u
    assert error.max() <= 1e-11, u[error.argmax()]

    x = np.array(
        [
            v
            for v in (
                1e-6,
                0.01,
                0.2,
                0.5,
                0.9,
                1.0,
                1.2,
                1.9,
                3.0,
                0.7 * shape[3],
                0.999 * shape[3],
                shape[3],
                1.01 * shape[3],
            )
            if v > 0
        ]
    )
    f, s = ndf.cdf(x), ndf.sf(x)
    lower = (f > 1e-290) & (f <= 0.5)
    upper = (s > 1e-290) & (s <= 0.5)
    assert (lower | upper).any()
    assert sc.relative_error(ndf.quantile(f[lower]), x[lower]).max(initial=0) <= 1e-11
    assert sc.relative_error(ndf.isf(s[upper]), x[upper]).max(initial=0) <= 1e-11


@pytest.mark.parametrize("shape", reference("profile.csv"), ids=lambda v: ",".join(f"{x:.10g}" for x in v))
def test_isf_and_sf_are_inverse(shape):
    """In the complementary function, down to 1e-300, where 1 - u is 1."""
    ndf = ndf_of(shape)
    s = np.array([0.9, 0.5, 0.1, 1e-3, 1e-8, 1e-20, 1e-100, 1e-200, 1e-300])
    x = ndf.isf(s)
    assert (np.diff(x) >= 0).all()
    # 2 p gamma - 2 near 1 puts the last of them near 1e300, which is still a number
    inside = np.isfinite(x) & (x < 1e300)
    assert inside[:6].all()
    low, high = ndf.sf(np.nextafter(x, np.inf)), ndf.sf(np.nextafter(x, 0.0))
    error = np.maximum(np.maximum(low - s, s - high), 0.0)[inside] / s[inside]
    assert error.max() <= 1e-11, s[inside][error.argmax()]


def test_ends_of_the_inverses():
    ndf = ndf_of((2.0, 1.0, 0.0, 0.0))
    assert ndf.quantile(0.0) == 0.0 and ndf.isf(1.0) == 0.0
    assert ndf.quantile(1.0) == np.inf and ndf.isf(0.0) == np.inf
    assert ndf.cdf(0.0) == 0.0 and ndf.sf(0.0) == 1.0 and ndf.cdf(np.inf) == 1.0 and ndf.sf(np.inf) == 0.0


# -- continuity where a formula is switched

SWITCHES = {
    "gamma to infinity": ("gamma", [1e8, 1e10, 1e12, 1e13, 1e14, 1e15, 1e16, 1e18, 1e30, float("inf")], 1e3),
    "lambda to 0": ("lam", [0.0, 1e-17, 1e-14, 1e-10, 1e-8, -1e-10], 10.0),
    "p to 1": ("p", [1.0, 1 + 2.0**-52, 1 - 2.0**-53, 1 + 1e-12, 1 + 1e-10, 1 - 1e-10], 30.0),
    "shift to 0": ("shift", [0.0, 1e-300, 1e-20, 1e-16, 1e-12, 1e-10, 1e-8], 10.0),
}


@pytest.mark.parametrize("quantity", ["normalization", "profile", "cdf", "sf", "lambda_"])
@pytest.mark.parametrize("switch", SWITCHES)
def test_continuity(switch, quantity):
    """Neighboring shapes have neighboring values: the step is bounded by the step of the parameter, and by 1e-12."""
    parameter, values, slope = SWITCHES[switch]
    base = dict(gamma=3.0, p=1.0, lam=0.0, shift=0.0)
    x = np.array([1e-4, 0.3, 0.9, 1.7, 3.0])
    answers = []
    for value in values:
        ndf = sgtd.Ndf(**{**base, parameter: value}, alpha=1.0, accuracy=0.0)
        if quantity == "normalization":
            answers.append(np.array([ndf.normalization]))
        elif quantity == "lambda_":
            answers.append(ndf.lambda_(np.array([direction_of_slope(a) for a in x])))
        else:
            answers.append(getattr(ndf, quantity)(x))
    limit = answers[-1] if parameter == "gamma" else answers[0]
    for value, answer in zip(values, answers):
        away = 1.0 / value if parameter == "gamma" else abs(value - values[0])
        assert sc.relative_error(answer, limit).max() <= 1e-12 + slope * away, value


@pytest.mark.parametrize("shape", [(2.0, 1.0, 0.0, 0.7), (4.0, 0.4, 0.5, 2.0), (float("inf"), 3.0, -0.9, 5.0)], ids=str)
def test_continuity_across_the_shift(shape):
    ndf = ndf_of(shape)
    m = shape[3]
    x = m * (1.0 + np.arange(-4, 5) * 2.0**-52)
    for function in (ndf.cdf, ndf.sf, lambda x: ndf.lambda_(np.array([direction_of_slope(a) for a in x]))):
        values = function(x)
        # eight neighbors of m span 2e-15 of it, and c = 0.1 makes that 1e-13 of the value
        assert sc.relative_error(values, values[4]).max() < 5e-13
    assert ndf.profile(m) == 1.0


# -- laws that need no reference


@pytest.mark.parametrize("alphas", [(0.3, 0.3), (0.6, 0.15)], ids=str)
@pytest.mark.parametrize("kind", [k for k in KINDS if k != "box"])
def test_weak_white_furnace(kind, alphas):
    """Visible facets fill the projected area: the integral of G1 D max(0, w.m) is cos(theta)."""
    ndf = sgtd.Ndf(**named(KINDS[kind]), alpha_u=alphas[0], alpha_v=alphas[1], accuracy=0.0)
    # midpoints in s, slope = s/(1-s)^10: the heaviest tail here, slope^-0.2, ends as (1-s)^2
    s = (np.arange(3000) + 0.5) / 3000
    rho, jacobian = s / (1 - s) ** 10, (1 + 9 * s) / (1 - s) ** 11
    phi = (np.arange(180) + 0.5) * (2 * np.pi / 180)
    x, y = alphas[0] * np.outer(rho, np.cos(phi)), alphas[1] * np.outer(rho, np.sin(phi))
    length = np.sqrt(1 + x * x + y * y)
    m = np.stack([x / length, y / length, 1 / length], axis=-1).reshape(-1, 3)
    area = (alphas[0] * alphas[1] * (rho * jacobian)[:, None] / length**3 * (2 * np.pi / 180) / 3000).ravel()
    d = ndf.d(m)
    assert np.sum(d * m[:, 2] * area) == pytest.approx(1.0, abs=1e-4)
    for theta in (0.0, 45.0, 75.0, 85.0):
        w = sc.direction(theta, 40.0)
        assert ndf.g1(w) * np.sum(d * np.maximum(m @ w, 0.0) * area) == pytest.approx(w[2], rel=5e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_masking(kind):
    ndf = sgtd.Ndf(**named(KINDS[kind]), alpha_u=0.4, alpha_v=0.2, accuracy=0.0)
    rng = np.random.default_rng(16)
    wi, wo = sc.uniform_directions(rng, 300), sc.uniform_directions(rng, 300)
    gi, go = ndf.g1(wi), ndf.g1(wo)
    assert ((0 < gi) & (gi <= 1)).all()
    assert np.allclose(gi, 1 / (1 + ndf.lambda_(wi)), rtol=1e-14)
    assert np.allclose(ndf.g2(wi, wo), gi * go, rtol=1e-13)
    correlated = ndf.g2(wi, wo, masking="height_correlated")
    assert np.allclose(correlated, 1 / (1 + ndf.lambda_(wi) + ndf.lambda_(wo)), rtol=1e-13)
    assert (correlated <= np.minimum(gi, go) * (1 + 1e-14)).all() and (correlated >= gi * go * (1 - 1e-14)).all()


@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_sample_returns_its_density(kind, visible):
    ndf = sgtd.Ndf(**named(KINDS[kind]), alpha_u=0.4, alpha_v=0.2, accuracy=0.0)
    rng = np.random.default_rng(17)
    wi = sc.direction(70.0, 20.0)
    m, pdf = ndf.sample(wi, rng.random((2000, 2)), visible=visible)
    valid = pdf > 0
    assert valid.mean() > 0.8
    assert np.allclose(np.linalg.norm(m[valid], axis=-1), 1.0, rtol=1e-12)
    assert sc.relative_error(ndf.pdf(wi, m[valid], visible=visible), pdf[valid]).max() < (
        1e-6 if kind == "box" else 1e-8
    )
    # not visible: the density is that of D cos, up to what the table is good for
    if not visible:
        ratio = pdf[valid] / (ndf.d(m[valid]) * m[valid, 2])
        assert np.quantile(np.abs(ratio / np.median(ratio) - 1), 0.9) < 0.1


def test_accuracy_is_kept():
    """Tables have the error that was asked for: G1 against quadrature."""
    rng = np.random.default_rng(18)
    w = sc.uniform_directions(rng, 500)
    for shape in KINDS.values():
        exact = sgtd.Ndf(**named(shape), alpha_u=0.5, alpha_v=0.2, accuracy=0.0).g1(w)
        for accuracy in (1e-2, 1e-4, 1e-6):
            ndf = sgtd.Ndf(**named(shape), alpha_u=0.5, alpha_v=0.2, accuracy=accuracy)
            error = sc.relative_error(ndf.g1(w), exact).max()
            assert error <= accuracy, (shape, accuracy)
            assert error <= 2.0 * ndf.accuracy_reached + 1e-15, (shape, accuracy)


# -- shapes of arrays, and errors


def test_shapes_of_results():
    ndf = sgtd.Ndf(gamma=1.8, shift=0.3)
    one, many = sc.direction(30.0), np.array([sc.direction(t) for t in (0.0, 20.0, 50.0)])
    for function in (ndf.d, ndf.lambda_, ndf.g1):
        assert np.shape(function(one)) == ()
        assert function(many).shape == (3,)
        assert function(many[:0]).shape == (0,)
        assert [float(function(w)) for w in many] == function(many).tolist()
        assert function(one.tolist()) == function(one)
        assert function(many.astype(np.float32)).dtype == np.float64
        assert np.array_equal(function(np.asfortranarray(many)), function(many))
        assert np.array_equal(function(np.repeat(many, 2, axis=0)[::2]), function(many))
    for function in (ndf.pdf, ndf.g2):
        assert np.shape(function(one, one)) == ()
        assert function(one, many).shape == (3,)
        assert [float(function(one, w)) for w in many] == function(one, many).tolist()
    for function in (ndf.profile, ndf.cdf, ndf.sf):
        assert np.shape(function(0.5)) == ()
        assert function(np.ones((2, 3))).shape == (2, 3)
    u = np.random.default_rng(0).random((3, 2))
    m, pdf = ndf.sample(one, u)
    assert m.shape == (3, 3) and pdf.shape == (3,)
    assert [ndf.sample(one, v)[1] for v in u] == pdf.tolist()
    m, pdf = ndf.sample(one, u[0])
    assert m.shape == (3,) and np.shape(pdf) == ()


def test_arguments_are_broadcast():
    rng = np.random.default_rng(23)
    ndf = sgtd.Ndf(gamma=1.8, p=1.2, shift=0.3, alpha_u=0.3, alpha_v=0.1)
    w, m = sc.uniform_directions(rng, 12).reshape(4, 3, 3), sc.normals(rng, 15, 0.3, 0.1).reshape(5, 3, 3)
    views, normals = w[:, None], m[None]
    for function in (ndf.pdf, ndf.g2):
        result = function(views, normals)
        assert result.shape == (4, 5, 3)
        assert [float(function(w[i, k], m[j, k])) for i, j, k in np.ndindex(4, 5, 3)] == result.ravel().tolist()
    u = rng.random((5, 1, 1, 2))
    drawn, density = ndf.sample(w, u)
    assert drawn.shape == (5, 4, 3, 3) and density.shape == (5, 4, 3)
    for i, j, k in np.ndindex(5, 4, 3):
        one, its = ndf.sample(w[j, k], u[i, 0, 0])
        assert np.array_equal(one, drawn[i, j, k]) and its == density[i, j, k]
    assert ndf.d(m).shape == (5, 3) and ndf.quantile(u).shape == u.shape
    assert ndf.pdf(np.zeros((0, 1, 1, 3)), m).shape == (0, 5, 3)
    assert ndf.sample(w[:0], u)[0].shape == (5, 0, 3, 3)


def test_batch_equals_loop():
    """Thousands of rows, split among threads, are the rows one by one."""
    rng = np.random.default_rng(19)
    ndf = sgtd.Ndf(gamma=1.7, p=1.3, lam=0.3, shift=0.4, alpha_u=0.3, alpha_v=0.1)
    w, m, u = sc.uniform_directions(rng, 5000), sc.normals(rng, 5000, 0.3, 0.1), rng.random((5000, 2))
    picks = rng.integers(0, 5000, 50)
    for together, alone in (
        (ndf.d(m), lambda i: ndf.d(m[i])),
        (ndf.lambda_(w), lambda i: ndf.lambda_(w[i])),
        (ndf.pdf(w, m), lambda i: ndf.pdf(w[i], m[i])),
        (ndf.sample(w, u)[1], lambda i: ndf.sample(w[i], u[i])[1]),
        (ndf.cdf(u[:, 0]), lambda i: ndf.cdf(u[i, 0])),
        (ndf.quantile(u[:, 0]), lambda i: ndf.quantile(u[i, 0])),
    ):
        assert [float(alone(i)) for i in picks] == together[picks].tolist()


ONE = np.array([0.0, 0.0, 1.0])

REFUSED = {
    "two components": (lambda n: n.d([0.0, 1.0]), "m"),
    "a number": (lambda n: n.d(1.0), "m.*shape"),
    "one of many not of unit length": (lambda n: n.d([[ONE, ONE], [ONE, 2 * ONE]]), r"m.*\[1, 1\].*length 2"),
    "complex": (lambda n: n.d(ONE.astype(complex)), "m"),
    "words": (lambda n: n.d(["a", "b", "c"]), "m"),
    "objects": (lambda n: n.d(np.array([None, 0, 1])), "m"),
    "not of unit length": (lambda n: n.d([0.0, 0.0, 1.1]), "m"),
    "not a number": (lambda n: n.g1([np.nan, 0.0, 1.0]), "w"),
    "infinite": (lambda n: n.lambda_([np.inf, 0.0, 1.0]), "w"),
    "different lengths": (
        lambda n: n.pdf(np.tile(ONE, (2, 1)), np.tile(ONE, (3, 1))),
        r"wi has \(2, 3\), m has \(3, 3\)",
    ),
    "unknown masking": (lambda n: n.g2(ONE, ONE, masking="smith"), "masking.*smith"),
    "random number 1": (lambda n: n.sample(ONE, [0.5, 1.0]), "u"),
    "random number negative": (lambda n: n.sample(ONE, [-0.1, 0.5]), "u"),
    "three random numbers": (lambda n: n.sample(ONE, [0.1, 0.5, 0.5]), "u"),
    "negative x": (lambda n: n.cdf(-1.0), "x"),
    "x not a number": (lambda n: n.sf(np.nan), "x"),
    "u above 1": (lambda n: n.quantile(1.5), "u"),
    "s negative": (lambda n: n.isf(-0.1), "s"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_arguments(case):
    call, message = REFUSED[case]
    with pytest.raises(ValueError, match=message):
        call(sgtd.Ndf())


@pytest.mark.parametrize(
    "given, words",
    [
        (dict(gamma=1.0), ["gamma", "1"]),
        (dict(gamma=1.5), ["gamma", "1.5", "3"]),
        (dict(gamma=np.nan), ["gamma", "nan"]),
        (dict(p=0.0), ["p", "0"]),
        (dict(lam=1.0), ["lam", "1"]),
        (dict(shift=-0.1), ["shift", "-0.1"]),
        (dict(shift=np.inf), ["shift", "inf"]),
        (dict(alpha=-0.1), ['"alpha"', "-0.1"]),
        (dict(alpha_u=0.1, alpha_v=np.nan), ["alpha_v", "nan"]),
        (dict(alpha=[0.1, 0.2]), ["alpha", "not a number"]),
        (dict(accuracy=-1.0), ["accuracy", "-1"]),
        (dict(accuracy=np.nan), ["accuracy", "nan"]),
        (dict(gamma="two"), ["gamma", "two"]),
    ],
    ids=str,
)
def test_refused_shapes(given, words):
    with pytest.raises(ValueError) as caught:
        sgtd.Ndf(**given)
    message = str(caught.value).lower()
    assert all(word in message for word in words), message
    assert "\n" not in message


# -- the same rules as the plugin's


def refusal(call):
    """The message of a refusal, in the plugin's names."""
    with pytest.raises((ValueError, RuntimeError)) as caught:
        call()
    return str(caught.value)


@pytest.mark.parametrize(
    "given",
    [
        dict(alpha_u=0.2),
        dict(alpha_v=0.2),
        dict(alpha=0.1, alpha_v=0.2),
        dict(alpha=0.1, alpha_u=0.2, alpha_v=0.2),
        dict(mu=0.1, shift=0.1),
        dict(mu=0.1, alpha_u=0.2, alpha_v=0.2),
        dict(mu=-0.1),
        dict(mu=float("inf")),
        dict(distribution="gxx"),
        dict(distribution="student", p=2.0),
        dict(distribution="ggx", gamma=2.0),
        dict(gamma=1.0),
        dict(gamma=1.5),
        dict(p=1000.0),
        dict(lam=1.0),
        dict(shift=-1.0),
    ],
    ids=str,
)
def test_refused_like_the_plugin(scalar, given):
    theirs = refusal(lambda: sc.load(**{"lambda" if name == "lam" else name: v for name, v in given.items()}))
    ours = refusal(lambda: sgtd.Ndf(**given))
    assert ours in theirs


def test_unknown_masking_is_refused_like_the_plugin(scalar):
    assert refusal(lambda: sgtd.Ndf().g2(ONE, ONE, masking="smith")) in refusal(lambda: sc.load(masking="smith"))


def test_positional_arguments_are_refused():
    """gamma first, or alpha first? Nobody should have to remember."""
    with pytest.raises(TypeError):
        sgtd.Ndf(2.0, 1.0)


@pytest.mark.parametrize("row", ROWS)
def test_a_row_is_the_plugins_row(scalar, row):
    given = {"lam" if name == "lambda" else name: value for name, value in ROWS[row].items()}
    ndf = sgtd.Ndf(**given, alpha_u=0.3, alpha_v=0.2, accuracy=0.0)
    bsdf = sc.load(**ROWS[row], alpha_u=0.3, alpha_v=0.2, accuracy=0.0)
    w = sc.direction(40.0, 25.0).astype(np.float32).astype(np.float64)
    w /= np.linalg.norm(w)
    # as Mitsuba's own Beckmann masks by a fit
    assert sc.evaluate(bsdf, w, w)[0][0, 0] == pytest.approx(ndf.d(w) * ndf.g1(w) ** 2 / (4 * w[2]), rel=1e-2)
    assert (ndf.alpha_u, ndf.alpha_v) == (0.3, 0.2)


def test_one_alpha_is_both():
    w = sc.direction(50.0, 30.0)
    assert sgtd.Ndf(alpha=0.3).d(w) == sgtd.Ndf(alpha_u=0.3, alpha_v=0.3).d(w)
    assert sgtd.Ndf(alpha=0.3, mu=0.15).shift == 0.5
    assert sgtd.Ndf(distribution="hyper_cauchy", gamma=3.0, alpha=0.3, mu=0.15).shift == pytest.approx(0.5)
    assert sgtd.Ndf().accuracy == 1e-5


# -- copies, processes, threads

FULL = dict(gamma=1.7, p=1.3, lam=0.3, shift=0.4, alpha_u=0.3, alpha_v=0.1, accuracy=1e-4)


@pytest.mark.parametrize("given", [{}, FULL, dict(distribution="hyper_cauchy", gamma=2.5, alpha=0.2)], ids=str)
def test_copies(given):
    ndf = sgtd.Ndf(**given)
    w = sc.uniform_directions(np.random.default_rng(20), 50)
    for copied in (
        pickle.loads(pickle.dumps(ndf)),
        copy.copy(ndf),
        copy.deepcopy(ndf),
        eval(repr(ndf), {"Ndf": sgtd.Ndf}),
    ):
        assert np.array_equal(copied.g1(w), ndf.g1(w)) and np.array_equal(copied.d(w), ndf.d(w))
        assert repr(copied) == repr(ndf)
        assert (copied.alpha_u, copied.alpha_v, copied.accuracy) == (ndf.alpha_u, ndf.alpha_v, ndf.accuracy)


# Every case runs in a process of its own, which must answer in time.
IN_CHILDREN = {
    "the same object": "ask(ndf)",
    "a new object": "ask(sgtd.Ndf(gamma=1.9, p=1.1, alpha=0.2))",
    "the table of missing energy": "assert _core.Ndf.get(Shape(1.9, 1.2, 0.0, 0.0), 1e-3, False).missing_energy(False)[0] > 0",
    "a child of the child": "ask(ndf); in_child(lambda: ask(ndf))",
}

PARENT = """
import os, sys, threading, time
import numpy as np, sgtd
from sgtd import _core
from sgtd._core import Shape

def ask(ndf):
    w = np.tile([0.6, 0.0, 0.8], (20000, 1))
    assert len(set(ndf.g1(w))) == 1 and len(set(ndf.cdf(np.ones(20000)))) == 1

def in_child(call):
    child = os.fork()
    if not child:
        status = 1
        try:
            call()
            status = 0
        finally:
            os._exit(status)
    for _ in range(200):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            assert status == 0, status
            return
        time.sleep(0.05)
    os.kill(child, 9)
    os.waitpid(child, 0)
    raise SystemExit("the child did not answer")

ndf = sgtd.Ndf(gamma=1.8, shift=0.3, accuracy=1e-3)
ask(ndf)
_core.Ndf.get(Shape(1.8, 1.2, 0.0, 0.0), 1e-3, False).missing_energy(False)
"""


def answers(program):
    done = subprocess.run([sys.executable, "-c", PARENT + program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("what", IN_CHILDREN)
def test_a_forked_child_answers(what):
    answers(f"def call():\n    {IN_CHILDREN[what]}\nin_child(call); in_child(call); ask(ndf)")


@pytest.mark.slow
def test_children_of_a_busy_parent_answer():
    """Threads that are in the core while the parent forks hold its locks and its pool; the child has none of them."""
    answers("""
stop = False
def work(k):
    turn = 0
    while not stop:
        turn += 1
        ask(sgtd.Ndf(gamma=1.5 + k + 0.001 * turn, p=1.3, alpha=0.2, accuracy=1e-2))
threads = [threading.Thread(target=work, args=(k,)) for k in range(3)]
for thread in threads:
    thread.start()
try:
    for turn in range(20):
        in_child(lambda: (ask(ndf), ask(sgtd.Ndf(gamma=1.51, p=1.3, alpha=0.2, accuracy=1e-2))))
finally:
    stop = True
""")


@pytest.mark.slow
def test_a_pool_of_processes():
    """multiprocessing's own way: the object goes to the workers, which are forks of a parent that has used it."""
    answers("""
import multiprocessing
w = np.tile([0.6, 0.0, 0.8], (20000, 1))
with multiprocessing.get_context("fork").Pool(2) as pool:
    for result in pool.map_async(ndf.g1, [w, w, w]).get(timeout=30):
        assert np.array_equal(result, ndf.g1(w))
""")


# -- the table of functions


def test_the_stub_is_that_of_the_module():
    """`python -m nanobind.stubgen -m sgtd._core -o mitsuba-plugin/sgtd/_core.pyi` writes it."""
    from nanobind.stubgen import StubGen

    generator = StubGen(_core)
    generator.put(_core)
    assert generator.get() == (Path(sgtd.__file__).parent / "_core.pyi").read_text(encoding="utf-8")


def test_functions_of_the_core_are_asked_by_name():
    core = _core.Ndf.get(_core.Shape(2.0, 1.0, 0.0, 0.0), 1e-3)
    with pytest.raises(ValueError, match='"sigma" is unknown.*lambda.*sample_visible'):
        core.eval("sigma", 0.1, 0.1, ONE)
    for second in (None, ONE[:2], np.tile(ONE, (2, 1))):
        with pytest.raises(ValueError, match='"second" has . numbers, but 3 are needed'):
            core.eval("pdf_visible", 0.1, 0.1, ONE, second)
    with pytest.raises(ValueError, match='"first"'):
        core.eval("d", 0.1, 0.1, np.append(ONE, 1.0))
