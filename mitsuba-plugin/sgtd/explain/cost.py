"""What materials of this family take against Mitsuba's built-ins, measured here and now. Both sides take turns.

The scene itself is rendered with them and with the built-ins: that is the ratio that a user sees. If asked for, each material is timed by
itself too, which says more than any scene will show: in JIT variants by a kernel that does nothing but evaluate and sample the BSDF,
and in all variants by a small render in which the material fills the view.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import mitsuba_errors
from ..interleaved_timing import Clock, ratios, render_clock
from ..scene import numeric_distribution
from ..scene.exchange import ISOTROPIC, ORIGINALS, exchange, one_roughness
from ..scene.graph import SceneGraph
from .material import Material

_LANES = 1 << 18

# The side of the image; samples per pixel of scalar variants and of the others.
_PIXELS, _SPP = 64, (16, 64)

# Pixels and samples per pixel of a render of the scene, in scalar variants and in the others: a second at most for most scenes.
_SCENE_PIXELS, _SCENE_SPP = (1 << 14, 1 << 16), (4, 16)

# Properties that both plugins have. Textures are exchanged for a bitmap.
_COMMON = ("alpha", "alpha_u", "alpha_v", "material", "sample_visible", "int_ior", "ext_ior", "nonlinear")

# Those that only this family has.
_OWN = (
    *("distribution", "gamma", "inv_gamma", "p", "lambda", "shift", "mu", "masking", "accuracy", "multiple_scattering"),
    *numeric_distribution.PROPERTIES,
)


@dataclass(frozen=True)
class Cost:
    """Ratio of seconds, ours over the built-in's: median and quartiles."""

    ratio: float
    low: float
    high: float
    against: str
    what: str

    def words(self) -> str:
        return f"{self.ratio:.2f} [{self.low:.2f}, {self.high:.2f}] × {self.against}: {self.what}"


def measure_scene(graph: SceneGraph, repetitions: int) -> Cost:
    """Times the scene, at a low resolution, against the same scene with the nearest of Mitsuba's built-ins."""
    import mitsuba as mi

    smaller = graph.copy()
    width, height = smaller.shrink(_SCENE_PIXELS[_is_jit()])
    if not smaller.plugins(mi.ObjectType.Integrator):
        smaller.use_integrator("path", {})
    pair = exchange(smaller, {})
    with mitsuba_errors("while rendering"):
        clocks = [render_clock(side.build(), _SCENE_SPP[_is_jit()]) for side in (pair.right, pair.left)]
        found = ratios(clocks[0], clocks[1], repetitions)
    kinds = dict.fromkeys(left for left, _, _ in pair.summary())
    what = f"renders of {width} x {height} pixels with {_SCENE_SPP[_is_jit()]} samples per pixel in {mi.variant()}, {repetitions} pairs"
    return _cost(found, " and ".join(kinds), what)


def _cost(found: list[float], against: str, what: str) -> Cost:
    low, middle, high = (float(x) for x in np.quantile(found, [0.25, 0.5, 0.75]))
    return Cost(middle, low, high, against, what)


def measure_costs(material: Material, repetitions: int) -> tuple[Cost, ...]:
    """Times a stand-in with the material's shape, masking and kind of roughness against GGX in the built-in plugin."""
    import mitsuba as mi

    theirs_plugin = ORIGINALS[material.plugin]
    common = {
        name: _texture() if name in material.objects else material.properties[name]
        for name in _COMMON
        if name in material.properties
    }
    own = {name: _number(material.properties[name]) for name in _OWN if name in material.properties}
    ours = {"type": material.plugin, **common, **own}
    theirs = {"type": theirs_plugin, "distribution": "ggx", **common}
    if theirs_plugin in ISOTROPIC and (mean := one_roughness(theirs)) is not None:
        theirs = {name: value for name, value in theirs.items() if name not in ("alpha_u", "alpha_v")} | {"alpha": mean}
    clocks = [(_render_seconds, f"a render of {_PIXELS} x {_PIXELS} pixels that it fills")]
    if _is_jit():
        clocks.insert(0, (_kernel_seconds, f"eval_pdf and sample of {_LANES} directions alone"))
    costs = []
    for clock, what in clocks:
        how = f"{what}, measured in {mi.variant()}, {repetitions} pairs"
        costs.append(_cost(ratios(clock(ours), clock(theirs), repetitions), f"{theirs_plugin} ggx", how))
    return tuple(costs)


