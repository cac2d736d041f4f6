"""sgtdplastic: equal to roughplastic where that is right, as far from it as documented where it is not, and a furnace that stays white."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc

PLUGIN = "sgtdplastic"
SHAPES = {
    "ggx": dict(distribution="ggx"),
    "beckmann": dict(distribution="beckmann"),
    "heavy tail": dict(gamma=1.6),
    "full": dict(gamma=1.9, p=1.3, shift=0.6, **{"lambda": 0.4}),
    "mixture": dict(
        distribution="mixture",
        members="weight=0.7 alpha=0.1 distribution=student gamma=1.6; weight=0.3 alpha=0.4 distribution=beckmann",
    ),
}
ROUGH = {"isotropic": dict(alpha=0.3), "anisotropic": dict(alpha_u=0.5, alpha_v=0.1)}


def pairs(rng, count, spread=0.3):
    """Views and lights, most of them around the lobe."""
    wi, wo = sc.uniform_directions(rng, count), sc.uniform_directions(rng, count)
    near = rng.random(count) < 0.6
    wo[near] = sc.reflect(wi, sc.normals(rng, count, spread, spread, reach=0.5))[near]
    return wi, np.where(wo[:, 2:] > 0, wo, -wo)


# -- roughplastic


@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_the_coat_is_roughplastic(variant, distribution, visible):
    """Mitsuba's own code: the specular part differs by the order of three multiplications, samples not at all."""
    sc.needs_equal_rounding()
    rng = np.random.default_rng(1)
    count = 20_000 if not sc.is_scalar() else 1000
    given = dict(distribution=distribution, alpha=0.2, sample_visible=visible, diffuse_reflectance=0.0)
    ours, theirs = (sc.load(plugin, specular_reflectance=0.7, **given) for plugin in (PLUGIN, "roughplastic"))
    wi, wo = pairs(rng, count, 0.2)
    u = rng.random((count, 3))
    # roughplastic has a density below the horizon of the light if above that of the view
    for found, expected in zip(sc.evaluate(ours, wi, wo), sc.evaluate(theirs, wi, wo)):
        assert np.count_nonzero(expected) > count // 2
        assert sc.relative_error(found, expected, floor=1e-20).max() < 1e-6
    (a, pdf, weight), (b, expected_pdf, expected) = (sc.sample(bsdf, wi, u) for bsdf in (ours, theirs))
    valid = expected[:, 0] > 0
    assert valid.mean() > 0.5 and np.array_equal(weight[:, 0] > 0, valid)
    assert np.array_equal(a[valid], b[valid])
    assert sc.relative_error(pdf, expected_pdf)[valid].max() < 1e-6
    assert sc.relative_error(weight, expected)[valid].max() < 1e-6


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_the_base_is_as_far_from_roughplastic_as_documented(llvm, distribution, nonlinear):
    """The base alone: what is thrown back from below is 1/64 more, and what is transmitted is that between 64 cosines."""
    rng = np.random.default_rng(2)
    given = dict(distribution=distribution, alpha=0.2, nonlinear=nonlinear, diffuse_reflectance=1.0)
    ours, theirs = (sc.load(plugin, **given) for plugin in (PLUGIN, "roughplastic"))
    wi, wo = pairs(rng, 20_000)
    found, expected = (sc.evaluate(bsdf, wi, wo, component=1) for bsdf in (ours, theirs))
    ratio = found[0][:, 0] / expected[0][:, 0]
    print(
        f"{distribution}: values {ratio.min():.4f} to {ratio.max():.4f}, median {np.median(ratio):.4f} of roughplastic's"
    )
    assert 1.01 < np.median(ratio) < 1.03
    # one factor for all directions, but for the transmittance
    assert np.abs(ratio / np.median(ratio) - 1).max() < 5e-3
    assert sc.relative_error(found[1], expected[1]).max() < 1e-6


def internal_reflectance(distribution, alpha, eta, count=1 << 20):
    """R_int by drawing visible normals with Mitsuba's own code, below the coat."""
    rng = np.random.default_rng(3)
    mu = np.sqrt(rng.random(count))
    phi = rng.uniform(0, 2 * np.pi, count)
    wi = mi.Vector3f(*(mi.Float(x) for x in (np.sqrt(1 - mu**2) * np.cos(phi), np.sqrt(1 - mu**2) * np.sin(phi), mu)))
    facets = mi.MicrofacetDistribution(distribution, alpha, True)
    m, _ = facets.sample(wi, mi.Point2f(mi.Float(rng.random(count)), mi.Float(rng.random(count))))
    wo = mi.reflect(wi, m)
    F = mi.fresnel(dr.dot(wi, m), 1 / eta)[0]
    return dr.mean(dr.select(wo.z > 0, F * facets.smith_g1(wo, m), 0)).numpy().item()


