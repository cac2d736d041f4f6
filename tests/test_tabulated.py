"""Tables and mixtures through Mitsuba and as arrays: are they what was given, and do they keep what the family promises?"""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import re

import conftest
import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc
from scipy.integrate import quad
from scipy.stats import chi2
from sgtd import Ndf
from tables import MIXTURES, PLUGIN, TABLES, listed, ndf_of, plugin_table
from test_construction import VARIANTS

ANISOTROPIC = dict(alpha_u=0.4, alpha_v=0.15)


def slope_normals(slopes, azimuth=0.3):
    slopes = np.asarray(slopes)
    m = np.stack([slopes * np.cos(azimuth), slopes * np.sin(azimuth), np.ones_like(slopes)], axis=-1)
    return m / np.linalg.norm(m, axis=-1, keepdims=True)


# -- arrays


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_as_it_was_given(name):
    """D at the nodes is the values, up to one factor, and D cos(theta) has mass 1."""
    table, ndf = TABLES[name], ndf_of(name)
    slopes = np.tan(np.radians(table["angles"])) if "angles" in table else np.asarray(table["slopes"])
    m = slope_normals(slopes[:-1] if table.get("tail") == "cut" else slopes)
    expected = np.asarray(table["values"])[: len(m)]
    d = ndf.d(m) * (1.0 if table["quantity"] == "D" else m[:, 2] ** 4)
    keep = expected > 0
    ratio = d[keep] / expected[keep]
    # a step of 1e-6 is the rounding of a direction
    assert ratio / ratio[0] == pytest.approx(1.0, rel=1e-6 if name == "step" else 1e-9)
    assert (d[expected == 0] < 1e-12 * d.max()).all()
    slope_density = lambda x: float(ndf.d(slope_normals(x))) / (1 + x * x) ** 2
    breaks = [x for x in slopes if x > 0]
    mass = sum(
        quad(lambda x: 2 * np.pi * x * slope_density(x), a, b, epsrel=1e-10)[0] for a, b in zip([0.0, *breaks], breaks)
    )
    tail = quad(lambda u: 2 * np.pi * slope_density(breaks[-1] / u) * breaks[-1] ** 2 / u**3, 0.0, 1.0, epsrel=1e-10)[0]
    assert mass + (0.0 if table.get("tail") == "cut" else tail) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("name", MIXTURES)
def test_a_mixture_is_the_blend_of_its_members(name):
    """Densities of slopes and projected areas add up with the weights; masking by quadrature over the blend."""
    ndf, parts = ndf_of(name, accuracy=0), MIXTURES[name]
    total = sum(weight for weight, _ in parts)
    members = [(weight / total, Ndf(**member, accuracy=0)) for weight, member in parts]
    m = slope_normals(np.geomspace(1e-3, 20, 50))
    assert ndf.d(m) == pytest.approx(sum(weight * member.d(m) for weight, member in members), rel=1e-11)
    for theta in (20.0, 60.0, 85.0, 89.0):
        w = sc.direction(theta)
        # cos(theta)/G1 = the area of facets seen from w
        area = sum(weight * np.cos(np.radians(theta)) / member.g1(w) for weight, member in members)
        assert np.cos(np.radians(theta)) / ndf.g1(w) == pytest.approx(area, rel=1e-11)


def test_smith_of_a_blend_by_quadrature():
    """The area of facets that face a view, as an integral over directional slopes of the blended density."""
    ndf = ndf_of("core and haze")
    parts = [(0.7, Ndf(distribution="student", gamma=1.6, alpha=0.1)), (0.3, Ndf(distribution="gnd", p=2.0, alpha=0.5))]

    def density(slope):
        m = slope_normals(slope)
        return sum(weight * float(part.d(m)) for weight, part in parts) / (1 + slope * slope) ** 2

    for theta in (40.0, 75.0):
        a = 1 / np.tan(np.radians(theta))

        # facing area over cos(theta): integral of P(s) max(0, 1 + s.t) with t = tan(theta)
        def ring(x):
            q = a / x
            if q >= 1:
                inner = 2 * np.pi
            else:
                phi = np.arccos(-q)
                inner = 2 * (phi + np.sin(phi) / q)
            return x * density(x) * inner

        ends = [0.0, 0.05, 0.2, 0.5, a, 1.0, 3.0]
        area = sum(quad(ring, x, y, epsrel=1e-9, limit=200)[0] for x, y in zip(sorted(ends), sorted(ends)[1:]))
        area += quad(lambda u: ring(3.0 / u) * 3.0 / u**2, 0.0, 1.0, epsrel=1e-9, limit=200)[0]
        assert 1 / float(ndf.g1(sc.direction(theta))) == pytest.approx(area, rel=1e-5)


