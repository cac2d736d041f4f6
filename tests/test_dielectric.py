"""sgtddielectric: equal to roughdielectric where that exists, and the laws of reflection and transmission where it does not."""

import math

import conftest
import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc
import sgtd
from family import ANISOTROPIC, KINDS, ROWS

INF = float("inf")
PLUGIN = "sgtddielectric"
RADIANCE, IMPORTANCE = "Radiance", "Importance"
MASKING = ["separable", "height_correlated"]
GLASS = dict(int_ior=1.5, ext_ior=1.0)


def load(**properties):
    return sc.load(PLUGIN, **properties)


def mode(name):
    return getattr(mi.TransportMode, name)


def pairs(rng, count, alpha_u, alpha_v, eta, shift=0.0):
    """Views from both sides, and directions into which facets around the lobe reflect (even rows) or refract them (odd rows)."""
    wi = sc.uniform_directions(rng, 4 * count, lower=True)
    m = sc.normals(rng, 4 * count, alpha_u, alpha_v, reach=0.5 * (1.0 + shift))
    refracted, there = sc.refract(wi, m, eta)
    wo = np.where((np.arange(4 * count) % 2 == 0)[:, None], sc.reflect(wi, m), refracted)
    sign = np.where(np.arange(4 * count) % 2 == 0, 1.0, -1.0)
    # the view and the other direction on the sides that the facet joins, or total reflection
    good = there & (sign * wo[:, 2] * wi[:, 2] > 0) & (np.sum(wi * m, axis=-1) * wi[:, 2] > 0)
    even, odd = (np.flatnonzero(good & (np.arange(4 * count) % 2 == k))[: count // 2] for k in (0, 1))
    chosen = np.stack([even[: min(len(even), len(odd))], odd[: min(len(even), len(odd))]], axis=1).ravel()
    return wi[chosen], wo[chosen]


def reflected(wi, wo):
    return wi[:, 2] * wo[:, 2] > 0


# -- equal to roughdielectric, and to sgtdconductor


@pytest.mark.parametrize("ior", [(1.5, 1.0), ("water", "diamond")], ids=str)
@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("roughness", ["isotropic", "anisotropic", "textured"])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_equal_to_roughdielectric(variant, distribution, roughness, visible, ior):
    rng = np.random.default_rng(1)
    alpha = {"isotropic": dict(alpha=0.2), "anisotropic": dict(alpha_u=0.4, alpha_v=0.05)}.get(
        roughness, dict(alpha=rng.uniform(0.02, 0.8, (8, 8)))
    )
    properties = dict(distribution=distribution, int_ior=ior[0], ext_ior=ior[1], sample_visible=visible, **alpha)
    properties.update(specular_reflectance=0.8, specular_transmittance=0.6)
    ours, theirs = (sc.load(plugin, **properties) for plugin in (PLUGIN, "roughdielectric"))
    eta = float(np.array(mi.traverse(theirs)["eta"]).ravel()[0])
    count = 8000 if variant != "scalar_rgb" else 400
    wi, wo = pairs(rng, count, 0.2, 0.2, eta)
    uv, u = rng.random((len(wi), 2)), rng.random((len(wi), 3))
    for transport in (RADIANCE, IMPORTANCE):
        found, expected = (sc.evaluate(b, wi, wo, uv, mode=mode(transport)) for b in (ours, theirs))
        for name, a, b in zip(("value", "density"), found, expected):
            assert np.count_nonzero(b) > len(wi) // 2
            # the half vector cancels more digits the nearer eta is to 1, and the lobe of diamond in water is steep
            error = sc.relative_error(a, b, floor=1e-4 * b.max())
            assert np.median(error) < 1e-6 and np.quantile(error, 0.999) < 2e-4, (name, error.max())
        for component in (None, 0, 1):
            drawn, theirs_drawn = (sc.sample_all(b, wi, u, uv, mode(transport), component) for b in (ours, theirs))
            valid, theirs_valid = ((d[2] > 0).any(axis=-1) for d in (drawn, theirs_drawn))
            assert np.count_nonzero(valid != theirs_valid) <= len(wi) // 1000
            both = valid & theirs_valid
            assert np.count_nonzero(both) > len(wi) // 5
            for name, a, b in zip(("wo", "pdf", "weight", "eta", "type", "component"), drawn, theirs_drawn):
                if name == "weight" and not visible:
                    continue  # theirs is not its value by its density there
                error = np.abs(a[both].astype(float) - b[both]) if name == "wo" else sc.relative_error(a[both], b[both])
                assert np.median(error) < 1e-6 and np.quantile(error, 0.999) < 1e-3, (name, component, error.max())


# Operations of the LLVM kernels of eval_pdf, pdf and sample beyond those of roughdielectric. They are above 0 for samples of
# all normals alone, whose weight is the value by the density: D at the roughness that is not widened, and a division.
BEYOND = {
    ("ggx", True): (0, 0, 0),
    ("beckmann", True): (0, 0, 0),
    ("ggx", False): (0, 0, 16),
    ("beckmann", False): (0, 0, 49),
}


def operations(bsdf):
    rng = np.random.default_rng(19)
    si = dr.zeros(mi.SurfaceInteraction3f, 100)
    si.wi, wo = (mi.Vector3f(sc.uniform_directions(rng, 100, lower=True).T.astype(np.float32)) for _ in range(2))
    u = mi.Point3f(rng.random((3, 100)).astype(np.float32))
    dr.eval(si, wo, u)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        dr.eval(bsdf.eval_pdf(mi.BSDFContext(), si, wo))
        dr.eval(bsdf.pdf(mi.BSDFContext(), si, wo))
        dr.eval(bsdf.sample(mi.BSDFContext(), si, u.z, mi.Point2f(u.x, u.y)))
        return np.array([kernel["operation_count"] for kernel in dr.kernel_history([dr.KernelType.JIT])])


@pytest.mark.parametrize("roughness", [dict(alpha=0.3), dict(alpha_u=0.3, alpha_v=0.1)], ids=str)
@pytest.mark.parametrize("ior", [(1.5, 1.0), (1.0, 3.5)], ids=str)
@pytest.mark.parametrize("distribution, visible", BEYOND)
def test_no_more_operations(llvm, distribution, visible, ior, roughness):
    """Not one operation beyond roughdielectric, but for what is named above; and more only where eta needs it."""
    properties = dict(distribution=distribution, sample_visible=visible, int_ior=ior[0], ext_ior=ior[1], **roughness)
    ours, theirs = (sc.load(plugin, **properties) for plugin in (PLUGIN, "roughdielectric"))
    base = operations(theirs)
    found = operations(ours)
    print(f"{found} against {base}")
    assert (found <= base + BEYOND[distribution, visible]).all()
    params = mi.traverse(ours)
    for eta, more in ((1.0, True), (1.00001, True), (5.0, True), (0.2, True), (1.4, False)):
        params["eta"] = eta
        params.update()
        # (what pdf needs does not depend on how great eta is)
        assert (operations(ours)[[0, 2]] > found[[0, 2]]).any() == more, eta


@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("kind", KINDS)
def test_reflection_is_that_of_the_conductor(variant, kind, masking):
    """By Fresnel's term alone: one distribution, one masking, one density."""
    rng = np.random.default_rng(2)
    count = 600
    wi = sc.uniform_directions(rng, count)
    wo = sc.reflect(wi, sc.normals(rng, count, 0.35, 0.1, reach=0.5 * (1 + KINDS[kind].get("shift", 0.0))))
    properties = dict(**KINDS[kind], **ANISOTROPIC, masking=masking)
    value, pdf = sc.evaluate(load(**GLASS, **properties), wi, wo, component=0)
    metal, metal_pdf = sc.evaluate(
        sc.load("sgtdconductor", **properties, specular_reflectance=1.0, sample_bounded=False), wi, wo
    )
    h = wi + wo
    cos = np.sum(wi * h, axis=-1) / np.linalg.norm(h, axis=-1)
    root = np.sqrt(1.0 - (1.0 - cos**2) / 1.5**2)
    F = 0.5 * (((cos - 1.5 * root) / (cos + 1.5 * root)) ** 2 + ((1.5 * cos - root) / (1.5 * cos + root)) ** 2)
    assert np.count_nonzero(metal) > count
    # the metal of eta = 0, k = 1 reflects everything
    assert sc.relative_error(value, F[:, None] * metal, floor=1e-6 * metal.max()).max() < 5e-5
    assert sc.relative_error(pdf, metal_pdf, floor=1e-6 * metal_pdf.max()).max() < 5e-5


# -- one way and the other through the plugin


@pytest.mark.parametrize(
    "eta, visible, masking",
    [(1.5, True, "separable"), (1.5, False, "height_correlated"), (1 / 1.8, True, "height_correlated")],
)
@pytest.mark.parametrize("kind", KINDS)
def test_scalar_equals_llvm(llvm, kind, eta, visible, masking):
    rng = np.random.default_rng(3)
    wi, wo = pairs(rng, 400, 0.35, 0.1, eta, KINDS[kind].get("shift", 0.0))
    u = rng.random((len(wi), 3))
    answers = []
    for variant in ("scalar_rgb", "llvm_ad_rgb"):
        conftest.use(variant)
        bsdf = load(**KINDS[kind], **ANISOTROPIC, int_ior=eta, ext_ior=1.0, sample_visible=visible, masking=masking)
        answers.append((*sc.evaluate(bsdf, wi, wo), *sc.sample(bsdf, wi, u)))
    (value_s, pdf_s, wo_s, _, weight_s), (value_l, pdf_l, wo_l, _, weight_l) = answers
    for side in (True, False):
        rows = reflected(wi, wo) == side
        assert np.count_nonzero(value_s[rows]) > np.count_nonzero(rows)
        for found, expected in ((value_l, value_s), (pdf_l, pdf_s)):
            error = sc.relative_error(found[rows], expected[rows], floor=1e-6 * expected.max())
            # rounding of a slope in single precision, magnified by a box or a ring
            assert np.quantile(error, 0.99) < 1e-4 and error.max() < 2e-3, (side, error.max())
    valid_s, valid_l = (weight_s > 0).any(axis=-1), (weight_l > 0).any(axis=-1)
    assert np.count_nonzero(valid_s != valid_l) <= 2
    valid = valid_s & valid_l
    # a random number at the Fresnel term may fall on either side of it
    angle = np.linalg.norm(wo_s - wo_l, axis=-1)[valid]
    assert np.quantile(angle, 0.995) < 1e-4


@pytest.mark.parametrize("component", [None, 0, 1])
@pytest.mark.parametrize("row", ["sgtd", "gnd", "ggx_centered"])
def test_eval_pdf_is_eval_and_pdf(variant, row, component):
    rng = np.random.default_rng(4)
    wi, wo = pairs(rng, 400, 0.35, 0.1, 1.5)
    bsdf = load(**ROWS[row], **ANISOTROPIC, **GLASS)
    together, apart = sc.evaluate(bsdf, wi, wo, component=component), sc.evaluate_apart(bsdf, wi, wo, None, component)
    for a, b in zip(together, apart):
        assert sc.relative_error(a, b, floor=1e-30).max() < 1e-6
        lit = (a > 0) if a.ndim == 1 else (a > 0).any(axis=-1)
        assert lit[reflected(wi, wo)].any() == (component != 1) and lit[~reflected(wi, wo)].any() == (component != 0)


@pytest.mark.parametrize(
    "eta, visible, component",
    [(1.5, True, None), (1.5, True, 0), (1.5, True, 1), (1.5, False, None), (1 / 1.8, True, None), (1.01, True, None)],
)
@pytest.mark.parametrize("kind", [*KINDS, "Mitsuba's"])
def test_weight_times_density_is_value(variant, kind, eta, visible, component):
    rng = np.random.default_rng(5)
    count = 2000 if variant != "scalar_rgb" else 300
    wi = sc.uniform_directions(rng, count, lower=True)
    shape = KINDS.get(kind, dict(distribution="ggx"))
    bsdf = load(**shape, **ANISOTROPIC, int_ior=eta, ext_ior=1.0, sample_visible=visible)
    wo, drawn, weight = sc.sample(bsdf, wi, rng.random((count, 3)), component=component)
    valid = (weight > 0).all(axis=-1)
    assert valid.mean() > (0.05 if component == 1 or eta == 1.01 else 0.2)
    wi, wo, drawn, weight = wi[valid], wo[valid], drawn[valid], weight[valid]
    assert (drawn > 0).all()
    value, pdf = sc.evaluate(bsdf, wi, wo, component=component)
    # 1e-7 of a direction is 1e-7 / |1 - eta| of the normal, and D magnifies that where it is steep
    steep = (50.0 if kind == "box" else 1.0) * (1.0 if abs(eta - 1) > 0.1 else 100.0)
    for found, expected in ((drawn, pdf), (weight * drawn[:, None], value)):
        error = sc.relative_error(found, expected)
        assert np.median(error) < 3e-6 * steep
        # a facet whose cosine is 1e-4 is known to a thousandth from directions in single precision
        h = (wi + np.where(reflected(wi, wo), 1.0, np.where(wi[:, 2] > 0, eta, 1 / eta))[:, None] * wo).astype(float)
        upright = np.abs(h[:, 2]) < 1e-3 * np.linalg.norm(h, axis=-1)
        facing = (np.abs(wo[:, 2]) > 0.05) & (np.abs(wi[:, 2]) > 0.05) & ~upright
        assert np.quantile(error[facing], 0.99) < 1e-3 * steep


# -- laws


@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("eta", [1.5, 1 / 1.8])
@pytest.mark.parametrize("row", ["sgtd", "sgnd", "hyper_cauchy", "ggx_centered"])
def test_radiance_is_scaled_by_eta_squared(variant, row, eta, masking):
    """Radiance is compressed by 1/eta^2 on the way that light takes, importance is not; reflection is the same for both."""
    rng = np.random.default_rng(6)
    wi, wo = pairs(rng, 300, 0.35, 0.1, eta)
    u = rng.random((len(wi), 3))
    bsdf = load(**ROWS[row], **ANISOTROPIC, int_ior=eta, ext_ior=1.0, masking=masking)
    radiance, importance = (sc.evaluate(bsdf, wi, wo, mode=mode(m))[0] for m in (RADIANCE, IMPORTANCE))
    factor = np.where(reflected(wi, wo), 1.0, np.where(wi[:, 2] > 0, 1 / eta**2, eta**2))
    assert np.count_nonzero(radiance[~reflected(wi, wo)]) > 100
    assert radiance == pytest.approx(factor[:, None] * importance, rel=2e-6)
    drawn, weight, drawn_importance, weight_importance = (
        sc.sample(bsdf, wi, u, mode=mode(m))[i] for m in (RADIANCE, IMPORTANCE) for i in (0, 2)
    )
    assert np.array_equal(drawn, drawn_importance, equal_nan=True)
    factor = np.where(reflected(wi, drawn), 1.0, np.where(wi[:, 2] > 0, 1 / eta**2, eta**2))
    assert weight == pytest.approx(factor[:, None] * weight_importance, rel=2e-6)


@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("row", ROWS)
def test_light_and_importance(variant, row, masking):
    """f(wi to wo) of radiance is f(wo to wi) of importance; so f/eta^2 of radiance is the same either way (Walter et al. 2007, eq. 17)."""
    rng = np.random.default_rng(7)
    wi, wo = pairs(rng, 400, 0.35, 0.1, 1.5)
    keep = (np.abs(wi[:, 2]) > 0.05) & (np.abs(wo[:, 2]) > 0.05)
    wi, wo = wi[keep], wo[keep]
    bsdf = load(**ROWS[row], **ANISOTROPIC, **GLASS, masking=masking)

    def f(a, b, m):
        return sc.evaluate(bsdf, a, b, mode=mode(m))[0][:, 0] / np.abs(b[:, 2])

    there, back = f(wi, wo, RADIANCE), f(wo, wi, IMPORTANCE)
    scale = 1e-5 * there.max()
    assert np.count_nonzero(there) > 100
    error = sc.relative_error(there, back, floor=scale)
    assert np.quantile(error, 0.99) < 1e-4 and error.max() < 5e-3
    index = lambda w: np.where(w[:, 2] > 0, 1.0, 1.5)
    error = sc.relative_error(there * index(wi) ** -2, f(wo, wi, RADIANCE) * index(wo) ** -2, floor=scale)
    assert np.quantile(error, 0.99) < 1e-4


def scattered(bsdf, views, count=1 << 15, component=None):
    """Mean weight of importance: the share of light from each view that is reflected and transmitted; and its standard error."""
    u = np.tile(np.random.default_rng(8).random((count, 3)), (len(views), 1))
    wi = np.repeat([sc.direction(view, 20.0) for view in views], count, axis=0)
    weight = sc.sample(bsdf, wi, u, mode=mode(IMPORTANCE), component=component)[2][:, 0].reshape(len(views), count)
    return weight.mean(axis=1), weight.std(axis=1) / count**0.5


VIEWS = np.array([0.0, 40.0, 70.0, 85.0, 95.0, 130.0, 160.0])


@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("row", ROWS)
def test_no_light_is_made(llvm, row, masking):
    """Reflection and transmission together are at most all light, whatever side it comes from; and are nearly all at a low roughness."""
    for eta, alpha in ((1.5, 0.7), (1.5, 0.25), (1 / 1.5, 0.25), (2.4, 0.25), (1.5, 1e-3), (1 / 2.4, 1e-3)):
        bsdf = load(**ROWS[row], alpha=alpha, int_ior=eta, ext_ior=1.0, masking=masking)
        share, error = scattered(bsdf, VIEWS, 1 << 13)
        assert (share > 0).all() and (share <= 1.0 + 3 * error + 1e-4).all(), (eta, alpha, share)
        if alpha == 1e-3:
            assert share[np.abs(VIEWS - 90) > 10].min() > 0.97, (eta, share)


@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.7])
def test_ggx_through_the_tables_is_roughdielectric(llvm, alpha, visible):
    """As much light as there, by either component, from either side."""
    tables = load(gamma=2.0, alpha=alpha, **GLASS, sample_visible=visible)
    theirs = sc.load("roughdielectric", distribution="ggx", alpha=alpha, **GLASS)
    for component in (0, 1):
        (a, error_a), (b, error_b) = (scattered(bsdf, VIEWS, component=component) for bsdf in (tables, theirs))
        assert (np.abs(a - b) < 4.5 * np.hypot(error_a, error_b) + 1e-5).all(), (component, a, b)


