"""Every input that has broken a renderer, through the plugin in single precision: no bad number, no sample without a density, and D as in the core.

The first line of each case says why it is one.
"""

import conftest
import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc
import sgtd
from family import named

INF = float("inf")

# name: (properties, why)
CASES = {
    "smallest roughness": (dict(gamma=1.8, alpha=1e-6), "below the floor of 1e-4: D is 1e8"),
    "roughness 0": (dict(gamma=1.8, alpha=0.0), "0/0 in x = tan/alpha"),
    "one roughness 0": (dict(gamma=1.8, alpha_u=0.0, alpha_v=0.3), "0/0 for one axis alone"),
    "roughness 1e-4": (dict(gamma=1.8, alpha=1e-4), "D underflows within a degree"),
    "roughness 10": (dict(gamma=1.8, alpha=10.0), "nearly all reflections are below the horizon"),
    "ratio of roughness 1e4": (dict(gamma=1.8, alpha_u=1e-3, alpha_v=10.0), "both of the above at once"),
    "texture with zeros": (
        dict(gamma=1.8, alpha=np.array([[0.0, 0.2], [1e-30, 1e-6]])),
        "exact zeros beside roughness, in one kernel",
    ),
    "two textures with zeros": (
        dict(alpha_u=np.array([[0.0, 0.2], [0.0, 0.2]]), alpha_v=np.array([[0.3, 0.3], [0.0, 0.0]])),
        "zeros that do not coincide",
    ),
    "tail at its limit": (dict(gamma=1.5005, alpha=0.2), "2 p gamma - 3 = 1e-3: masking is nearly infinite"),
    "tail at its limit, cusp": (dict(gamma=6.002, p=0.25, alpha=0.2), "the same with f not differentiable at its peak"),
    "gamma 1.05": (dict(gamma=1.05, p=1.5, shift=0.1, alpha=0.2), "1/(gamma-1) is 20 in every term"),
    "box": (
        dict(gamma=2.0, p=50.0, alpha=0.3),
        "f falls from 1 to 0 within a hundredth of the roughness, and u overflows beyond",
    ),
    "normal box": (dict(gamma=INF, p=50.0, alpha=0.3), "f underflows at 1.05 of the edge"),
    "ring": (dict(gamma=2.0, shift=1e3, alpha=0.01), "a normal at slope 10 +- 0.01: x - m loses three digits"),
    "normal ring": (dict(gamma=INF, shift=1e3, alpha=1e-3), "f underflows at normal incidence"),
    "thin ring": (dict(gamma=INF, p=2.0, shift=30.0, alpha=0.02, **{"lambda": 0.9}), "one side ten times thinner"),
    "skew -0.999": (dict(gamma=1.8, shift=0.5, alpha=0.3, **{"lambda": -0.999}), "outer side 1e-3 wide"),
    "skew 0.999": (dict(gamma=1.8, shift=0.5, alpha=0.3, **{"lambda": 0.999}), "inner side 1e-3 wide"),
    "normal, skew 0.999": (
        dict(gamma=INF, shift=0.5, alpha=0.3, **{"lambda": 0.999}),
        "f is 0 below half of the shift",
    ),
    "gamma 1e12": (dict(gamma=1e12, alpha=0.2), "1 + u/(gamma-1) is 1"),
    "gamma 1e38": (dict(gamma=1e38, alpha=0.2), "at the end of single precision"),
    "all normals": (
        dict(gamma=1.6, shift=2.0, alpha=0.5, sample_visible=False),
        "samples that face away from the viewer",
    ),
    "height correlated": (
        dict(gamma=1.6, shift=2.0, alpha=0.5, masking="height_correlated"),
        "the sum of two infinite Lambda",
    ),
    "eta 1": (dict(gamma=1.8, alpha=0.2, eta=1.0, k=0.0), "no reflection at all: 0 and not 0/0"),
    "dark metal": (dict(gamma=1.8, alpha=0.2, eta=1e-3, k=1e-3), "Fresnel at its ends"),
    "ggx": (dict(distribution="ggx", alpha=0.0), "Mitsuba's own code, held to the same"),
    "beckmann": (dict(distribution="beckmann", alpha=10.0), "Mitsuba's own code, held to the same"),
    "shifted beckmann": (
        dict(distribution="beckmann", alpha=1e-4, shift=5.0),
        "the floor of the roughness moves the ring",
    ),
}