@pytest.mark.parametrize("alpha", [0.05, 0.4])
@pytest.mark.parametrize("kind", ["GGX", "Beckmann"])
def test_what_the_coat_throws_back(llvm, kind, alpha):
    """R_int of ours is that of brute force, and roughplastic's is not: it follows from values at two base colors."""

    def found(plugin):
        values = []
        for d in (0.2, 0.8):
            bsdf = sc.load(
                plugin,
                distribution=kind.lower(),
                alpha=alpha,
                nonlinear=True,
                diffuse_reflectance=d,
                int_ior=1.5,
                ext_ior=1.0,
            )
            values.append(sc.evaluate(bsdf, sc.direction(20.0), sc.direction(30.0), component=1)[0][0, 0] / d)
        # d / (1 - d R): the quotient of both is (1 - .2 R) / (1 - .8 R)
        q = values[1] / values[0]
        return (q - 1) / (0.8 * q - 0.2)

    exact = internal_reflectance(getattr(mi.MicrofacetType, kind), alpha, 1.5)
    ours, theirs = found(PLUGIN), found("roughplastic")
    print(f"{kind}, alpha {alpha}: {ours:.4f}, roughplastic {theirs:.4f}, drawn {exact:.4f}")
    assert ours == pytest.approx(exact, abs=2e-3)
    assert theirs < exact - 4e-3


# -- laws


@pytest.mark.parametrize("roughness", ROUGH)
@pytest.mark.parametrize("shape", SHAPES)
def test_white_furnace(llvm, shape, roughness):
    """A white base under a coat that scatters more than once returns all light; without that, never more than there is."""
    count = 1 << 17
    u = np.random.default_rng(4).random((count, 3))
    for masking in ("separable", "height_correlated"):
        for angle in (5.0, 60.0, 86.0):
            wi = np.tile(sc.direction(angle, 25.0), (count, 1))
            given = dict(diffuse_reflectance=1.0, masking=masking, **SHAPES[shape], **ROUGH[roughness])
            kept = []
            for multiple in (True, False):
                weight = sc.sample(sc.load(PLUGIN, multiple_scattering=multiple, **given), wi, u)[2][:, 0]
                kept.append((weight.mean(), weight.std() / count**0.5))
            (all_light, noise), (single, _) = kept
            assert abs(all_light - 1) < 2e-3 + 4 * noise, (masking, angle, kept)
            assert single < all_light - 1e-3 and single > 0, (masking, angle, kept)


@pytest.mark.parametrize("nonlinear", [False, True])
def test_dark_bases_return_less(llvm, nonlinear):
    """Of a base that absorbs, no direction returns more than a white one, and a black one the coat's part alone."""
    rng = np.random.default_rng(5)
    wi, wo = pairs(rng, 5000)
    for multiple in (False, True):
        given = dict(gamma=1.8, alpha=0.3, nonlinear=nonlinear, multiple_scattering=multiple)
        values = [
            sc.evaluate(sc.load(PLUGIN, diffuse_reflectance=d, **given), wi, wo)[0][:, 0] for d in (0.0, 0.3, 1.0)
        ]
        assert (values[0] <= values[1]).all() and (values[1] <= values[2]).all()
        coat = sc.evaluate(sc.load(PLUGIN, diffuse_reflectance=0.3, **given), wi, wo, component=0)[0][:, 0]
        assert sc.relative_error(coat, values[0], floor=1e-6).max() < 1e-5


@pytest.mark.parametrize("multiple", [False, True])
@pytest.mark.parametrize("roughness", ROUGH)
@pytest.mark.parametrize("shape", SHAPES)
def test_reciprocity(llvm, shape, roughness, multiple):
    bsdf = sc.load(PLUGIN, nonlinear=True, multiple_scattering=multiple, **SHAPES[shape], **ROUGH[roughness])
    wi, wo = pairs(np.random.default_rng(6), 5000)
    there, back = sc.evaluate(bsdf, wi, wo)[0][:, 0] / wo[:, 2], sc.evaluate(bsdf, wo, wi)[0][:, 0] / wi[:, 2]
    assert sc.relative_error(there, back, floor=1e-4).max() < 3e-3