def count_code_paths(scene: Any) -> int | None:
    """Distinct pieces of BSDF code that a kernel of this scene holds; None in scalar variants, which have no kernels.

    All BSDFs of the scene are called at once, as rays do that hit different shapes, and the functions of the kernel are counted:
    Dr.Jit merges those whose code is equal.
    """
    import drjit as dr
    import mitsuba as mi

    if not _is_jit():
        return None
    count = len(scene.shapes())
    if count == 0:
        return 0
    size = 4 * count
    bsdf = dr.gather(mi.ShapePtr, scene.shapes_dr(), dr.arange(mi.UInt32, size) % count).bsdf()
    si = dr.zeros(mi.SurfaceInteraction3f, size)
    si.wi = mi.Vector3f(0.1, 0.2, 0.9)
    wo = mi.Vector3f(0.1, -0.2, 0.9)
    dr.make_opaque(bsdf, si, wo)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        dr.eval(bsdf.eval_pdf(mi.BSDFContext(), si, wo, True))
        kernels = dr.kernel_history([dr.KernelType.JIT])
    functions = {name for kernel in kernels for name in _FUNCTION.findall(_text(kernel["ir"]))}
    # a call with one target alone is written into the kernel itself
    return max(len(functions), 1)


# Functions that kernels define: LLVM's "define void @func_...", and ".visible .func func_..." of PTX.
_FUNCTION = re.compile(r"^(?:define|\.visible \.func|\.func).*?\b(func_\w+)", re.MULTILINE)


def _text(ir: Any) -> str:
    return ir.getvalue() if hasattr(ir, "getvalue") else str(ir)


def _is_jit() -> bool:
    import mitsuba as mi

    return not mi.variant().startswith("scalar_")


def _number(value: Any) -> Any:
    return math.inf if value == "inf" else value


def _texture() -> dict[str, Any]:
    import mitsuba as mi

    pixels = np.linspace(0.1, 0.4, 16, dtype=np.float32).reshape(4, 4, 1)
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True}


def _kernel_seconds(description: dict[str, Any]) -> Clock:
    import drjit as dr
    import mitsuba as mi

    bsdf = mi.load_dict(description)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, _LANES)
    si = dr.zeros(mi.SurfaceInteraction3f, _LANES)
    si.wi = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    si.uv = sampler.next_2d()
    si.sh_frame = mi.Frame3f([1, 0, 0], [0, 1, 0], [0, 0, 1])
    wo = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    u1, u2 = sampler.next_1d(), sampler.next_2d()
    si.wavelengths = mi.sample_rgb_spectrum(sampler.next_1d())[0] if mi.is_spectral else si.wavelengths
    dr.eval(si, wo, u1, u2)

    def run(_turn: int) -> float:
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            context = mi.BSDFContext()
            dr.eval(bsdf.eval_pdf(context, si, wo), bsdf.sample(context, si, u1, u2))
            dr.sync_thread()
            return sum(kernel["execution_time"] for kernel in dr.kernel_history([dr.KernelType.JIT]))

    return run


def _render_seconds(description: dict[str, Any]) -> Clock:
    import mitsuba as mi

    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "sensor": {
                "type": "orthographic",
                "to_world": mi.ScalarTransform4f().look_at([0, -1, 2], [0, 0, 0], [0, 1, 0]).scale([0.4, 0.4, 1]),
                "film": {"type": "hdrfilm", "width": _PIXELS, "height": _PIXELS, "rfilter": {"type": "box"}},
            },
            "light": {"type": "constant"},
            "shape": {"type": "rectangle", "bsdf": description},
        }
    )
    return render_clock(scene, _SPP[_is_jit()])
