"""Does bounded sampling draw reflections that can happen, without a bias, and with the noise that it promises?"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc

COUNT = 2**20


def samples(degrees, **properties):
    """Weights of a mirror, and whether they are lost."""
    bsdf = sc.load(**properties)
    si = dr.zeros(mi.SurfaceInteraction3f, COUNT)
    si.wi = mi.Vector3f(sc.direction(degrees, 0.0))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(5, COUNT)
    _, weight = bsdf.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())
    return np.array(weight[0], dtype=np.float64)


@pytest.mark.parametrize("alpha, permitted", [(1.0, 0.16), (0.3, 0.085)])
def test_ggx_has_the_noise_of_spherical_caps(llvm, alpha, permitted):
    """Variance over the square of the mean at 60 degrees: that of bounded spherical caps, and the mean of Mitsuba's GGX."""
    ggx = {"distribution": "ggx", "alpha": alpha, "masking": "height_correlated"}
    bounded, plain = samples(60.0, sample_bounded=True, **ggx), samples(60.0, **ggx)
    assert bounded.var() / bounded.mean() ** 2 <= permitted
    noise = np.hypot(bounded.std(), plain.std()) / COUNT**0.5
    assert abs(bounded.mean() - plain.mean()) < 4.5 * noise + 1e-3 * plain.mean()


@pytest.mark.parametrize("shape", [{"gamma": 1.6}, {"gamma": 2.2, "p": 1.6, "lambda": -0.4, "shift": 0.8}])
@pytest.mark.parametrize("roughness", [{"alpha": 0.7}, {"alpha_u": 0.5, "alpha_v": 0.15}])
@pytest.mark.parametrize("degrees", [5.0, 50.0, 82.0])
def test_bounds_take_noise_and_nothing_else(llvm, shape, roughness, degrees):
    """The mean is that of all visible normals, the noise is lower, and with one roughness next to nothing is lost.

    With two, the radius may end beyond nearly all slopes: then as much is lost as without it.
    """
    bounded, plain = (
        samples(degrees, **shape, **roughness),
        samples(degrees, sample_bounded=False, **shape, **roughness),
    )
    noise = np.hypot(bounded.std(), plain.std()) / COUNT**0.5
    assert abs(bounded.mean() - plain.mean()) < 4.5 * noise
    assert bounded.var() < plain.var()
    assert np.mean(bounded == 0.0) <= (0.01 if "alpha" in roughness else np.mean(plain == 0.0))


def test_bounds_and_all_normals_do_not_go_together(llvm):
    with pytest.raises(RuntimeError, match="sample_bounded.*sample_visible"):
        sc.load(gamma=1.6, sample_bounded=True, sample_visible=False)
