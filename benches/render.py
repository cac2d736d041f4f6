"""What sgtdconductor costs against roughconductor, as ratios measured in one run.

Both sides are rendered alternately with the same sampler, resolution and samples per pixel; the ratio of each
pair of repetitions is taken, and its median and quartiles are printed. Run by ``make bench``.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
from rich.progress import Progress
from sgtd.interleaved_timing import ratios, render_clock
from sgtd.scene.variants import probe

SCENE = Path(__file__).resolve().parent.parent / "scenes" / "spheres.xml"
FULL = {"distribution": "sgtd", "gamma": 2.7, "p": 1.3, "lambda": 0.3, "shift": 0.4}
SIZE = {"width": "480", "height": "270"}


class Row:
    """One printed line."""

    def __init__(self, what: str, against: str, target: str) -> None:
        self.head = (what, against, target)

    def print(self, ratios: list[float], unit: str = "") -> None:
        low, middle, high = np.quantile(ratios, [0.25, 0.5, 0.75])
        self.text(f"{middle:.3f}{unit} [{low:.3f}, {high:.3f}]")

    def text(self, value: str) -> None:
        what, against, target = self.head
        print(f"{what:<58} {against:<28} {value:<28} target {target}", flush=True)


def scenes(settings: dict, distribution: str) -> tuple[object, object]:
    """(sgtdconductor with the settings, roughconductor with its own distribution)."""
    from sgtd.scene.exchange import exchange
    from sgtd.scene.graph import read_scene

    pair = exchange(read_scene(SCENE, {**SIZE, "distribution": distribution}), settings)
    return pair.right.build(), pair.left.build()


def many_materials(count: int) -> object:
    """A plane of small spheres with `count` different shapes, in a fixed order."""
    import mitsuba as mi

    side = 10
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {
            "type": "perspective",
            "fov": 40,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 16], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 320, "height": 320},
        },
        "light": {"type": "constant"},
    }
    for k in range(side * side):
        j = k % count
        scene[f"sphere{k}"] = {
            "type": "sphere",
            "center": [k % side - 4.5, k // side - 4.5, 0],
            "radius": 0.45,
            "bsdf": {
                "type": "sgtdconductor",
                "material": "Al",
                "alpha": 0.2,
                **{"gamma": 2.0 + 0.03 * j, "p": 1.1 + 0.004 * j, "lambda": 0.005 * j, "shift": 0.01 * j},
            },
        }
    return mi.load_dict(scene)


def weights(sample_visible: bool, count: int, angle: float) -> np.ndarray:
    """Weights of BSDF samples of one view, channel 0."""
    import drjit as dr
    import mitsuba as mi

    bsdf = mi.load_dict(
        {"type": "sgtdconductor", "material": "none", "alpha": 0.3, "sample_visible": sample_visible, **FULL}
    )
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    sin, cos = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    si.wi = mi.Vector3f(float(sin), 0, float(cos))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(7, count)
    _, weight = bsdf.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())
    return np.array(weight[0])


def peak_memory(plugin: str) -> float:
    """MiB of a process of its own that renders the scene."""
    code = (
        "import resource,sys\n"
        "import mitsuba as mi\nmi.set_variant('llvm_ad_rgb')\n"
        "import sgtd,json\n"
        "from pathlib import Path\nfrom sgtd.scene.exchange import exchange\nfrom sgtd.scene.graph import read_scene\n"
        f"pair=exchange(read_scene(Path({str(SCENE)!r}),{{'width':'960','height':'540'}}),{FULL!r})\n"
        f"scene=(pair.right if {plugin!r}=='sgtdconductor' else pair.left).build()\n"
        "import numpy as np\nnp.array(mi.render(scene,spp=16))\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss/1024)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def batch_seconds(threads: int, count: int) -> float:
    """Seconds of a batch of samples inside a process with so many threads: the median of three, because the first finds no memory."""
    code = (
        "import time,numpy as np,sgtd\n"
        f"n={count}\nndf=sgtd.Ndf(gamma=2.7,p=1.3,lam=.3,shift=.4,accuracy=1e-5)\n"
        "g=np.random.default_rng(1);m=g.normal(size=(n,3));m[:,2]=abs(m[:,2]);m/=np.linalg.norm(m,axis=1,keepdims=True)\n"
        "ndf.sample(m[:1000],g.random((1000,2)))\nu=g.random((n,2))\n"
        "seconds=[]\n"
        "for _ in range(3):\n"
        " t=time.perf_counter();ndf.sample(m,u);seconds.append(time.perf_counter()-t)\n"
        "print(np.median(seconds))\n"
    )
    environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    return float(done.stdout.split()[-1])


def has_llvm() -> bool:
    """Does llvm_ad_rgb run here? If not, says why."""
    found = probe("llvm_ad_rgb")
    if not found.usable:
        print(f"LLVM variants are left out: {found.reason}")
    return found.usable


@click.command()
@click.option("--repetitions", default=15, show_default=True, help="Pairs of renders per row.")
def main(repetitions: int) -> None:
    """Prints the table of ratios."""
    import drjit as dr
    import mitsuba as mi
    import sgtd  # noqa: F401 - registers the plugin

    variants = [("scalar_rgb", 4)]
    if has_llvm():
        variants.append(("llvm_ad_rgb", 32))

    with Progress(transient=True) as progress:
        task = progress.add_task("render benches", total=3 * len(variants) + 5)

        def step() -> None:
            progress.advance(task)

        for variant, spp in variants:
            mi.set_variant(variant)
            ours, theirs = scenes(FULL, "ggx")
            found = ratios(render_clock(ours, spp), render_clock(theirs, spp), repetitions)
            Row(f"render, {variant}, full SGTD", "roughconductor ggx", "<= 1.10").print(found)
            step()
            for distribution in ("ggx", "beckmann"):
                ours, theirs = scenes({}, distribution)
                left, right = (np.array(mi.render(scene, spp=4, seed=3)) for scene in (ours, theirs))
                apart = np.abs(left - right).max() / right.max()
                found = ratios(render_clock(ours, spp), render_clock(theirs, spp), repetitions)
                Row(f"render, {variant}, {distribution}, pixels within {apart:.0e}", "roughconductor", "<= 1.01").print(
                    found
                )
                step()
        if len(variants) > 1:
            one, hundred = many_materials(1), many_materials(100)
            found = ratios(render_clock(hundred, 16), render_clock(one, 16), repetitions)
            with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
                dr.kernel_history_clear()
                dr.eval(mi.render(hundred, spp=16, seed=5))
                kernels = sum(1 for k in dr.kernel_history([dr.KernelType.JIT]))
            Row(f"render, 100 SGTD materials, {kernels} kernels", "1 material", "<= 1.05, 2 kernels").print(found)
            step()
            visible, projected = weights(True, 2**21, 80), weights(False, 2**21, 80)
            Row("variance at 80 degrees, D cos sampling", "visible sampling", ">= 5").text(
                f"{projected.var() / visible.var():.1f} (means {projected.mean():.4f}, {visible.mean():.4f})"
            )
            step()
            memory = [peak_memory("sgtdconductor") / peak_memory("roughconductor") for _ in range(3)]
            Row("peak memory of a render", "roughconductor", "<= 1.02").print(memory)
            step()
        count = 10**7
        found = [batch_seconds(1, count) / batch_seconds(2, count) for _ in range(5)]
        Row("Ndf.sample, batch of 1e7, one core", "two cores", ">= 1.9").print(found)
        step()


if __name__ == "__main__":
    main()
