"""Does the material with `multiple_scattering` return what single scattering loses, and cost nothing without it?"""

import functools

import conftest
import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc
from family import ROWS

# Eta 0 and k 1, the default, reflect everything.
MASKINGS = ["separable", "height_correlated"]
ALPHAS = [0.05, 0.3, 1.0, 2.0]
PAIRS = [(0.6, 0.1), (0.05, 2.0), (0.3, 0.3)]
ANGLES = [0.0, 40.0, 70.0, 85.0]
AZIMUTH = 25.0
GOLD = dict(material="Au", gamma=1.8, shift=0.2)


def material(multiple=True, **properties):
    return sc.load(multiple_scattering=multiple, **properties)


@functools.cache
def sequence(count):
    """Three numbers per sample that are spread evenly (Roberts' sequence)."""
    index = np.arange(count, dtype=np.float64)
    steps = (0.8191725133961645, 0.6710436067037893, 0.5497004779019703)
    return np.stack([np.minimum((index * step + 0.5) % 1.0, 1.0 - 2.0**-24) for step in steps], axis=-1)


def interaction(wi, count, uv=(0.5, 0.5)):
    si = dr.zeros(mi.SurfaceInteraction3f, count) if count else dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(*(float(c) for c in wi))
    si.uv = mi.Point2f(*uv)
    dr.make_opaque(si.wi, si.uv)  # one kernel for all views
    if "spectral" in mi.variant():
        si.wavelengths = type(si.wavelengths)([450.0, 520.0, 580.0, 650.0])
    return si


def draw(bsdf, wi, u, uv=(0.5, 0.5)):
    """Directions, densities and weights of samples, with all three random numbers."""
    ctx = mi.BSDFContext()
    if sc.is_scalar():
        si, results = interaction(wi, None, uv), []
        for one, two, three in u.tolist():
            bs, weight = bsdf.sample(ctx, si, one, (two, three))
            results.append([*bs.wo, bs.pdf, *sc.channel(weight)])
        results = np.array(results)
        return results[:, :3], results[:, 3], results[:, 4:]
    one, two, three = (mi.Float(np.ascontiguousarray(c, dtype=np.float32)) for c in u.T)
    bs, weight = bsdf.sample(ctx, interaction(wi, len(u), uv), one, mi.Point2f(two, three))
    return bs.wo.numpy().T, bs.pdf.numpy(), np.stack([c.numpy() for c in sc.channel(weight)], axis=-1)


@functools.cache
def columns(count):
    """The same as the material takes them."""
    return [np.ascontiguousarray(c, dtype=np.float32) for c in sequence(count).T]


def albedo(bsdf, wi, count, uv=(0.5, 0.5)):
    if sc.is_scalar():
        return draw(bsdf, wi, sequence(count), uv)[2].astype(np.float64).mean(axis=0)
    one, two, three = (mi.Float(c) for c in columns(count))
    _, weight = bsdf.sample(mi.BSDFContext(), interaction(wi, count, uv), one, mi.Point2f(two, three))
    return np.array([dr.mean(mi.Float64(c))[0] for c in sc.channel(weight)])


def every_other(shape, number):
    """Both maskings with every shape and with every roughness; of the pairs of the two, every other one."""
    return MASKINGS[(shape + number) % 2]


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS)
def test_white_furnace(llvm, row):
    """1 for every roughness, isotropic or not, from normal to grazing. Fewer samples are noisier: 3e-3 for half as many."""
    surfaces = [dict(alpha=a) for a in ALPHAS] + [dict(alpha_u=u, alpha_v=v) for u, v in PAIRS]
    for number, roughness in enumerate(surfaces):
        masking = every_other(list(ROWS).index(row), number)
        bsdf = material(**ROWS[row], **roughness, masking=masking)
        for angle in ANGLES:
            whole = albedo(bsdf, sc.direction(angle, AZIMUTH), 1 << 19)
            conftest.measured("white furnace", np.abs(whole[:1] - 1), lambda _: (row, masking, roughness, angle))
            assert whole == pytest.approx(1.0, abs=1e-3), (roughness, angle)


HARD = [dict(shift=5.0), dict(gamma=np.inf, p=50.0), dict(gamma=1.52), dict(gamma=np.inf, shift=10.0)]


@pytest.mark.slow
@pytest.mark.parametrize("shape", HARD, ids=str)
def test_white_furnace_of_hard_shapes(llvm, shape):
    """Rings, boxes and the heaviest tails: grids of all sizes are read as they are made; noise is 2e-4."""
    for number, alpha in enumerate(ALPHAS):
        bsdf = material(**shape, alpha=alpha, masking=every_other(HARD.index(shape), number))
        for angle in ANGLES:
            assert albedo(bsdf, sc.direction(angle, AZIMUTH), 1 << 20) == pytest.approx(1.0, abs=1.2e-3), (alpha, angle)


