"""Are `ggx` and `beckmann` without a shift roughconductor, number for number?"""

import numpy as np
import pytest
import scattering as sc

COUNT = 100_000

ROUGHNESS = {
    "isotropic": lambda rng: dict(alpha=0.2),
    "smooth": lambda rng: dict(alpha=1e-3),
    "anisotropic": lambda rng: dict(alpha_u=0.4, alpha_v=0.05),
    "textured": lambda rng: dict(alpha=rng.uniform(0.02, 0.8, (8, 8))),
    "textured_anisotropic": lambda rng: dict(
        alpha_u=rng.uniform(0.02, 0.8, (8, 8)), alpha_v=rng.uniform(0.02, 0.8, (4, 4))
    ),
}


@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("roughness", ROUGHNESS)
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_equal_to_roughconductor(variant, distribution, roughness, visible):
    sc.needs_equal_rounding()
    rng = np.random.default_rng(1)
    properties = dict(distribution=distribution, material="Au", sample_visible=visible, **ROUGHNESS[roughness](rng))
    ours, theirs = (sc.load(plugin, **properties) for plugin in ("sgtdconductor", "roughconductor"))

    # fewer in the slow variant, whose code is the same C++
    count = COUNT if variant != "scalar_rgb" else COUNT // 5 if roughness == "textured_anisotropic" else COUNT // 20
    wi = sc.uniform_directions(rng, count)
    wi[::10, 2] *= -1.0
    # a quarter of all outgoing directions anywhere, the others around the lobe
    wo = sc.uniform_directions(rng, count, lower=True)
    near = rng.random(count) < 0.75
    spread = 1e-3 if roughness == "smooth" else 0.2
    wo[near] = sc.reflect(wi, sc.normals(rng, count, spread, spread, reach=0.5))[near]
    uv = rng.random((count, 2))
    u = rng.random((count, 2))

    for name, found, expected in (
        *zip(("value", "density"), sc.evaluate(ours, wi, wo, uv), sc.evaluate(theirs, wi, wo, uv)),
        *zip(("eval", "pdf"), sc.evaluate_apart(ours, wi, wo, uv), sc.evaluate_apart(theirs, wi, wo, uv)),
        *zip(("direction", "sampled density", "weight"), sc.sample(ours, wi, u, uv), sc.sample(theirs, wi, u, uv)),
    ):
        assert np.count_nonzero(expected) > count // 10
        # the direction that roughconductor returns with a weight of 0 is not a number in JIT variants
        assert (np.isfinite(found) == np.isfinite(expected)).all()
        finite = np.isfinite(expected)
        different = np.count_nonzero(found[finite] != expected[finite])
        error = np.where(finite, sc.relative_error(found, expected, floor=1e-30), 0.0)
        print(f"{name}: {different} of {found.size} numbers differ, largest relative difference {error.max():.2e}")
        assert error.max() <= 1e-6, (name, wi[np.unravel_index(error.argmax(), error.shape)[0]])


# As it is written, and the roughness along one tangent that GGX needs for it
GGX_BY_ANY_NAME = {
    "defaults": ({}, 1.0),
    "gtd": (dict(distribution="gtd", gamma=2.0, p=1.0), 1.0),
    "std": (dict(distribution="std", gamma=2.0), 1.0),
    "student": (dict(distribution="student", gamma=2.0, shift=0.0), 1.0),
    "no skew": (dict(gamma=2.0, **{"lambda": 0.0}), 1.0),
    "mu 0": (dict(mu=0.0), 1.0),
    # sigma sqrt(2/(q-1)) with q = 2
    "hyper_cauchy": (dict(distribution="hyper_cauchy", gamma=2.0), 2.0**0.5),
    # without a shift there is an outer side alone, of width 1 + lambda
    "skew without a shift": (dict(**{"lambda": 0.5}), 1.5),
    "narrow skew of std": (dict(distribution="std", **{"lambda": -0.25}), 0.75),
}


