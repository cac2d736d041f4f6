"""Physics and calculus: reciprocity, energy, polarization, derivatives, frozen functions, and no bias in a render."""

import conftest
import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc
from family import ANISOTROPIC, ISOTROPIC, KINDS, ROWS

MASKING = ["separable", "height_correlated"]


def pairs(rng, count, alpha=0.3):
    wi = sc.uniform_directions(rng, count)
    return wi, sc.reflect(wi, sc.normals(rng, count, alpha, alpha, reach=0.7))


# -- reciprocity and energy


@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("kind", KINDS)
def test_reciprocity(variant, kind, masking):
    """f(wi, wo) = f(wo, wi): what eval returns, without its cosine."""
    wi, wo = pairs(np.random.default_rng(8), 1000)
    up = wo[:, 2] > 0.01
    wi, wo = wi[up], wo[up]
    bsdf = sc.load(**KINDS[kind], **ANISOTROPIC, masking=masking, material="Cu")
    there, back = sc.evaluate(bsdf, wi, wo)[0] / wo[:, 2:], sc.evaluate(bsdf, wo, wi)[0] / wi[:, 2:]
    assert np.count_nonzero(there) > 500
    assert sc.relative_error(there, back, floor=1e-6 * there.max()).max() < 1e-5


@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("row", ROWS)
def test_furnace(llvm, row, visible, masking):
    """A perfect mirror reflects no more than it receives, and at normal incidence on a smooth surface nearly all."""
    rng = np.random.default_rng(9)
    count = 1 << 16
    u = rng.random((count, 2))
    for roughness in (ISOTROPIC, ANISOTROPIC, dict(alpha=1.0)):
        bsdf = sc.load(**ROWS[row], **roughness, sample_visible=visible, masking=masking)
        for theta in (0.0, 30.0, 60.0, 80.0, 89.0, 89.9):
            _, _, weight = sc.sample(bsdf, sc.direction(theta, 25.0), u)
            mean, error = weight[:, 0].mean(), weight[:, 0].std() / count**0.5
            assert 0.0 < mean <= 1.0 + 4.0 * error + 1e-5, (roughness, theta, mean, error)
            if visible:
                assert weight.max() < 1.15  # G1(wo), up to the error of the table that is sampled
    smooth = sc.load(**ROWS[row], alpha=0.01, sample_visible=visible, masking=masking)
    assert sc.sample(smooth, sc.direction(0.0), u)[2].mean() > 0.95


@pytest.mark.parametrize("masking", MASKING)
def test_albedo_grows_with_correlation(llvm, masking):
    """Correlated masking loses less light: the two settings differ, and in this direction."""
    u = np.random.default_rng(10).random((1 << 16, 2))
    albedo = {
        m: sc.sample(sc.load(gamma=1.8, shift=0.3, alpha=0.6, masking=m), sc.direction(60.0), u)[2].mean()
        for m in MASKING
    }
    assert albedo["height_correlated"] > albedo["separable"] + 0.01


# -- polarization and transport


@pytest.mark.parametrize(
    "polarized, plain", [("llvm_ad_mono_polarized", "llvm_ad_mono"), ("scalar_spectral_polarized", "scalar_spectral")]
)
@pytest.mark.parametrize("row", ["sgtd", "ggx", "ggx_centered"])
def test_intensity_of_mueller_matrix(polarized, plain, row):
    """The first element of the Mueller matrix is what the unpolarized variant returns."""
    rng = np.random.default_rng(11)
    wi, wo = pairs(rng, 300)
    u = rng.random((300, 2))
    answers = []
    for variant in (polarized, plain):
        conftest.use(variant)
        bsdf = sc.load(**ROWS[row], **ANISOTROPIC, eta=0.3, k=3.0)
        answers.append((*sc.evaluate(bsdf, wi, wo), *sc.sample(bsdf, wi, u)))
    assert np.count_nonzero(answers[1][0]) > 300 // 2
    for found, expected in zip(*answers):
        finite = np.isfinite(expected)
        assert sc.relative_error(found[finite], expected[finite], floor=1e-6).max() < 2e-5