def test_equal_materials_share_the_table(llvm):
    """The second takes no work; another masking is another table. Work is CPU time, which other processes do not stretch."""
    import time

    def seconds(**properties):
        start = time.process_time()
        return material(**dict(gamma=1.83, shift=5.5, alpha=0.3) | properties), time.process_time() - start

    first, build = seconds()
    second, again = seconds(alpha=0.4)
    other, anew = seconds(masking="height_correlated")
    assert again < 0.2 * build and anew > 2.0 * again


def test_a_rough_table_warns(llvm, warnings):
    """A thin ring with two very different roughnesses is more than the grid holds."""
    material(gamma=1.9, alpha_u=0.3, alpha_v=0.1)
    assert "multiple_scattering" not in "".join(warnings)
    material(gamma=np.inf, **{"lambda": -0.9}, shift=10.0, alpha_u=0.05, alpha_v=2.0)
    assert "A lower shift" in "".join(warnings)


@pytest.mark.slow
@pytest.mark.parametrize("row", ["sgtd", "student", "ggx_centered", "beckmann_centered"])
def test_white_furnace_rendered(variant, row):
    """A plate under a sky of radiance 1, seen at 50 degrees, by the path tracer, which samples the sky as well; noise is 4e-4."""
    for roughness in (dict(alpha=0.4), dict(alpha_u=0.9, alpha_v=0.2)):
        origin = [float(10.0 * c) for c in sc.direction(50.0, AZIMUTH)]
        scene = mi.load_dict(
            {
                "type": "scene",
                "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}},
                "plate": {"type": "rectangle", "bsdf": material(**ROWS[row], **roughness)},
                "camera": {
                    "type": "perspective",
                    "fov": 0.5,
                    "to_world": mi.ScalarTransform4f().look_at(origin=origin, target=[0, 0, 0], up=[0, 0, 1]),
                    "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}},
                },
            }
        )
        image = mi.render(scene, spp=4096, integrator=mi.load_dict({"type": "path", "max_depth": 2}))
        assert np.array(image).astype(np.float64).mean() == pytest.approx(1.0, abs=1.5e-3)


def test_a_furnace_without_the_lobe_is_dark(llvm):
    """What the furnace measures is there to be lost: at alpha = 1, gamma = 1.6, along the normal, 0.164 remain."""
    for gamma, kept in ((40.0, 0.457), (2.0, 0.307), (1.6, 0.164)):
        bsdf = material(multiple=False, gamma=gamma, alpha=1.0)
        assert albedo(bsdf, (0, 0, 1), 1 << 19) == pytest.approx(kept, abs=6e-4)


@pytest.mark.slow
@pytest.mark.parametrize("row", ["sgtd", "student", "ggx_centered"])
def test_furnace_of_a_textured_roughness(llvm, row):
    """Every texel by itself."""
    bsdf = material(**ROWS[row], alpha=np.array([[0.05, 0.2], [0.7, 1.9]]))
    for uv in ((0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)):
        for angle in ANGLES:
            assert albedo(bsdf, sc.direction(angle, AZIMUTH), 1 << 19, uv) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
def test_two_textures_are_approximate(llvm):
    """As documented: the isotropic surface of the mean stands in."""
    bsdf = material(gamma=2.0, alpha_u=np.array([[0.3, 0.5]]), alpha_v=np.array([[0.2, 0.5]]))
    for angle in ANGLES:
        wi = sc.direction(angle, AZIMUTH)
        assert albedo(bsdf, wi, 1 << 18, (0.25, 0.5)) == pytest.approx(1.0, abs=0.02)
        assert albedo(bsdf, wi, 1 << 19, (0.75, 0.5)) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("roughness", [dict(alpha=1.0), dict(alpha_u=1.2, alpha_v=0.6)], ids=str)