COSINES = np.array([0.0, 1e-45, 1e-30, 1e-7, 1e-4, 0.01, 0.5, 0.9999999, 1.0, -0.3])
NUMBERS = np.array([0.0, 1e-45, 1e-38, 2.0**-24, 1e-4, 0.25, 0.5, 0.75, 0.9999, 1.0 - 2.0**-24])


def corner_directions(phis):
    """All cosines at all azimuths, in single precision."""
    directions = []
    for z in COSINES:
        for phi in phis:
            r = np.sqrt(max(0.0, 1.0 - z * z))
            directions.append([r * np.cos(phi), r * np.sin(phi), z])
    return np.array(directions, dtype=np.float32)


def product(*arrays):
    """All combinations of rows."""
    grids = np.meshgrid(*(np.arange(len(a)) for a in arrays), indexing="ij")
    return [a[g.ravel()] for a, g in zip(arrays, grids)]


def inputs():
    wi = corner_directions([0.0, 0.7, 0.5 * np.pi])
    wo = np.concatenate([corner_directions([0.0, 0.7 + np.pi]), [[0, 0, 1e-45], [1e-45, 0, 1]]]).astype(np.float32)
    u = np.array(product(NUMBERS[:, None], NUMBERS[:, None]))[..., 0].T
    return wi, wo, u


# texels and edges of the two-by-two textures
UVS = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [1.0, 1.0]])


def uv_of(properties):
    return UVS if any(isinstance(v, np.ndarray) for v in properties.values()) else UVS[:1]


# Mitsuba's Fresnel term of a conductor rounds to -3e-8 where it should be 0, in roughconductor as well.
ROUNDING = {"eta 1": -1e-6}


def check_values(value, pdf, what):
    assert np.isfinite(value).all(), (what, "value")
    assert (value >= ROUNDING.get(what, 0.0)).all(), (what, "value")
    assert np.isfinite(pdf).all() and (pdf >= 0).all(), (what, "density")


def check_samples(wo, pdf, weight, what):
    assert np.isfinite(weight).all() and (weight >= ROUNDING.get(what, 0.0)).all(), what
    valid = (weight > 0).any(axis=-1)
    assert np.isfinite(pdf[valid]).all() and (pdf[valid] > 0).all(), what
    assert np.isfinite(wo[valid]).all() and (wo[valid, 2] > 0).all(), what
    assert np.abs(np.linalg.norm(wo[valid], axis=-1) - 1.0).max(initial=0.0) < 1e-5, what
    return valid


@pytest.mark.parametrize(
    "variant", ["scalar_rgb", "llvm_ad_rgb", "llvm_ad_mono_polarized", "scalar_spectral_polarized"]
)
@pytest.mark.parametrize("case", CASES)
def test_no_bad_number(case, variant):
    conftest.use(variant)
    properties, _ = CASES[case]
    bsdf = sc.load(**properties)
    wi, wo, u = inputs()
    if variant.startswith("scalar"):
        wi, wo, u = wi[::2], wo[::2], u[::3]
    all_wi, all_wo, uv = product(wi, wo, uv_of(properties))
    # wi = wo, where the plane of reflection is undefined
    all_wi, all_wo, uv = (
        np.concatenate([all_wi, wi]),
        np.concatenate([all_wo, wi]),
        np.concatenate([uv, np.full((len(wi), 2), 0.25)]),
    )
    value, pdf = sc.evaluate(bsdf, all_wi, all_wo, uv)
    check_values(value, pdf, case)
    value, pdf = sc.evaluate_apart(bsdf, all_wi, all_wo, uv)
    check_values(value, pdf, case)
    below = (all_wi[:, 2] <= 0) | (all_wo[:, 2] <= 0)
    assert (value[below] == 0).all() and (pdf[below] == 0).all()

    all_wi, all_u, uv = product(wi, u, uv_of(properties))
    drawn = sc.sample(bsdf, all_wi, all_u, uv)
    valid = check_samples(*drawn, case)
    assert not valid[all_wi[:, 2] <= 0].any()
    if properties.get("eta") != 1.0 and case not in ("ring", "normal ring"):
        assert valid[all_wi[:, 2] > 0.4].any(), "no sample was valid"

    # the tests above would pass for a black material
    rng = np.random.default_rng(20)
    wi = np.tile(sc.direction(50.0, 30.0), (400, 1))
    wo, pdf, weight = sc.sample(bsdf, wi, rng.random((400, 2)), np.full((400, 2), 0.75))
    valid = check_samples(wo, pdf, weight, case)
    if properties.get("eta") != 1.0 and valid.any():
        value, pdf = sc.evaluate(bsdf, wi[valid], wo[valid], np.full((valid.sum(), 2), 0.75))
        assert (value > 0).any() and (pdf > 0).any()


