"""Derivatives by the shape: through bsdf.eval, pdf and sample, through renders, and of the distribution itself."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc
import sgtd

# gamma, p, lambda, shift, alpha: GGX, a full member, a cusp, a ring, a box with a heavy tail
SHAPES = [
    (2.0, 1.0, 0.0, 0.0, 0.5),
    (1.7, 1.2, 0.3, 0.6, 0.4),
    (6.0, 0.4, -0.3, 0.5, 0.3),
    (3.0, 2.5, 0.5, 2.0, 0.2),
    (1.3, 6.0, -0.6, 0.2, 0.8),
]
NAMES = ("gamma", "p", "lambda", "shift", "alpha.value")


def directions(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    cos, phi = rng.uniform(0.02, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    sin = np.sqrt(1.0 - cos * cos)
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=1)


def interaction(wi: np.ndarray):
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(wi.T.copy())
    return si


def load(theta, plugin="sgtdconductor", **more):
    gamma, p, lam, shift, alpha = theta
    return sc.load(plugin, gamma=gamma, p=p, shift=shift, alpha=alpha, **{"lambda": lam}, **more)


def value(theta, wi, wo, masking):
    """The BSDF of a mirror, from the core in double precision."""
    gamma, p, lam, shift, alpha = theta
    ndf = sgtd.Ndf(gamma=gamma, p=p, lam=lam, shift=shift, alpha=alpha, accuracy=0)
    half = wi + wo
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return ndf.d(half) * ndf.g2(wi, wo, masking) / (4.0 * wi[:, 2])


def difference(theta, index, f):
    """Fourth order; one-sided where a shift is 0."""
    step = 1e-4 * max(abs(theta[index]), 0.1)

    def at(x):
        moved = list(theta)
        moved[index] += x * step
        return f(moved)

    if index == 3 and theta[3] == 0.0:
        return (-3.0 * at(0) + 4.0 * at(1) - at(2)) / (2.0 * step)
    return (8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12.0 * step)


@pytest.mark.parametrize("masking", ["separable", "height_correlated"])
@pytest.mark.parametrize("theta", SHAPES, ids=str)
def test_eval_follows_the_shape(llvm, theta, masking):
    wi, wo = directions(2000, 1), directions(2000, 2)
    if theta[1] < 1.0:  # next to a cusp derivatives are as large as one likes
        half = wi + wo
        x = np.hypot(half[:, 0], half[:, 1]) / half[:, 2] / theta[4]
        away = abs(x - theta[3]) > 0.05
        wi, wo = wi[away], wo[away]
    bsdf = load(theta, masking=masking)
    params = mi.traverse(bsdf)
    plain = sc.load(gamma=theta[0], p=theta[1], shift=theta[3], alpha=theta[4], masking=masking, **{"lambda": theta[2]})
    before = np.array(plain.eval(mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy()))[0])
    for index, name in enumerate(NAMES):
        dr.enable_grad(params[name])
        params.update()
        got = bsdf.eval(mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy()))[0]
        dr.forward(params[name])
        forward = np.array(dr.grad(got))
        exact = difference(theta, index, lambda moved: value(moved, wi, wo, masking))
        assert np.linalg.norm(forward - exact) < 1e-4 * np.linalg.norm(exact), name
        # what a gradient adds is 0 in the value
        assert np.array(got) == pytest.approx(before, rel=2e-4, abs=1e-7)
        # and in reverse
        again = bsdf.eval(mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy()))[0]
        dr.set_grad(params[name], 0.0)
        dr.backward(dr.sum(again))
        assert dr.grad(params[name]).numpy().item() == pytest.approx(forward.sum(), rel=1e-3, abs=1e-4), name
        dr.disable_grad(params[name])
        params.update()


@pytest.mark.parametrize("theta", SHAPES[:3], ids=str)
def test_pdf_follows_the_shape(llvm, theta):
    """The density of visible normals does: that of the tables, up to the error of their spline."""
    wi, wo = directions(2000, 3), directions(2000, 4)
    bsdf = load(theta, sample_bounded=False)
    params = mi.traverse(bsdf)

    def density(moved):
        gamma, p, lam, shift, alpha = moved
        ndf = sgtd.Ndf(gamma=gamma, p=p, lam=lam, shift=shift, alpha=alpha, accuracy=0)
        half = wi + wo
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        return ndf.d(half) * ndf.g1(wi) / (4.0 * wi[:, 2])

    for index, name in enumerate(NAMES[:4]):
        dr.enable_grad(params[name])
        params.update()
        _, got = bsdf.eval_pdf(mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy()))
        alone = bsdf.pdf(mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy()))
        dr.forward(params[name], flags=dr.ADFlag.ClearEdges)
        exact = difference(theta, index, density)
        near = np.abs(exact) < 1e3
        assert np.linalg.norm((np.array(dr.grad(got)) - exact)[near]) < 0.03 * np.linalg.norm(exact[near]), name
        assert np.array(dr.grad(alone)) == pytest.approx(np.array(dr.grad(got)), rel=1e-3, abs=1e-4)
        dr.disable_grad(params[name])
        params.update()


@pytest.mark.parametrize("plugin", ["sgtdconductor", "sgtddielectric"])
@pytest.mark.parametrize("symbolic", [True, False])
def test_samples_follow_the_shape(llvm, plugin, symbolic):
    """The mean of weights is the albedo, and the mean of their derivatives that of the albedo; directions do not move."""
    theta, count = (1.8, 1.2, 0.2, 0.4, 0.6), 1 << 19
    wi = np.tile(sc.direction(50.0, 20.0), (count, 1))

    def albedo(bsdf, seed):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count)
        numbers = sampler.next_1d(), sampler.next_2d()
        with dr.scoped_set_flag(dr.JitFlag.SymbolicCalls, symbolic):
            sample, weight = mi.BSDFPtr(bsdf).sample(mi.BSDFContext(), interaction(wi), *numbers)
        assert not dr.grad_enabled(sample.wo) or symbolic
        return weight[0]

    for index, name in enumerate(NAMES[:4]):
        bsdf = load(theta, plugin)
        params = mi.traverse(bsdf)
        dr.enable_grad(params[name])
        params.update()
        weights = albedo(bsdf, 1)
        dr.forward(params[name])
        grads = np.array(dr.grad(weights))
        step = 0.02
        moved = [list(theta), list(theta)]
        moved[0][index] -= step
        moved[1][index] += step
        # the same random numbers: what is left of the noise is that of the difference
        low, high = (np.array(albedo(load(m, plugin), 1)) for m in moved)
        differences = (high - low) / (2.0 * step)
        error = np.hypot(grads.std(), differences.std()) / np.sqrt(count)
        assert abs(grads.mean() - differences.mean()) < 4.0 * error + 1e-3, name


def scene(plugin, integrator, **shape):
    look = mi.ScalarTransform4f().look_at
    film = {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}, "pixel_format": "luminance"}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": integrator, "max_depth": 4},
            "sensor": {
                "type": "perspective",
                "fov": 35,
                "film": film,
                "to_world": look([0, -4, 2.2], [0, 0, 0.2], [0, 0, 1]),
            },
            "light": {"type": "constant", "radiance": 0.6},
            "lamp": {
                "type": "sphere",
                "center": [1.5, -1, 3],
                "radius": 0.5,
                "emitter": {"type": "area", "radiance": 8.0},
            },
            "ball": {"type": "sphere", "bsdf": {"type": plugin, **shape}},
        }
    )


# plugin, integrator, symbolic calls and loops, samples for a standard error below 2 %
RENDERS = [
    ("sgtdconductor", "path", True, 192),
    ("sgtdconductor", "path", False, 192),
    ("sgtdconductor", "prb", True, 192),
    ("sgtdconductor", "prb_basic", True, 512),
    ("sgtddielectric", "prb", True, 384),
    ("sgtddielectric", "prbvolpath", True, 384),
]


@pytest.mark.parametrize("plugin, integrator, symbolic, spp", RENDERS, ids=str)
def test_renders_follow_the_shape(llvm, plugin, integrator, symbolic, spp):
    """All parameters at once, along one direction; ten seeds."""
    shape, along = dict(gamma=1.8, p=1.2, shift=0.5, alpha=0.35), dict(gamma=-0.5, p=0.4, shift=-0.3)
    with dr.scoped_set_flag(dr.JitFlag.SymbolicCalls, symbolic), dr.scoped_set_flag(dr.JitFlag.SymbolicLoops, symbolic):
        made = scene(plugin, integrator, **shape)
        params = mi.traverse(made)
        keys = {name: f"ball.bsdf.{name}" for name in along}
        for key in keys.values():
            dr.enable_grad(params[key])
        params.update()
        grads = []
        for seed in range(10):
            image = mi.render(made, params, spp=spp, seed=seed)
            if integrator == "prbvolpath":  # has no forward mode
                dr.backward(dr.mean(image, axis=None))
                grads.append(sum(along[name] * dr.grad(params[key]).numpy().item() for name, key in keys.items()))
                for key in keys.values():
                    dr.clear_grad(params[key])
                continue
            for name, key in keys.items():
                dr.set_grad(params[key], along[name])
            dr.enqueue(dr.ADMode.Forward, *(params[key] for key in keys.values()))
            dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearEdges)
            grads.append(np.array(dr.grad(image)).mean())
        step = 0.1

        def mean(x):
            moved = scene(plugin, integrator, **{k: v + x * step * along.get(k, 0.0) for k, v in shape.items()})
            return np.array([np.array(mi.render(moved, spp=spp, seed=seed)).mean() for seed in range(10)])

        differences = (mean(1.0) - mean(-1.0)) / (2.0 * step)
    error = np.hypot(np.std(grads, ddof=1), np.std(differences, ddof=1)) / np.sqrt(10)
    assert abs(np.mean(grads) - differences.mean()) < 3.0 * error + 0.005 * abs(differences.mean())
    assert np.std(grads, ddof=1) / np.sqrt(10) < 0.02 * abs(np.mean(grads))


# -- what has no gradient has nothing of it


def test_without_a_gradient_nothing_is_added(llvm):
    """Kernels and values are those of a material that never had one; at GGX's point Mitsuba's own code runs again."""
    wi, wo = directions(256, 5), directions(256, 6)

    def history(bsdf):
        si, out = interaction(wi), mi.Vector3f(wo.T.copy())
        dr.make_opaque(si, out)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            dr.kernel_history_clear()
            got = bsdf.eval(mi.BSDFContext(), si, out)
            dr.eval(got)
            kernels = [entry["hash"] for entry in dr.kernel_history([dr.KernelType.JIT])]
        return kernels, np.array(got)

    for shape in (dict(gamma=2.0, alpha=0.3), dict(gamma=1.7, p=1.3, shift=0.4, alpha=0.3)):
        bsdf, other = sc.load(**shape), sc.load(**shape)
        params = mi.traverse(bsdf)
        dr.enable_grad(params["p"])
        params.update()
        with dr.suspend_grad():
            history(bsdf)
        dr.disable_grad(params["p"])
        params.update()
        (kernels, values), (others, expected) = history(bsdf), history(other)
        # up to 3.8, equal kernels are not always recorded alike
        assert kernels == others or mi.__version__ < "3.9"
        assert np.array_equal(values, expected)


def test_a_gradient_that_the_tables_lack_is_refused(llvm):
    bsdf = load(SHAPES[1])
    params = mi.traverse(bsdf)
    dr.enable_grad(params["shift"])
    with pytest.raises(Exception, match=r"shift.*update"):
        bsdf.eval(mi.BSDFContext(), interaction(directions(4, 1)), mi.Vector3f(directions(4, 2).T.copy()))


@pytest.mark.parametrize("plugin", ["sgtdconductor", "sgtddielectric"])
@pytest.mark.parametrize("more", [{}, {"distribution": "beckmann"}, {"sample_bounded": True}], ids=str)
def test_a_gradient_that_no_tables_follow_is_refused(llvm, plugin, more):
    """Mitsuba's own distributions have no tables at all."""
    if plugin == "sgtddielectric" and "sample_bounded" in more:
        return
    bsdf = sc.load(plugin, alpha=0.3, **more)
    params = mi.traverse(bsdf)
    dr.enable_grad(params["shift"])
    ctx, si, wo = mi.BSDFContext(), interaction(directions(4, 1)), mi.Vector3f(directions(4, 2).T.copy())
    number, numbers = mi.Float(0.5), mi.Point2f(0.3, 0.6)
    for call in (
        lambda: bsdf.eval(ctx, si, wo),
        lambda: bsdf.pdf(ctx, si, wo),
        lambda: bsdf.eval_pdf(ctx, si, wo),
        lambda: bsdf.sample(ctx, si, number, numbers),
        lambda: bsdf.eval_pdf_sample(ctx, si, wo, number, numbers),
    ):
        with pytest.raises(Exception, match=r"shift.*update"):
            call()
    with dr.suspend_grad():
        bsdf.eval(ctx, si, wo)


