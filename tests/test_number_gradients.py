"""Derivatives by the values of a table and the weights and roughnesses of a mixture: through the BSDF and through renders."""

from __future__ import annotations

import conftest
import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import scattering as sc
from sgtd import Ndf
from tables import MIXTURES, PLUGIN, TABLES, ndf_of
from test_shape_gradients import directions, interaction, scene


@pytest.fixture(autouse=True)
def _variant(llvm):
    pass


def lists(name: str) -> dict[str, np.ndarray]:
    """The numbers of one of them, by the names that traverse() shows."""
    if name in TABLES:
        return {"values": np.array(TABLES[name]["values"], float)}
    weights, members = zip(*MIXTURES[name])
    return {"weights": np.array(weights), "alphas": np.array([member["alpha"] for member in members])}


def made(name: str, numbers: dict[str, np.ndarray], **more) -> Ndf:
    """The distribution with these numbers, and the knee that it had."""
    if name in TABLES:
        knee = ndf_of(name).table.knee
        return Ndf.tabulated(**{**TABLES[name], "values": numbers["values"], "knee": knee}, accuracy=0, **more)
    parts = zip(numbers["weights"], numbers["alphas"], MIXTURES[name])
    return Ndf.mixture(
        [(weight, Ndf(**{**member, "alpha": alpha})) for weight, alpha, (_, member) in parts], accuracy=0, **more
    )


def value(ndf: Ndf, wi: np.ndarray, wo: np.ndarray, masking: str) -> np.ndarray:
    half = wi + wo
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return ndf.d(half) * ndf.g2(wi, wo, masking) / (4.0 * wi[:, 2])


def difference(name, numbers, key, along, f, **more):
    """Fourth order, by a share `along` of all numbers of a list."""
    step = 1e-4

    def at(x):
        return f(made(name, {**numbers, key: numbers[key] * (1.0 + x * step * along)}, **more))

    return (8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12.0 * step)


def attach(bsdf, key, gradient=None):
    params = mi.traverse(bsdf)
    dr.enable_grad(params[key])
    params.set_dirty(key)
    params.update()
    if gradient is not None:
        dr.set_grad(params[key], mi.Float(gradient))
    return params


def attach_in(room):
    params = mi.traverse(room)
    dr.enable_grad(params["ball.bsdf.values"])
    params.set_dirty("ball.bsdf.values")
    params.update()
    return params


def off_nodes(name, wi, wo, **more):
    """Pairs whose half vector is not next to a node, where derivatives jump and a step in f begins."""
    if name not in TABLES:
        return wi, wo
    table, half, ndf = TABLES[name], wi + wo, ndf_of(name, **more)
    slope = np.hypot(half[:, 0] / ndf.alpha_u, half[:, 1] / ndf.alpha_v) / half[:, 2]
    slopes = np.tan(np.radians(table["angles"])) if "angles" in table else np.asarray(table["slopes"])
    nodes = np.maximum(slopes / ndf_of(name).alpha_u, 1e-9)
    keep = np.abs(np.log(slope[:, None] / nodes)).min(axis=1) > 2e-3
    return wi[keep], wo[keep]


GIVEN, ROUND, BRUSHED = {}, {"alpha": 0.5}, {"alpha_u": 0.6, "alpha_v": 0.2}
EVALUATED = [
    *(("measured", more) for more in (GIVEN, ROUND, BRUSHED)),
    *(("core and haze", more) for more in (GIVEN, BRUSHED)),
    ("noise", ROUND),
    ("ring", BRUSHED),
    ("giant", GIVEN),
    ("two", ROUND),
    ("step", BRUSHED),
    ("ring and box", ROUND),
]


@pytest.mark.parametrize("name, more", EVALUATED, ids=str)
def test_eval_follows_the_numbers(name, more):
    """Forward along random shares of all numbers against differences of the core; reverse against forward."""
    rng = np.random.default_rng(1)
    wi, wo = off_nodes(name, directions(3000, 2), directions(3000, 3), **more)
    numbers, masking = lists(name), "height_correlated" if more else "separable"
    arguments = mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy())
    plain = np.array(sc.load(**PLUGIN[name], **more, masking=masking).eval(*arguments)[0])
    worst = []
    for key, list_ in numbers.items():
        along = rng.uniform(-1.0, 1.0, len(list_))
        bsdf = sc.load(**PLUGIN[name], **more, masking=masking)
        params = attach(bsdf, key, along * list_)
        got = bsdf.eval(*arguments)[0]
        dr.enqueue(dr.ADMode.Forward, params[key])
        dr.traverse(dr.ADMode.Forward)
        forward = np.array(dr.grad(got))
        # without a roughness of its own a table keeps its slopes
        exact = difference(name, numbers, key, along, lambda ndf: value(ndf, wi, wo, masking), **more)
        worst.append(np.linalg.norm(forward - exact) / np.linalg.norm(exact))
        assert worst[-1] < 1e-3, key
        # what a gradient adds is 0 in the value
        assert np.array(got) == pytest.approx(plain, rel=2e-4, abs=1e-6)
        # the same again in reverse
        params = attach(bsdf, key)
        dr.clear_grad(params[key])
        dr.backward(dr.sum(bsdf.eval(*arguments)[0]))
        reverse = np.array(dr.grad(params[key])) * along * list_
        assert reverse.sum() == pytest.approx(forward.sum(), rel=1e-3, abs=1e-3 * np.abs(reverse).sum()), key
    conftest.measured("d eval by numbers, relative L2", np.array(worst), lambda k: f"{name}, {more}")


