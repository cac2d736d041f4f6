"""What traverse() shows: every kind of number that Python has, values through attributes, refusals that change nothing."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc

SPECULAR = (sc.direction(40.0, 10.0), sc.direction(40.0, 190.0))
PLUGINS = ["sgtdconductor", "sgtddielectric", "sgtdplastic"]
#: sgtdplastic shows a number, as roughplastic does
ALPHA = {"sgtdplastic": "alpha"}


def number(params, key) -> float:
    return float(np.array(params[key]).item())


NUMBERS = {
    "float": lambda: 1.7,
    "int": lambda: 3,
    "float64": lambda: np.float64(1.7),
    "float32": lambda: np.float32(1.7),
    "0-d array": lambda: np.array(1.7),
    "Float": lambda: mi.Float(1.7),
    "opaque Float": lambda: dr.opaque(mi.Float, 1.7),
}


@pytest.mark.parametrize("kind", NUMBERS)
@pytest.mark.parametrize("plugin", PLUGINS)
def test_numbers_of_every_kind(llvm, plugin, kind):
    bsdf = sc.load(plugin, gamma=1.6, alpha=0.3)
    params = mi.traverse(bsdf)
    params["gamma"] = value = NUMBERS[kind]()
    params.update()
    # as good as given when it was made: single precision between the two loses nothing
    given = float(np.array(value).item())
    assert str(bsdf) == str(sc.load(plugin, gamma=round(given, 6), alpha=0.3))
    assert number(mi.traverse(bsdf), "gamma") == pytest.approx(given, rel=1e-7)


@pytest.mark.parametrize("kind", ["float", "int"])
def test_numbers_in_scalar_variants(scalar, kind):
    """Mitsuba itself compares an update with what is there, and knows Python's numbers alone in these variants."""
    bsdf = sc.load(gamma=1.6)
    params = mi.traverse(bsdf)
    params["gamma"] = NUMBERS[kind]()
    params.update()
    assert number(params, "gamma") == pytest.approx(NUMBERS[kind](), rel=1e-7)


def test_what_was_given_is_not_rounded(variant):
    """An update of one parameter leaves the others in double precision; an update is the decimal that was written."""
    shape = dict(gamma=1.7, p=1.1, shift=0.3, **{"lambda": 0.7})
    bsdf, other = sc.load(**shape), sc.load(**{**shape, "p": 1.3})
    params = mi.traverse(bsdf)
    params["p"] = 1.3
    params.update()
    for a, b in zip(sc.evaluate(bsdf, *SPECULAR), sc.evaluate(other, *SPECULAR)):
        assert np.array_equal(a, b)


def test_several_numbers_are_refused(llvm):
    bsdf = sc.load(gamma=1.6)
    params = mi.traverse(bsdf)
    params["gamma"] = mi.Float([1.6, 1.7])
    with pytest.raises(Exception, match=r"gamma.*2 numbers"):
        params.update()
    assert number(mi.traverse(bsdf), "gamma") == pytest.approx(1.6)


@pytest.mark.parametrize(
    "plugin, given",
    [
        ("sgtdconductor", {"gamma": 1.6, "p": 1.5, "lambda": 0.25, "shift": 0.5}),
        ("sgtdconductor", {"mu": 0.05}),
        ("sgtddielectric", {"gamma": 1.6, "p": 1.5, "lambda": 0.25, "shift": 0.5}),
        ("sgtddielectric", {"eta": None}),
        ("sgtdplastic", {"gamma": 1.6, "p": 1.5, "lambda": 0.25, "shift": 0.5, "eta": None}),
    ],
    ids=str,
)
def test_attributes(variant, plugin, given):
    bsdf = sc.load(plugin, **{k: v for k, v in given.items() if v is not None})
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = [0, 0, 1]
    for name, value in given.items():
        value = value if value is not None else number(mi.traverse(bsdf), name)
        assert np.all(np.array(bsdf.has_attribute(name)))
        assert np.array(bsdf.eval_attribute_1(name, si)).item() == pytest.approx(value, rel=1e-6)
        for call in (bsdf.eval_attribute, bsdf.eval_attribute_3):
            assert np.array(call(name, si)).ravel() == pytest.approx([value] * 3, rel=1e-6)
    assert not np.any(np.array(bsdf.has_attribute("gama")))
    assert np.array(bsdf.eval_attribute_1("alpha", si)).item() == pytest.approx(0.1)