def test_masking_of_a_transmission(variant):
    """Correlated by height it is B(1 + Lambda_i, 1 + Lambda_o), below the product of both: what light sees from above is hidden from below."""
    wi, m = np.array([sc.direction(60.0)]), np.array([sc.direction(20.0, 40.0)])
    wo, _ = sc.refract(wi, m, 1.5)
    for shape in (dict(distribution="ggx"), dict(gamma=1.7, p=1.2)):
        one, other = (sc.evaluate(load(alpha=0.8, **shape, **GLASS, masking=k), wi, wo)[0][0, 0] for k in MASKING)
        numbers = {"gamma": 2.0} if "distribution" in shape else shape
        ndf = sgtd.Ndf(**numbers, alpha=0.8, accuracy=0.0)
        g = [float(ndf.g1(w / np.linalg.norm(w))) for w in (wi[0], -wo[0])]
        x, y = 1 / g[0], 1 / g[1]
        beta = math.exp(math.lgamma(x) + math.lgamma(y) - math.lgamma(x + y))
        assert beta < 0.99 * g[0] * g[1]
        assert other / one == pytest.approx(beta / (g[0] * g[1]), rel=1e-4)


# -- equal indices


def test_equal_indices_let_light_through(variant):
    """Nothing is reflected, and what is not masked goes straight on, from either side; nothing is a density there."""
    rng = np.random.default_rng(9)
    wi = sc.uniform_directions(rng, 400, lower=True)
    wi = wi[np.abs(wi[:, 2]) > 0.2]
    for shape in (dict(gamma=1.8, shift=0.3), dict(distribution="ggx"), dict(distribution="beckmann")):
        bsdf = load(**shape, alpha=0.01, int_ior=1.3, ext_ior=1.3)
        for component in (None, 1):
            wo, pdf, weight, eta, kind, which = sc.sample_all(bsdf, wi, rng.random((len(wi), 3)), component=component)
            assert wo == pytest.approx(-wi, abs=1e-6)
            # to the accuracy of the density that visible normals are drawn from
            assert weight.mean() == pytest.approx(1.0, abs=2e-3)
            assert (pdf == 1).all() and (eta == 1).all() and (which == 1).all()
            assert (kind == int(mi.BSDFFlags.DeltaTransmission)).all()
        assert not (sc.sample(bsdf, wi, rng.random((len(wi), 3)), component=0)[2] > 0).any()
        value, pdf = sc.evaluate(bsdf, wi, -wi)
        assert (value == 0).all() and (pdf == 0).all()
        value, pdf = sc.evaluate(bsdf, wi, sc.uniform_directions(rng, len(wi), lower=True))
        assert (value == 0).all() and (pdf == 0).all()