def matrix(bsdf, mode, wi, wo):
    """The 4x4 matrices of eval, without its cosine, as (N, 4, 4)."""
    ctx = mi.BSDFContext()
    ctx.mode = mode
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    value = bsdf.eval(ctx, si, mi.Vector3f(wo.T.astype(np.float32)))
    rows = [[np.broadcast_to(np.array(value[i, j][0]), len(wi)) for j in range(4)] for i in range(4)]
    return np.moveaxis(np.array(rows), -1, 0) / wo[:, 2, None, None]


@pytest.mark.parametrize("row", ["sgtd", "ggx_centered"])
def test_light_and_importance(row):
    """Importance from wo to wi is radiance from wi to wo: the same matrix for the same light path."""
    conftest.use("llvm_ad_mono_polarized")
    wi, wo = pairs(np.random.default_rng(12), 500)
    up = wo[:, 2] > 0.05
    wi, wo = wi[up], wo[up]
    bsdf = sc.load(**ROWS[row], **ANISOTROPIC, eta=0.3, k=3.0)
    radiance = matrix(bsdf, mi.TransportMode.Radiance, wi, wo)
    importance = matrix(bsdf, mi.TransportMode.Importance, wo, wi)
    reverse = matrix(bsdf, mi.TransportMode.Radiance, wo, wi)
    assert np.isfinite(radiance).all()
    scale = np.abs(radiance).max(axis=(1, 2), keepdims=True) + 1e-20
    assert (np.abs(radiance - importance) / scale).max() < 1e-4
    # the matrix of the reversed path is another one, so the mode is obeyed
    assert (np.abs(radiance - reverse) / scale).max() > 1e-2


# -- derivatives


def differentiated(bsdf, key, wi, wo, step):
    """Sum over directions of eval, its derivative by AD, and by central differences."""
    params = mi.traverse(bsdf)
    start = float(np.array(params[key]).ravel()[0])
    ctx = mi.BSDFContext()
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    out = mi.Vector3f(wo.T.astype(np.float32))

    def at(value):
        params[key] = value
        params.update()
        return bsdf.eval(ctx, si, out)[0]

    x = mi.Float(start)
    dr.enable_grad(x)
    y = at(x)
    dr.forward(x)
    by_ad = dr.grad(y).numpy().astype(np.float64)
    finite = (at(mi.Float(start + step)).numpy().astype(np.float64) - at(mi.Float(start - step)).numpy()) / (2 * step)
    return by_ad, finite


@pytest.mark.parametrize("key", ["alpha.value", "eta.value", "k.value"])
@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("kind", KINDS)
def test_derivative_of_eval(llvm, kind, key, masking):
    wi, wo = pairs(np.random.default_rng(13), 400)
    bsdf = sc.load(**KINDS[kind], alpha=0.3, eta=0.4, k=2.5, masking=masking)
    # a box falls from 1 to 0 within a hundredth of its roughness
    by_ad, finite = differentiated(bsdf, key, wi, wo, 3e-5 if kind == "box" and key == "alpha.value" else 3e-4)
    assert np.isfinite(by_ad).all()
    scale = np.abs(finite).max()
    assert scale > 1e-3
    # 400 directions, and the few that a difference crosses a kink for are left out by the quantile
    error = np.abs(by_ad - finite) / scale
    print(f"{kind} {key}: {np.quantile(error, 0.98):.1e}, largest {error.max():.1e}")
    assert np.quantile(error, 0.98) < 5e-3
    assert by_ad.sum() == pytest.approx(finite.sum(), rel=2e-2, abs=1e-3 * scale)


