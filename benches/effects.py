"""What each effect costs when it is on, and that it costs nothing when it is off. Run by ``make bench``.

For both sides of every effect: operations of the LLVM kernels of eval_pdf and sample, pieces of code in a kernel that calls both
sides, instructions of eval_pdf in scalar_rgb (callgrind), bytes of tables, and seconds of a render, on against off. The first pair
is plain GGX against roughconductor: nothing may be there that is not in Mitsuba's own material.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
from render import has_llvm
from rich.progress import Progress
from sgtd.interleaved_timing import ratios, render_clock

TABLES = {"gamma": 1.9}
RING = {"gamma": 1.9, "shift": 0.4}

# name, off, on. Properties of sgtdconductor beside alpha = 0.3, unless "type" says otherwise.
EFFECTS: tuple[tuple[str, dict[str, Any], dict[str, Any]], ...] = (
    ("GGX of the family", {"type": "roughconductor", "distribution": "ggx"}, {}),
    ("Beckmann by name", {"type": "roughconductor"}, {"distribution": "beckmann"}),
    ("glass of GGX", {"type": "roughdielectric", "distribution": "ggx"}, {"type": "sgtddielectric"}),
    ("transmission of tables", TABLES, {"type": "sgtddielectric", **TABLES}),
    ("tail", {}, TABLES),
    ("kurtosis", TABLES, {**TABLES, "p": 1.3}),
    ("shift", TABLES, RING),
    ("skew", RING, {**RING, "lambda": 0.3}),
    ("anisotropy of GGX", {}, {"alpha_u": 0.3, "alpha_v": 0.2}),
    ("anisotropy of tables", TABLES, {**TABLES, "alpha_u": 0.3, "alpha_v": 0.2}),
    ("correlation of GGX", {}, {"masking": "height_correlated"}),
    ("correlation of tables", TABLES, {**TABLES, "masking": "height_correlated"}),
    ("visible normals of GGX", {"sample_visible": False}, {}),
    ("visible normals of tables", {**TABLES, "sample_visible": False}, TABLES),
    ("multiple scattering of GGX", {}, {"multiple_scattering": True}),
    ("multiple scattering of tables", TABLES, {**TABLES, "multiple_scattering": True}),
    ("double precision", {**TABLES, "p": 8.0}, {**TABLES, "p": 50.0}),
)

# Calls of eval_pdf that callgrind counts at once.
CALLS = 500


def described(properties: dict[str, Any]) -> dict[str, Any]:
    """What mi.load_dict takes."""
    roughness = {} if "alpha_u" in properties else {"alpha": 0.3}
    return {"type": "sgtdconductor", **roughness, **properties}


def kernels(properties: dict[str, Any]) -> tuple[list[int], list[str]]:
    """(operations, hashes) of the kernels of eval_pdf and of sample."""
    import drjit as dr
    import mitsuba as mi

    size = 1000
    bsdf = mi.load_dict(described(properties))
    si = dr.zeros(mi.SurfaceInteraction3f, size)
    si.wi = dr.normalize(mi.Vector3f(dr.linspace(mi.Float, 0, 1, size), 0.3, 1))
    wo = dr.normalize(mi.Vector3f(0.2, dr.linspace(mi.Float, -0.5, 0.7, size), 1))
    u = mi.Point2f(dr.linspace(mi.Float, 0, 0.99, size), 0.3)
    dr.eval(si, wo, u)
    operations, hashes = [], []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for call in (
            lambda: bsdf.eval_pdf(mi.BSDFContext(), si, wo),
            lambda: bsdf.sample(mi.BSDFContext(), si, u.x, u),
        ):
            dr.kernel_history_clear()
            dr.eval(call())
            (kernel,) = dr.kernel_history([dr.KernelType.JIT])
            operations.append(kernel["operation_count"])
            hashes.append(str(kernel["hash"]))
    return operations, hashes


def code_paths(*materials: dict[str, Any]) -> int:
    """Pieces of code in a kernel that calls all of these materials."""
    import mitsuba as mi
    from sgtd.explain.cost import count_code_paths

    shapes = {f"s{k}": {"type": "sphere", "bsdf": described(m)} for k, m in enumerate(materials)}
    return count_code_paths(mi.load_dict({"type": "scene", **shapes})) or 0


def table_bytes(properties: dict[str, Any]) -> int:
    """Bytes of the tables that the core makes for a material."""
    from sgtd import _core

    if properties.get("type", "sgtd").startswith("rough"):
        return 0
    row = properties.get("distribution", "sgtd")
    shape, _ = _core.shape_of_row(row, *(properties.get(name) for name in ("gamma", "p", "lambda", "shift")))
    node = _core.lowest_node(shape)
    ndf = _core.Ndf.get(node.shape, _core.default_accuracy, properties.get("sample_visible", True))
    missing_energy = ndf.missing_energy(False)[0] if properties.get("multiple_scattering") else 0
    if node.closed_form or (row == "beckmann" and shape.shift == 0.0):
        return missing_energy
    return ndf.table_bytes + missing_energy


def filled(properties: dict[str, Any]) -> object:
    """A view that one sphere of the material nearly fills."""
    import mitsuba as mi

    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 3},
            "sensor": {
                "type": "perspective",
                "fov": 30,
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 128, "height": 128},
            },
            "light": {"type": "constant"},
            "sphere": {"type": "sphere", "bsdf": described(properties)},
        }
    )


# Runs under callgrind: says "begin" and "end" around the calls to be counted, and waits for an answer each time.
COUNTED = """
import json, sys
import mitsuba as mi
mi.set_variant("scalar_rgb")
import sgtd
si, context = mi.SurfaceInteraction3f(), mi.BSDFContext()
si.wi, above, below = mi.Vector3f(0.1, 0.2, 0.9), mi.Vector3f(0.2, 0.1, 0.9), mi.Vector3f(0.2, 0.1, -0.9)
calls, materials = json.loads(sys.argv[1])
def say(word):
    print(word, flush=True)
    sys.stdin.readline()