@pytest.mark.parametrize("eta", [1.0 + 2e-5, 1.0001, 1.001, 0.9999])
def test_nearly_equal_indices(variant, eta):
    """Light goes on within the angle that the facets bend it by, and none is made or lost against equal indices."""
    rng = np.random.default_rng(10)
    u = rng.random((2000 if variant != "scalar_rgb" else 300, 3))
    for view in (30.0, 140.0):
        wi = np.tile(sc.direction(view, 20.0), (len(u), 1))
        bsdf, equal = (load(gamma=1.8, alpha=0.2, int_ior=i, ext_ior=1.0) for i in (eta, 1.0))
        wo, pdf, weight = sc.sample(bsdf, wi, u)
        assert np.isfinite(pdf).all() and np.isfinite(weight).all() and (weight >= 0).all()
        through = (weight[:, 0] > 0) & ~reflected(wi, wo)
        assert through.mean() > 0.9
        assert np.quantile(np.linalg.norm(wo + wi, axis=-1)[through], 0.95) < 6 * abs(eta - 1)
        _, _, equal_weight = sc.sample(equal, wi, u)
        assert weight.mean() == pytest.approx(equal_weight.mean(), rel=2e-2)


# -- textures, polarization, and every input that has broken a renderer

HARD = {
    "roughness 0": dict(gamma=1.8, alpha=0.0),
    "one roughness 0": dict(gamma=1.8, alpha_u=0.0, alpha_v=0.3),
    "roughness 10": dict(gamma=1.8, alpha=10.0),
    "texture with zeros": dict(gamma=1.7, alpha=np.array([[0.0, 0.2], [1e-30, 1e-6]])),
    "tail at its limit": dict(gamma=1.5005, alpha=0.2),
    "box": dict(gamma=2.0, p=50.0, alpha=0.3),
    "ring": dict(gamma=2.0, shift=1e3, alpha=0.01),
    "normal ring": dict(gamma=INF, shift=1e3, alpha=1e-3),
    "thin ring": dict(gamma=INF, p=2.0, shift=30.0, alpha=0.02, **{"lambda": 0.9}),
    "skew 0.999": dict(gamma=1.8, shift=0.5, alpha=0.3, **{"lambda": 0.999}),
    "all normals": dict(gamma=1.6, shift=2.0, alpha=0.5, sample_visible=False),
    "height correlated": dict(gamma=1.6, shift=2.0, alpha=0.5, masking="height_correlated"),
    "eta 1": dict(gamma=1.8, alpha=0.2, int_ior=1.0, ext_ior=1.0),
    "eta 1.0001": dict(gamma=1.8, alpha=0.2, int_ior=1.0001, ext_ior=1.0),
    "eta 1e4": dict(gamma=1.8, alpha=0.2, int_ior=1e4, ext_ior=1.0),
    "eta 1e-4": dict(gamma=1.8, alpha=0.2, int_ior=1e-4, ext_ior=1.0),
    "eta 1/1.5": dict(gamma=1.8, alpha=0.2, int_ior=1.0, ext_ior=1.5),
    "ggx": dict(distribution="ggx", alpha=0.0),
    "ggx, height correlated": dict(distribution="ggx", alpha=2.0, masking="height_correlated"),
    "beckmann, all normals": dict(distribution="beckmann", alpha=10.0, sample_visible=False),
}

