"""Does a frozen function ever replay the code of another structural state?

Whatever selects code must be visible to the recording: Dr.Jit looks at the number and types of the variables that an
object holds. So every ordered pair of states is walked through, by updates of one material and by exchanging materials.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc

# Two members of each state: a switch is told from a change of numbers.
SHAPES = {
    "ggx": ({"gamma": 2.0, "p": 1.0, "lambda": 0.0, "shift": 0.0},) * 2,
    "scaled ggx": (
        {"gamma": 2.0, "p": 1.0, "lambda": 0.4, "shift": 0.0},
        {"gamma": 2.0, "p": 1.0, "lambda": 0.3, "shift": 0.0},
    ),
    "tables": (
        {"gamma": 1.8, "p": 1.0, "lambda": 0.0, "shift": 0.0},
        {"gamma": 1.8, "p": 1.2, "lambda": 0.4, "shift": 0.3},
    ),
    "steep tables": (
        {"gamma": 2.0, "p": 50.0, "lambda": 0.0, "shift": 0.0},
        {"gamma": 2.0, "p": 1.0, "lambda": 0.0, "shift": 300.0},
    ),
}
INDICES = {"ordinary": (1.5, 1.4), "matched": (1.0, 1.000001), "great": (10.0, 11.0)}


def walk(count):
    """Every ordered pair of states, a state with itself too, as one path that visits each once."""
    # Hierholzer's path through the complete graph
    left = {k: list(range(count)) for k in range(count)}
    stack, path = [0], []
    while stack:
        if left[stack[-1]]:
            stack.append(left[stack[-1]].pop())
        else:
            path.append(stack.pop())
    path.reverse()
    assert len(set(zip(path, path[1:]))) == count * count == len(path) - 1
    return path


def interaction(glass, count=60):
    rng = np.random.default_rng(21)
    wi = sc.uniform_directions(rng, count, lower=glass)
    m = sc.normals(rng, count, 0.3, 0.3, reach=0.5)
    wo = sc.reflect(wi, m)
    if glass:
        through, _ = sc.refract(wi, m, 1.5)
        wo[::2] = through[::2]
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(wi.T.astype(np.float32))
    u = mi.Point3f(rng.random((3, count)).astype(np.float32))
    return si, mi.Vector3f(wo.T.astype(np.float32)), u


def call(bsdf, si, wo, u):
    drawn, weight = bsdf.sample(mi.BSDFContext(), si, u.z, mi.Point2f(u.x, u.y))
    return *bsdf.eval_pdf(mi.BSDFContext(), si, wo), drawn.wo, drawn.pdf, weight


def compare(frozen, bsdf, arguments, words):
    found = [x.numpy() for x in frozen(bsdf, *arguments)]
    for a, b in zip(found, call(bsdf, *arguments)):
        assert np.allclose(a, b.numpy(), rtol=1e-5, atol=1e-6, equal_nan=True), words
    return found


@pytest.mark.parametrize("extra", [{}, {"multiple_scattering": True}], ids=str)
@pytest.mark.parametrize("roughness", [{"alpha": 0.3}, {"alpha_u": 0.3, "alpha_v": 0.2}], ids=str)
def test_metal_through_every_pair(llvm, roughness, extra):
    arguments, names = interaction(False), list(SHAPES)
    bsdf, frozen = sc.load(**roughness, **extra), dr.freeze(call)
    params = mi.traverse(bsdf)
    seen = {}
    for step, k in enumerate(walk(len(names))):
        for key, value in SHAPES[names[k]][step % 2].items():
            params[key] = value
        params.update()
        values = compare(frozen, bsdf, arguments, names[k])
        seen.setdefault(names[k], float(values[0].sum()))
    assert len(set(seen.values())) == len(seen)
    # one for each state, and one more where a literal has become a variable
    assert frozen.n_recordings <= len(names) + 1


def test_glass_through_every_pair(llvm):
    arguments = interaction(True)
    names = [(shape, index) for shape in SHAPES for index in INDICES]
    bsdf, frozen = sc.load("sgtddielectric", alpha=0.3), dr.freeze(call)
    params = mi.traverse(bsdf)
    for step, k in enumerate(walk(len(names))):
        shape, index = names[k]
        for key, value in SHAPES[shape][step % 2].items():
            params[key] = value
        params["eta"] = INDICES[index][step % 2]
        params.update()
        compare(frozen, bsdf, arguments, names[k])
    # matched and great indices share their code
    assert frozen.n_recordings <= 2 * len(SHAPES) + 1


@pytest.mark.slow
@pytest.mark.parametrize("plugin", ["sgtdconductor", "sgtddielectric"])
def test_materials_are_not_confused(llvm, plugin):
    """One function for many materials: each has the code of its own, also where it was fixed when the material was made."""
    glass = plugin == "sgtddielectric"
    arguments = interaction(glass)
    given = [
        *(shapes[0] for shapes in SHAPES.values()),
        {"distribution": "beckmann"},
        {"distribution": "beckmann", "shift": 0.4},
    ]
    extras = [
        {},
        {"sample_visible": False},
        {"masking": "height_correlated"},
        {"alpha_u": 0.3, "alpha_v": 0.1},
        {"int_ior": 20.0} if glass else {"multiple_scattering": True},
        {"specular_transmittance": 0.5} if glass else {"multiple_scattering": True, "alpha_u": 0.3, "alpha_v": 0.1},
        {"specular_reflectance": 0.5},
    ]
    materials = [
        sc.load(plugin, **{**({} if "alpha_u" in extra else {"alpha": 0.3}), **extra, **shape})
        for shape in given
        for extra in extras
    ]
    frozen = dr.freeze(call)
    for order in (1, -1):
        for bsdf in materials[::order]:
            compare(frozen, bsdf, arguments, str(bsdf))
    assert frozen.n_recordings <= len(materials) + 1


@pytest.mark.parametrize(
    "start, changes",
    [
        ({"lambda": 0.4}, [{}, {"eta": 1.4}, {"lambda": 0.0, "eta": 1.0}]),
        ({"lambda": 0.4}, [{}, {"lambda": 0.3}, {"lambda": 0.0}, {"eta": 10.0}]),
        ({}, [{"eta": 10.0}, {"eta": 11.0}, {"eta": 1.5, "lambda": 0.4}]),
    ],
    ids=str,
)
def test_frozen_render_of_glass(llvm, start, changes):
    film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}}
    view = mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4},
            "light": {"type": "constant"},
            "sensor": {"type": "perspective", "to_world": view, "film": film},
            "sphere": {"type": "sphere", "bsdf": {"type": "sgtddielectric", "alpha": 0.3, **start}},
        }
    )
    params = mi.traverse(scene)

    def render(scene, seed):
        return mi.render(scene, seed=seed, spp=16)

    frozen = dr.freeze(render)
    for change in changes:
        for key, value in change.items():
            params["sphere.bsdf." + key] = value
        params.update()
        images = [function(scene, mi.UInt32(1)).numpy() for function in (frozen, render)]
        assert np.allclose(*images, rtol=1e-4, atol=1e-5), change


def test_eta_changes_inside_a_frozen_function(llvm):
    """There its value is not known when the function is recorded, and the code must do for every index."""
    arguments = interaction(True)

    def inside(bsdf, params, eta, *others):
        params["eta"] = eta
        params.update()
        return call(bsdf, *others)

    bsdf = sc.load("sgtddielectric", alpha=0.3)
    params = mi.traverse(bsdf)
    frozen = dr.freeze(lambda bsdf, eta, *others: inside(bsdf, params, eta, *others))
    for eta in (1.4, 1.5, 1.0, 10.0, 1.6):
        found = frozen(bsdf, mi.Float(eta), *arguments)
        other = sc.load("sgtddielectric", alpha=0.3)
        for a, b in zip(found, inside(other, mi.traverse(other), mi.Float(eta), *arguments)):
            assert np.allclose(a.numpy(), b.numpy(), rtol=1e-4, atol=1e-5, equal_nan=True), eta


@pytest.mark.parametrize(
    "name, given, words",
    [
        ("gamma", {}, ["gamma", "frozen"]),
        ("mu", {"mu": 0.1}, ["mu", "frozen"]),
        ("alpha.value", {"mu": 0.1}, ["mu", "alpha", "shift"]),
        (
            "alpha_u.value",
            {"alpha_u": 0.2, "alpha_v": 0.1, "multiple_scattering": True},
            ["alpha_u", "multiple_scattering"],
        ),
    ],
)
def test_what_needs_the_host_is_refused_inside_a_frozen_function(llvm, name, given, words):
    bsdf = sc.load(gamma=1.8, **given)
    params = mi.traverse(bsdf)
    arguments = interaction(False)

    def inside(bsdf, value, *others):
        params[name] = value
        params.update()
        return call(bsdf, *others)

    with pytest.raises(RuntimeError) as caught:
        dr.freeze(inside)(bsdf, dr.opaque(mi.Float, 0.3), *arguments)
    message = str(caught.value) + str(caught.value.__cause__)
    for word in words:
        assert word in message


@pytest.mark.parametrize("plugin", ["sgtdconductor", "sgtddielectric"])
@pytest.mark.parametrize("shape", SHAPES)
def test_each_call_is_one_kernel(llvm, plugin, shape):
    """No lane waits for another: nothing is reduced over lanes, which would split a kernel, and darken all for one."""
    si, wo, u = interaction(plugin == "sgtddielectric")
    bsdf = sc.load(plugin, alpha=0.3, **SHAPES[shape][1])
    dr.eval(si, wo, u)
    for function in (
        lambda: bsdf.eval_pdf(mi.BSDFContext(), si, wo),
        lambda: bsdf.sample(mi.BSDFContext(), si, u.z, mi.Point2f(u.x, u.y)),
    ):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            dr.eval(function())
            assert len(dr.kernel_history([dr.KernelType.JIT])) == 1