@pytest.mark.parametrize("name", ["measured", "ring", "core and haze"])
def test_pdf_follows_the_numbers(name):
    """As the density of visible normals does, up to the error of what is drawn from."""
    rng = np.random.default_rng(4)
    wi, wo = off_nodes(name, directions(3000, 5), directions(3000, 6), alpha=0.4)
    numbers = lists(name)
    arguments = mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy())

    def density(ndf):
        half = wi + wo
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        return ndf.d(half) * ndf.g1(wi) / (4.0 * wi[:, 2])

    for key, list_ in numbers.items():
        along = rng.uniform(-1.0, 1.0, len(list_))
        bsdf = sc.load(**PLUGIN[name], alpha=0.4, sample_bounded=False)
        params = attach(bsdf, key, along * list_)
        _, got = bsdf.eval_pdf(*arguments)
        alone = bsdf.pdf(*arguments)
        dr.enqueue(dr.ADMode.Forward, params[key])
        dr.traverse(dr.ADMode.Forward)
        exact = difference(name, numbers, key, along, density, alpha=0.4)
        assert np.linalg.norm(np.array(dr.grad(got)) - exact) < 0.03 * np.linalg.norm(exact), key
        assert np.array(dr.grad(alone)) == pytest.approx(np.array(dr.grad(got)), rel=1e-3, abs=1e-4)


@pytest.mark.parametrize("plugin", ["sgtdconductor", "sgtddielectric"])
@pytest.mark.parametrize("symbolic", [True, False])
def test_samples_follow_the_numbers(plugin, symbolic):
    """The mean of the derivatives of weights is that of the albedo."""
    name, key, count = "core and haze", "weights", 1 << 18
    along = np.array([0.2, -0.1])
    wi = np.tile(sc.direction(50.0, 20.0), (count, 1))

    def albedo(bsdf):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(1, count)
        numbers = sampler.next_1d(), sampler.next_2d()
        with dr.scoped_set_flag(dr.JitFlag.SymbolicCalls, symbolic):
            _, weight = mi.BSDFPtr(bsdf).sample(mi.BSDFContext(), interaction(wi), *numbers)
        return weight[0]

    bsdf = sc.load(plugin, **PLUGIN[name], alpha=0.7)
    params = attach(bsdf, key, along)
    weights = albedo(bsdf)
    dr.enqueue(dr.ADMode.Forward, params[key])
    dr.traverse(dr.ADMode.Forward)
    grads = np.array(dr.grad(weights))

    def moved(x):
        other = sc.load(plugin, **PLUGIN[name], alpha=0.7)
        params = mi.traverse(other)
        params[key] = mi.Float(lists(name)[key] + x * along)
        params.update()
        return np.array(albedo(other))

    differences = (moved(0.2) - moved(-0.2)) / 0.4
    error = np.hypot(grads.std(), differences.std()) / np.sqrt(count)
    assert abs(grads.mean() - differences.mean()) < 4.0 * error + 1e-3
    assert abs(grads.mean()) > 10.0 * grads.std() / np.sqrt(count)


RENDERS = [
    ("sgtdconductor", "path", True, 96),
    ("sgtdconductor", "path", False, 96),
    ("sgtdconductor", "prb", True, 96),
    ("sgtdconductor", "prb_basic", True, 192),
    ("sgtddielectric", "prb", True, 128),
]


BELL = np.array([1.0, 0.9, 0.5, 0.2, 0.1, 0.06, 0.03, 0.01])


def bell(values=BELL):
    """A table of eight rows, as wide as its slopes say."""
    listed = " ".join(str(value) for value in values)
    slopes = " ".join(str(slope) for slope in np.linspace(0.0, 1.5, 8))
    return {
        "distribution": "tabulated",
        "slopes": slopes,
        "values": listed,
        "quantity": "slope",
        "tail": "cut",
        "knee": 0.5,
    }