COSINES = np.array([0.0, 1e-45, 1e-30, 1e-7, 1e-4, 0.01, 0.5, 0.9999999, 1.0])
NUMBERS = np.array([0.0, 1e-45, 2.0**-24, 1e-4, 0.25, 0.5, 0.9999, 1.0 - 2.0**-24])


def corners(phis):
    """All cosines on both sides, at all azimuths."""
    return np.array(
        [
            [np.sqrt(max(0.0, 1 - z * z)) * np.cos(phi), np.sqrt(max(0.0, 1 - z * z)) * np.sin(phi), sign * z]
            for z in COSINES
            for phi in phis
            for sign in (1.0, -1.0)
        ],
        dtype=np.float32,
    )


def combinations(*arrays):
    grids = np.meshgrid(*(np.arange(len(a)) for a in arrays), indexing="ij")
    return [a[g.ravel()] for a, g in zip(arrays, grids)]


def hard_inputs(step=1):
    wi, wo = corners([0.0, 0.7])[::step], corners([0.0, 0.7 + np.pi])[::step]
    a, b = combinations(wi, wo)
    # straight on and straight back, where half vector or plane of incidence do not exist
    a, b = np.concatenate([a, wi, wi]), np.concatenate([b, wi, -wi])
    u = np.array(combinations(NUMBERS[:, None], NUMBERS[:, None], NUMBERS[::3, None]))[..., 0].T
    return a, b, *combinations(wi, u[::step])


