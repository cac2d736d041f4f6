"""The rooms of the package: imports go down only, and in no circle."""

from __future__ import annotations

import ast
import functools
import importlib.metadata
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest
import sgtd

PACKAGE = Path(sgtd.__file__).parent

# Ground floor first; a room imports from its own and from those before it.
FLOORS = (
    ("_core", "errors", "interleaved_timing"),
    ("atomic_output", "jobs", "ndf", "page"),
    ("scene",),
    ("compare", "distribution_picture", "named_shape"),
    ("explain", "accuracy", "doctor"),
    ("microsurface", "inverse", "fitting", "sweep"),
    ("measured", "slope_fitting"),
    ("fit_report",),
    ("cli",),
    ("__main__",),
)


def modules() -> list[str]:
    paths = [path.relative_to(PACKAGE).with_suffix("") for path in PACKAGE.rglob("*.py") if "scenes" not in path.parts]
    return sorted(".".join(path.parts).removesuffix("__init__").rstrip(".") for path in paths)


@functools.cache
def imports(module: str) -> frozenset[str]:
    """The modules of the package that a module names in its imports, those inside functions too ("" is the package)."""
    path = PACKAGE.joinpath(*module.split(".")) if module else PACKAGE
    is_package = path.is_dir()
    source = (path / "__init__.py") if is_package else path.with_suffix(".py")
    known, found = set(modules()) | {"_core"}, set()
    here = [part for part in module.split(".") if part]
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name.split(".", 1) for alias in node.names if alias.name.split(".")[0] == "sgtd"]
            found.update(name[1] if len(name) > 1 else "" for name in names)
        if isinstance(node, ast.ImportFrom) and node.level:
            up = node.level - is_package
            base = [*here[: len(here) - up], *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                inner = ".".join([*base, alias.name])
                found.add(inner if inner in known else ".".join(base))
    return frozenset(found - {module})


def floor(module: str) -> int:
    room = module.split(".")[0]
    return next(number for number, rooms in enumerate(FLOORS) if room in rooms)


def test_every_module_has_a_floor():
    assert {module.split(".")[0] for module in modules() if module} <= {room for rooms in FLOORS for room in rooms}


@pytest.mark.parametrize("module", [module for module in modules() if module])
def test_imports_go_down(module):
    # The package itself is no room: commands ask it for its release and its search path.
    up = [other for other in imports(module) if other and floor(other) > floor(module)]
    beside = [o for o in imports(module) if o and floor(o) == floor(module) and o.split(".")[0] != module.split(".")[0]]
    assert not up and not beside


def test_no_circles():
    done: set[str] = set()

    def visit(module: str, above: tuple[str, ...]) -> None:
        assert module not in above, " -> ".join([*above[above.index(module) :], module])
        if module not in done:
            for other in sorted(imports(module) - {"_core", ""}):
                visit(other, (*above, module))
            done.add(module)

    for module in modules():
        visit(module, ())


def test_extras_are_those_of_the_package():
    """The packages that are asked for by name are what ``pip install 'sgtd[...]'`` brings."""
    from sgtd.errors import EXTRAS

    declared: dict[str, set[str]] = {}
    for requirement in importlib.metadata.requires("sgtd") or ():
        if found := re.match(r"([\w-]+).*extra == ['\"](\w+)['\"]", requirement):
            name = found[1].lower().replace("-", "_")
            declared.setdefault(found[2], set()).add(name)
    assert {extra: {name.lower() for name in names} for extra, names in EXTRAS.items()} == {
        extra: names for extra, names in declared.items() if extra != "all"
    }


def test_a_missing_package_is_named_with_its_command(monkeypatch):
    from sgtd.errors import MissingPackage, require

    require("report")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "flip_evaluator" else True)
    with pytest.raises(MissingPackage, match=r"flip-evaluator is not installed.*pip install 'sgtd\[compare\]'"):
        require("compare")


def test_import_is_light():
    """``import sgtd`` brings in nothing that it does not need to render: each of these takes longer than all of the package."""
    code = "import sys, sgtd; print([m for m in ('scipy', 'matplotlib', 'jinja2', 'rich', 'click', 'distributed') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