def work(bsdf, wo):
    for _ in range(calls):
        bsdf.eval_pdf(context, si, wo)
# a call that does nothing comes first: what Python takes
for description, wo in [({"type": "diffuse"}, below)] + [(material, above) for material in materials]:
    bsdf = mi.load_dict(description)
    work(bsdf, wo)
    say("begin")
    work(bsdf, wo)
    say("end")
"""


def instructions(materials: list[dict[str, Any]]) -> list[float] | str:
    """Instructions per call of eval_pdf, beyond those of a call that does nothing; or why there is no count."""
    for tool in ("valgrind", "callgrind_control"):
        if not shutil.which(tool):
            return f"{tool} is missing: apt install valgrind"
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "count"
        command = ["valgrind", "--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={output}"]
        command += [sys.executable, "-c", COUNTED, json.dumps([CALLS, [described(m) for m in materials]])]
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert process.stdin and process.stdout

        def control(*arguments: str) -> None:
            subprocess.run(["callgrind_control", *arguments, str(process.pid)], capture_output=True, check=True)

        try:
            for word in process.stdout:
                if word.strip() == "begin":
                    control("-i", "on")
                    control("-z")
                elif word.strip() == "end":
                    control("-d")
                process.stdin.write("\n")
                process.stdin.flush()
        except (OSError, subprocess.CalledProcessError) as error:
            process.kill()
            return f"callgrind did not answer: {error}"
        if process.wait() != 0:
            return f"valgrind ended with status {process.returncode}"
        counts = []
        for k in range(1, len(materials) + 2):
            found = re.search(r"^summary: (\d+)", Path(f"{output}.{k}").read_text(), re.MULTILINE)
            assert found, f"{output}.{k} has no summary"
            counts.append(int(found[1]) / CALLS)
        return [count - counts[0] for count in counts[1:]]


@click.command()
@click.option("--repetitions", default=9, show_default=True, help="Pairs of renders per effect and variant.")
def main(repetitions: int) -> None:
    """Prints the table of effects."""
    import mitsuba as mi
    import numpy as np
    import sgtd  # noqa: F401 - registers the plugin

    jit = has_llvm()
    if jit:
        mi.set_variant("llvm_ad_rgb")
    sides = [side for _, off, on in EFFECTS for side in (off, on)]
    counted = instructions(sides)
    if isinstance(counted, str):
        print(f"Instructions are left out: {counted}")
        counted = [float("nan")] * len(sides)
    head = (
        "effect",
        "operations of eval_pdf",
        "of sample",
        "code paths",
        "instructions",
        "bytes",
        "llvm_ad_rgb",
        "scalar_rgb",
    )
    print("each pair: off -> on; seconds of a render: on / off, median [quartiles]")
    form = "{:<26} {:>22} {:>16} {:>10} {:>14} {:>14} {:>22} {:>22}  {}"
    print(form.format(*head, ""))
    with Progress(transient=True) as progress:
        for k, (name, off, on) in progress.track(list(enumerate(EFFECTS)), description="effects"):
            cells, remark = ["-", "-", "-"], ""
            seconds = {}
            if jit:
                mi.set_variant("llvm_ad_rgb")
                (a, hash_a), (b, hash_b) = kernels(off), kernels(on)
                cells = [f"{x} -> {y}" for x, y in zip(a, b)] + [str(code_paths(off, on))]
                remark = "the same kernels, to the last bit" if hash_a == hash_b else ""
                found = ratios(render_clock(filled(on), 64), render_clock(filled(off), 64), repetitions)
                seconds["llvm"] = np.quantile(found, [0.5, 0.25, 0.75])
            mi.set_variant("scalar_rgb")
            found = ratios(render_clock(filled(on), 8), render_clock(filled(off), 8), repetitions)
            seconds["scalar"] = np.quantile(found, [0.5, 0.25, 0.75])
            cells += [
                f"{counted[2 * k]:.0f} -> {counted[2 * k + 1]:.0f}",
                f"{table_bytes(off)} -> {table_bytes(on)}",
                *(
                    "{:.3f} [{:.3f}, {:.3f}]".format(*seconds[which]) if which in seconds else "-"
                    for which in ("llvm", "scalar")
                ),
            ]
            progress.console.print(form.format(name, *cells, remark), highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