@pytest.mark.parametrize(
    "case, variant",
    [(case, variant) for case in HARD for variant in ("scalar_rgb", "llvm_ad_rgb")]
    + [(case, "llvm_ad_mono_polarized") for case in HARD if case.startswith(("eta", "roughness", "ggx"))]
    + [(case, "scalar_spectral_polarized") for case in ("eta 1", "roughness 0", "height correlated")],
)
def test_no_bad_number(case, variant):
    conftest.use(variant)
    bsdf = load(**{**GLASS, **HARD[case]})
    wi, wo, sample_wi, u = hard_inputs(1 if variant.startswith("llvm") else 5)
    textured = any(isinstance(value, np.ndarray) for value in HARD[case].values())
    for texel in (0.25, 0.75) if textured else (0.25,):
        uv = (texel, 0.25)
        for value, pdf in (sc.evaluate(bsdf, wi, wo, uv), sc.evaluate_apart(bsdf, wi, wo, uv)):
            assert np.isfinite(value).all() and (value >= 0).all()
            assert np.isfinite(pdf).all() and (pdf >= 0).all()
        for component in (None, 0, 1):
            out, pdf, weight = sc.sample(bsdf, sample_wi, u, uv, component=component)
            assert np.isfinite(weight).all() and (weight >= 0).all()
            valid = (weight > 0).any(axis=-1)
            assert np.isfinite(pdf[valid]).all() and (pdf[valid] > 0).all()
            assert np.abs(np.linalg.norm(out[valid], axis=-1) - 1.0).max(initial=0.0) < 1e-5
            # radiance from glass to air is scaled up, and where all normals are drawn a weight may be great
            if HARD[case].get("sample_visible", True):
                eta = HARD[case].get("int_ior", 1.5) / HARD[case].get("ext_ior", 1.0)
                assert weight.max(initial=0.0) < 1.001 * max(eta, 1 / eta) ** 2 * (1.5 if case != "eta 1e4" else 10)
            if case not in ("eta 1", "eta 1e4", "eta 1e-4") and component is None:
                assert valid[np.abs(sample_wi[:, 2]) > 0.4].any()


# (Mitsuba's own samplers have derivatives that are not a number at random numbers of 0)
@pytest.mark.parametrize("case", [case for case in HARD if not case.startswith(("ggx", "beckmann"))])
def test_derivatives_are_finite(llvm, case):
    """Of value, density and weight with respect to the roughness and to eta."""
    bsdf = load(**{**GLASS, **HARD[case]})
    params = mi.traverse(bsdf)
    keys = [key for key in params.keys() if key.startswith("alpha") and key.endswith((".value", ".data"))] + ["eta"]
    for key in keys:
        dr.enable_grad(params[key])
    params.update()
    wi, wo, sample_wi, u = hard_inputs()
    # at a cosine of 1e-7 derivatives overflow, in roughdielectric as well
    eval_rows, sample_rows = ((np.abs(w[:, 2]) >= 1e-4) | (w[:, 2] == 0) for w in (wi, sample_wi))
    wi, wo, sample_wi, u = wi[eval_rows], wo[eval_rows], sample_wi[sample_rows], u[sample_rows]
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi, si.uv = mi.Vector3f(wi.T), mi.Point2f(0.25, 0.25)
    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(wo.T))
    si = dr.zeros(mi.SurfaceInteraction3f, len(sample_wi))
    si.wi, si.uv = mi.Vector3f(sample_wi.T), mi.Point2f(0.25, 0.25)
    numbers = mi.Point3f(u.T.astype(np.float32))
    bs, weight = bsdf.sample(mi.BSDFContext(), si, numbers.z, mi.Point2f(numbers.x, numbers.y))
    dr.backward(1e-12 * (dr.sum(value[0]) + dr.sum(pdf) + dr.sum(weight[0])))
    for key in keys:
        assert np.isfinite(dr.grad(params[key]).numpy()).all(), key


@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("key", ["alpha.value", "eta", "specular_transmittance.value"])
@pytest.mark.parametrize("kind", ["heavy_tail", "ring", "skew", "Mitsuba's"])
def test_derivative_of_eval(llvm, kind, key, masking):
    rng = np.random.default_rng(11)
    wi, wo = pairs(rng, 400, 0.3, 0.3, 1.5)
    shape = KINDS.get(kind, dict(distribution="ggx"))
    bsdf = load(**shape, alpha=0.3, **GLASS, specular_transmittance=0.7, masking=masking)
    params = mi.traverse(bsdf)
    start = float(np.array(params[key]).ravel()[0])
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi, out = mi.Vector3f(wi.T.astype(np.float32)), mi.Vector3f(wo.T.astype(np.float32))

    def at(value):
        params[key] = value
        params.update()
        return bsdf.eval(mi.BSDFContext(), si, out)[0]

    x = mi.Float(start)
    dr.enable_grad(x)
    y = at(x)
    dr.forward(x)
    by_ad, step = dr.grad(y).numpy().astype(np.float64), 1e-3
    finite = (at(mi.Float(start + step)).numpy().astype(np.float64) - at(mi.Float(start - step)).numpy()) / (2 * step)
    scale = np.abs(finite).max()
    assert scale > 1e-3 and np.isfinite(by_ad).all()
    error = np.abs(by_ad - finite) / scale
    assert np.quantile(error, 0.98) < 5e-3
    # beside the critical angle, whose slope is infinite
    smooth = error <= np.quantile(error, 0.98)
    assert by_ad[smooth].sum() == pytest.approx(finite[smooth].sum(), rel=2e-2, abs=2e-2 * scale)


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_derivative_of_a_sample(llvm, distribution):
    """With respect to the normal of the surface, through the drawn direction and its weight: as in roughdielectric."""
    found = []
    for plugin in (PLUGIN, "roughdielectric"):
        for lobe in (0.0, 0.9):
            angle = mi.Float(0.1)
            dr.enable_grad(angle)
            si = dr.zeros(mi.SurfaceInteraction3f)
            si.sh_frame = mi.Frame3f(mi.Normal3f(dr.sin(angle), 0, dr.cos(angle)))
            si.wi = si.to_local(mi.Vector3f(0, 0, 1))
            bsdf = sc.load(plugin, distribution=distribution, alpha=0.5)
            bs, weight = bsdf.sample(mi.BSDFContext(), si, lobe, [0.3, 0.3])
            dr.forward(angle, dr.ADFlag.ClearVertices)
            found.append([weight[0][0], dr.grad(weight[0])[0], *(dr.grad(c)[0] for c in bs.wo)])
    assert found[0] == pytest.approx(found[2], rel=1e-4, abs=1e-6)
    assert found[1] == pytest.approx(found[3], rel=1e-4, abs=1e-6)
    assert abs(found[0][1]) > 1e-3 and abs(found[1][1]) > 5e-5