@pytest.mark.parametrize("plugin, integrator, symbolic, spp", RENDERS, ids=str)
def test_renders_follow_the_values(plugin, integrator, symbolic, spp):
    """Ten seeds in forward and in reverse mode against differences."""
    along, key = np.linspace(-1.0, 1.0, 8) * BELL, "ball.bsdf.values"
    with dr.scoped_set_flag(dr.JitFlag.SymbolicCalls, symbolic), dr.scoped_set_flag(dr.JitFlag.SymbolicLoops, symbolic):
        room = scene(plugin, integrator, **bell())
        params = attach_in(room)
        grads, reverse = [], []
        for seed in range(10):
            params.set_dirty(key)
            params.update()
            image = mi.render(room, params, spp=spp, seed=seed)
            dr.set_grad(params[key], mi.Float(along))
            dr.enqueue(dr.ADMode.Forward, params[key])
            dr.traverse(dr.ADMode.Forward)
            grads.append(np.array(dr.grad(image)).mean())
            params.set_dirty(key)
            params.update()
            dr.clear_grad(params[key])
            image = mi.render(room, params, spp=spp, seed=seed)
            dr.backward(dr.mean(image, axis=None))
            reverse.append(np.array(dr.grad(params[key])) @ along)

        def mean(x):
            other = scene(plugin, integrator, **bell(BELL + x * along))
            return np.array([np.array(mi.render(other, spp=spp, seed=seed)).mean() for seed in range(10)])

        differences = (mean(0.2) - mean(-0.2)) / 0.4
    error = np.hypot(np.std(grads, ddof=1), np.std(differences, ddof=1)) / np.sqrt(10)
    assert abs(np.mean(grads) - differences.mean()) < 3.0 * error + 0.01 * abs(differences.mean())
    assert np.std(grads, ddof=1) / np.sqrt(10) < 0.02 * abs(np.mean(grads))
    assert np.array(reverse) == pytest.approx(np.array(grads), rel=1e-3)


# -- what has no gradient has nothing of it, and what cannot be followed is refused


def test_without_a_gradient_nothing_is_added():
    """Kernels and values are those of a material that never had one."""
    wi, wo = directions(256, 7), directions(256, 8)

    def history(bsdf):
        si, out = interaction(wi), mi.Vector3f(wo.T.copy())
        dr.make_opaque(si, out)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            dr.kernel_history_clear()
            got = bsdf.eval(mi.BSDFContext(), si, out)
            dr.eval(got)
            kernels = [entry["hash"] for entry in dr.kernel_history([dr.KernelType.JIT])]
        return kernels, np.array(got)

    for name, key in (("measured", "values"), ("step", "values"), ("core and haze", "weights")):
        bsdf, other = sc.load(**PLUGIN[name]), sc.load(**PLUGIN[name])
        params = attach(bsdf, key)
        # suspended, it runs the kernel of one that has none
        with dr.suspend_grad():
            kernels, _ = history(bsdf)
        assert kernels == history(other)[0]
        dr.disable_grad(params[key])
        params.update()
        (kernels, values), (others, expected) = history(bsdf), history(other)
        assert kernels == others
        assert np.array_equal(values, expected)


def test_gradients_that_are_not_followed_are_refused():
    wi, wo = directions(4, 1), directions(4, 2)
    arguments = mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy())
    bsdf = sc.load(**PLUGIN["two"])
    params = mi.traverse(bsdf)
    dr.enable_grad(params["values"])
    with pytest.raises(Exception, match=r"values.*update"):
        bsdf.eval(*arguments)
    params.update()
    dr.backward(dr.sum(bsdf.eval(*arguments)[0]))
    # the way back to the values is gone with that pass
    with pytest.raises(Exception, match=r"values.*taken.*update"):
        bsdf.eval(*arguments)
    # those of other scenes are recorded along with the ones that are asked
    left = bsdf
    room = scene("sgtdconductor", "prb", **bell())
    params = attach_in(room)
    dr.backward(dr.mean(mi.render(room, params, spp=4), axis=None))
    assert np.any(np.array(dr.grad(params["ball.bsdf.values"])) != 0.0)
    assert left is not None
    for plugin, more, words in [
        ("sgtdconductor", {"multiple_scattering": True}, "values.*multiple_scattering"),
        ("sgtdplastic", {}, "values.*transmits"),
    ]:
        bsdf = sc.load(plugin, **PLUGIN["two"], **more)
        before = np.array(bsdf.eval(*arguments)[0])
        params = mi.traverse(bsdf)
        dr.enable_grad(params["values"])
        with pytest.raises(Exception, match=words):
            params.update()
        # and the material is what it was
        assert np.array_equal(np.array(bsdf.eval(*arguments)[0]), before)


def test_an_optimization_by_adam():
    """From a flat table to the one that made the values; the roughness follows, so slopes stay where they are."""
    wi, wo = directions(4000, 11), directions(4000, 12)
    arguments = mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T.copy())
    goal = dr.detach(sc.load(**bell()).eval(*arguments)[0])
    bsdf = sc.load(**bell(np.full(8, 0.3)))
    params = mi.traverse(bsdf)
    optimizer = mi.ad.Adam(lr=0.1)
    optimizer["log"] = mi.Float(np.log(np.full(8, 0.3)))
    losses = []
    for _ in range(150):
        params["values"] = dr.exp(optimizer["log"])
        params.update()
        loss = dr.mean(dr.square(dr.log(bsdf.eval(*arguments)[0] + 1e-3) - dr.log(goal + 1e-3)))
        dr.backward(loss)
        optimizer.step()
        losses.append(loss.numpy().item())
    found = np.exp(np.array(optimizer["log"]))
    assert losses[-1] < 1e-3 * losses[0]
    assert found / found[0] == pytest.approx(BELL / BELL[0], rel=0.05)
