"""Whatever a built-in loads and renders, its drop-in loads and renders alike.

One table of property values of every kind, good and bad, goes through both plugins; where the built-in gives finite
numbers, ours must agree. What ours refuses (not a number, infinite) gives no finite image in the built-in either.
"""

from __future__ import annotations

import math

import conftest
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc

NAN, INF = math.nan, math.inf


def rgb(*values):
    return {"type": "rgb", "value": list(values)}


def spectrum(*pairs):
    return {"type": "spectrum", "value": list(pairs)}


def image(values):
    return lambda: sc.texture(np.asarray(values, dtype=np.float32))


RNG = np.random.default_rng(31)
VALUES = {
    "nan": NAN,
    "inf": INF,
    "-inf": -INF,
    "-0.5": -0.5,
    "0": 0.0,
    "-0": -0.0,
    "1e-40": 1e-40,
    "1e-9": 1e-9,
    "1": 1.0,
    "2": 2.0,
    "50": 50.0,
    "1e6": 1e6,
    "1e39": 1e39,
    "whole 2": 2,
    "whole 0": 0,
    "true": True,
    "a word": "rough",
    "a number in quotes": "0.5",
    "rgb": rgb(0.2, 0.5, 0.9),
    "rgb of gold in a living room": rgb(-0.0485, 4.14, 4.67),
    "rgb with nan": rgb(NAN, 1.0, 1.0),
    "rgb with inf": rgb(INF, 1.0, 1.0),
    "rgb 0": rgb(0.0, 0.0, 0.0),
    "rgb above 1": rgb(1.5, 2.0, 3.0),
    "spectrum": spectrum((400.0, 0.3), (700.0, 0.9)),
    "spectrum of one number": {"type": "spectrum", "value": 0.5},
    "spectrum with a negative part": spectrum((400.0, -0.3), (700.0, 0.9)),
    "spectrum above 1": spectrum((400.0, 2.0), (700.0, 5.0)),
    "uniform": {"type": "uniform", "value": 0.4},
    "uniform below 0": {"type": "uniform", "value": -0.4},
    "rawconstant": {"type": "rawconstant", "value": 0.4},
    "d65": {"type": "d65"},
    "checkerboard": {"type": "checkerboard", "color0": 0.1, "color1": 0.7},
    "bitmap": image(RNG.uniform(0.05, 0.9, (4, 4))),
    "bitmap with negative texels": image(RNG.uniform(-0.9, 0.9, (4, 4))),
    "bitmap of zeros": image(np.zeros((3, 3))),
    "bitmap above 1": image(RNG.uniform(1.0, 5.0, (3, 3))),
    "volume": {"type": "volume", "volume": {"type": "constvolume", "value": 0.3}},
}
METAL = {
    "nothing": {},
    "negative eta and k": dict(eta=-1.0, k=-2.0),
    "eta 0, k 0": dict(eta=0.0, k=0.0),
    "a material": dict(material="Au"),
    "a material in capitals": dict(material="AU"),
    "material none": dict(material="none"),
    "material none and eta": dict(material="none", eta=0.3),
    "material None": dict(material="None"),
    "no name of a material": dict(material=""),
    "a material and eta": dict(material="Au", eta=0.3),
    "a material and k": dict(material="Au", k=0.3),
    "all roughnesses": dict(alpha=0.1, alpha_u=0.1, alpha_v=0.1),
    "one roughness of two": dict(alpha_u=0.1),
    "distribution in capitals": dict(distribution="GGX"),
    "distribution as nobody has it": dict(distribution="phong"),
    "sample_visible off": dict(sample_visible=False),
    "sample_visible 1": dict(sample_visible=1),
    "sample_visible in quotes": dict(sample_visible="true"),
    "a typo": dict(alhpa=0.1),
    **{metal: dict(material=metal) for metal in ("Ag", "Al", "a-C", "Cu", "W", "Cr", "CuO", "SiC", "Te", "VN")},
}
GLASS = {
    "nothing": {},
    "equal": dict(int_ior=1.5, ext_ior=1.5),
    "equal names": dict(int_ior="water", ext_ior="water"),
    "names in capitals": dict(int_ior="WATER", ext_ior="Vacuum"),
    "a name of two words": dict(int_ior="fused quartz"),
    "an unknown name": dict(int_ior="unobtainium"),
    "a number in quotes": dict(int_ior="1.5"),
    "inside out": dict(int_ior=1.0, ext_ior=1.5),
    "0": dict(int_ior=0.0, ext_ior=0.0),
    "great": dict(int_ior=100.0),
    "distribution in capitals": dict(distribution="BECKMANN"),
    "eta": dict(eta=1.5),
    "a metal": dict(material="Au"),
}
PAIRS = {"metal": ("roughconductor", "sgtdconductor"), "glass": ("roughdielectric", "sgtddielectric")}