def test_what_a_row_fixes_is_no_attribute(variant):
    assert not np.any(np.array(sc.load(distribution="student", gamma=1.6).has_attribute("p")))


def test_attributes_in_a_frozen_function(llvm):
    bsdf = sc.load(gamma=1.6)
    params = mi.traverse(bsdf)
    si = dr.zeros(mi.SurfaceInteraction3f)
    frozen = dr.freeze(lambda bsdf, si: bsdf.eval_attribute_1("gamma", si))
    for gamma in (1.6, 1.7, 1.8, 2.0, 1.9):
        params["gamma"] = gamma
        params.update()
        assert frozen(bsdf, si).numpy().item() == pytest.approx(gamma)


# -- refused updates

BAD = [
    ("sgtdconductor", {"alpha": 0.25}, "alpha.value", "alpha", [math.nan, math.inf, -math.inf, -0.2]),
    ("sgtdconductor", {"alpha_u": 0.25, "alpha_v": 0.1}, "alpha_v.value", "alpha_v", [math.nan, math.inf, -0.2]),
    ("sgtdconductor", {"alpha": 0.25, "gamma": 1.7, "multiple_scattering": True}, "alpha.value", "alpha", [math.nan]),
    ("sgtdconductor", {"alpha": {"type": "uniform", "value": 0.2}}, "alpha.value", "alpha", [math.nan, -1.0]),
    ("sgtdconductor", {"eta": 1.5, "k": 2.0}, "eta.value", "eta", [math.nan, math.inf]),
    ("sgtdconductor", {"eta": 1.5, "k": 2.0}, "k.value", "k", [math.nan]),
    (
        "sgtdconductor",
        {"specular_reflectance": 0.5},
        "specular_reflectance.value",
        "specular_reflectance",
        [math.nan, math.inf],
    ),
    ("sgtddielectric", {"alpha": 0.25}, "alpha.value", "alpha", [math.nan, math.inf, -0.2]),
    ("sgtddielectric", {"alpha_u": 0.25, "alpha_v": 0.1}, "alpha_u.value", "alpha_u", [math.nan]),
    ("sgtddielectric", {}, "eta", "eta", [math.nan, math.inf, 0.0, -1.0]),
    ("sgtdplastic", {"alpha": 0.25, "gamma": 1.7}, "alpha", "alpha", [math.nan, math.inf, -0.2]),
    ("sgtdplastic", {"alpha_u": 0.25, "alpha_v": 0.1}, "alpha_u", "alpha_u", [math.nan]),
    ("sgtdplastic", {"gamma": 1.7}, "eta", "eta", [math.nan, math.inf, 0.0, -1.0]),
    ("sgtdplastic", {"diffuse_reflectance": 0.4}, "diffuse_reflectance.value", "diffuse_reflectance", [math.nan]),
    (
        "sgtddielectric",
        {"specular_transmittance": 0.5},
        "specular_transmittance.value",
        "specular_transmittance",
        [math.nan],
    ),
]