@pytest.mark.parametrize("case", CASES)
def test_mueller_matrices_are_finite(case):
    """All sixteen elements, also where wi = wo and the plane of reflection is undefined."""
    conftest.use("llvm_ad_mono_polarized")
    bsdf = sc.load(**CASES[case][0])
    wi, wo, u = inputs()
    all_wi, all_wo = product(wi, wo)
    all_wi, all_wo = np.concatenate([all_wi, wi]), np.concatenate([all_wo, wi])
    si = dr.zeros(mi.SurfaceInteraction3f, len(all_wi))
    si.wi, si.uv = mi.Vector3f(all_wi.T), mi.Point2f(0.75, 0.75)
    value, _ = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(all_wo.T))
    all_wi, all_u = product(wi, u)
    si = dr.zeros(mi.SurfaceInteraction3f, len(all_wi))
    si.wi, si.uv = mi.Vector3f(all_wi.T), mi.Point2f(0.75, 0.75)
    _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(0.5), mi.Point2f(all_u.T.astype(np.float32)))
    for matrix in (value, weight):
        elements = np.array(
            [
                np.broadcast_to(np.array(matrix[i, j][0]), 1 if dr.width(matrix) == 1 else dr.width(matrix))
                for i in range(4)
                for j in range(4)
            ]
        )
        assert np.isfinite(elements).all()
        # no element exceeds the intensity
        assert (
            np.abs(elements) <= np.maximum(elements[0], 0.0) * (1 + 1e-4) + 1e-30 - 10 * ROUNDING.get(case, 0.0)
        ).all()


@pytest.mark.parametrize("case", [case for case in CASES if case not in ("ggx", "beckmann")])
def test_derivatives_are_finite(llvm, case):
    """Of value, density and weight with respect to the roughness, which the zeros of a texture and the floor cut off."""
    bsdf = sc.load(**CASES[case][0])
    params = mi.traverse(bsdf)
    keys = [key for key in params.keys() if key.startswith("alpha") and key.endswith((".value", ".data"))]
    for key in keys:
        dr.enable_grad(params[key])
    params.update()
    wi, wo, u = inputs()
    # at a cosine of 1e-7 derivatives overflow, in roughconductor as well
    wi = wi[(wi[:, 2] >= 1e-4) | (wi[:, 2] <= 0)]
    all_wi, all_wo, all_u, uv = product(wi, wo[::3], u[::7], uv_of(CASES[case][0]))
    si = dr.zeros(mi.SurfaceInteraction3f, len(all_wi))
    si.wi, si.uv = mi.Vector3f(all_wi.T), mi.Point2f(uv.T.astype(np.float32))
    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(all_wo.T))
    _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(0.5), mi.Point2f(all_u.T.astype(np.float32)))
    # the scale keeps a sum of 1e8's finite, a NaN stays one
    dr.backward(1e-12 * (dr.sum(value[0]) + dr.sum(pdf) + dr.sum(weight[0])))
    for key in keys:
        assert np.isfinite(dr.grad(params[key]).numpy()).all(), key


@pytest.mark.parametrize("steps", [40])
def test_gradient_descent_stays_finite(llvm, steps):
    """Many steps of an optimizer on a texture of roughness, some of whose texels end at 0."""
    rng = np.random.default_rng(21)
    bsdf = sc.load(gamma=1.7, shift=0.2, alpha=rng.uniform(0.0, 0.3, (4, 4)))
    params = mi.traverse(bsdf)
    key = next(key for key in params.keys() if key.startswith("alpha"))
    optimizer = mi.ad.Adam(lr=0.05)
    optimizer[key] = params[key]
    count = 2000
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    wi = sc.uniform_directions(rng, count)
    si.wi, si.uv = mi.Vector3f(wi.T.astype(np.float32)), mi.Point2f(rng.random((2, count)).astype(np.float32))
    wo = mi.Vector3f(sc.reflect(wi, sc.normals(rng, count, 0.05, 0.05)).T.astype(np.float32))
    for _ in range(steps):
        params.update(optimizer)
        value = bsdf.eval(mi.BSDFContext(), si, wo)[0]
        dr.backward(dr.mean(dr.square(value - 0.5)))
        optimizer.step()
        optimizer[key] = dr.clip(optimizer[key], 0.0, 1.0)
    assert np.isfinite(optimizer[key].numpy()).all()


# -- limits