def test_multiple_scattering_with_a_gradient_is_refused(llvm):
    bsdf = load(SHAPES[1], multiple_scattering=True)
    params = mi.traverse(bsdf)
    dr.enable_grad(params["gamma"])
    with pytest.raises(Exception, match="multiple_scattering"):
        params.update()
    # and the material is what it was
    assert np.isfinite(
        np.array(bsdf.eval(mi.BSDFContext(), interaction(directions(4, 1)), mi.Vector3f(directions(4, 2).T.copy())))
    ).all()


def test_infinite_gamma_follows_its_inverse(llvm):
    wi, wo = directions(500, 7), directions(500, 8)
    si, out = interaction(wi), mi.Vector3f(wo.T.copy())
    bsdf = sc.load(inv_gamma=0.0, p=1.2, alpha=0.4)
    params = mi.traverse(bsdf)
    assert "gamma" not in params
    dr.enable_grad(params["inv_gamma"])
    params.update()
    got = bsdf.eval(mi.BSDFContext(), si, out)[0]
    dr.forward(params["inv_gamma"])
    step = 1e-5
    at = [value((1.0 / (x * step) if x else np.inf, 1.2, 0.0, 0.0, 0.4), wi, wo, "separable") for x in range(3)]
    exact = (-3.0 * at[0] + 4.0 * at[1] - at[2]) / (2.0 * step)
    assert np.linalg.norm(np.array(dr.grad(got)) - exact) < 1e-3 * np.linalg.norm(exact)
    # by gamma itself it is 0, and a number
    bsdf = sc.load(gamma=np.inf, alpha=0.4)
    params = mi.traverse(bsdf)
    dr.enable_grad(params["gamma"])
    params.update()
    got = bsdf.eval(mi.BSDFContext(), si, out)[0]
    dr.forward(params["gamma"])
    assert np.array_equal(np.array(dr.grad(got)), np.zeros(500))