@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("name", GGX_BY_ANY_NAME)
def test_ggx_by_any_name(variant, name, visible):
    """The numbers decide, not the row: all of these are roughconductor's GGX to the last bit, but for the rounding of the roughness."""
    sc.needs_equal_rounding()
    given, scale = GGX_BY_ANY_NAME[name]
    rng = np.random.default_rng(3)
    wi = sc.uniform_directions(rng, 2000)
    wo = sc.reflect(wi, sc.normals(rng, 2000, 0.2, 0.2, reach=0.5))
    u = rng.random((2000, 2))
    ours = sc.load(alpha=0.2, sample_visible=visible, **given)
    theirs = sc.load("roughconductor", distribution="ggx", alpha=0.2 * scale, sample_visible=visible)
    # a product of two numbers in single precision against one that was rounded once
    permitted = 0.0 if scale == 1.0 else 3e-5
    found, expected = ((*sc.evaluate(b, wi, wo), *sc.sample(b, wi, u)) for b in (ours, theirs))
    for a, b in zip(found, expected):
        assert np.count_nonzero(b) > 500
        finite = np.isfinite(b)
        assert (np.isfinite(a) == finite).all()
        assert np.where(finite, sc.relative_error(a, b, floor=1e-6), 0.0).max() <= permitted


def test_beckmann_by_another_name_is_exact(variant):
    """Mitsuba masks its Beckmann by a fit that is off by up to 6e-3. Who names another row gets the accuracy that is promised."""
    import math

    import sgtd

    ndf = sgtd.Ndf(gamma=math.inf, alpha=0.5)
    w = np.array([np.sin(1.2), 0.0, np.cos(1.2)]).astype(np.float32).astype(np.float64)
    exact = ndf.d(w) * ndf.g1(w) ** 2 / (4 * w[2])
    for given, low, high in ((dict(gamma=math.inf), 0, 1e-4), (dict(distribution="beckmann"), 1e-3, 2e-2)):
        error = abs(sc.evaluate(sc.load(alpha=0.5, **given), w, w)[0][0, 0] / exact - 1)
        assert low <= error < high, given


@pytest.mark.parametrize("extra", [{}, {"sample_visible": False}, {"alpha_u": 0.3, "alpha_v": 0.1}], ids=str)
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_the_same_kernels(llvm, distribution, extra):
    """Not one operation more: kernels are equal to the last bit, and a scene with both plugins has one code path."""
    import drjit as dr
    import mitsuba as mi
    from sgtd.explain.cost import count_code_paths

    roughness = {} if extra else {"alpha": 0.3}
    wi, wo = (mi.Vector3f(sc.uniform_directions(np.random.default_rng(k), 100).T.astype(np.float32)) for k in (1, 2))
    si = dr.zeros(mi.SurfaceInteraction3f, 100)
    si.wi = wi
    dr.eval(si, wo)
    hashes = {}
    for plugin in ("roughconductor", "sgtdconductor"):
        bsdf = sc.load(plugin, distribution=distribution, **roughness, **extra)
        calls = (
            lambda b: b.eval_pdf(mi.BSDFContext(), si, wo),
            lambda b: b.pdf(mi.BSDFContext(), si, wo),
            lambda b: b.sample(mi.BSDFContext(), si, wo.x, mi.Point2f(dr.abs(wo.x), dr.abs(wo.y))),
        )
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            for call in calls:
                dr.eval(call(bsdf))
            hashes[plugin] = [str(kernel["hash"]) for kernel in dr.kernel_history([dr.KernelType.JIT])]
    assert len(set(hashes["roughconductor"])) == 3
    assert hashes["sgtdconductor"] == hashes["roughconductor"]
    del bsdf
    scene = mi.load_dict(
        {
            "type": "scene",
            "a": {"type": "sphere", "bsdf": {"type": "roughconductor", "distribution": distribution, **extra}},
            "b": {"type": "sphere", "bsdf": {"type": "sgtdconductor", "distribution": distribution, **extra}},
        }
    )
    assert count_code_paths(scene) == 1