def test_small_roughness_is_the_smooth_conductor(variant):
    """The albedo at the floor of the roughness is the Fresnel reflectance."""
    u = np.random.default_rng(22).random((500, 2))
    for shape in (dict(gamma=3.0), dict(gamma=INF, p=2.0), dict(gamma=INF, shift=1.0)):
        wi = sc.direction(40.0, 15.0)
        _, _, weight = sc.sample(sc.load(alpha=1e-6, eta=0.3, k=3.0, **shape), wi, u)
        wo, _, smooth = sc.sample(sc.load("conductor", eta=0.3, k=3.0), wi, u[:1])
        assert weight[:, 0].mean() == pytest.approx(smooth[0, 0], rel=1e-3)
        wo, _, _ = sc.sample(sc.load(alpha=1e-6, **shape), wi, u)
        assert np.median(np.linalg.norm(wo - sc.direction(40.0, 195.0), axis=-1)) < 1e-3


def test_no_reflection_where_eta_is_that_of_air(variant):
    value, _ = sc.evaluate(
        sc.load(gamma=1.8, alpha=0.2, eta=1.0, k=0.0), sc.direction(40.0, 10.0), sc.direction(40.0, 190.0)
    )
    assert np.abs(value).max() < 1e-6


def test_texture_with_zeros_renders(llvm):
    """An image of a sphere under a constant light: finite everywhere, and no brighter than the light."""
    rng = np.random.default_rng(23)
    alpha = rng.uniform(0.0, 0.5, (16, 16)) * (rng.random((16, 16)) > 0.5)
    assert (alpha == 0).sum() > 50
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4},
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at(origin=[0, -4, 1], target=[0, 0, 0], up=[0, 0, 1]),
                "fov": 35,
                "film": {"type": "hdrfilm", "width": 48, "height": 48, "rfilter": {"type": "box"}},
            },
            "light": {"type": "constant"},
            "ball": {
                "type": "sphere",
                "bsdf": {"type": "sgtdconductor", "gamma": 1.7, "shift": 0.3, "alpha": sc.texture(alpha)},
            },
        }
    )
    image = mi.render(scene, spp=64).numpy()
    assert np.isfinite(image).all() and (image >= 0).all()
    ball = image[16:32, 16:32, :3]
    assert 0.5 < ball.mean() <= 1.0 + 0.02


def test_mesh_without_uvs(llvm):
    """An anisotropic material on triangles that have no parametrization: Mitsuba makes up tangents, and the image is finite."""
    mesh = mi.Mesh("plane", vertex_count=4, face_count=2)
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0], dtype=np.float32)
    params["faces"] = np.array([0, 1, 2, 0, 2, 3], dtype=np.uint32)
    params.update()
    props = mi.Properties()
    props["mesh_bsdf"] = sc.load(gamma=1.8, alpha_u=0.3, alpha_v=0.05)
    mesh = mi.Mesh("plane", vertex_count=4, face_count=2, props=props)
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0], dtype=np.float32)
    params["faces"] = np.array([0, 1, 2, 0, 2, 3], dtype=np.uint32)
    params.update()
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2},
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at(origin=[0, -2, 2], target=[0, 0, 0], up=[0, 0, 1]),
                "film": {"type": "hdrfilm", "width": 24, "height": 24},
            },
            "light": {"type": "constant"},
            "mesh": mesh,
        }
    )
    image = mi.render(scene, spp=32).numpy()
    assert np.isfinite(image).all() and image.mean() > 0.3


# -- the distribution of normals, against the core

SHAPES = {
    "ggx": dict(gamma=2.0),
    "normal": dict(gamma=INF),
    "gamma 1.6": dict(gamma=1.6),
    "gamma 1e12": dict(gamma=1e12),
    "gamma 1e4, cusp": dict(gamma=1e4, p=0.3),
    "tail at its limit": dict(gamma=1.5005),
    "full": dict(gamma=1.9, p=1.3, shift=0.6, **{"lambda": 0.4}),
    "skew 0.999": dict(gamma=1.8, shift=0.5, **{"lambda": 0.999}),
    "skew -0.999": dict(gamma=1.8, shift=0.5, **{"lambda": -0.999}),
    "ring 5": dict(gamma=2.0, shift=5.0),
    "ring 30": dict(gamma=3.0, p=2.0, shift=30.0),
    "ring 1000": dict(gamma=2.0, shift=1e3),
    "normal ring 1000": dict(gamma=INF, shift=1e3),
    "box 10": dict(gamma=2.0, p=10.0),
    "box 50": dict(gamma=2.0, p=50.0),
    "normal box 50": dict(gamma=INF, p=50.0),
}