def test_furnace_of_values(llvm, roughness):
    """The integral of eval by midpoints, which knows nothing of sample and pdf."""
    bsdf = material(gamma=1.8, shift=0.2, **roughness)
    rows, columns = 1024, 1024
    index = dr.arange(mi.UInt32, rows * columns)
    # the square of the distance from the pole; finer towards the horizon
    t = (mi.Float(index // columns) + 0.5) / rows
    cosine = dr.square(t)
    sine, cos_phi = dr.sincos((mi.Float(index % columns) + 0.5) * (2.0 * dr.pi / columns))
    radius = dr.safe_sqrt(1.0 - dr.square(cosine))
    wo = mi.Vector3f(radius * cos_phi, radius * sine, cosine)
    for angle in ANGLES[:3]:
        value = bsdf.eval(mi.BSDFContext(), interaction(sc.direction(angle, AZIMUTH), len(index)), wo)
        whole = dr.sum(mi.Float64(value.x * 2.0 * t))[0] * 2.0 * np.pi / (rows * columns)
        assert whole == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("properties", [dict(GOLD, alpha=0.8), dict(GOLD, alpha_u=0.9, alpha_v=0.2)], ids=str)
def test_laws(variant, properties):
    """Reciprocity; eval_pdf is (eval, pdf); a sample's weight is value over density."""
    bsdf = material(**properties)
    rng = np.random.default_rng(11)
    wi, wo = sc.uniform_directions(rng, 400), sc.uniform_directions(rng, 400)
    there, pdf = sc.evaluate(bsdf, wi, wo)
    back, _ = sc.evaluate(bsdf, wo, wi)
    assert (there > 0).all() and (pdf > 0).all()
    assert sc.relative_error(there * wi[:, 2:], back * wo[:, 2:]).max() < 2e-4
    value, density = sc.evaluate_apart(bsdf, wi, wo)
    assert np.array_equal(there, value) and np.array_equal(pdf, density)
    wi = sc.direction(60.0, 15.0)
    drawn, pdf, weight = draw(bsdf, wi, rng.random((400, 3)))
    valid = pdf > 0
    assert valid.mean() > 0.5 and (weight[~valid] == 0).all()
    value, density = sc.evaluate(bsdf, wi, drawn[valid])
    assert sc.relative_error(density, pdf[valid]).max() < 1e-3
    assert sc.relative_error(value, weight[valid] * pdf[valid, None]).max() < 1e-3


@pytest.mark.parametrize("visible", [True, False])
@pytest.mark.parametrize("row", ["sgtd", "student", "ggx_centered", "beckmann_centered"])
def test_samples_follow_the_density(llvm, row, visible):
    """Mitsuba's own test, with both lobes."""
    bsdf = material(**ROWS[row], alpha_u=0.8, alpha_v=0.4, sample_visible=visible)
    ctx = mi.BSDFContext()
    for angle in (10.0, 60.0, 80.0):
        wi = sc.direction(angle, AZIMUTH)

        def sample(u):
            bs, weight = bsdf.sample(ctx, interaction(wi, dr.width(u)), u[0], mi.Vector2f(u[1], u[2]))
            valid = dr.any(weight != 0.0)
            return dr.select(valid, bs.wo, mi.Vector3f(0, 0, 1)), dr.select(valid, mi.Float(1.0), 0.0)

        test = mi.chi2.ChiSquareTest(
            domain=mi.chi2.SphericalDomain(),
            sample_func=sample,
            pdf_func=lambda wo: bsdf.pdf(ctx, interaction(wi, dr.width(wo)), wo),
            sample_dim=3,
            sample_count=250_000,
            res=60,
            ires=24,
            seed=1,
        )
        assert test.run(0.01, test_count=24, quiet=True), f"at {angle} degrees:\n{test.messages}"


def traced(bsdf):
    """Operations in the kernels of one evaluation and one sample."""
    si = interaction(sc.direction(40.0), 1024)
    u = mi.Float(np.linspace(0.01, 0.99, 1024, dtype=np.float32))
    wo = dr.normalize(mi.Vector3f(u, 0.3, 1.0))
    dr.eval(si, u, wo)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        dr.eval(bsdf.eval_pdf(mi.BSDFContext(), si, wo))
        dr.eval(bsdf.sample(mi.BSDFContext(), si, u, mi.Point2f(u, u)))
        kernels = [entry for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT]
    return [entry["operation_count"] for entry in kernels]


@pytest.mark.parametrize("row", ["sgtd", "ggx_centered"])
def test_what_is_not_used_costs_nothing(llvm, row):
    """Off and absent are the same kernels; on is more, which shows that it is counted."""
    absent, off = sc.load(**ROWS[row], alpha=0.3), material(multiple=False, **ROWS[row], alpha=0.3)
    on = material(**ROWS[row], alpha=0.3)
    assert traced(absent) == traced(off)
    assert sum(traced(on)) > 1.1 * sum(traced(off))
    assert mi.traverse(off).keys() == mi.traverse(on).keys()


def test_gold_becomes_more_saturated(variant):
    """Repeated reflection darkens what a metal absorbs: red over blue rises with the roughness, and never without the lobe by as much."""
    count = 1 << 16 if not sc.is_scalar() else 3000
    ratios = {}
    for multiple in (True, False):
        for alpha in (0.1, 0.5, 1.5):
            red, green, blue = albedo(material(multiple, **GOLD, alpha=alpha), sc.direction(30.0), count)
            assert 0 < blue < green < red < 1
            ratios[multiple, alpha] = red / blue
    assert ratios[True, 0.1] * 1.05 < ratios[True, 0.5] < ratios[True, 1.5] / 1.05
    assert ratios[True, 1.5] > 1.1 * ratios[False, 1.5]


@pytest.mark.parametrize("variant", ["scalar_spectral_polarized", "llvm_ad_mono_polarized"])
def test_polarized_light_carries_the_same_energy(variant):
    """The first element of the Mueller matrix is the unpolarized value, and the lobe adds to no other one."""
    wi, wo = sc.direction(50.0, 20.0), sc.direction(35.0, 130.0)
    matrices = {}
    for name in (variant, variant.replace("_polarized", "") if "scalar" not in variant else "scalar_spectral"):
        conftest.use(name)
        for multiple in (True, False):
            bsdf = material(multiple, gamma=1.8, eta=0.4, k=2.5, alpha=1.2)
            count = None if sc.is_scalar() else 1
            value = bsdf.eval(mi.BSDFContext(), interaction(wi, count), mi.Vector3f(*(float(c) for c in wo)))
            matrices[name, multiple] = np.array(value).reshape(-1)
    polarized, plain = (next(n for n in matrices if ("polarized" in n[0]) == p)[0] for p in (True, False))
    channels = len(matrices[plain, True])
    added = (matrices[polarized, True] - matrices[polarized, False]).reshape(4, 4, -1)
    assert added[0, 0] == pytest.approx((matrices[plain, True] - matrices[plain, False])[: added.shape[2]], rel=1e-4)
    assert channels == added.shape[2] and (added[0, 0] > 1e-3).all()
    added[0, 0] = 0
    assert np.abs(added).max() < 1e-6


@pytest.mark.parametrize("roughness", [dict(alpha=0.5), dict(alpha_u=0.7, alpha_v=0.3)], ids=str)
def test_derivative_by_the_roughness(llvm, roughness):
    """Of the value of gold, against differences; what is returned depends on the roughness as well."""
    key = next(iter(roughness)) + ".value"
    si, step = interaction(sc.direction(50.0, AZIMUTH), 256), 4e-3
    wo = dr.normalize(mi.Vector3f(dr.linspace(mi.Float, -1.5, 1.5, 256), 0.4, 1.0))

    def value(alpha):
        bsdf = material(**GOLD, **roughness)
        params = mi.traverse(bsdf)
        params[key] = mi.Float(alpha)
        params.update()
        return bsdf.eval(mi.BSDFContext(), si, wo)

    alpha = mi.Float(next(iter(roughness.values())))
    dr.enable_grad(alpha)
    bsdf = material(**GOLD, **roughness)
    params = mi.traverse(bsdf)
    params[key] = alpha
    params.update()
    result = bsdf.eval(mi.BSDFContext(), si, wo)
    dr.set_grad(alpha, 1.0)
    dr.enqueue(dr.ADMode.Forward, alpha)
    dr.traverse(dr.ADMode.Forward)
    slope = dr.grad(result).numpy()
    center = next(iter(roughness.values()))
    expected = (value(center * (1 + step)).numpy() - value(center * (1 - step)).numpy()) / (2 * step * center)
    assert np.isfinite(slope).all()
    assert np.abs(slope - expected).max() < 0.03 * np.abs(expected).max()
    assert np.abs(expected).max() > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("change", [dict(gamma=2.6), {"alpha_u.value": 0.9}], ids=str)
def test_changes_reach_the_table(llvm, change):
    """The furnace stays white when a parameter is changed."""
    bsdf = material(gamma=1.8, alpha_u=0.4, alpha_v=0.2)
    params = mi.traverse(bsdf)
    for key, value in change.items():
        params[key] = value
    params.update()
    for angle in ANGLES[:3]:
        assert albedo(bsdf, sc.direction(angle, AZIMUTH), 1 << 22) == pytest.approx(1.0, abs=1e-3)


def test_reflectance_scales_both_lobes(llvm):
    bsdf = material(gamma=1.8, alpha=1.0, specular_reflectance=0.25)
    assert albedo(bsdf, sc.direction(40.0), 1 << 18) == pytest.approx(0.25, abs=3e-4)


def test_extreme_roughness_is_finite(variant):
    for roughness in (dict(alpha=1e-6), dict(alpha=1e-3), dict(alpha=50.0), dict(alpha_u=1e-4, alpha_v=5.0)):
        bsdf = material(**GOLD, **roughness)
        for angle in (0.0, 45.0, 89.9, 89.99999):
            wo, pdf, weight = draw(bsdf, sc.direction(angle, 1.0), sequence(200))
            assert np.isfinite(pdf).all() and np.isfinite(weight).all() and (weight >= 0).all() and (pdf >= 0).all()