CHI2 = [
    pytest.param(shape, roughness, angle, extra, id=f"{shape}-{roughness}-{angle:g}-{extra}")
    for shape, roughness, angle, extra in (
        *((shape, "isotropic", 60.0, {}) for shape in SHAPES),
        ("full", "anisotropic", 60.0, {}),
        ("heavy tail", "anisotropic", 85.0, {"multiple_scattering": True}),
        ("ggx", "isotropic", 20.0, {"multiple_scattering": True}),
        ("full", "isotropic", 75.0, {"sample_visible": False}),
        ("heavy tail", "isotropic", 75.0, {"sample_bounded": False}),
    )
]


@pytest.mark.parametrize("shape, roughness, angle, extra", CHI2)
def test_chi2(llvm, shape, roughness, angle, extra):
    from mitsuba.chi2 import ChiSquareTest, SphericalDomain

    given = {"type": PLUGIN, **SHAPES[shape], **ROUGH[roughness], **extra}
    sample, pdf = adapter(given, angle)
    test = ChiSquareTest(SphericalDomain(), sample, pdf, sample_dim=3, sample_count=500_000, res=101, ires=16, seed=7)
    assert test.run(0.01, test_count=len(CHI2)), test.messages


def adapter(given, angle):
    """Samples and density of a BSDF at one view."""
    bsdf = mi.load_dict(given)

    def interaction(count):
        si = dr.zeros(mi.SurfaceInteraction3f, count)
        si.wi = mi.Vector3f(sc.direction(angle, 25.0))
        return si

    def sample(u):
        count = dr.width(u)
        bs, weight = bsdf.sample(mi.BSDFContext(), interaction(count), u[0], [u[1], u[2]])
        return bs.wo, dr.select(dr.any(weight > 0), mi.Float(1.0), 0.0)

    def pdf(wo):
        return bsdf.pdf(mi.BSDFContext(), interaction(dr.width(wo)), wo)

    return sample, pdf


@pytest.mark.parametrize("extra", [{}, {"multiple_scattering": True}], ids=str)
@pytest.mark.parametrize("shape", ["ggx", "full"])
def test_weight_is_value_by_density(variant, shape, extra):
    rng = np.random.default_rng(8)
    bsdf = sc.load(PLUGIN, alpha=0.3, **SHAPES[shape], **extra)
    count = 5000 if not sc.is_scalar() else 500
    wi, u = sc.uniform_directions(rng, count), rng.random((count, 3))
    for component in (None, 0, 1):
        wo, pdf, weight, eta, kind, which = sc.sample_all(bsdf, wi, u, component=component)
        valid = weight[:, 0] > 0
        assert valid.mean() > 0.5 and (eta[valid] == 1).all()
        kinds = np.array([int(mi.BSDFFlags.GlossyReflection), int(mi.BSDFFlags.DiffuseReflection)])
        assert (kind[valid] == kinds[which[valid]]).all() and component in (None, *np.unique(which[valid]))
        value, density = sc.evaluate(bsdf, wi[valid], wo[valid], component=component)
        assert sc.relative_error(density, pdf[valid]).max() < 2e-3
        assert sc.relative_error(value, weight[valid] * pdf[valid, None], floor=1e-5).max() < 2e-3


# -- variants


def test_variants_agree(llvm):
    """Scalar code in single and double precision, the core at each hit, and kernels."""
    import conftest

    rng = np.random.default_rng(9)
    wi, wo = pairs(rng, 300)
    given = [
        dict(**SHAPES[shape], **rough, multiple_scattering=m)
        for shape in ("full", "ggx")
        for rough in ROUGH.values()
        for m in (False, True)
    ]
    expected = [sc.evaluate(sc.load(PLUGIN, **g), wi, wo) for g in given]
    for name in ("scalar_rgb", "scalar_rgb_double", "scalar_mono_polarized"):
        if name not in mi.variants():
            continue
        conftest.use(name)
        for g, (value, pdf) in zip(given, expected):
            found, density = sc.evaluate(sc.load(PLUGIN, **g), wi, wo)
            assert sc.relative_error(found[:, 0], value[:, 0], floor=1e-3).max() < 1e-3, (name, g)
            assert sc.relative_error(density, pdf, floor=1e-3).max() < 1e-3, (name, g)


