"""``sgtd doctor``: what works on this machine, and the mend for what does not."""

from __future__ import annotations

import ctypes.util
import os
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import one_line
from .scene.variants import Probe, known_variants, probe

PLUGINS = ("sgtdconductor", "sgtddielectric", "sgtdplastic")

# What is evaluated; a metal's name makes a spectrum, which a plugin of another layout gets wrong.
_MATERIALS = (
    {"type": "sgtdconductor", "material": "Au", "alpha": 0.2},
    {"type": "sgtddielectric", "alpha": 0.2},
    {"type": "sgtdplastic", "alpha": 0.2},
)

_NAMES = f"{', '.join(PLUGINS[:-1])} and {PLUGINS[-1]}"

# The versions of LLVM that Dr.Jit accepts and that still end the process on processors with AVX-512.
_LLVM_ABORTS_ON_AVX512 = range(15, 17)

_INSTALL_LLVM = "sudo apt-get install libllvm19 (Debian), or set DRJIT_LIBLLVM_PATH to the libLLVM.so of a newer LLVM"

_BACKENDS = ("scalar_", "llvm_", "cuda_")

_INSTALL_PLUGIN = (
    "pip install --force-reinstall --no-deps sgtd, or in a checkout: pip install --force-reinstall --no-deps ."
)


@dataclass(frozen=True)
class Finding:
    """One line of the report. ``state`` is "ok", "off" (not here, not needed) or "bad"."""

    subject: str
    state: str
    text: str
    mend: str = ""


@dataclass(frozen=True)
class Diagnosis:
    """All findings. ``usable`` is the verdict: at least scalar_rgb renders with the plugins."""

    findings: tuple[Finding, ...]

    @property
    def usable(self) -> bool:
        return any(finding.subject == "scalar_rgb" and finding.state == "ok" for finding in self.findings)

    def verdict(self) -> str:
        """One sentence, the last line of the report."""
        works = [f.subject for f in self.findings if f.state == "ok" and f.subject.startswith(_BACKENDS)]
        if not self.usable:
            return f"Not usable: {_NAMES} do not both work in scalar_rgb. See the mends above."
        fast = [variant for variant in works if not variant.startswith("scalar_")]
        if not fast:
            return f"Usable, but slow: {_NAMES} work in the scalar variants only."
        return f"Usable: {_NAMES} work in {len(works)} variants."


def diagnose(tried: Callable[[str], None] = print) -> Iterator[Finding]:
    """Checks everything, from what the rest depends on to the single variants; ``tried`` hears what comes next."""
    tried("Mitsuba")
    for check in (_mitsuba, _plugin_files):
        finding = check()
        yield finding
        if finding.state != "ok":
            return
    variants = known_variants()
    for backend, describe in (("scalar_", None), ("llvm_", _llvm), ("cuda_", _cuda)):
        probes = []
        for variant in variants:
            if variant.startswith(backend):
                tried(variant)
                probes.append(probe(variant, _MATERIALS))
        if describe is not None:
            yield describe(probes)
        absent = describe is not None and not any(p.backend for p in probes)
        for result in probes:
            yield _variant(result, absent)


def _mitsuba() -> Finding:
    """Mitsuba's version against the one that the plugin was built with: another one loads and misbehaves."""
    known = releases()
    install = f"pip install mitsuba=={known[-1]}" if known else _INSTALL_PLUGIN
    try:
        import mitsuba as mi
    except (ImportError, OSError, RuntimeError) as error:
        return Finding("Mitsuba", "bad", one_line(error), install)
    if mi.__version__ not in known:
        there = ", ".join(known) or "none"
        return Finding("Mitsuba", "bad", f"{mi.__version__} is installed; there are plugins for {there}", install)
    return Finding("Mitsuba", "ok", f"{mi.__version__}, with plugins built for it (Python {platform.python_version()})")


def releases() -> tuple[str, ...]:
    """The releases of Mitsuba that there are plugins for."""
    import sgtd

    return sgtd.MITSUBA_RELEASES