def small_scene(plugin_properties, integrator):
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": integrator,
            "sensor": {
                "type": "perspective",
                "fov": 40,
                "to_world": mi.ScalarTransform4f().look_at(origin=[0, -4, 2], target=[0, 0, 0], up=[0, 0, 1]),
                "film": {
                    "type": "hdrfilm",
                    "width": 24,
                    "height": 24,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
                "sampler": {"type": "independent"},
            },
            "ground": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(2),
                "bsdf": {"id": "metal", **plugin_properties},
            },
            "light": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f()
                .look_at(origin=[0, 2.5, 2], target=[0, 0, 0], up=[0, 0, 1])
                .scale(0.7),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [3, 3, 3]}},
            },
        }
    )


@pytest.mark.parametrize("integrator", ["path", "prb"])
def test_derivative_of_render(llvm, integrator):
    """d(mean)/d(alpha) of an image, by AD against differences of images with the same random numbers."""
    scene = small_scene(
        {"type": "sgtdconductor", "gamma": 1.8, "shift": 0.4, "alpha": 0.3}, {"type": integrator, "max_depth": 2}
    )
    params = mi.traverse(scene)
    key = next(k for k in params.keys() if k.endswith("alpha.value"))
    spp, seeds = 256, range(4)

    def mean(alpha, seed):
        params[key] = alpha
        params.update()
        return dr.mean(mi.render(scene, params, spp=spp, seed=seed, seed_grad=seed + 100), axis=None)

    by_ad, finite = [], []
    for seed in seeds:
        alpha = mi.Float(0.3)
        dr.enable_grad(alpha)
        dr.backward(mean(alpha, seed))
        by_ad.append(float(dr.grad(alpha)[0]))
        step = 0.02
        finite.append(
            (float(mean(mi.Float(0.3 + step), seed).array[0]) - float(mean(mi.Float(0.3 - step), seed).array[0]))
            / (2 * step)
        )
    by_ad, finite = np.array(by_ad), np.array(finite)
    error = (by_ad.std() + finite.std()) / len(seeds) ** 0.5
    print(f"AD {by_ad.mean():.4f} +- {by_ad.std():.4f}, differences {finite.mean():.4f} +- {finite.std():.4f}")
    assert abs(finite.mean()) > 10 * error
    assert abs(by_ad.mean() - finite.mean()) < 4 * error + 0.02 * abs(finite.mean())


def test_derivative_with_respect_to_a_texture(llvm):
    """A texture of roughness with an exact zero has finite derivatives everywhere."""
    rng = np.random.default_rng(14)
    alpha = np.array([[0.0, 0.2], [0.4, 1e-6]])
    bsdf = sc.load(gamma=1.7, shift=0.3, alpha=alpha)
    params = mi.traverse(bsdf)
    key = next(k for k in params.keys() if k.startswith("alpha"))
    dr.enable_grad(params[key])
    params.update()
    count = 4000
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    wi, wo = pairs(rng, count)
    si.wi, si.uv = mi.Vector3f(wi.T.astype(np.float32)), mi.Point2f(rng.random((2, count)).astype(np.float32))
    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(wo.T.astype(np.float32)))
    bs, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(0.5), mi.Point2f(rng.random((2, count)).astype(np.float32)))
    dr.backward(dr.sum(value[0]) + dr.sum(pdf) + dr.sum(weight[0]))
    gradient = dr.grad(params[key]).numpy()
    assert np.isfinite(gradient).all()
    assert np.count_nonzero(gradient) >= 2


# -- frozen functions