@pytest.mark.parametrize("plugin, given, key, name, values", BAD, ids=lambda x: str(x)[:40])
def test_bad_updates_are_refused_and_undone(variant, plugin, given, key, name, values):
    bsdf = sc.load(plugin, **given)
    words, before = str(bsdf), sc.evaluate(bsdf, *SPECULAR)
    for value in values:
        params = mi.traverse(bsdf)
        last = number(params, key)
        params[key] = value
        if "gamma" in params:  # a good value beside a bad one is not taken either
            params["gamma"] = 1.55
        with pytest.raises(Exception, match=rf'"{name}" is -?(nan|inf|\d)'):
            params.update()
        assert number(mi.traverse(bsdf), key) == last
        assert str(bsdf) == words
        assert all(np.array_equal(a, b) for a, b in zip(sc.evaluate(bsdf, *SPECULAR), before))
    # and a good one is accepted afterwards
    params = mi.traverse(bsdf)
    params[key] = 0.35
    params.update()
    assert number(mi.traverse(bsdf), key) == pytest.approx(0.35)


@pytest.mark.parametrize("plugin", PLUGINS)
def test_a_bad_shape_takes_the_others_back(variant, plugin):
    """The roughness and the index that came with a refused shape stay what they were as well."""
    bsdf = sc.load(plugin, gamma=1.8, alpha=0.25)
    words, before = str(bsdf), sc.evaluate(bsdf, *SPECULAR)
    params = mi.traverse(bsdf)
    params["gamma"] = 0.5
    params[ALPHA.get(plugin, "alpha.value")] = 0.4
    if plugin != "sgtdconductor":
        params["eta"] = 1.3
    with pytest.raises(Exception, match=r"gamma.*0\.5"):
        params.update()
    assert str(bsdf) == words
    assert all(np.array_equal(a, b) for a, b in zip(sc.evaluate(bsdf, *SPECULAR), before))


# -- derivatives