ROUGHNESSES = {"0.3": (0.3, 0.3), "1e-4": (1e-4, 1e-4), "10": (10.0, 10.0), "1e-3 and 10": (1e-3, 10.0)}


# At 0, scalar variants call the core; from 1e-7 on they read tables in single precision, as the others always do.
@pytest.mark.parametrize("variant, accuracy", [("scalar_rgb", 0.0), ("scalar_rgb", 1e-7), ("llvm_ad_rgb", 0.0)])
@pytest.mark.parametrize("roughness", ROUGHNESSES)
@pytest.mark.parametrize("shape", SHAPES)
def test_distribution_is_that_of_the_core(variant, accuracy, shape, roughness):
    """D within 1e-5 of the core wherever D cos exceeds 1e-6 of its peak. With wi = wo = m, eval returns D G1(m)^2 / (4 cos) for a mirror."""
    conftest.use(variant)
    # the plugin holds roughness in single precision
    alpha_u, alpha_v = (float(np.float32(alpha)) for alpha in ROUGHNESSES[roughness])
    ndf = sgtd.Ndf(**named(SHAPES[shape]), alpha_u=alpha_u, alpha_v=alpha_v, accuracy=0.0)
    # radial quantiles of D cos and of its tails: all of the lobe, as densely as it is populated
    q = np.concatenate([np.linspace(0.001, 0.999, 300), 10.0 ** np.linspace(-14, -3, 60)])
    x = np.concatenate([ndf.quantile(q), ndf.isf(q)])
    x = x[np.isfinite(x)]
    rng = np.random.default_rng(24)
    phi = rng.uniform(0, 2 * np.pi, len(x))
    slopes = np.stack([alpha_u * x * np.cos(phi), alpha_v * x * np.sin(phi)], axis=-1)
    length = np.sqrt(1.0 + np.sum(slopes**2, axis=-1))
    m = np.stack([slopes[:, 0] / length, slopes[:, 1] / length, 1.0 / length], axis=-1).astype(np.float32)
    m = m[m[:, 2] > 0]

    exact = m.astype(np.float64)
    d, g1 = ndf.d(exact), ndf.g1(exact)
    # below 1e-20 D is 0, as in Mitsuba; and the value must not underflow
    inside = (
        (d * exact[:, 2] > 1e-6 * (d * exact[:, 2]).max())
        & (d * exact[:, 2] > 1e-19)
        & (d * g1**2 / exact[:, 2] > 1e-30)
    )
    assert inside.sum() > 100
    value, _ = sc.evaluate(
        sc.load(**SHAPES[shape], alpha_u=alpha_u, alpha_v=alpha_v, accuracy=accuracy), m[inside], m[inside]
    )
    found = value[:, 0] * 4.0 * exact[inside, 2] / g1[inside] ** 2
    error = sc.relative_error(found, d[inside])
    conftest.measured(f"D in {variant} at {accuracy:g}", error, lambda worst: f"{shape}, alpha {roughness}")
    print(
        f"{shape}, alpha {roughness}: largest {error.max():.2e}, 99% {np.quantile(error, 0.99):.2e}, median {np.median(error):.2e}"
    )
    assert error.max() < 1e-5, exact[inside][error.argmax()]


@pytest.mark.parametrize("p", [1.0, 1.5, 3.0, 8.0, 10.0, 20.0, 29.0, 50.0])
@pytest.mark.parametrize("gamma", [2.0, INF])
def test_no_hole_in_the_lobe(variant, gamma, p):
    """Near the center x^(2p) passes through the least exponents of both precisions, where exp2 may return anything: D stays at its peak."""
    alpha = 0.5
    # around 2^-126, 2^-149, 2^-1022 and 2^-1074, and over all of the center
    exponents = np.concatenate([np.linspace(e - 3, e + 3, 600) for e in (-127, -149, -1023, -1074)])
    x = np.concatenate([2.0 ** (exponents / (2 * p)), 10.0 ** np.linspace(-12, -2, 600)])
    x = x[(x < 1e-2) & (x > 1e-18)]
    m = np.stack([alpha * x, np.zeros(len(x)), np.ones(len(x))], axis=-1)
    value, pdf = sc.evaluate(sc.load(gamma=gamma, p=p, alpha=alpha), m, m)
    # f differs from 1 by x^(2p) gamma/(gamma-1), which is 2e-4 at most
    assert value[:, 0].min() > 0.999 * value[:, 0].max()
    # the density is that of the table, which need not be flat
    assert pdf.min() > 0.9 * pdf.max()
