"""Do the core per call, the tables in scalar code and the tables in traced code give the same numbers?"""

import conftest
import numpy as np
import pytest
import scattering as sc
from family import ANISOTROPIC, ISOTROPIC, KINDS

COUNT = 3000
TOLERANCE = 1e-4


def inputs(rng, alpha_u, alpha_v, shift):
    wi = sc.uniform_directions(rng, COUNT)
    m = sc.normals(rng, COUNT, alpha_u, alpha_v, reach=0.5 * (1.0 + shift))
    # half of the normals lean to the viewer, or most reflections would be below the horizon
    m[::2, :2] *= np.sign(np.sum(m[::2, :2] * wi[::2, :2], axis=-1, keepdims=True))
    return wi, sc.reflect(wi, m), rng.random((COUNT, 2))


# An accuracy that single precision does not have is computed by the core, call by call; else scalar variants read the tables too.
CORE = {"accuracy": 1e-8}


def both(first, properties, wi, wo, u):
    answers = []
    for variant, more in (("scalar_rgb", first), ("llvm_ad_rgb", {})):
        conftest.use(variant)
        bsdf = sc.load(**properties, **more)
        answers.append((*sc.evaluate(bsdf, wi, wo), *sc.sample(bsdf, wi, u)))
    return answers


@pytest.mark.parametrize("masking", ["separable", "height_correlated"])
@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("roughness", [ISOTROPIC, ANISOTROPIC], ids=["isotropic", "anisotropic"])
@pytest.mark.parametrize("first", [CORE, {}], ids=["core", "tables"])
@pytest.mark.parametrize("kind", KINDS)
def test_scalar_equals_llvm(llvm, kind, first, roughness, visible, masking):
    rng = np.random.default_rng(3)
    alpha_u, alpha_v = (roughness.get(name, roughness.get("alpha")) for name in ("alpha_u", "alpha_v"))
    wi, wo, u = inputs(rng, alpha_u, alpha_v, KINDS[kind].get("shift", 0.0))
    properties = dict(**KINDS[kind], **roughness, sample_visible=visible, masking=masking)
    (value_s, pdf_s, wo_s, drawn_s, weight_s), (value_l, pdf_l, wo_l, drawn_l, weight_l) = both(
        first, properties, wi, wo, u
    )

    # 1e-6 of the largest value is the part of the lobe that f32 inputs determine to 1e-4 (a box falls by 1e-5 per 1e-7 of slope)
    assert np.count_nonzero(value_s) > COUNT // 4
    for name, found, expected in (("value", value_l, value_s), ("density", pdf_l, pdf_s)):
        error = sc.relative_error(found, expected, floor=1e-6 * expected.max())
        print(f"{name}: {error.max():.2e}")
        assert error.max() < TOLERANCE, (name, error.max())

    valid_s, valid_l = (weight_s > 0).any(axis=-1), (weight_l > 0).any(axis=-1)
    # a sample at the horizon may fall on either side of it
    assert np.count_nonzero(valid_s != valid_l) <= COUNT // 1000
    valid = valid_s & valid_l
    assert valid.mean() > 0.3
    angle = np.linalg.norm(wo_s - wo_l, axis=-1)[valid]
    print(f"directions: {angle.max():.2e}, median {np.median(angle):.2e}")
    assert angle.max() < TOLERANCE


@pytest.mark.parametrize("masking", ["separable", "height_correlated"])
@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_eval_pdf_is_eval_and_pdf(variant, kind, visible, masking):
    rng = np.random.default_rng(4)
    wi, wo, _ = inputs(rng, 0.35, 0.1, KINDS[kind].get("shift", 0.0))
    wi[:50, 2] *= -1.0
    wo[50:100, 2] *= -1.0
    bsdf = sc.load(**KINDS[kind], **ANISOTROPIC, sample_visible=visible, masking=masking)
    value, pdf = sc.evaluate(bsdf, wi, wo)
    value_apart, pdf_apart = sc.evaluate_apart(bsdf, wi, wo)
    assert (value[:100] == 0).any() and (value[100:] > 0).any()
    assert sc.relative_error(value, value_apart, floor=1e-30).max() < 1e-6
    assert sc.relative_error(pdf, pdf_apart, floor=1e-30).max() < 1e-6


@pytest.mark.parametrize("visible", [True, False], ids=["visible", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_weight_times_density_is_value(variant, kind, visible):
    rng = np.random.default_rng(5)
    count = 2000
    wi = sc.uniform_directions(rng, count)
    bsdf = sc.load(**KINDS[kind], **ANISOTROPIC, sample_visible=visible, material="Au")
    wo, drawn, weight = sc.sample(bsdf, wi, rng.random((count, 2)))
    valid = (weight > 0).all(axis=-1)
    assert valid.mean() > 0.3
    value, pdf = sc.evaluate(bsdf, wi[valid], wo[valid])
    assert (drawn[valid] > 0).all() and (pdf > 0).mean() > 0.999

    # The half vector of wi and the f32 wo is not exactly the normal that was drawn: the density is compared where it is not grazing,
    # and in the mean elsewhere.
    facing = (wo[valid][:, 2] > 0.05) & (wi[valid][:, 2] > 0.05)
    error = sc.relative_error(drawn[valid], pdf)
    steep = 50.0 if kind == "box" else 1.0
    print(f"density: {error[facing].max():.2e} facing, median {np.median(error):.2e}")
    assert np.median(error) < 2e-6 * steep
    assert error[facing].max() < 1e-3 * steep
    product = weight[valid] * drawn[valid][:, None]
    error = sc.relative_error(product, value)
    print(f"weight * density: {error[facing].max():.2e} facing, median {np.median(error):.2e}")
    assert np.median(error) < 2e-6 * steep
    assert error[facing].max() < 1e-3 * steep