def test_mu_needs_an_update_for_a_derivative_by_alpha(llvm):
    """At a fixed shift it would be off by .28: without the tables for it, it is refused by name."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(SPECULAR[0])
    bsdf = sc.load(mu=0.1, alpha=0.2)
    params = mi.traverse(bsdf)
    dr.enable_grad(params["alpha.value"])
    with pytest.raises(Exception, match="mu.*update.*alpha"):
        bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(SPECULAR[1]))
    # by other parameters, derivatives are there
    bsdf = sc.load(mu=0.1, alpha=0.2, specular_reflectance=0.5)
    params = mi.traverse(bsdf)
    dr.enable_grad(params["specular_reflectance.value"])
    params.update()
    dr.backward(dr.sum(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(SPECULAR[1]))[0]))
    assert dr.grad(params["specular_reflectance.value"]).numpy().item() > 0


@pytest.mark.parametrize("integrator", ["path", "prb"])
def test_mu_in_the_gradient_of_a_render(llvm, integrator):
    film = {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}}
    view = mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": integrator, "max_depth": 3},
            "light": {"type": "constant"},
            "sensor": {"type": "perspective", "to_world": view, "film": film},
            "sphere": {"type": "sphere", "bsdf": {"type": "sgtdconductor", "alpha": 0.3, "mu": 0.1}},
        }
    )
    params = mi.traverse(scene)
    key = next(key for key in params.keys() if key.endswith("alpha.value"))
    dr.enable_grad(params[key])
    with pytest.raises(Exception) as caught:
        dr.backward(dr.mean(mi.render(scene, params, spp=4), axis=None))
    error, words = caught.value, ""
    while error is not None:
        words, error = words + str(error), error.__cause__ or error.__context__
    assert "mu" in words and "update" in words


def test_mu_follows_an_optimizer_that_needs_no_derivative(llvm):
    bsdf = sc.load(mu=0.1, alpha=0.2)
    params = mi.traverse(bsdf)
    for alpha in (0.3, 0.25, 0.4):
        params["alpha.value"] = dr.opaque(mi.Float, alpha)
        params.update()
        fresh = sc.load(mu=0.1, alpha=alpha)
        assert sc.evaluate(bsdf, *SPECULAR)[0] == pytest.approx(sc.evaluate(fresh, *SPECULAR)[0], rel=1e-4)


# -- albedo


@pytest.mark.parametrize(
    "plugin, given, expected",
    [
        ("sgtdconductor", {"alpha": 0.25}, [1.0] * 3),
        ("sgtdconductor", {"alpha": 0.02, "gamma": 1.7}, [1.0] * 3),
        ("sgtdconductor", {"material": "Au", "gamma": 1.7}, None),
        ("sgtdconductor", {"eta": 0.5, "k": 2.0, "specular_reflectance": 0.5}, [0.5 * 4.25 / 6.25] * 3),
        ("sgtdconductor", {"specular_reflectance": 3.0}, [1.0] * 3),
        ("sgtddielectric", {"alpha": 0.25}, [1.0] * 3),
        ("sgtddielectric", {"int_ior": 3.0, "ext_ior": 1.0, "specular_reflectance": 0.0}, [0.75] * 3),
        ("sgtddielectric", {"int_ior": 3.0, "ext_ior": 1.0, "specular_transmittance": 0.0}, [0.25] * 3),
        ("sgtdplastic", {"diffuse_reflectance": 0.3}, [0.3] * 3),
    ],
    ids=lambda x: str(x)[:50],
)
def test_albedo(variant, plugin, given, expected):
    """Of denoisers: within [0, 1], whatever the view and the roughness. At normal incidence it is that of the smooth surface."""
    bsdf = sc.load(plugin, **given)
    seen = []
    for wi in (sc.direction(0.0), sc.direction(40.0), sc.direction(89.0, 70.0)):
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(wi)
        seen.append(np.array(bsdf.eval_diffuse_reflectance(si)).ravel())
    assert np.array_equal(seen[0], seen[1]) and np.array_equal(seen[0], seen[2])
    assert (seen[0] >= 0).all() and (seen[0] <= 1).all()
    if expected is None:
        red, _, blue = seen[0]
        assert 0.9 < red < 1 and 0.2 < blue < 0.5
    else:
        assert seen[0] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("name", ["scalar_spectral_polarized", "llvm_ad_mono", "scalar_spectral"])
def test_albedo_in_other_variants(name):
    import conftest

    conftest.use(name)
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = [0.0, 0.0, 1.0]
    if "spectral" in name:
        si.wavelengths = [450.0, 520.0, 580.0, 650.0]
    for plugin, given in (("sgtdconductor", {"material": "Al"}), ("sgtddielectric", {})):
        value = np.array(sc.channel(sc.load(plugin, **given).eval_diffuse_reflectance(si))).ravel()
        assert (value > 0.8).all() and (value <= 1).all()


# -- textures without a mean


@pytest.mark.parametrize("varying", ["alpha_u", "alpha_v", "both", "alpha"])
def test_a_texture_without_a_mean_can_be_a_roughness(variant, varying):
    """Its light that is scattered twice is that of the isotropic mean, as for a bitmap."""
    rough = {"type": "mesh_attribute", "name": "vertex_rough"}
    given = {"alpha": {"alpha": rough}, "both": {"alpha_u": rough, "alpha_v": dict(rough)}}.get(
        varying, {"alpha_u": 0.2, "alpha_v": 0.2, varying: rough}
    )
    bsdf = sc.load(gamma=1.7, multiple_scattering=True, **given)
    params = mi.traverse(bsdf)
    params["gamma"] = 1.8
    params.update()
    assert "gamma = 1.8" in str(bsdf)


def test_a_python_texture_can_be_a_roughness(variant):
    class Constant(mi.Texture):
        def __init__(self, props):
            mi.Texture.__init__(self, props)

        def eval_1(self, si, active=True):
            return mi.Float(0.3)

        def to_string(self):
            return "Constant[]"

    name = f"constant_{variant}"
    mi.register_texture(name, lambda props: Constant(props))
    bsdf = sc.load(gamma=1.7, multiple_scattering=True, alpha_u={"type": name}, alpha_v=0.3)
    value, pdf = sc.evaluate(bsdf, *SPECULAR)
    assert np.isfinite(value).all() and (value > 0).all() and (pdf > 0).all()
