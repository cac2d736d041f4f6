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
    rng = np.random.default_rng(1)
    properties = dict(distribution=distribution, material="Au", sample_visible=visible, **ROUGHNESS[roughness](rng))
    ours, theirs = (sc.load(plugin, **properties) for plugin in ("sgtdconductor", "roughconductor"))

    # the full number where both roughnesses and the texture lookup take part, fewer elsewhere in the slow variant
    count = COUNT if variant != "scalar_rgb" or (roughness == "textured_anisotropic" and visible) else COUNT // 20
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


def test_defaults_are_ggx(variant):
    """All defaults together are GGX at roughness 0.1."""
    rng = np.random.default_rng(2)
    wi = sc.uniform_directions(rng, 2000)
    wo = sc.reflect(wi, sc.normals(rng, 2000, 0.1, 0.1, reach=0.5))
    found, _ = sc.evaluate(sc.load(accuracy=0.0), wi, wo)
    expected, _ = sc.evaluate(sc.load("roughconductor", distribution="ggx"), wi, wo)
    assert np.count_nonzero(expected) > 1000
    error = sc.relative_error(found, expected, floor=1e-20)
    assert error.max() < 2e-5, wi[error.max(axis=-1).argmax()]