@pytest.mark.parametrize(
    "polarized, plain", [("llvm_ad_mono_polarized", "llvm_ad_mono"), ("scalar_spectral_polarized", "scalar_spectral")]
)
@pytest.mark.parametrize("row", ["sgtd", "ggx_centered"])
def test_intensity_of_mueller_matrix(polarized, plain, row):
    """The first element of the Mueller matrix is what the unpolarized variant returns, for eval and for samples."""
    rng = np.random.default_rng(12)
    wi, wo = pairs(rng, 200, 0.35, 0.1, 1.5)
    u = rng.random((len(wi), 3))
    answers = []
    for variant in (polarized, plain):
        conftest.use(variant)
        bsdf = load(**ROWS[row], **ANISOTROPIC, **GLASS)
        answers.append((*sc.evaluate(bsdf, wi, wo), *sc.sample(bsdf, wi, u)))
    assert np.count_nonzero(answers[1][0]) > 100
    for found, expected in zip(*answers):
        finite = np.isfinite(expected)
        assert sc.relative_error(found[finite], expected[finite], floor=1e-6).max() < 2e-5


def matrices(value, count):
    return np.moveaxis(
        np.array([[np.broadcast_to(np.array(value[i, j][0]), count) for j in range(4)] for i in range(4)]), -1, 0
    )


@pytest.mark.parametrize("component", [0, 1])
@pytest.mark.parametrize("transport", [RADIANCE, IMPORTANCE])
def test_polarization_is_that_of_smooth_glass(transport, component):
    """At the floor of the roughness the whole matrix of a sample is that of `dielectric`, from either side."""
    conftest.use("llvm_ad_mono_polarized")
    ctx = sc.context(mode(transport), component)
    views = [sc.direction(view, phi) for view in (10.0, 35.0, 56.31, 75.0, 150.0, 120.0) for phi in (0.0, 37.0, 200.0)]
    wi = mi.Vector3f(np.array(views).T.astype(np.float32))
    si = dr.zeros(mi.SurfaceInteraction3f, len(views))
    si.wi = wi
    found = []
    for plugin, extra in ((PLUGIN, dict(alpha=0.0, gamma=INF)), ("dielectric", {})):
        bs, weight = sc.load(plugin, **GLASS, **extra).sample(ctx, si, mi.Float(0.5), mi.Point2f(0.3, 0.6))
        found.append((matrices(weight, len(views)), bs.wo.numpy().T))
    (ours, our_wo), (theirs, their_wo) = found
    seen = theirs[:, 0, 0] > 0
    assert seen.sum() >= 15
    assert np.abs(our_wo - their_wo)[seen].max() < 1e-3
    # off the diagonal there is polarization to be compared, and the bases count
    assert np.abs(theirs[:, 0, 1:3]).max() > 0.02
    # the spline that normals are drawn from is not quite D: what a sample weighs beside its matrix
    weight = ours[seen, 0, 0] / theirs[seen, 0, 0]
    assert np.abs(weight - 1).max() < 5e-3
    assert not ours[~seen].any()
    assert np.abs(ours[seen] / weight[:, None, None] - theirs[seen]).max() < 5e-4


def test_polarization_through_a_tilted_facet():
    """Fresnel's matrix of the facet, between the bases of the two directions; swapped ones are off by 0.8, unless the facet is upright."""
    conftest.use("llvm_ad_mono_polarized")
    m = np.array(sc.direction(25.0, 60.0))
    wi = sc.uniform_directions(np.random.default_rng(21), 200)
    wi = wi[(wi @ m > 0.1) & (wi[:, 2] > 0.1)]
    wo, there = sc.refract(wi, np.tile(m, (len(wi), 1)), 1.5)
    keep = there & (wo[:, 2] < -0.1)
    si = dr.zeros(mi.SurfaceInteraction3f, np.count_nonzero(keep))
    si.wi, out = (mi.Vector3f(w[keep].T.astype(np.float32)) for w in (wi, wo))
    facet = mi.Normal3f(*m.tolist())
    fresnel = mi.mueller.specular_transmission(
        mi.UnpolarizedSpectrum(dr.dot(si.wi, facet)), mi.UnpolarizedSpectrum(1.5)
    )
    axes = (dr.normalize(dr.cross(facet, w)) for w in (-out, si.wi))
    bases = [mi.mueller.stokes_basis(w) for w in (-out, si.wi)]
    wanted = mi.mueller.rotate_mueller_basis(fresnel, -out, next(axes), bases[0], si.wi, next(axes), bases[1])
    found = load(gamma=1.7, alpha=0.5, **GLASS).eval(sc.context(mode(RADIANCE)), si, out)
    a, b = (matrices(M, np.count_nonzero(keep)) for M in (found, wanted))
    assert len(a) > 100 and (a[:, 0, 0] > 0).all()
    assert np.abs(a / a[:, :1, :1] - b / b[:, :1, :1]).max() < 1e-5


def test_polarized_light_and_importance():
    """Importance from wo to wi is the matrix of radiance from wi to wo: the same light path."""
    conftest.use("llvm_ad_mono_polarized")
    wi, wo = pairs(np.random.default_rng(13), 400, 0.35, 0.1, 1.5)
    keep = (np.abs(wi[:, 2]) > 0.05) & (np.abs(wo[:, 2]) > 0.05)
    wi, wo = wi[keep], wo[keep]
    bsdf = load(**ROWS["sgtd"], **ANISOTROPIC, **GLASS)

    def f(a, b, m):
        si = dr.zeros(mi.SurfaceInteraction3f, len(a))
        si.wi = mi.Vector3f(a.T.astype(np.float32))
        value = bsdf.eval(sc.context(mode(m)), si, mi.Vector3f(b.T.astype(np.float32)))
        return matrices(value, len(a)) / np.abs(b[:, 2, None, None])

    radiance, importance, reverse = f(wi, wo, RADIANCE), f(wo, wi, IMPORTANCE), f(wo, wi, RADIANCE)
    scale = np.abs(radiance).max(axis=(1, 2), keepdims=True) + 1e-5 * np.abs(radiance).max()
    assert np.quantile(np.abs(radiance - importance) / scale, 0.99) < 2e-4
    assert (np.abs(radiance - reverse) / scale).max() > 1e-2


