"""Which variants of Mitsuba work on this machine.

A variant can be part of the wheel and yet not run: the LLVM and CUDA ones load a library of the system when they
start, and some versions of LLVM end the whole process on some processors ("LLVM ERROR: Cannot select"). So a
variant is tried in a process of its own.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import UserError, one_line

# What `sgtd render` and `sgtd compare` take when no variant is named: the first of these that works. The order is
# Mitsuba's own ("the most capable variant whose backend is available, preferring an RGB color representation").
PREFERRED = ("cuda_ad_rgb", "llvm_ad_rgb", "scalar_rgb")

# A JIT variant starts in about 1 s on an idle machine; a probe that takes longer than this is taken as hung.
PROBE_TIMEOUT = 120.0

# Runs in the probing process. `dr.minimum` is what LLVM 14 to 16 cannot translate for processors with AVX-512.
_PROBE = """
import json, sys
variant, materials = sys.argv[1], json.loads(sys.argv[2])
answer = {}
try:
    import mitsuba as mi
    import drjit as dr
    mi.set_variant(variant)
    if variant.startswith("llvm_"):
        answer["backend"] = "LLVM " + ".".join(str(x) for x in dr.detail.llvm_version() if x >= 0)
    if variant.startswith("cuda_"):
        answer["backend"] = "CUDA " + ".".join(str(x) for x in dr.detail.cuda_version())
    if not variant.startswith("scalar_"):
        dr.eval(dr.minimum(dr.arange(mi.Float, 16) + dr.opaque(mi.Float, 1), 3.5))
        dr.sync_thread()
    for material in materials:
        import sgtd
        bsdf = mi.load_dict(material)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(0, 0.6, 0.8)
        value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(0, -0.6, 0.8))
        pdf = pdf if isinstance(pdf, float) else pdf[0]
        if not 0 < pdf < 1e6:
            raise RuntimeError(material["type"] + " evaluates to a density of " + str(pdf))
    answer["usable"] = True
except BaseException as error:
    answer["usable"] = False
    answer["reason"] = str(error) or type(error).__name__
print("\\n" + json.dumps(answer), flush=True)
"""


@dataclass(frozen=True)
class Probe:
    """How one variant fared: ``reason`` says in one line why it cannot be used."""

    variant: str
    usable: bool
    reason: str = ""
    backend: str = ""
    seconds: float = 0.0


def known_variants() -> list[str]:
    """The variants that this Mitsuba was built with."""
    import mitsuba as mi

    return list(mi.variants())


def probe(variant: str, materials: Sequence[Mapping[str, Any]] = ()) -> Probe:
    """Starts a variant in a process of its own; makes and evaluates these BSDFs there too."""
    start = time.perf_counter()
    command = [sys.executable, "-c", _PROBE, variant, json.dumps(materials)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PROBE_TIMEOUT, check=False)
    except subprocess.TimeoutExpired:
        return Probe(variant, False, f"no answer within {PROBE_TIMEOUT:.0f} s")
    seconds = time.perf_counter() - start
    try:
        answer = json.loads(done.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        return Probe(variant, False, _how_it_died(done), seconds=seconds)
    return Probe(
        variant=variant,
        usable=answer["usable"],
        reason=_plain(one_line(answer.get("reason", ""))),
        backend=answer.get("backend", ""),
        seconds=seconds,
    )


def choose(requested: str | None) -> tuple[str, str]:
    """The variant to use and a remark for the user ("" if there is nothing to say).

    A variant that was asked for is used or refused; without one, the first of ``PREFERRED`` that works.
    """
    known = known_variants()
    if requested is not None:
        if requested not in known:
            raise UserError(f'unknown variant "{requested}"; this Mitsuba has: {", ".join(known)}')
        if requested.startswith("scalar_"):
            return requested, ""
        result = probe(requested)
        if not result.usable:
            raise UserError(f"variant {requested} does not run here ({result.reason}); see: sgtd doctor")
        return requested, ""

    remark = ""
    for variant in PREFERRED:
        if variant not in known:
            continue
        if variant.startswith("scalar_"):
            return variant, remark
        result = probe(variant)
        if result.usable:
            return variant, remark
        if variant.startswith("llvm_"):
            remark = f"{variant} does not run here ({result.reason}): the slower scalar_rgb is used; see: sgtd doctor"
    raise UserError(f"none of the variants {', '.join(PREFERRED)} is in this Mitsuba")


def _plain(reason: str) -> str:
    """Dr.Jit's reasons in fewer words; other reasons as they are."""
    if "LLVM shared library" in reason:
        return "no usable libLLVM was found"
    if "CUDA backend" in reason:
        return "no CUDA driver was found"
    return reason


def _how_it_died(done: subprocess.CompletedProcess[str]) -> str:
    """One line on a process that ended without an answer: LLVM's own complaint if there is one."""
    for line in done.stderr.splitlines():
        if "LLVM ERROR" in line:
            # "LLVM ERROR: Cannot select: 0x564666af5280: f32 = fminimum ...": the addresses say nothing
            return f"the process was ended by {line.split(': 0x')[0].strip()}"
    if done.returncode < 0:
        return f"the process was ended by signal {signal.Signals(-done.returncode).name}"
    return f"the process ended with status {done.returncode}"
