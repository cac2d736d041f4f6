"""Is the plugin made, described, changed and refused as its documentation says, in every variant?"""

import math
import re

import conftest
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc
from family import ROWS

VARIANTS = [
    "scalar_rgb",
    "scalar_spectral",
    "scalar_spectral_polarized",
    "llvm_ad_rgb",
    "llvm_ad_mono",
    "llvm_ad_mono_polarized",
    "llvm_ad_spectral",
    "llvm_ad_spectral_polarized",
    "cuda_ad_rgb",
    "cuda_ad_mono",
    "cuda_ad_mono_polarized",
    "cuda_ad_spectral",
    "cuda_ad_spectral_polarized",
]

SPECULAR = (sc.direction(40.0, 10.0), sc.direction(40.0, 190.0))


def test_the_list_of_variants_is_complete():
    assert sorted(mi.variants()) == sorted(VARIANTS)


@pytest.mark.parametrize("variant", VARIANTS)
def test_gold_in_every_variant(variant):
    """Gold is where a wrong ABI shows: the plugin loads, and fails in its spectra."""
    conftest.use(variant)
    bsdf = sc.load(material="Au", gamma=1.8, shift=0.2)
    value, pdf = sc.evaluate(bsdf, *SPECULAR)
    theirs, _ = sc.evaluate(sc.load("roughconductor", material="Au", distribution="ggx"), *SPECULAR)
    assert value.shape == theirs.shape and np.isfinite(value).all() and pdf[0] > 0
    # Fresnel alone makes the color
    assert (value > 0).all()
    assert value / value.mean() == pytest.approx(theirs / theirs.mean(), rel=1e-5)
    if "rgb" in variant:
        red, _, blue = value[0]
        assert red > 1.5 * blue


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_plugin_holds_code_for_every_variant(variant):
    """Variants that cannot run here (no GPU) are at least in the library that Mitsuba loads."""
    import sgtd

    library = (sgtd.plugin_dir(mi.__version__) / "plugins" / "sgtdconductor.so").read_bytes()
    # names of types, not of functions, which are there as well where debug symbols are
    names = set(re.findall(rb"(?<=\0)N7mitsuba13SgtdConductorI[\w]+(?=\0)", library))
    backend = {
        "scalar": rb"13SgtdConductorIf",
        "llvm": rb"DiffArrayIL10JitBackend2E",
        "cuda": rb"DiffArrayIL10JitBackend1E",
    }
    color = rb"NS_5ColorI" if "rgb" in variant else rb"NS_8SpectrumI" if "spectral" in variant else rb"NS_5ColorI"
    found = [name for name in names if backend[variant.split("_")[0]] in name and color in name]
    assert found, names
    assert any(b"MuellerMatrix" in name or b"6MatrixI" in name for name in found) >= ("polarized" in variant)
    assert len(names) == len(VARIANTS)


@pytest.mark.parametrize("row", ROWS)
def test_every_row(variant, row):
    bsdf = sc.load(**ROWS[row], alpha=0.3)
    value, pdf = sc.evaluate(bsdf, *SPECULAR)
    assert (value > 0).all() and (pdf > 0).all()
    # rows differ: none is silently another one
    others = [
        sc.evaluate(sc.load(**other, alpha=0.3), *SPECULAR)[0][0, 0] for name, other in ROWS.items() if name != row
    ]
    assert min(abs(value[0, 0] / other - 1) for other in others) > 1e-3
    assert ROWS[row]["distribution"] in str(bsdf)


EQUAL_ROWS = {
    "student is sgtd": (dict(distribution="student", gamma=1.6), dict(gamma=1.6)),
    "gtd is sgtd": (dict(distribution="gtd", gamma=1.6, p=1.4), dict(gamma=1.6, p=1.4)),
    "std is sgtd": (dict(distribution="std", gamma=1.6, **{"lambda": 0.3}), dict(gamma=1.6, **{"lambda": 0.3})),
    "sgnd is sgtd": (
        dict(distribution="sgnd", p=1.4, **{"lambda": 0.3}),
        dict(gamma=math.inf, p=1.4, **{"lambda": 0.3}),
    ),
    "gnd is sgnd": (dict(distribution="gnd", p=1.4), dict(distribution="sgnd", p=1.4)),
    "snd is sgnd": (dict(distribution="snd", **{"lambda": 0.3}), dict(distribution="sgnd", **{"lambda": 0.3})),
    "beckmann is snd": (dict(distribution="beckmann", shift=0.5), dict(distribution="snd", shift=0.5)),
    "ggx is student": (dict(distribution="ggx", shift=0.5), dict(distribution="student", shift=0.5)),
    "names in capitals": (dict(distribution="GGX", shift=0.5), dict(distribution="ggx", shift=0.5)),
    "mu is shift times alpha": (dict(gamma=1.8, mu=0.15), dict(gamma=1.8, shift=0.5)),
    "alpha_u = alpha_v is alpha": (dict(gamma=1.8, alpha_u=0.3, alpha_v=0.3), dict(gamma=1.8)),
    # (q-1) (2 sigma^2)^(q-1) / (pi cos^4 (2 sigma^2 + tan^2)^q) with q = 2.3, sigma = 0.3
    "hyper_cauchy is student": (
        dict(distribution="hyper_cauchy", gamma=2.3),
        dict(distribution="student", gamma=2.3, alpha=0.3 * math.sqrt(2 / 1.3)),
    ),
}