# -- renders


def furnace(bsdf):
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 64, "rr_depth": 64},
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at(origin=[0, -4, 1], target=[0, 0, 0], up=[0, 0, 1]),
                "fov": 35,
                "film": {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}},
            },
            "light": {"type": "constant"},
            "ball": {"type": "sphere", "bsdf": bsdf},
        }
    )
    return mi.render(scene, spp=64).numpy()[..., :3]


def test_white_furnace(llvm):
    """Rough glass under a constant light is nowhere brighter than the light, close to it at a low roughness, and no darker than GGX should be."""
    rng = np.random.default_rng(14)
    zeros = rng.uniform(0.0, 0.3, (8, 8)) * (rng.random((8, 8)) > 0.5)
    means = {}
    for name, bsdf in {
        "theirs": {"type": "roughdielectric", "distribution": "ggx", "alpha": 0.2},
        "tables": {"type": PLUGIN, "gamma": 2.0, "alpha": 0.2},
        "own": {"type": PLUGIN, "distribution": "ggx", "alpha": 0.2},
        "smooth": {"type": PLUGIN, "gamma": 1.7, "alpha": 0.005},
        "equal": {"type": PLUGIN, "gamma": 1.7, "alpha": 0.005, "int_ior": 1.3, "ext_ior": 1.3},
        "rarer": {"type": PLUGIN, "gamma": 2.4, "alpha": 0.2, "int_ior": 1.0, "ext_ior": 1.5},
        "full": {"type": PLUGIN, **ROWS["sgtd"], "alpha": 0.2},
        "zeros": {"type": PLUGIN, "gamma": 1.8, "alpha": sc.texture(zeros)},
    }.items():
        image = furnace(bsdf)
        ball = image[10:22, 10:22]
        assert np.isfinite(image).all() and (image >= 0).all()
        assert ball.mean() < 1.003, name
        means[name] = ball.mean(), ball.std() / ball[..., 0].size ** 0.5
        print(f"{name}: {means[name][0]:.4f} +- {means[name][1]:.4f}")
    for name in ("tables", "own"):
        error = math.hypot(means[name][1], means["theirs"][1])
        assert abs(means[name][0] - means["theirs"][0]) < 4 * error + 1e-3, means
    assert means["smooth"][0] > 0.98 and means["equal"][0] > 0.98
    assert means["zeros"][0] > 0.7


def test_equal_indices_are_invisible(llvm):
    """A sphere of equal indices before a light is the light: its samples have no density that could be weighed against it."""
    image = furnace({"type": PLUGIN, "gamma": 1.8, "alpha": 1e-3, "int_ior": 1.3, "ext_ior": 1.3})
    assert image == pytest.approx(1.0, abs=0.01)


# -- as a plugin


def test_flags_and_components(variant):
    for roughness in (dict(alpha=0.2), dict(alpha_u=0.2, alpha_v=0.1)):
        for row in ("sgtd", "ggx_centered"):
            bsdf, theirs = load(**ROWS[row], **roughness), sc.load("roughdielectric", **roughness)

            def check():
                assert bsdf.component_count() == 2
                assert bsdf.flags() == theirs.flags()
                assert [bsdf.flags(i) for i in range(2)] == [theirs.flags(i) for i in range(2)]
                assert mi.has_flag(bsdf.flags(), mi.BSDFFlags.Anisotropic) == (len(roughness) == 2)

            check()
            params = mi.traverse(bsdf)
            for step in range(3):
                for key in params.keys():
                    if key.startswith(("alpha", "shift", "eta")):
                        params[key] = 1.15 + 0.1 * step
                params.update()
                check()


def test_parameters(variant):
    keys = set(mi.traverse(load(gamma=1.8, specular_transmittance=0.5)).keys())
    assert keys == {"alpha.value", "eta", "gamma", "p", "lambda", "shift", "specular_transmittance.value"}
    theirs = mi.traverse(sc.load("roughdielectric", specular_reflectance=0.5, specular_transmittance=0.5))
    ours = mi.traverse(load(distribution="ggx", specular_reflectance=0.5, specular_transmittance=0.5))
    for key in theirs.keys():
        assert ours.flags(key) == theirs.flags(key)
        assert np.array(ours[key]).ravel() == pytest.approx(np.array(theirs[key]).ravel())


@pytest.mark.parametrize(
    "key, given, new",
    [
        ("gamma", dict(gamma=1.8), 2.6),
        ("shift", dict(distribution="beckmann"), 0.7),
        ("mu", dict(mu=0.06), 0.22),
        ("alpha.value", dict(gamma=1.7), 0.45),
        ("specular_transmittance.value", dict(specular_transmittance=0.9), 0.5),
    ],
)
def test_update_equals_a_new_material(variant, key, given, new):
    rng = np.random.default_rng(15)
    wi, wo = pairs(rng, 100, 0.2, 0.2, 1.5)
    u = rng.random((len(wi), 3))
    bsdf = load(**{"alpha": 0.2, **given}, **GLASS)
    before = sc.evaluate(bsdf, wi, wo)[0]
    params = mi.traverse(bsdf)
    params[key] = new
    params.update()
    fresh = load(**{"alpha": 0.2, **given, key.split(".")[0]: new}, **GLASS)
    assert sc.relative_error(sc.evaluate(bsdf, wi, wo)[0], before, floor=1e-3).max() > 1e-3
    for found, wanted in zip(
        (*sc.evaluate(bsdf, wi, wo), *sc.sample(bsdf, wi, u)), (*sc.evaluate(fresh, wi, wo), *sc.sample(fresh, wi, u))
    ):
        assert np.allclose(found, wanted, rtol=1e-5, atol=1e-6, equal_nan=True)