@pytest.mark.parametrize("name", PLUGIN)
def test_arrays_of_tables_have_all_that_the_family_has(name):
    ndf = ndf_of(name, **ANISOTROPIC)
    rng = np.random.default_rng(2)
    wi, u = sc.uniform_directions(rng, 3000), rng.random((3000, 2))
    for options in (dict(), dict(visible=False), dict(bounded=True)):
        m, pdf = ndf.sample(wi, u, **options)
        valid = pdf > 0
        assert valid.mean() > 0.9
        again = ndf.pdf(wi, m, **options)
        error = sc.relative_error(again[valid], pdf[valid])
        # next to a step rounding decides the side
        assert np.quantile(error, 0.999) < 1e-6, options
    for other in (copy.deepcopy(ndf), pickle.loads(pickle.dumps(ndf)), copy.copy(ndf)):
        assert np.array_equal(other.d(m), ndf.d(m)) and np.array_equal(other.g1(wi), ndf.g1(wi))
        assert repr(other) == repr(ndf)
    assert ndf.d(m[:7, None]).shape == (7, 1) and ndf.pdf(wi[:, None][:5], m[:6]).shape == (5, 6)
    x = np.geomspace(0.01, 5, 40)
    assert ndf.quantile(ndf.cdf(x[ndf.profile(x) > 1e-9])) == pytest.approx(x[ndf.profile(x) > 1e-9], rel=1e-6)
    with pytest.raises(AttributeError, match="no gamma"):
        ndf.gamma  # noqa: B018


def _g1_in_child(ndf, w, queue):
    queue.put(ndf.g1(w))


def test_tables_in_a_forked_child():
    ndf, w = ndf_of("measured"), sc.uniform_directions(np.random.default_rng(1), 5000)
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_g1_in_child, args=(ndf, w, queue))
    child.start()
    assert np.array_equal(queue.get(timeout=30), ndf.g1(w))
    child.join(timeout=30)


def test_alpha_is_the_mean_slope():
    ndf = ndf_of("two")
    wide = ndf_of("two", alpha=2 * ndf.alpha_u)
    m = slope_normals(np.geomspace(0.01, 3, 20))
    doubled = slope_normals(2 * np.geomspace(0.01, 3, 20))
    assert wide.d(doubled) * doubled[:, 2] ** 4 == pytest.approx(ndf.d(m) * m[:, 2] ** 4 / 4, rel=1e-12)
    x = np.linspace(0, 1, 100001)[1:-1]
    assert np.mean(ndf_of("giant").quantile(x)) == pytest.approx(1.0, rel=1e-4)
    assert ndf_of("giant", alpha=0.2).mean_slope == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize(
    "shape", [dict(gamma=1.9), dict(gamma=2.7, p=1.3, lam=0.3, shift=0.4), dict(distribution="beckmann")]
)
def test_resampled_rows(shape):
    exact = Ndf(**shape, alpha=0.3)
    table = exact.resampled(64)
    theta = np.radians(np.linspace(1, 89.5, 60))
    w = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=-1)
    assert table.g1(w) == pytest.approx(exact.g1(w), rel=1.0e-3)
    d = exact.d(w)
    # seen as a density of slopes, whose tail no cosine lifts
    bright = d * w[:, 2] ** 4 > 1e-6 * d.max()
    assert table.d(w)[bright] == pytest.approx(d[bright], rel=1e-2)


def test_files(tmp_path):
    table = TABLES["measured"]
    wanted = Ndf.tabulated(**table)
    m = slope_normals(np.linspace(0, 3, 30))
    np.savez(tmp_path / "a.npz", angles=table["angles"], D=table["values"], tail_cut=True)
    np.savez_compressed(tmp_path / "b.npz", angles=table["angles"], values=table["values"])
    rows = np.stack([table["angles"], table["values"]], axis=-1)
    np.savetxt(tmp_path / "c.csv", rows, delimiter=",", header="tail: cut", fmt="%.17g")
    assert np.array_equal(Ndf.from_file(tmp_path / "a.npz").d(m), wanted.d(m))
    assert np.array_equal(Ndf.from_file(tmp_path / "b.npz", tail="cut").d(m), wanted.d(m))
    assert np.array_equal(Ndf.from_file(tmp_path / "c.csv").d(m), wanted.d(m))
    with pytest.raises(ValueError, match="missing.csv: cannot be read"):
        Ndf.from_file(tmp_path / "missing.csv")


