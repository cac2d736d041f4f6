"""From a picture to a material: the search, its variables, what it refuses; the example and the notebook run."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import sgtd.inverse
from sgtd.inverse import Variables

EXAMPLES = Path(__file__).parent.parent / "examples"
MEMBERS = [
    {"gamma": 1.8, "p": 1.3, "lambda": 0.25, "shift": 0.5, "alpha": 0.3},
    {"gamma": 40.0, "p": 0.4, "lambda": -0.7, "shift": 6.0, "alpha": 0.05},
    {"gamma": 1.05, "p": 20.0, "lambda": 0.0, "shift": 0.01, "alpha": 1.0},
]


def example():
    spec = importlib.util.spec_from_file_location("recover_lobe", EXAMPLES / "recover_lobe.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("member", MEMBERS, ids=str)
def test_variables_are_coordinates(member):
    variables = Variables()
    v = variables.from_parameters(member)
    assert variables.to_parameters(v) == pytest.approx(member, rel=1e-6)
    step = 1e-6
    for column in range(5):
        moved = [variables.to_parameters(v + x * step * np.eye(5)[column]) for x in (-1.0, 1.0)]
        slopes = [(moved[1][name] - moved[0][name]) / (2.0 * step) for name in member]
        assert variables.jacobian(v)[:, column] == pytest.approx(slopes, rel=1e-5, abs=1e-8)


def test_variables_in_drjit(llvm):
    variables = Variables()
    v = [mi.Float(float(x)) for x in variables.from_parameters(MEMBERS[0])]
    dr.enable_grad(v)
    values = variables.to_parameters(v, dr)
    assert {name: float(np.array(x).item()) for name, x in values.items()} == pytest.approx(MEMBERS[0], rel=1e-5)
    dr.backward(values["gamma"])
    assert [dr.grad(x).numpy().item() for x in v] == pytest.approx(
        variables.jacobian(variables.from_parameters(MEMBERS[0]))[0], rel=1e-5
    )


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"unknown": ["gamma", "beta"]}, "beta.*choose among"),
        ({"unknown": []}, "nothing to recover"),
        ({"unknown": ["gamma", "gamma"]}, "more than once"),
        ({"unknown": ["gamma"], "gamma": 2.0}, "more than once"),
    ],
)
def test_bad_variables_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        Variables(**arguments)
    with pytest.raises(ValueError, match="no member"):
        Variables().from_parameters({**MEMBERS[0], "gamma": 1.0})
    with pytest.raises(ValueError, match="missing"):
        Variables().from_parameters({"gamma": 2.0})


@pytest.mark.parametrize("factor", [0.8, 1.5])
def test_a_lobe_is_recovered(llvm, factor):
    """From a start of another shape, within the noise of the picture."""
    module = example()
    target = module.photograph(24, 256)
    scene = module.sphere(24, **module.TRUTH)
    start = {**module.START, "alpha": factor * module.START["alpha"]}
    recovery = sgtd.inverse.recover(scene, target, "ball.bsdf", start, spp=32, mask=module.inside(scene, 24))
    assert recovery.converged and recovery.error < 0.05
    for name, value in recovery.parameters.items():
        assert abs(value - module.TRUTH[name]) < 5.0 * recovery.deviations[name] + 0.02 * abs(module.TRUTH[name]), name
    assert recovery.steps[0].error > 10.0 * recovery.steps[-1].error
    # the scene is left at the result
    left = mi.traverse(scene)["ball.bsdf.gamma"]
    assert float(np.array(left).item()) == pytest.approx(recovery.parameters["gamma"], rel=1e-6)
    assert "gamma" in str(recovery) and sgtd.inverse.figure(recovery, module.TRUTH).axes


def test_some_parameters_can_be_fixed(llvm):
    module = example()
    target = module.photograph(16, 128)
    scene = module.sphere(16, **module.TRUTH)
    fixed = {name: module.TRUTH[name] for name in ("p", "lambda", "shift")}
    recovery = sgtd.inverse.recover(
        scene, target, "ball.bsdf", {"gamma": 3.0, "alpha": 0.2}, unknown=["gamma", "alpha"], fixed=fixed, spp=16,
        mask=module.inside(scene, 16),
    )  # fmt: skip
    assert set(recovery.parameters) == {"gamma", "alpha"}
    assert recovery.parameters["gamma"] == pytest.approx(1.8, rel=0.05)


def test_bad_targets_are_refused(llvm):
    module = example()
    scene = module.sphere(8, **module.TRUTH)
    good = np.ones((8, 8, 1))
    for target, words in [
        (np.ones((4, 4, 1)), r"\(4, 4, 1\)"),
        (np.full((8, 8, 1), np.nan), "finite"),
        (-good, "negative"),
        (0.0 * good, "everywhere"),
    ]:
        with pytest.raises(ValueError, match=words):
            sgtd.inverse.recover(scene, target, "ball.bsdf", module.START, spp=1)
    with pytest.raises(ValueError, match="ball.bsdf"):
        sgtd.inverse.recover(scene, good, "sphere.bsdf", module.START, spp=1)
    with pytest.raises(ValueError, match="mask"):
        sgtd.inverse.recover(scene, good, "ball.bsdf", module.START, spp=1, mask=np.zeros((8, 8)))


def test_the_example_runs(llvm, tmp_path):
    small = ["--size", "12", "--spp", "8", "--steps", "4"]
    script = [sys.executable, str(EXAMPLES / "recover_lobe.py"), *small]
    done = subprocess.run([*script, "-o", str(tmp_path)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "recovery.png").stat().st_size > 10_000
    done = subprocess.run([*script, "--optimizer", "adam"], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "gamma" in done.stdout


def test_the_notebook_runs(llvm):
    """Its cells, one after the other."""
    cells = json.loads((EXAMPLES / "recover_lobe.ipynb").read_text(encoding="utf-8"))["cells"]
    source = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    environment = {**os.environ, "RECOVER_SIZE": "12", "RECOVER_SPP": "8"}
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 0, done.stderr
    assert "d(mean radiance)/d(gamma)" in done.stdout


def test_memory_stays_flat(llvm):
    """Hundreds of steps of one optimization leave nothing behind."""
    module = example()
    scene = module.sphere(8, **module.TRUTH)
    params = mi.traverse(scene)

    def steps(first, count):
        for step in range(first, first + count):
            number = mi.Float(1.7 + 1e-3 * (step % 100))
            dr.enable_grad(number)
            params["ball.bsdf.gamma"] = number
            params.update()
            dr.backward(dr.mean(mi.render(scene, params, spp=4, seed=step), axis=None))
        dr.sync_thread()
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096 / 2**20

    steps(0, 60)
    before = steps(60, 20)
    assert steps(80, 150) - before < 12.0  # MiB


# -- lists of numbers


def test_numbers_are_coordinates():
    numbers = sgtd.inverse.Numbers({"values": [1.0, 2.0, 0.0, 0.5], "alphas": [0.1, 0.3]})
    assert numbers.unknown == ("values[0]", "values[3]", "alphas[0]", "alphas[1]")
    given = {"values[0]": 1.0, "values[3]": 0.5, "alphas[0]": 0.1, "alphas[1]": 0.3}
    v = numbers.from_parameters(given)
    assert numbers.to_parameters(v) == pytest.approx(given)
    assert numbers.jacobian(v) == pytest.approx(np.diag(list(given.values())))
    for bad in ({"values": [1.0]}, {"values": [1.0, -1.0]}, {"weights": [0.0, 0.0]}, {"alphas": [np.nan, 1.0]}):
        with pytest.raises(ValueError, match=next(iter(bad)) + "|nothing to recover"):
            sgtd.inverse.Numbers(bad)


def test_a_mixture_is_recovered(llvm):
    """Weights and roughnesses of two members, from others."""
    module = example()
    members = "weight=0.6 alpha=0.1 distribution=student gamma=1.7; weight=0.4 alpha=0.5 distribution=beckmann"
    shape = {"distribution": "mixture", "members": members}
    target = module.photograph(20, 128, **shape)
    scene = module.sphere(20, **shape)
    start = {"weights": [0.5, 0.5], "alphas": [0.15, 0.3]}
    found = sgtd.inverse.recover(
        scene, target, "ball.bsdf", start, unknown=["weights", "alphas"], spp=32, mask=module.inside(scene, 20)
    )
    assert found.converged and found.error < 0.05
    assert found.lists["alphas"] == pytest.approx([0.1, 0.5], rel=0.03)
    weights = found.lists["weights"] / found.lists["weights"].sum()
    assert weights == pytest.approx([0.6, 0.4], abs=0.02)
    assert sgtd.inverse.figure(found, {"weights": [0.6, 0.4]}).axes and "alphas[1]" in str(found)
    with pytest.raises(ValueError, match="alone"):
        sgtd.inverse.recover(scene, target, "ball.bsdf", start, unknown=["weights", "gamma"], spp=1)
    with pytest.raises(ValueError, match="values.*missing"):
        sgtd.inverse.recover(scene, target, "ball.bsdf", start, unknown=["values"], spp=1)


def test_the_example_of_tables_runs(llvm, tmp_path):
    small = ["--size", "24", "--spp", "8", "--steps", "5"]
    script = [sys.executable, str(EXAMPLES / "recover_table.py"), *small, "-o", str(tmp_path)]
    done = subprocess.run(script, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "table.png").stat().st_size > 10_000
    residuals = [float(line.split()[1]) for line in done.stdout.splitlines() if line.startswith("residual")]
    assert residuals[-1] < 0.1 * residuals[0]
    # what was found is a material
    scene = example().sphere(4, distribution="tabulated", filename=str(tmp_path / "table.csv"), tail_exponent=3.4)
    assert mi.traverse(scene)["ball.bsdf.values"] is not None