def test_update_of_eta(variant):
    """Through 1 and to below it; and a bad one is refused."""
    rng = np.random.default_rng(16)
    bsdf = load(gamma=1.8, alpha=0.2, **GLASS)
    params = mi.traverse(bsdf)
    for eta in (1.0, 0.7, 2.0):
        params["eta"] = eta
        params.update()
        wi, wo = pairs(rng, 100, 0.2, 0.2, eta if eta != 1 else 1.5)
        fresh = load(gamma=1.8, alpha=0.2, int_ior=eta, ext_ior=1.0)
        for found, wanted in zip(sc.evaluate(bsdf, wi, wo), sc.evaluate(fresh, wi, wo)):
            assert np.allclose(found, wanted, rtol=1e-5)
            assert (found > 0).any() == (eta != 1.0)
    for bad in (-1.0, 0.0, math.nan):
        params["eta"] = bad
        with pytest.raises(Exception, match="eta"):
            params.update()
        assert np.allclose(sc.evaluate(bsdf, wi, wo)[0], sc.evaluate(fresh, wi, wo)[0], rtol=1e-5)


@pytest.mark.parametrize("row", ["sgtd", "beckmann_centered"])
def test_description_is_the_same_every_time(variant, row):
    first, second = (str(load(**ROWS[row], alpha=0.3, int_ior=1.5, specular_transmittance=0.5)) for _ in range(2))
    assert first == second and "0x" not in first
    assert "eta = " in first and "specular_transmittance" in first


BAD = {
    "int_ior 0": (dict(int_ior=0.0), ["int_ior", "0"]),
    "int_ior nan": (dict(int_ior=math.nan), ["int_ior", "nan"]),
    "ext_ior negative": (dict(ext_ior=-1.5), ["ext_ior", "-1.5"]),
    "ext_ior inf": (dict(ext_ior=math.inf), ["ext_ior", "inf"]),
    "unknown material": (dict(int_ior="unobtainium"), ["int_ior", "unobtainium", "bk7"]),
    "gamma": (dict(gamma=1.0), ["gamma", "1"]),
    "transmittance": (dict(specular_transmittance=math.nan), ["specular_transmittance", "nan"]),
    "alpha_u alone": (dict(alpha_u=0.1), ["alpha_v"]),
    "typo": (dict(int_iro=1.5), ["int_iro"]),
    "eta": (dict(eta=1.5), ["eta"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(variant, case):
    properties, words = BAD[case]
    with pytest.raises(Exception) as caught:
        load(**properties)
    for word in words:
        assert word in str(caught.value)


def test_whole_numbers_are_indices(variant):
    assert np.array(mi.traverse(load(int_ior=2, ext_ior=1))["eta"]).item() == 2.0


def test_frozen_eval(llvm):
    """A frozen function follows shapes, indices and roughness, and a switch to and from Mitsuba's own code."""

    def call(bsdf, si, wo):
        return bsdf.eval_pdf(mi.BSDFContext(), si, wo)

    rng = np.random.default_rng(17)
    wi, wo = pairs(rng, 300, 0.3, 0.3, 1.5)
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi, out = mi.Vector3f(wi.T.astype(np.float32)), mi.Vector3f(wo.T.astype(np.float32))
    for given, changes in (
        (dict(gamma=1.8), [{}, {"gamma": 2.5}, {"p": 2.0}, {"shift": 3.0}, {"eta": 1.4}, {"eta": 0.7}, {"p": 50.0}]),
        (dict(distribution="ggx"), [{}, {"shift": 0.5}, {"shift": 0.0, "eta": 1.3}, {"shift": 1.0}, {"eta": 1.6}]),
    ):
        frozen = dr.freeze(call)
        bsdf = load(**given, alpha=0.3, **GLASS)
        params = mi.traverse(bsdf)
        seen = []
        for change in changes:
            for key, value in change.items():
                params[key] = value
            params.update()
            found, expected = frozen(bsdf, si, out), call(bsdf, si, out)
            for a, b in zip(found, expected):
                assert np.allclose(a.numpy(), b.numpy(), rtol=1e-5)
            seen.append(found[0].numpy().sum())
        assert len(set(seen)) == len(seen)
        assert frozen.n_recordings <= 2


@pytest.mark.parametrize("shape", [dict(gamma=1.8), dict(distribution="ggx")], ids=str)
def test_frozen_sample_follows_equal_indices(llvm, shape):
    """Equal and great indices have code of their own: a frozen function must notice when eta becomes one, and when it ceases to be."""

    def call(bsdf, si, u):
        return bsdf.sample(mi.BSDFContext(), si, u.z, mi.Point2f(u.x, u.y))

    rng = np.random.default_rng(20)
    si = dr.zeros(mi.SurfaceInteraction3f, 200)
    si.wi = mi.Vector3f(sc.uniform_directions(rng, 200).T.astype(np.float32))
    u = mi.Point3f(rng.random((3, 200)).astype(np.float32))
    bsdf, frozen = load(**shape, alpha=0.3, **GLASS), dr.freeze(call)
    params = mi.traverse(bsdf)
    delta = int(mi.BSDFFlags.DeltaTransmission)
    for eta in (1.5, 1.4, 1.0, 1.3, 1.000001, 50.0, 0.7):
        params["eta"] = eta
        params.update()
        (found, weight), (expected, expected_weight) = frozen(bsdf, si, u), call(bsdf, si, u)
        assert (found.sampled_type.numpy() == delta).any() == (abs(eta - 1) < 1e-5), eta
        lit = expected_weight[0].numpy() > 0
        assert lit.sum() > 50
        for a, b in ((found.wo, expected.wo), (found.pdf, expected.pdf), (weight, expected_weight)):
            assert np.allclose(a.numpy()[..., lit], b.numpy()[..., lit], rtol=1e-5, atol=1e-6), eta
    # one for ordinary indices, one for the others
    assert frozen.n_recordings == 2


@pytest.mark.parametrize("name", ["llvm_ad_spectral", "scalar_spectral", "llvm_ad_mono"])
def test_other_variants(name):
    """Spectral and single-channel variants see the same glass."""
    conftest.use(name)
    wi, wo = pairs(np.random.default_rng(18), 100, 0.3, 0.3, 1.5)
    value, _ = sc.evaluate(load(gamma=1.8, alpha=0.3, **GLASS), wi, wo)
    conftest.use("scalar_rgb")
    expected, _ = sc.evaluate(load(gamma=1.8, alpha=0.3, **GLASS), wi, wo)
    assert sc.relative_error(value[:, 0], expected[:, 0], floor=1e-4 * expected.max()).max() < 1e-3