@pytest.mark.parametrize("bad, words", [(1.0, "below 1"), (-0.1, "at least 0"), (0.9, "2\\*p\\*gamma")])
def test_bad_inverses_are_refused(llvm, bad, words):
    with pytest.raises(Exception, match=words):
        sc.load(inv_gamma=bad)
    with pytest.raises(Exception, match="together"):
        sc.load(inv_gamma=0.5, gamma=2.0)


@pytest.mark.parametrize("name", ["mu", "alpha.value"])
def test_a_shift_by_mu_is_followed(llvm, name):
    """The shape depends on mu / alpha: both have their part in it."""
    wi, wo = directions(1000, 9), directions(1000, 10)
    theta = dict(mu=0.15, alpha=0.3)
    bsdf = sc.load(gamma=1.9, p=1.3, **theta)
    params = mi.traverse(bsdf)
    dr.enable_grad(params[name])
    params.update()
    got = bsdf.eval(mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy()))[0]
    dr.forward(params[name])

    def at(moved):
        mu, alpha = moved
        return value((1.9, 1.3, 0.0, mu / alpha, alpha), wi, wo, "separable")

    exact = difference((0.15, 0.3), 0 if name == "mu" else 1, at)
    assert np.linalg.norm(np.array(dr.grad(got)) - exact) < 1e-3 * np.linalg.norm(exact)