@pytest.mark.parametrize(
    "arguments, words",
    [
        (dict(values=[1, 2]), "either"),
        (dict(slopes=[0, 1], angles=[0, 1], values=[1, 2]), "either"),
        (dict(slopes=[0.3, 0.1], values=[1, 2], tail="cut"), '"slopes" in row 2 is 0.1, but must be greater than'),
        (dict(angles=[0, 90], values=[1, 2]), '"angles" in row 2 is 90, but must be at least 0 and below 90'),
        (dict(slopes=[0, 1], values=[1, -2]), '"values" in row 2 is -2'),
        (dict(slopes=[0, 1], values=[1, np.nan]), '"values" in row 2 is NaN'),
        (dict(slopes=[0], values=[1]), "has 1 rows, but must have 2 to 1000"),
        (dict(slopes=[0, 1], values=[0, 0]), "no mass"),
        (dict(slopes=[0, 1], values=[1, 0.9]), "too heavy a tail"),
        (dict(slopes=[0, 1], values=[1, 0.9], tail_exponent=2), '"tail_exponent" is 2'),
        (dict(slopes=[0, 1], values=[1, 0.1], quantity="height"), "one of D, D_cos, slope"),
        (dict(slopes=[[0, 1]], values=[1, 0.1]), "its shape is (1, 2)"),
        (dict(slopes=["a"], values=[1]), "must be real numbers"),
        (dict(slopes=[0, 1], values=[1, 0.1], tail="cut", alpha=-1), '"alpha" is -1'),
    ],
)
def test_bad_tables(arguments, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        Ndf.tabulated(**arguments)


def test_bad_mixtures():
    ggx = Ndf(distribution="ggx")
    for parts, words in [([], "0 rows"), ([(0, ggx)], "is 0"), ([(1, Ndf(**ANISOTROPIC))], "two roughnesses")]:
        with pytest.raises(ValueError, match=words):
            Ndf.mixture(parts)


# -- the plugin


@pytest.mark.parametrize("plugin", ["sgtdconductor", "sgtddielectric"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_every_variant_makes_them(variant, plugin):
    conftest.use(variant)
    for name in ("measured", "core and haze"):
        bsdf = sc.load(plugin, **PLUGIN[name])
        value, pdf = sc.evaluate(bsdf, sc.direction(40.0, 10.0), sc.direction(38.0, 188.0))
        assert np.isfinite(value).all() and (value > 0).all() and pdf[0] > 0


def directions(ndf, rng, count=3000):
    """Views, and reflections about normals that the distribution has."""
    wi = sc.uniform_directions(rng, count)
    m, _ = ndf.sample(wi, rng.random((count, 2)))
    return wi, sc.reflect(wi, m), rng.random((count, 2))


@pytest.mark.parametrize("masking", ["separable", "height_correlated"])
@pytest.mark.parametrize("roughness", [{}, ANISOTROPIC], ids=["isotropic", "anisotropic"])
@pytest.mark.parametrize("name", PLUGIN)
def test_the_plugin_is_the_core(variant, name, roughness, masking):
    """Value, density and samples of tables in single precision against the core in double precision."""
    ndf = ndf_of(name, **roughness)
    rng = np.random.default_rng(4)
    wi, wo, u = directions(ndf, rng, 3000 if variant.startswith("llvm") else 400)
    keep = wo[:, 2] > 1e-3
    wi, wo, u = (a[keep].astype(np.float32).astype(np.float64) for a in (wi, wo, u))
    bsdf = sc.load(**PLUGIN[name], **roughness, masking=masking)
    value, pdf = sc.evaluate(bsdf, wi, wo)
    half = wi + wo
    m = half / np.linalg.norm(half, axis=-1, keepdims=True)
    d = ndf.d(m)
    expected = d * ndf.g2(wi, wo, masking=masking) / (4 * wi[:, 2])
    # where the rounding of the directions decides (a step, the end of a cut table) it does
    nearby = np.abs(ndf.d(slope_shift(m, 1e-6)) - d) + np.abs(ndf.d(slope_shift(m, -1e-6)) - d)
    sure = (nearby < 1e-3 * d) & (d * m[:, 2] > 1e-6 * (ndf.d(slope_normals([0.0, 0.1, 0.5]))).max())
    assert sure.mean() > (0.2 if name == "step" else 0.6)
    error = sc.relative_error(value[sure, 0], expected[sure])
    conftest.measured(f"tables, {variant[:6]}", error, lambda k: f"{name}, {roughness}, {masking}")
    assert error.max() < 1e-4, error.max()
    density = ndf.pdf(wi, m, bounded=True) / (4 * np.sum(wo * m, axis=-1))
    assert np.quantile(sc.relative_error(pdf[sure], density[sure], floor=1e-6 * density.max()), 0.99) < 3e-3
    out, drawn, weight = sc.sample(bsdf, wi, u)
    valid = (weight > 0).any(axis=-1)
    assert valid.mean() > 0.9
    again, density = sc.evaluate(bsdf, wi[valid], out[valid])
    clear = out[valid][:, 2] > 1e-2
    assert np.quantile(sc.relative_error(density, drawn[valid])[clear], 0.98) < 1e-3
    estimate = again[:, 0] / density
    assert np.quantile(sc.relative_error(weight[valid, 0], estimate)[clear], 0.98) < 1e-3


def slope_shift(m, by):
    """Normals whose slopes are longer by a share."""
    longer = m * [1 + by, 1 + by, 1]
    return longer / np.linalg.norm(longer, axis=-1, keepdims=True)


def _chi2(bsdf, wi, count, cases):
    """Mitsuba's test on the half vector's sphere of directions."""
    ctx = mi.BSDFContext()

    def interaction(width):
        si = dr.zeros(mi.SurfaceInteraction3f, width)
        si.wi = mi.Vector3f(wi)
        return si

    def sample(u):
        bs, weight = bsdf.sample(ctx, interaction(dr.width(u)), u[0], mi.Vector2f(u[1], u[2]))
        valid = dr.any(weight != 0.0)
        return dr.select(valid, bs.wo, mi.Vector3f(0, 0, 1)), dr.select(valid, mi.Float(1.0), 0.0)

    test = mi.chi2.ChiSquareTest(
        domain=mi.chi2.SphericalDomain(),
        sample_func=sample,
        pdf_func=lambda wo: bsdf.pdf(ctx, interaction(dr.width(wo)), wo),
        sample_dim=3,
        sample_count=count,
        res=60,
        ires=32,
        seed=1,
    )
    return test.run(0.01, test_count=cases, quiet=True), test.messages


@pytest.mark.parametrize("name", ["noise", "two", "core and haze", "ring and box"])
def test_samples_follow_the_density(llvm, name):
    """χ² with a million samples, isotropic, anisotropic and of all normals; steps are for the test over facets below."""
    for k, more in enumerate([dict(alpha=0.3), ANISOTROPIC, dict(alpha=0.3, sample_visible=False)]):
        ok, messages = _chi2(sc.load(**PLUGIN[name], **more), sc.direction((30.0, 60.0, 75.0)[k], 25.0), 1_000_000, 12)
        assert ok, messages


@pytest.mark.parametrize("name", ["measured", "ring", "giant", "step"])
def test_samples_follow_the_distribution_of_visible_normals(llvm, name):
    """χ² with a million samples over the slope of the facet against the exact share of visible normals: of all, drawn from D cos."""
    bsdf, ndf = sc.load(**PLUGIN[name], sample_visible=False), ndf_of(name)
    count = 1_000_000
    rng = np.random.default_rng(3)
    wi = sc.direction(10.0)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(*wi.tolist())
    u = rng.random((count, 2)).astype(np.float32)
    bs, _ = bsdf.sample(mi.BSDFContext(), si, 0.5, mi.Point2f(u[:, 0].copy(), u[:, 1].copy()))
    half = bs.wo.numpy().T.astype(np.float64) + wi if bs.wo.numpy().shape[0] == 3 else bs.wo.numpy() + wi
    half = half[bs.pdf.numpy() > 0]
    slope = np.hypot(half[:, 0], half[:, 1]) / half[:, 2]
    edges = ndf.alpha_u * ndf.quantile(np.linspace(0, 0.95, 96))
    found, _ = np.histogram(slope, edges)
    # samples below the horizon are lost: only radii below all of those count
    keep = edges[1:] < np.tan(np.radians(40.0))
    expected = count * 0.01
    statistic = np.sum((found[keep] - expected) ** 2 / expected)
    assert keep.sum() > 20
    assert chi2.sf(statistic, keep.sum()) > 0.01 / 4, (name, statistic, keep.sum())


@pytest.mark.parametrize("roughness", [{}, {"alpha": 0.8}, {"alpha_u": 0.5, "alpha_v": 0.25}], ids=str)
@pytest.mark.parametrize("name", ["measured", "noise", "ring", "core and haze"])
def test_white_furnace(llvm, name, roughness):
    """With multiple scattering a mirror loses nothing."""
    bsdf = sc.load(**PLUGIN[name], **roughness, multiple_scattering=True, masking="height_correlated")
    count = 1 << 20
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(7, count)
    for angle in (20.0, 60.0, 80.0):
        si = dr.zeros(mi.SurfaceInteraction3f, count)
        si.wi = mi.Vector3f(*sc.direction(angle, 25.0).tolist())
        _, weight = bsdf.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())
        weights = weight.x.numpy().astype(np.float64)
        error = weights.std() / np.sqrt(count)
        assert abs(weights.mean() - 1) < 2e-3 + 3 * error, (angle, weights.mean(), error)


@pytest.mark.parametrize("name", ["measured", "core and haze"])
def test_glass_keeps_weights_below_one(variant, name):
    """Reflection and transmission together lose light and make none; density and value are those of samples."""
    rng = np.random.default_rng(6)
    count = 20000 if variant.startswith("llvm") else 300
    bsdf = sc.load("sgtddielectric", **PLUGIN[name], masking="height_correlated")
    wi, u = sc.uniform_directions(rng, count, lower=True), rng.random((count, 3))
    wi = wi[np.abs(wi[:, 2]) > 0.1]
    u = u[: len(wi)]
    wo, pdf, weight = sc.sample(bsdf, wi, u, mode=mi.TransportMode.Importance)
    valid = (weight[:, 0] > 0) & (np.abs(wo[:, 2]) > 1e-2)
    # (the density that is drawn from is near that of visible normals, not equal)
    assert valid.mean() > 0.8 and weight.max() < 1.03 and np.mean(weight) < 1
    value, density = sc.evaluate(bsdf, wi[valid], wo[valid], mode=mi.TransportMode.Importance)
    assert np.quantile(sc.relative_error(density, pdf[valid]), 0.98) < 1e-3
    # (a direction on the rim of the cone of upright facets may round to one beyond it)
    seen = density > 0
    assert seen.mean() > 0.998
    assert (
        np.quantile(sc.relative_error((value[:, 0] / np.where(seen, density, 1.0))[seen], weight[valid, 0][seen]), 0.98)
        < 1e-3
    )
    assert (wo[valid, 2] * wi[valid, 2] < 0).mean() > 0.4


def test_textured_roughness_is_that_of_each_place(variant):
    alphas = np.array([0.05, 0.2, 0.7])
    textured = sc.load(**PLUGIN["measured"], alpha=alphas)
    rng = np.random.default_rng(8)
    wi, wo = sc.uniform_directions(rng, 60), sc.uniform_directions(rng, 60)
    for k, alpha in enumerate(alphas):
        value, pdf = sc.evaluate(textured, wi, wo, uv=((k + 0.5) / 3, 0.5))
        alone, density = sc.evaluate(sc.load(**PLUGIN["measured"], alpha=float(alpha)), wi, wo)
        assert value == pytest.approx(alone, rel=1e-4, abs=1e-7) and pdf == pytest.approx(density, rel=1e-4, abs=1e-7)


def test_files_and_tensors_say_what_texts_say(variant, tmp_path):
    table = TABLES["measured"]
    rows = np.stack([table["angles"], table["values"]], axis=-1)
    path = tmp_path / "metal.csv"
    np.savetxt(path, rows, delimiter=",", header="angle,D", comments="", fmt="%.17g")
    wi, wo = sc.direction(30.0), sc.direction(25.0, 180.0)
    expected, _ = sc.evaluate(sc.load(**PLUGIN["measured"]), wi, wo)
    for given in (
        dict(filename=str(path), tail="cut"),
        dict(
            angles=mi.TensorXf(np.float32(table["angles"])), values=mi.TensorXf(np.float32(table["values"])), tail="cut"
        ),
    ):
        value, _ = sc.evaluate(sc.load(distribution="tabulated", **given), wi, wo)
        assert value == pytest.approx(expected, rel=1e-5)
    xml = """<scene version="3.0.0"><bsdf type="sgtdconductor" id="m"><string name="distribution" value="tabulated"/>
        <string name="filename" value="metal.csv"/><string name="tail" value="cut"/></bsdf></scene>"""
    (tmp_path / "scene.xml").write_text(xml)
    scene = mi.load_file(str(tmp_path / "scene.xml"))
    assert scene is not None


@pytest.mark.parametrize(
    "properties, words",
    [
        (dict(distribution="tabulated"), 'needs "filename", or "values"'),
        (dict(distribution="tabulated", angles="0 10", slopes="0 1", values="1 1"), 'needs "filename", or "values"'),
        (dict(distribution="tabulated", filename="nowhere.csv"), "nowhere.csv: cannot be read"),
        (dict(distribution="tabulated", slopes="0 1 0.5", values="1 1 1"), '"slopes" in row 3 is 0.5'),
        (dict(distribution="tabulated", slopes="0 1", values="1 much"), '"values" has "much", which is not a number'),
        (dict(distribution="tabulated", slopes="0 1", values="1 1"), "too heavy a tail"),
        (dict(distribution="tabulated", slopes="0 1", values="1 .1", gamma=2.0), '"gamma" is given'),
        (dict(distribution="tabulated", slopes="0 1", values="1 .1", tail="gauss"), "one of power, cut"),
        (dict(distribution="tabulated", slopes="0 1", values=True), "must be a list of numbers"),
        (dict(distribution="mixture"), 'needs "members"'),
        (dict(distribution="mixture", members="weight=1 gamma"), 'member 1 of the mixture, "weight=1 gamma": '),
        (dict(distribution="mixture", members="weight=1; weigth=2"), 'parameter "weigth" is unknown'),
        (dict(distribution="mixture", members="distribution=ggx gamma=3"), "fixes"),
        (dict(distribution="mixture", members="weight=-1"), '"weights" in row 1 is -1'),
        (dict(distribution="mixture", members="distribution=tabulated filename=no.npz"), "cannot be read"),
        (dict(distribution="mixture", members="distribution=ggx quantity=D"), "is not one of distribution"),
    ],
)
def test_errors(scalar, properties, words):
    with pytest.raises(RuntimeError, match=re.escape(words)):
        sc.load(**properties)


def test_values_change_through_traverse(variant):
    bsdf = sc.load(**PLUGIN["two"])
    params = mi.traverse(bsdf)
    other = dict(TABLES["two"], values=[1.0, 0.01])
    params["values"] = type(params["values"])(other["values"])
    params.update()
    wi, wo = sc.direction(50.0), sc.direction(20.0, 170.0)
    expected, _ = sc.evaluate(sc.load(**plugin_table(other)), wi, wo)
    found, _ = sc.evaluate(bsdf, wi, wo)
    # nobody gave a roughness, so the table stays as it is given
    assert found == pytest.approx(expected, rel=1e-5)
    params["values"] = type(params["values"])([1.0, -1.0])
    with pytest.raises(RuntimeError, match='"values" in row 2 is -1'):
        params.update()
    assert sc.evaluate(bsdf, wi, wo)[0] == pytest.approx(found)
    assert np.array(params["values"]) == pytest.approx([1.0, 0.01])
    mixture = sc.load(**PLUGIN["core and haze"])
    params = mi.traverse(mixture)
    before, _ = sc.evaluate(mixture, wi, wo)
    params["weights"] = type(params["weights"])([0.1, 0.9])
    params.update()
    after, _ = sc.evaluate(mixture, wi, wo)
    parts = [(0.1, MIXTURES["core and haze"][0][1]), (0.9, MIXTURES["core and haze"][1][1])]
    ndf = Ndf.mixture([(weight, Ndf(**member)) for weight, member in parts])
    m = (wi + wo) / np.linalg.norm(wi + wo)
    assert after[0, 0] == pytest.approx(float(ndf.d(m) * ndf.g2(wi, wo)) / (4 * wi[2]), rel=1e-4)
    assert not after[0, 0] == pytest.approx(before[0, 0], rel=1e-2)


def test_frozen_functions_notice(llvm):
    """A change of the values is seen by a recording, and each kind of distribution has its own code."""
    from test_frozen_code import call, compare, interaction

    arguments, frozen = interaction(False), dr.freeze(call)
    materials = [
        sc.load(**PLUGIN["two"], alpha=0.3),
        sc.load(gamma=1.8, alpha=0.3),
        sc.load(**PLUGIN["core and haze"], alpha=0.3),
        sc.load(distribution="ggx", alpha=0.3),
        sc.load(**PLUGIN["measured"], alpha=0.3),
        sc.load(**PLUGIN["step"], alpha=0.3),
    ]
    for _ in range(2):
        for bsdf in materials + materials[::-1]:
            compare(frozen, bsdf, arguments, str(bsdf))
    recorded = frozen.n_recordings
    params = mi.traverse(materials[0])
    for value in (0.3, 0.05):
        params["values"] = mi.Float([1.0, value])
        params.update()
        compare(frozen, materials[0], arguments, f"value {value}")
    assert frozen.n_recordings == recorded


def test_the_family_has_no_cells(llvm):
    """Materials without a table hold nothing for one."""
    params = mi.traverse(sc.load(gamma=1.8))
    assert not [key for key in params.keys() if key in ("values", "weights", "alphas")]
    assert "rows = " not in str(sc.load(gamma=1.8)) and "rows = 15" in str(sc.load(**PLUGIN["measured"]))
    assert listed([0.5, 1]) == "0.5 1.0"


# -- derivatives


def _moved(name, group, index, step):
    """The distribution with one number moved, at the roughness and the knee that it had."""
    ndf = ndf_of(name)
    if name in TABLES:
        values = np.array(TABLES[name]["values"], float)
        values[index] *= np.exp(step)
        return Ndf.tabulated(
            **{**TABLES[name], "values": values, "knee": ndf.table.knee}, alpha=ndf.alpha_u, accuracy=0
        )
    parts = [(weight, dict(member)) for weight, member in MIXTURES[name]]
    if group == "weights":
        parts[index] = (parts[index][0] * np.exp(step), parts[index][1])
    else:
        parts[index][1]["alpha"] *= np.exp(step)
    return Ndf.mixture([(weight, Ndf(**member)) for weight, member in parts], alpha=ndf.alpha_u, accuracy=0)


@pytest.mark.parametrize("name", PLUGIN)
def test_arrays_follow_their_numbers(name):
    """Derivatives by values, weights and alphas against differences; off the nodes, where they jump."""
    ndf = ndf_of(name)
    rng = np.random.default_rng(11)
    w = sc.uniform_directions(rng, 400)
    slope = np.hypot(w[:, 0], w[:, 1]) / w[:, 2]
    nodes = ndf.table.slopes if name in TABLES else np.array([1e9])
    w = w[np.abs(np.log(slope[:, None] / np.maximum(nodes, 1e-9))).min(axis=1) > 2e-3].reshape(-1, 1, 3)
    step = 1e-4
    for quantity in ("d", "lambda"):
        of = (lambda n: n.d(w)) if quantity == "d" else (lambda n: n.lambda_(w))
        scale = of(ndf) + 1e-9
        for group, by in ndf.gradient(quantity, w).items():
            assert by.shape == (len(w), 1, by.shape[-1])
            if name in TABLES:
                given = TABLES[name]["values"]
            else:
                given = [weight if group == "weights" else member["alpha"] for weight, member in MIXTURES[name]]
            for index in range(0, by.shape[-1], max(1, by.shape[-1] // 8)):
                low, high = (of(_moved(name, group, index, x * step)) for x in (-1.0, 1.0))
                exact = (high - low) / (2 * step) / scale
                got = by[..., index] * given[index] / scale
                assert np.linalg.norm(got - exact) < 1e-5 * np.linalg.norm(exact) + 1e-6, (quantity, group, index)
    with pytest.raises(ValueError, match="normalization"):
        ndf.gradient("normalization")


def test_derivatives_by_zero_are_zero():
    ring = ndf_of("ring")
    by = ring.gradient("d", slope_normals(np.linspace(0.01, 1.1, 50)))["values"]
    assert (by[:, np.asarray(TABLES["ring"]["values"]) == 0.0] == 0.0).all() and np.isfinite(by).all()