def test_transmittance_is_that_of_the_distribution(llvm):
    """T of a member that Mitsuba does not have, by drawing visible normals with the array interface."""
    import sgtd

    rng = np.random.default_rng(10)
    eta, shape = 1.5, dict(gamma=1.7, p=1.2, shift=0.3)
    ndf = sgtd.Ndf(alpha=0.4, **shape)
    bsdf = sc.load(PLUGIN, alpha=0.4, int_ior=eta, ext_ior=1.0, diffuse_reflectance=1.0, **shape)

    def drawn(angle, count=200_000):
        wi = np.tile(sc.direction(angle), (count, 1))
        m, pdf = ndf.sample(wi, rng.random((count, 2)))
        cosine = np.sum(wi * m, axis=-1)
        beyond = np.sqrt(1 - (1 - cosine**2) / eta**2)
        rs, rp = (cosine - eta * beyond) / (cosine + eta * beyond), (eta * cosine - beyond) / (eta * cosine + beyond)
        through = wi / eta + (beyond - cosine / eta)[:, None] * m
        g1 = ndf.g1(through / np.linalg.norm(through, axis=-1, keepdims=True))
        return np.mean((1 - 0.5 * (rs**2 + rp**2)) * g1)

    angles = (0.0, 45.0, 80.0)
    values = [sc.evaluate(bsdf, sc.direction(a), sc.direction(0.0), component=1)[0][0, 0] for a in angles]
    expected = [drawn(a) for a in angles]
    for value, t in zip(values[1:], expected[1:]):
        assert value / values[0] == pytest.approx(t / expected[0], abs=3e-3)


def test_polarized_facets_are_fresnels():
    """Where roughplastic depolarizes: at Brewster's angle the coat reflects light of one polarization alone."""
    import conftest

    conftest.use("scalar_mono_polarized" if "scalar_mono_polarized" in mi.variants() else "scalar_spectral_polarized")
    angle = math.degrees(math.atan(1.5))
    bsdf = sc.load(PLUGIN, alpha=0.05, gamma=1.8, int_ior=1.5, ext_ior=1.0, diffuse_reflectance=0.0)
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = sc.direction(angle)
    if "spectral" in mi.variant():
        si.wavelengths = [450.0, 520.0, 580.0, 650.0]
    M = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(sc.direction(angle, 180.0)))
    first = [float(np.array(M[i, j]).ravel()[0]) for i, j in ((0, 0), (0, 1), (1, 0), (1, 1))]
    assert first[0] > 0
    # all of it has the polarization of the first column: |M01| = M00
    assert np.abs(first[1]) == pytest.approx(first[0], rel=1e-3) and first[3] == pytest.approx(first[0], rel=1e-3)


# -- updates


@pytest.mark.parametrize("extra", [{}, {"multiple_scattering": True}], ids=str)
def test_updates_are_new_materials(variant, extra):
    """Roughness, index, shape and colors: after an update nothing is left of what was."""
    wi, wo = pairs(np.random.default_rng(11), 200)
    bsdf = sc.load(PLUGIN, gamma=1.8, alpha=0.2, **extra)
    params = mi.traverse(bsdf)
    assert {"alpha", "eta", "diffuse_reflectance.value", "gamma"} <= set(params.keys())
    params["alpha"], params["gamma"], params["diffuse_reflectance.value"] = 0.4, 1.6, 0.3
    params["eta"] = 1.25
    params.update()
    same = sc.load(PLUGIN, gamma=1.6, alpha=0.4, diffuse_reflectance=0.3, int_ior=1.25, ext_ior=1.0, **extra)
    assert str(bsdf) == str(same)
    for found, expected in zip(sc.evaluate(bsdf, wi, wo), sc.evaluate(same, wi, wo)):
        assert sc.relative_error(found, expected, floor=1e-6).max() < 1e-5


def test_names_are_those_of_roughplastic(llvm):
    ours, theirs = (
        set(mi.traverse(sc.load(p, distribution="ggx", specular_reflectance=0.5)).keys())
        for p in (PLUGIN, "roughplastic")
    )
    assert theirs <= ours