def cases():
    for kind, names, others in (
        ("metal", ("alpha", "alpha_u", "alpha_v", "eta", "k", "specular_reflectance"), METAL),
        ("glass", ("alpha", "int_ior", "ext_ior", "specular_reflectance", "specular_transmittance"), GLASS),
    ):
        for name in names:
            other = {"alpha_u": {"alpha_v": 0.2}, "alpha_v": {"alpha_u": 0.2}}.get(name, {})
            for words, value in VALUES.items():
                yield kind, f"{name} is {words}", {name: value, **other}
        for words, given in others.items():
            yield kind, words, given


def fresh(value):
    """A description that can be loaded: tensors are used up."""
    return value() if callable(value) else dict(value) if isinstance(value, dict) else value


def numbers(plugin, glass, given):
    """None if it cannot be loaded or run, else the message of the first and the values, densities and samples."""
    try:
        bsdf = mi.load_dict({"type": plugin, **{name: fresh(value) for name, value in given.items()}})
    except Exception as error:
        return str(error), None
    rng = np.random.default_rng(5)
    wi = sc.uniform_directions(rng, 24, lower=glass)
    m = sc.normals(rng, 24, 0.2, 0.2, reach=0.5)
    wo = sc.reflect(wi, m)
    if glass:
        wo[::2] = sc.refract(wi, m, 1.5)[0][::2]
    u, uv = rng.random((24, 3)), rng.random((24, 2))
    try:
        return "", (*sc.evaluate(bsdf, wi, wo, uv), *sc.sample(bsdf, wi, u, uv))
    except RuntimeError as error:
        return str(error), None


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb", "scalar_spectral", "llvm_ad_mono_polarized"])
def test_what_a_built_in_renders_is_rendered(variant, distribution):
    conftest.use(variant)
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    refused, compared, failures = [], 0, []
    # kernels are compiled for each material: the slow variants see a part of the table
    part = list(cases())[:: 1 if variant == "scalar_rgb" else 8]
    for kind, words, given in part:
        given = {"distribution": distribution, **given}
        (_, theirs), (message, ours) = (numbers(plugin, kind == "glass", given) for plugin in PAIRS[kind])
        if theirs is None or not all(np.isfinite(x).all() for x in theirs):
            continue
        compared += 1
        if ours is None:
            # parts of a color that are not finite may vanish on the way to a spectrum
            if "must be finite numbers" not in message:
                refused.append((kind, words, message))
            continue
        for a, b in zip(ours, theirs):
            # polarized glass has Fresnel's matrices where the built-in depolarizes: the first element is the same
            # near equal indices, the half vector of a refraction is a difference of directions, rounded
            rounding = 1e-2 if words == "int_ior is 1" else 2e-4
            if not np.allclose(a, b, rtol=rounding, atol=1e-5 * max(1.0, float(np.abs(b).max()))):
                failures.append((kind, words, float(np.abs(a - b).max())))
                break
    mi.set_log_level(level)
    assert not refused
    assert not failures
    assert compared > 0.4 * len(part)


@pytest.mark.parametrize(
    "plugin, given, words",
    [
        ("sgtdconductor", dict(eta=rgb(-0.0485, 4.14, 4.67)), ["eta", "-0.0485", "below 0"]),
        ("sgtdconductor", dict(k=-0.75), ["k", "-0.75"]),
        ("sgtdconductor", dict(alpha=-0.3), ["alpha", "-0.3", "1e-4"]),
        ("sgtdconductor", dict(specular_reflectance=-0.4), ["specular_reflectance", "-0.4"]),
        ("sgtddielectric", dict(specular_transmittance=-0.45), ["specular_transmittance", "-0.45"]),
    ],
    ids=str,
)
def test_what_no_surface_has_is_told_once(scalar, warnings, plugin, given, words):
    name = "-".join(words[:2])
    for _ in range(3):
        mi.load_dict({"type": plugin, "id": name, **given})
    (line,) = (text for text in warnings if name in text and "parameter" in text)
    for word in (plugin, *words):
        assert word in line


@pytest.mark.parametrize("shape", [{"gamma": 1.7}, {"gamma": 1.7, "multiple_scattering": True}, {"mu": 0.2}], ids=str)
def test_the_family_renders_it_too(variant, shape):
    """Negative parts of eta do not stop a material that runs on tables, and give finite light."""
    bsdf = sc.load(eta=rgb(-0.0485, 4.14, 4.67), k=rgb(2.0, 2.0, 2.0), alpha=0.3, **shape)
    rng = np.random.default_rng(6)
    wi, wo = sc.uniform_directions(rng, 100), sc.uniform_directions(rng, 100)
    value, pdf = sc.evaluate(bsdf, wi, wo)
    assert np.isfinite(value).all() and (value >= 0).all() and np.isfinite(pdf).all() and value.max() > 0