@pytest.mark.parametrize("pair", EQUAL_ROWS)
def test_equal_rows(variant, pair):
    a, b = EQUAL_ROWS[pair]
    rng = np.random.default_rng(6)
    wi = sc.uniform_directions(rng, 300)
    wo = sc.reflect(wi, sc.normals(rng, 300, 0.3, 0.3, reach=0.5))
    values = [sc.evaluate(sc.load(**({} if "alpha_u" in x else {"alpha": 0.3}) | x), wi, wo)[0] for x in (a, b)]
    assert np.count_nonzero(values[0]) > 200
    assert sc.relative_error(*values, floor=1e-12).max() < 2e-5


# -- traverse and update


def free_parameters():
    return {
        "gamma": (dict(gamma=1.8), 2.6),
        "p": (dict(p=1.3), 2.0),
        "lambda": (dict(**{"lambda": 0.3}), -0.5),
        "shift": (dict(shift=0.3), 1.1),
        "mu": (dict(mu=0.06), 0.22),
        "alpha.value": (dict(alpha=0.2, gamma=1.7), 0.45),
        "alpha_u.value": (dict(alpha_u=0.2, alpha_v=0.1, gamma=1.7), 0.45),
        "eta.value": (dict(eta=0.2, k=3.0, gamma=1.7), 1.5),
        "specular_reflectance.value": (dict(specular_reflectance=0.8, gamma=1.7), 0.5),
    }


@pytest.mark.parametrize("name", free_parameters())
def test_update_equals_a_new_material(variant, name):
    given, new = free_parameters()[name]
    if not {"alpha", "alpha_u"} & set(given):
        given = dict(given, alpha=0.2)
    bsdf = sc.load(**given)
    before = sc.evaluate(bsdf, *SPECULAR)[0]
    params = mi.traverse(bsdf)
    assert name in params
    params[name] = new
    params.update()
    fresh = sc.load(**{**given, name.split(".")[0]: new})
    after, expected = (sc.evaluate(b, *SPECULAR)[0] for b in (bsdf, fresh))
    assert after == pytest.approx(expected, rel=1e-6)
    assert abs(after / before - 1).max() > 1e-3
    rng = np.random.default_rng(7)
    u = rng.random((200, 2))
    for found, wanted in zip(sc.sample(bsdf, SPECULAR[0], u), sc.sample(fresh, SPECULAR[0], u)):
        assert np.allclose(found, wanted, rtol=1e-5, atol=1e-6, equal_nan=True)


def test_mu_follows_alpha(variant):
    bsdf = sc.load(mu=0.1, alpha=0.2)
    params = mi.traverse(bsdf)
    params["alpha.value"] = 0.4
    params.update()
    value = sc.evaluate(bsdf, *SPECULAR)[0]
    assert value == pytest.approx(sc.evaluate(sc.load(shift=0.25, alpha=0.4), *SPECULAR)[0], rel=1e-5)


@pytest.mark.parametrize(
    "given", [dict(gamma=1.2, p=2.0), dict(gamma=6.5, p=0.3), dict(gamma=1.05, p=30.0, shift=2.0)], ids=str
)
def test_each_parameter_is_read(scalar, given):
    """A value that would be out of range at the defaults of the others is still this material's."""
    import sgtd

    bsdf = sc.load(alpha=0.3, **given, accuracy=0.0)
    assert set(given) <= set(mi.traverse(bsdf).keys())
    w = sc.direction(40.0).astype(np.float32).astype(np.float64)
    w /= np.linalg.norm(w)
    ndf = sgtd.Ndf(**given, alpha=0.3, accuracy=0.0)
    value = sc.evaluate(bsdf, w, w)[0][0, 0]
    assert value == pytest.approx(ndf.d(w) * ndf.g1(w) ** 2 / (4 * w[2]), rel=1e-4)