def test_frozen_eval(llvm):
    """A frozen function never replays a stale recording, and has one for each way of evaluation alone: tables, tables in
    double precision, and GGX."""

    def call(bsdf, si, wo):
        return bsdf.eval_pdf(mi.BSDFContext(), si, wo)

    frozen = dr.freeze(call)
    wi, wo = pairs(np.random.default_rng(15), 500)
    si = dr.zeros(mi.SurfaceInteraction3f, 500)
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    out = mi.Vector3f(wo.T.astype(np.float32))
    bsdf = sc.load(gamma=1.8, p=1.2, alpha=0.3)
    params = mi.traverse(bsdf)
    seen = []
    for changes in (
        {},
        {"gamma": 2.5},
        {"p": 2.0},
        {"lambda": 0.4},
        {"shift": 3.0},
        {"gamma": float("inf")},
        {"gamma": 2.0, "p": 1.0, "lambda": 0.0, "shift": 0.0},
        {"alpha.value": 0.1},
        {"p": 50.0},
        {"p": 1.0, "shift": 500.0},
        {"shift": 0.2},
    ):
        for key, value in changes.items():
            params[key] = value
        params.update()
        value, pdf = frozen(bsdf, si, out)
        expected, expected_pdf = call(bsdf, si, out)
        assert np.allclose(value.numpy(), expected.numpy(), rtol=1e-6) and np.allclose(
            pdf.numpy(), expected_pdf.numpy(), rtol=1e-6
        )
        seen.append(value.numpy().sum())
    assert len(set(seen)) == len(seen)
    assert frozen.n_recordings <= 3


@pytest.mark.parametrize("row", ["ggx", "beckmann"])
def test_frozen_eval_across_a_structural_switch(llvm, row):
    """A shift moves these rows from Mitsuba's own code to the tables: a stale recording would keep the other one."""

    def call(bsdf, si, wo):
        return bsdf.eval_pdf(mi.BSDFContext(), si, wo)

    frozen = dr.freeze(call)
    wi, wo = pairs(np.random.default_rng(15), 500)
    si = dr.zeros(mi.SurfaceInteraction3f, 500)
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    out = mi.Vector3f(wo.T.astype(np.float32))
    bsdf = sc.load(distribution=row, alpha=0.3)
    params = mi.traverse(bsdf)
    values = {}
    for shift in (0.0, 0.5, 0.0, 1.0, 0.0):
        params["shift"] = shift
        params.update()
        value, pdf = (x.numpy() for x in frozen(bsdf, si, out))
        expected, expected_pdf = (x.numpy() for x in call(bsdf, si, out))
        assert np.allclose(value, expected, rtol=1e-6) and np.allclose(pdf, expected_pdf, rtol=1e-6)
        assert np.array_equal(values.setdefault(shift, value), value)
    assert not np.allclose(values[0.0], values[0.5], rtol=1e-2)
    assert frozen.n_recordings <= 2


def test_frozen_calls_across_nodes(llvm):
    """Numbers alone decide which code runs: a parameter that passes through GGX takes it there and away again, and a skew
    without a shift is a roughness. No call is one of the node before."""

    def call(bsdf, si, wo, u):
        drawn, weight = bsdf.sample(mi.BSDFContext(), si, u.x, u)
        return *bsdf.eval_pdf(mi.BSDFContext(), si, wo), drawn.wo, drawn.pdf, weight

    frozen = dr.freeze(call)
    rng = np.random.default_rng(16)
    wi, wo = pairs(rng, 500)
    si = dr.zeros(mi.SurfaceInteraction3f, 500)
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    out, u = mi.Vector3f(wo.T.astype(np.float32)), mi.Point2f(rng.random((2, 500)).astype(np.float32))
    bsdf = sc.load(alpha=0.3)
    params = mi.traverse(bsdf)
    shape, seen = {}, []
    for changes in (
        {"gamma": 1.9},
        {"gamma": 2.0},
        {"gamma": 2.0 + 1e-6},
        {"gamma": 2.0, "lambda": 0.4},
        {"lambda": 0.0},
        {"gamma": float("inf")},
        {"gamma": 2.0, "p": 1.2},
        {"p": 1.0, "shift": 0.3},
        {"shift": 0.0, "lambda": -0.3},
        {"lambda": 0.0},
    ):
        shape.update(changes)
        for key, value in changes.items():
            params[key] = value
        params.update()
        assert str(bsdf) == str(sc.load(alpha=0.3, **shape))
        found = [x.numpy() for x in frozen(bsdf, si, out, u)]
        for a, b in zip(found, call(sc.load(alpha=0.3, **shape), si, out, u)):
            assert np.allclose(a, b.numpy(), rtol=1e-5, atol=1e-6, equal_nan=True)
        assert bsdf.component_count() == 1 and bsdf.flags() == bsdf.flags(0) == sc.load("roughconductor").flags()
        seen.append(float(found[0].sum()))
    # GGX three times, its neighbor nearly that, and nothing else twice
    assert seen[1] == seen[4] == seen[9] == pytest.approx(seen[2], rel=1e-4)
    others = [seen[k] for k in (0, 1, 3, 5, 6, 7, 8)]
    assert min(abs(a / b - 1) for i, a in enumerate(others) for b in others[:i]) > 1e-3
    # GGX, GGX at another roughness, tables
    assert frozen.n_recordings <= 3