def test_hyper_cauchy_follows_gamma(llvm):
    """Its gamma is a roughness as well."""
    wi, wo = directions(1000, 11), directions(1000, 12)
    bsdf = sc.load(distribution="hyper_cauchy", gamma=1.9, alpha=0.3)
    params = mi.traverse(bsdf)
    dr.enable_grad(params["gamma"])
    params.update()
    got = bsdf.eval(mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy()))[0]
    dr.forward(params["gamma"])

    def at(moved):
        return value((moved[0], 1.0, 0.0, 0.0, 0.3 * np.sqrt(2.0 / (moved[0] - 1.0))), wi, wo, "separable")

    exact = difference((1.9,), 0, at)
    assert np.linalg.norm(np.array(dr.grad(got)) - exact) < 1e-3 * np.linalg.norm(exact)


def test_frozen_functions_follow_which_parameters_have_a_gradient(llvm):
    """Both orders: a recording with a gradient is none without it."""
    wi, wo = directions(64, 13), directions(64, 14)
    bsdf = load(SHAPES[1])
    params = mi.traverse(bsdf)

    @dr.freeze
    def frozen(bsdf, si, wo):
        return bsdf.eval(mi.BSDFContext(), si, wo)[0]

    si, out = interaction(wi), mi.Vector3f(wo.T.copy())
    dr.make_opaque(si, out)
    expected = np.array(bsdf.eval(mi.BSDFContext(), si, out)[0])
    for which in ("none", "gamma", "none", "p", "gamma", "none"):
        for name in ("gamma", "p"):
            (dr.enable_grad if name == which else dr.disable_grad)(params[name])
        params.update()
        with dr.suspend_grad():
            assert np.array(frozen(bsdf, si, out)) == pytest.approx(expected, rel=1e-4)