def plugin_file(plugin: str) -> Path | None:
    """A plugin in Mitsuba's search path, as Mitsuba itself would find it."""
    import mitsuba as mi

    import sgtd  # noqa: F401  (puts the plugins on the search path)

    endings = {"Windows": ".dll", "Darwin": ".dylib"}
    name = f"plugins/{plugin}{endings.get(platform.system(), '.so')}"
    found = Path(str(mi.file_resolver().resolve(name)))
    return found if found.is_file() else None


def _plugin_files() -> Finding:
    try:
        found = {plugin: plugin_file(plugin) for plugin in PLUGINS}
    except (ImportError, OSError, RuntimeError) as error:
        return Finding("plugins", "bad", one_line(error), _INSTALL_PLUGIN)
    missing = [plugin for plugin, file in found.items() if file is None]
    if missing:
        text = f"not in Mitsuba's search path: {', '.join(missing)}"
        return Finding("plugins", "bad", text, _INSTALL_PLUGIN)
    return Finding("plugins", "ok", ", ".join(str(file) for file in found.values()))


def _llvm(probes: list[Probe]) -> Finding:
    """LLVM, as the LLVM variants met it."""
    forced = os.environ.get("DRJIT_LIBLLVM_PATH", "")
    source = f"DRJIT_LIBLLVM_PATH={forced}" if forced else "the system's"
    worked = [p for p in probes if p.backend]
    if worked:
        return Finding("LLVM", "ok", f"{worked[0].backend.removeprefix('LLVM ')}, {source}")
    if not probes:
        return Finding("LLVM", "off", "this Mitsuba has no LLVM variants")
    reason = probes[0].reason
    if "LLVM ERROR" in reason or "signal" in reason:
        versions = f"{_LLVM_ABORTS_ON_AVX512[0]} and {_LLVM_ABORTS_ON_AVX512[-1]}"
        avx = " (this processor has AVX-512)" if _has_avx512() else ""
        text = f"{source} ends the process: LLVM {versions} do so on processors with AVX-512{avx}"
        return Finding("LLVM", "bad", text, _INSTALL_LLVM)
    if forced and not Path(forced).exists():
        return Finding("LLVM", "bad", f"{source} does not exist", f"unset DRJIT_LIBLLVM_PATH, or: {_INSTALL_LLVM}")
    if not forced and ctypes.util.find_library("LLVM") is None:
        return Finding("LLVM", "bad", "no libLLVM found: the fast CPU variants are off", _INSTALL_LLVM)
    return Finding("LLVM", "bad", f"{source} is too old or does not load", _INSTALL_LLVM)


def _cuda(probes: list[Probe]) -> Finding:
    """CUDA is an extra: a machine without it is a usable one."""
    worked = [p for p in probes if p.backend]
    if worked:
        return Finding("CUDA", "ok", worked[0].backend.removeprefix("CUDA "))
    return Finding("CUDA", "off", "no NVIDIA GPU with a driver: the CUDA variants are off")


def _variant(result: Probe, backend_absent: bool) -> Finding:
    if result.usable:
        return Finding(result.variant, "ok", f"the plugins evaluate ({result.seconds:.1f} s)")
    if backend_absent:
        return Finding(result.variant, "off", "see above")
    return Finding(result.variant, "bad", result.reason, _INSTALL_PLUGIN)


def _has_avx512() -> bool:
    try:
        return "avx512f" in Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False


def print_findings(findings: tuple[Finding, ...], console: Any) -> None:
    """The report as a table, with the mends below it."""
    from rich.markup import escape
    from rich.table import Table

    marks = {"ok": "[green]ok[/]", "off": "[dim]off[/]", "bad": "[bold red]bad[/]"}
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column()
    table.add_column()
    table.add_column(overflow="fold")  # paths are copied from here
    for finding in findings:
        table.add_row(marks[finding.state], finding.subject, escape(finding.text))
    console.print(table)
    mends: dict[str, list[str]] = {}
    for finding in findings:
        if finding.mend:
            mends.setdefault(finding.mend, []).append(finding.subject)
    for mend, subjects in mends.items():
        console.print(f"[bold]mend for {', '.join(subjects)}[/]: {escape(mend)}", soft_wrap=True, highlight=False)