def test_derivatives_by_roughness_index_and_color(llvm):
    """Of the specular part by alpha and eta, of the base by its color: against differences."""
    wi, wo = sc.direction(30.0), sc.direction(40.0, 170.0)
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(wi)

    def value(component, **given):
        return sc.evaluate(sc.load(PLUGIN, **{**start, **given}), wi, wo, component=component)[0][0, 0]

    start = dict(gamma=1.7, alpha=0.3, int_ior=1.5, ext_ior=1.0, diffuse_reflectance=0.4)
    for component, key, name, at in (
        (0, "alpha", "alpha", 0.3),
        (0, "eta", "int_ior", 1.5),
        (1, "diffuse_reflectance.value", "diffuse_reflectance", 0.4),
    ):
        bsdf = sc.load(PLUGIN, **start)
        params = mi.traverse(bsdf)
        dr.enable_grad(params[key])
        params.update()
        dr.backward(dr.sum(bsdf.eval(sc.context(component=component), si, mi.Vector3f(wo))[0]))
        found = dr.grad(params[key]).numpy().item()
        h = 1e-2
        expected = (value(component, **{name: at + h}) - value(component, **{name: at - h})) / (2 * h)
        assert found == pytest.approx(expected, rel=1e-2), key


@pytest.mark.parametrize(
    "given, words",
    [
        ({"alpha": {"type": "checkerboard"}}, ["alpha", "texture", "one number"]),
        ({"int_ior": -1.0}, ["int_ior", "-1"]),
        ({"ext_ior": "gas"}, ["ext_ior", "gas"]),
        ({"gamma": 0.5}, ["gamma", "0.5"]),
        ({"alpha_u": 0.1}, ["alpha_v", "missing"]),
    ],
    ids=str,
)
def test_refusals_are_by_name(variant, given, words):
    with pytest.raises(Exception) as error:
        sc.load(PLUGIN, **given)
    assert all(word in str(error.value) for word in words)


def test_gradients_of_the_shape_are_refused(llvm):
    bsdf = sc.load(PLUGIN, gamma=1.7)
    params = mi.traverse(bsdf)
    dr.enable_grad(params["gamma"])
    with pytest.raises(Exception, match="coat.*no derivatives"):
        params.update()


def test_frozen_functions_follow_updates(llvm):
    """Shapes change the code, numbers do not; what needs new tables is refused inside."""
    rng = np.random.default_rng(12)
    wi, wo = pairs(rng, 200)
    si = dr.zeros(mi.SurfaceInteraction3f, 200)
    si.wi = mi.Vector3f(*(mi.Float(np.ascontiguousarray(c)) for c in wi.T))
    light = mi.Vector3f(*(mi.Float(np.ascontiguousarray(c)) for c in wo.T))

    def call(bsdf, si, wo):
        return bsdf.eval_pdf(mi.BSDFContext(), si, wo)

    for extra in ({}, {"multiple_scattering": True}):
        bsdf, frozen = sc.load(PLUGIN, alpha=0.3, **extra), dr.freeze(call)
        params = mi.traverse(bsdf)
        for gamma, alpha, eta in ((2.0, 0.3, 1.5), (1.7, 0.3, 1.5), (1.8, 0.2, 1.3), (2.0, 0.4, 1.4), (1.6, 0.4, 0.8)):
            params["gamma"], params["alpha"], params["eta"] = gamma, alpha, eta
            params.update()
            for a, b in zip(frozen(bsdf, si, light), call(bsdf, si, light)):
                assert np.allclose(a.numpy(), b.numpy(), rtol=1e-5, atol=1e-6)
        assert frozen.n_recordings <= 3

    def change(params, alpha):
        params["alpha"] = alpha
        params.update()
        return alpha

    with pytest.raises(Exception) as error:
        dr.freeze(change)(params, mi.Float(0.25))
    assert "frozen" in str(error.value.__cause__) and '"alpha"' in str(error.value.__cause__)


@pytest.mark.parametrize(
    "given",
    [{"int_ior": 1.3, "ext_ior": 1.3}, {"int_ior": 1.0, "ext_ior": 1.5}, {"alpha": 0.0}, {"int_ior": 100.0}],
    ids=str,
)
def test_edges(variant, given):
    """No number that is not one, and no density without a value or the other way round."""
    rng = np.random.default_rng(13)
    for multiple in (False, True):
        bsdf = sc.load(PLUGIN, gamma=1.7, multiple_scattering=multiple, **given)
        wi, wo = pairs(rng, 300)
        wi[:20, 2] = [0.0, 1e-30, 1e-7, 1e-4] * 5
        for view, light in ((wi, wo), (wo, wi)):
            value, pdf = sc.evaluate(bsdf, view, light)
            assert np.isfinite(value).all() and np.isfinite(pdf).all() and (value >= 0).all() and (pdf >= 0).all()
        _, pdf, weight = sc.sample(bsdf, wi, rng.random((300, 3)))
        assert np.isfinite(weight).all() and (weight >= 0).all() and (pdf[weight[:, 0] > 0] > 0).all()