def test_frozen_render(llvm):
    scene = small_scene({"type": "sgtdconductor", "gamma": 1.8, "alpha": 0.3}, {"type": "path", "max_depth": 3})
    params = mi.traverse(scene)
    prefix = next(k for k in params.keys() if k.endswith(".gamma")).removesuffix("gamma")

    def call(scene):
        return mi.render(scene, spp=4)

    frozen = dr.freeze(call)
    means = []
    for gamma in (1.8, 2.5, 1.6, 4.0):
        params[prefix + "gamma"] = gamma
        params.update()
        image = frozen(scene)
        expected = call(scene)
        assert np.allclose(image.numpy(), expected.numpy(), rtol=1e-4, atol=1e-6)
        means.append(float(image.numpy().mean()))
    assert len(set(means)) == 4
    assert frozen.n_recordings <= 2


def test_kernels_of_a_render(llvm):
    """As many kernels as with a built-in: nothing is made at render time."""
    counts = {}
    for plugin, extra in (("roughconductor", {}), ("sgtdconductor", {"gamma": 1.8, "shift": 0.3})):
        scene = small_scene({"type": plugin, "alpha": 0.3, **extra}, {"type": "path", "max_depth": 3})
        dr.sync_thread()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            dr.eval(mi.render(scene, spp=4, seed=0))
            dr.sync_thread()
            counts[plugin] = sum(entry["type"] == dr.KernelType.JIT for entry in dr.kernel_history())
    assert counts["sgtdconductor"] == counts["roughconductor"] > 0


# -- no bias


@pytest.mark.parametrize("kind", ["heavy_tail", "ring", "skew", "box"])
def test_three_estimators_agree(llvm, kind):
    """One image by light samples (eval alone), by material samples of both kinds (sample alone) and by both (eval, pdf, sample)."""
    means, errors = {}, {}
    emitter_only = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": True}
    bsdf_only = {"type": "direct", "emitter_samples": 0, "bsdf_samples": 1, "hide_emitters": True}
    both = {"type": "path", "max_depth": 2, "hide_emitters": True}
    for name, integrator, visible, spp in (
        ("reference", emitter_only, True, 1024),
        ("visible", bsdf_only, True, 256),
        ("all normals", bsdf_only, False, 256),
        ("combined", both, True, 256),
        ("combined, all normals", both, False, 256),
    ):
        scene = small_scene(
            {"type": "sgtdconductor", **KINDS[kind], **ANISOTROPIC, "sample_visible": visible}, integrator
        )
        images = [mi.render(scene, spp=spp, seed=seed).numpy().mean() for seed in range(12)]
        means[name], errors[name] = np.mean(images), np.std(images, ddof=1) / len(images) ** 0.5
    print(kind, {name: f"{means[name]:.5f} +- {errors[name]:.5f}" for name in means})
    assert errors["reference"] < 0.005 * means["reference"]
    for name in means:
        assert errors[name] < 0.02 * means[name], name
        error = np.hypot(errors[name], errors["reference"])
        # twelve renders make Student's t with 11 degrees of freedom: 4.5 is met by chance once in a thousand
        assert abs(means[name] - means["reference"]) < 4.5 * error, (name, means, errors)