# -- the distribution itself


@pytest.mark.parametrize("theta", SHAPES[1:], ids=str)
def test_distributions_have_gradients(theta):
    gamma, p, lam, shift, alpha = theta
    w = directions(64, 15).reshape(8, 8, 3)

    def made(moved):
        gamma, p, lam, shift = moved
        return sgtd.Ndf(gamma=gamma, p=p, lam=lam, shift=shift, alpha=alpha, accuracy=0)

    ndf = made(theta[:4])
    x = np.hypot(w[..., 0], w[..., 1]) / w[..., 2] / alpha
    near = abs(x - shift) < 0.05
    for quantity, f in (
        ("d", lambda n: n.d(w)),
        ("lambda", lambda n: n.lambda_(w)),
        ("normalization", lambda n: n.normalization),
    ):
        by = ndf.gradient(quantity) if quantity == "normalization" else ndf.gradient(quantity, w)
        for index, name in enumerate(("gamma", "p", "lam", "shift")):
            exact = np.asarray(difference(theta[:4], index, lambda moved: f(made(moved))))
            got = np.asarray(by[name])
            assert got.shape == exact.shape
            keep = ~near if quantity == "d" else np.ones(exact.shape, bool)
            assert np.linalg.norm((got - exact)[keep]) < 1e-5 * np.linalg.norm(exact[keep]) + 1e-9, (quantity, name)
        assert by["inv_gamma"] == pytest.approx(-(gamma**2) * np.asarray(by["gamma"]))


def test_gradients_refuse_what_they_are_not():
    ndf = sgtd.Ndf(gamma=1.8)
    with pytest.raises(ValueError, match="g1.*d, lambda, normalization"):
        ndf.gradient("g1", (0, 0, 1))
    with pytest.raises(ValueError, match="missing"):
        ndf.gradient("d")
    with pytest.raises(ValueError, match="student"):
        sgtd.Ndf(distribution="hyper_cauchy", gamma=1.8).gradient("d", (0, 0, 1))