def test_a_refused_update_changes_nothing(variant):
    bsdf = sc.load(gamma=1.8, alpha=0.3)
    before = sc.evaluate(bsdf, *SPECULAR)[0]
    params = mi.traverse(bsdf)
    params["gamma"] = 0.5
    with pytest.raises(Exception, match=r"gamma.*0\.5"):
        params.update()
    assert (sc.evaluate(bsdf, *SPECULAR)[0] == before).all()
    assert "gamma = 1.8" in str(bsdf)


def test_tables_are_not_parameters(variant):
    keys = set(mi.traverse(sc.load(gamma=1.8, shift=0.2)).keys())
    assert keys == {"alpha.value", "eta.value", "k.value", "gamma", "p", "lambda", "shift"}
    keys = set(mi.traverse(sc.load(distribution="gnd", p=1.4, specular_reflectance=0.5)).keys())
    assert keys == {"alpha.value", "eta.value", "k.value", "p", "shift", "specular_reflectance.value"}


def test_flags_of_parameters(llvm):
    """What can be differentiated says so."""
    params = mi.traverse(sc.load(gamma=1.8, alpha=0.2))
    flags = {key: int(params.flags(key)) for key in params.keys()}
    assert not flags["gamma"] & int(mi.ParamFlags.NonDifferentiable)
    assert not flags["alpha.value"] & int(mi.ParamFlags.NonDifferentiable)
    assert flags["alpha.value"] & int(mi.ParamFlags.Discontinuous)


@pytest.mark.parametrize("row", ["sgtd", "gnd", "beckmann_centered"])
def test_description_is_the_same_every_time(variant, row):
    first, second = (str(sc.load(**ROWS[row], alpha=0.3)) for _ in range(2))
    assert first == second
    assert "0x" not in first
    for value in ROWS[row].values():
        assert str(value) in first


# -- flags and components


@pytest.mark.parametrize("roughness, anisotropic", [(dict(alpha=0.2), False), (dict(alpha_u=0.2, alpha_v=0.1), True)])
@pytest.mark.parametrize("row", ["sgtd", "ggx_centered"])
def test_flags_and_components(variant, row, roughness, anisotropic):
    bsdf = sc.load(**ROWS[row], **roughness)
    theirs = sc.load("roughconductor", **roughness)

    def check():
        assert bsdf.flags() == theirs.flags()
        assert mi.has_flag(bsdf.flags(), mi.BSDFFlags.Anisotropic) == anisotropic
        assert bsdf.component_count() == 1
        assert bsdf.flags(0) == bsdf.flags()

    check()
    params = mi.traverse(bsdf)
    for step in range(3):
        key = next(key for key in params.keys() if key.startswith("alpha"))
        params[key] = 0.15 + 0.1 * step
        params.update()
        check()


# -- bad input

TEXTURE = object()

