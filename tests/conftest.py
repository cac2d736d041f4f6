"""Variants, and a loud line for each that cannot run here."""

from __future__ import annotations

import functools
import importlib.util
import subprocess
import sys

import numpy as np
import pytest

# LLVM 14 to 16 end the process on processors with AVX-512 when a minimum is compiled, hence a process of its own.
PROBE = """
import sys
import mitsuba as mi, drjit as dr
mi.set_variant(sys.argv[1])
print(mi.BSDFContext())
if not sys.argv[1].startswith("scalar"):
    assert dr.minimum(dr.arange(mi.Float, 16) + dr.opaque(mi.Float, 1), 3.5)[15] == 3.5
"""


@functools.cache
def why_not(variant: str) -> str:
    """Empty if the variant runs on this machine, else the reason."""
    if variant.startswith("scalar_"):
        return ""
    done = subprocess.run([sys.executable, "-c", PROBE, variant], capture_output=True, text=True, timeout=120)
    if done.returncode == 0:
        return ""
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return lines[-1] if lines else f"the process ended with status {done.returncode}"


def use(variant: str) -> None:
    """Sets a variant, or skips the test with the reason."""
    reason = why_not(variant.replace("_spectral", "_rgb").replace("_mono", "_rgb").replace("_polarized", ""))
    if reason:
        pytest.skip(f"{variant} DOES NOT RUN ON THIS MACHINE: {reason}")
    import mitsuba as mi
    import sgtd  # noqa: F401  (puts the plugin on the search path)

    mi.set_variant(variant)


def pytest_addoption(parser):
    parser.addoption("--quick", action="store_true", help="one case of each test, and none that is marked slow")


def pytest_collection_modifyitems(config, items):
    """Of the cases of a test, ``--quick`` keeps the first: every test runs, for one shape, one variant and one input."""
    if not config.getoption("--quick"):
        return
    kept = {}
    for item in items:
        if not item.get_closest_marker("slow"):
            kept.setdefault(item.nodeid.partition("[")[0], item)
    first = set(kept.values())
    config.hook.pytest_deselected(items=[item for item in items if item not in first])
    items[:] = [item for item in items if item in first]


def pytest_configure(config):
    config.addinivalue_line("markers", "slow: longer than a few seconds; left out by --quick")
    # Mitsuba makes some of its functions anew in every variant that is set
    config.addinivalue_line("filterwarnings", "ignore:The AST-transforming decorator:RuntimeWarning")


# What tests of accuracy measured: name -> [largest relative error, its input, sum of squares, count]
MEASURED: dict[str, list] = {}


def measured(name: str, errors: np.ndarray, inputs) -> None:
    """Adds errors, and the inputs that they belong to, to the table at the end of the output."""
    entry = MEASURED.setdefault(name, [-1.0, None, 0.0, 0])
    worst = int(np.argmax(errors))
    if errors[worst] > entry[0]:
        entry[:2] = float(errors[worst]), str(inputs(worst))
    entry[2] += float(np.sum(np.square(errors)))
    entry[3] += len(errors)


def pytest_sessionfinish(session):
    # a worker of pytest-xdist has measured its own part of the table
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["measured"] = MEASURED


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error):
    for name, (largest, where, squares, count) in getattr(node, "workeroutput", {}).get("measured", {}).items():
        entry = MEASURED.setdefault(name, [-1.0, None, 0.0, 0])
        if largest > entry[0]:
            entry[:2] = largest, where
        entry[2] += squares
        entry[3] += count


def pytest_terminal_summary(terminalreporter):
    if MEASURED:
        terminalreporter.section("relative errors")
        for name, (largest, where, squares, count) in sorted(MEASURED.items()):
            rms = (squares / count) ** 0.5
            terminalreporter.line(f"{name:24} largest {largest:.2e}  RMS {rms:.2e}  of {count:6}  worst at {where}")
    missing = {reason for reason in (why_not("llvm_ad_rgb"),) if reason}
    for reason in missing:
        terminalreporter.section("LLVM VARIANTS WERE NOT TESTED", sep="!")
        terminalreporter.line(
            f"{reason}. Install LLVM 17 or newer (Debian: apt install libllvm19), then run the tests again."
        )


def pytest_report_header(config):
    found = importlib.util.find_spec("sgtd")
    return f"sgtd: {found.origin if found else 'NOT INSTALLED: pip install .'}"


@pytest.fixture
def scalar():
    use("scalar_rgb")


@pytest.fixture
def llvm():
    use("llvm_ad_rgb")


@pytest.fixture(params=["scalar_rgb", "llvm_ad_rgb"])
def variant(request):
    """Both ways through the plugin: tables read one value at a time, and in traced code."""
    use(request.param)
    return request.param


@pytest.fixture
def warnings():
    """What Mitsuba says, as it says it, whoever else listens: a variant has to be set before."""
    import mitsuba as mi

    said = []

    class Listener(mi.Appender):
        def append(self, _level, text):
            said.append(text)

        def log_progress(self, *_):
            pass

    level, listener = mi.log_level(), Listener()
    mi.set_log_level(mi.LogLevel.Warn)
    mi.logger().add_appender(listener)
    yield said
    mi.logger().remove_appender(listener)
    mi.set_log_level(level)