BAD = {
    "gamma 1": (dict(gamma=1.0), ["gamma", "1"]),
    "gamma 0": (dict(gamma=0.0), ["gamma", "0"]),
    "gamma -inf": (dict(gamma=-math.inf), ["gamma", "-inf"]),
    "gamma nan": (dict(gamma=math.nan), ["gamma", "nan"]),
    "2 p gamma = 3": (dict(gamma=1.5), ["gamma", "1.5", "p", "3"]),
    "2 p gamma < 3": (dict(gamma=2.0, p=0.5), ["gamma", "2", "p", "0.5", "3"]),
    "p 0": (dict(p=0.0), ["p", "0"]),
    "p nan": (dict(p=math.nan), ["p", "nan"]),
    "p inf": (dict(p=math.inf), ["p", "inf"]),
    "p negative": (dict(p=-1.0), ["p", "-1"]),
    "lambda 1": (dict(**{"lambda": 1.0}), ["lambda", "1"]),
    "lambda -1": (dict(**{"lambda": -1.0}), ["lambda", "-1"]),
    "lambda nan": (dict(**{"lambda": math.nan}), ["lambda", "nan"]),
    "shift negative": (dict(shift=-0.5), ["shift", "-0.5"]),
    "shift nan": (dict(shift=math.nan), ["shift", "nan"]),
    "shift inf": (dict(shift=math.inf), ["shift", "inf"]),
    "mu negative": (dict(mu=-0.5), ["mu", "-0.5"]),
    "mu nan": (dict(mu=math.nan), ["mu", "nan"]),
    "mu and shift": (dict(mu=0.1, shift=0.5), ["mu", "shift"]),
    "mu with two roughnesses": (dict(mu=0.1, alpha_u=0.1, alpha_v=0.2), ["mu", "alpha"]),
    "mu with a texture": (dict(mu=0.1, alpha=TEXTURE), ["mu", "alpha"]),
    "unknown distribution": (dict(distribution="phong"), ["distribution", "phong", "beckmann", "hyper_cauchy"]),
    "unknown masking": (dict(masking="none"), ["masking", "none", "height_correlated"]),
    "ggx with gamma": (dict(distribution="ggx", gamma=2.5), ["ggx", "gamma", "2.5"]),
    "ggx with its own gamma": (dict(distribution="ggx", gamma=2.0), ["ggx", "gamma", "2"]),
    "student with p": (dict(distribution="student", p=1.5), ["student", "p", "1.5"]),
    "gtd with lambda": (dict(distribution="gtd", **{"lambda": 0.5}), ["gtd", "lambda", "0.5"]),
    "beckmann with gamma": (dict(distribution="beckmann", gamma=3.0), ["beckmann", "gamma", "3"]),
    "alpha inf": (dict(alpha=math.inf), ["alpha", "inf"]),
    "eta nan": (dict(eta=math.nan), ["eta", "nan"]),
    "k inf": (dict(k=math.inf), ["k", "inf"]),
    "eta with a part that is nan": (dict(eta={"type": "rgb", "value": [math.nan, 1.0, 1.0]}), ["eta", "nan"]),
    "specular_reflectance inf": (dict(specular_reflectance=math.inf), ["specular_reflectance", "inf"]),
    "alpha nan": (dict(alpha=math.nan), ["alpha", "nan"]),
    "alpha_u alone": (dict(alpha_u=0.1), ["alpha_u", "alpha_v"]),
    "alpha and alpha_u": (dict(alpha=0.1, alpha_u=0.1, alpha_v=0.2), ["alpha", "alpha_u"]),
    "accuracy negative": (dict(accuracy=-1.0), ["accuracy", "-1"]),
    "accuracy nan": (dict(accuracy=math.nan), ["accuracy", "nan"]),
    "typo": (dict(gama=1.8), ["gama"]),
    "typo in a fixed row": (dict(distribution="ggx", smaple_visible=True), ["smaple_visible"]),
    "material and eta": (dict(material="Au", eta=0.2), ["material", "eta"]),
    "unknown material": (dict(material="Unobtainium"), ["Unobtainium"]),
    "word for a number": (dict(gamma="two"), ["gamma"]),
    "number for a switch": (dict(multiple_scattering=1.0), ["multiple_scattering"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(variant, case):
    properties, words = BAD[case]
    properties = {k: np.full((2, 2), 0.2) if v is TEXTURE else v for k, v in properties.items()}
    with pytest.raises(Exception) as caught:
        sc.load(**properties)
    message = str(caught.value)
    for word in words:
        assert re.search(rf"(?<![\w.]){re.escape(word)}(?![\w]|\.[1-9])", message, re.IGNORECASE), (word, message)


@pytest.mark.parametrize("case", ["gamma 1", "shift negative", "unknown distribution", "typo", "mu and shift"])
def test_bad_input_in_xml(scalar, case):
    properties, words = BAD[case]
    kind = lambda v: "string" if isinstance(v, str) else "float"
    inner = "".join(f'<{kind(v)} name="{k}" value="{v}"/>' for k, v in properties.items())
    with pytest.raises(Exception) as caught:
        mi.load_string(f'<bsdf version="3.0.0" type="sgtdconductor">{inner}</bsdf>')
    for word in words:
        assert word in str(caught.value)


def test_every_documented_property_is_accepted_in_xml(scalar):
    bsdf = mi.load_string(
        """<bsdf version="3.0.0" type="sgtdconductor">
            <string name="material" value="Au"/> <string name="distribution" value="sgtd"/>
            <float name="gamma" value="1.8"/> <float name="p" value="1.2"/> <float name="lambda" value="0.1"/> <float name="shift" value="0.2"/>
            <float name="alpha_u" value="0.1"/> <float name="alpha_v" value="0.3"/>
            <rgb name="specular_reflectance" value="0.9, 0.8, 0.7"/>
            <boolean name="sample_visible" value="false"/> <string name="masking" value="height_correlated"/>
            <boolean name="multiple_scattering" value="true"/>
        </bsdf>"""
    )
    assert "height_correlated" in str(bsdf) and "sample_visible = 0" in str(bsdf)
    # gamma = inf from XML
    assert "inf" in str(
        mi.load_string('<bsdf version="3.0.0" type="sgtdconductor"><float name="gamma" value="inf"/></bsdf>')
    )
