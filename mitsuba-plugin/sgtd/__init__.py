"""Microfacet BSDFs of the skewed generalized t-distribution (SGTD) family for Mitsuba 3.

Importing this package makes the plugins ``sgtdconductor``, ``sgtddielectric`` and ``sgtdplastic`` known to Mitsuba::

    import mitsuba as mi
    import sgtd

    mi.set_variant("llvm_ad_rgb")
    bsdf = mi.load_dict({"type": "sgtdconductor", "material": "Au", "gamma": 1.8})

The import may come before or after ``mi.set_variant``: Mitsuba has one search path for the whole process, shared by all variants and
threads. Only ``mi.set_file_resolver`` with a new resolver loses them; :func:`register` adds it again.

A plugin works with the release of Mitsuba that it was built for and no other; ``MITSUBA_RELEASES`` are those that this installation has plugins
for, and :func:`register` takes the ones for the Mitsuba that is installed.

:class:`sgtd.Ndf` evaluates the distributions over numpy arrays, without Mitsuba's variants.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .fitting import fit
    from .ndf import Ndf
    from .slope_fitting import fit_heights, fit_slopes

__all__ = [
    "Ndf",
    "MITSUBA_RELEASES",
    "PACKAGE_DIR",
    "__version__",
    "fit",
    "fit_heights",
    "fit_slopes",
    "plugin_dir",
    "register",
]

__version__ = importlib.metadata.version("sgtd")

#: The folder of this package; the scenes that come with it are in ``scenes`` below it.
PACKAGE_DIR = Path(__file__).resolve().parent


def plugin_dir(release: str) -> Path:
    """The folder that Mitsuba searches for ``plugins/sgtdconductor.so`` and the others, for one release of Mitsuba."""
    return PACKAGE_DIR / "releases" / release


def _releases() -> tuple[str, ...]:
    folders = (PACKAGE_DIR / "releases").glob("*/plugins")
    return tuple(sorted((folder.parent.name for folder in folders), key=lambda name: [int(n) for n in name.split(".")]))


#: The releases of Mitsuba that this installation has plugins for, oldest first.
MITSUBA_RELEASES: tuple[str, ...] = _releases()


def register() -> None:
    """Puts the plugins for the installed Mitsuba on its search path; does nothing if they are there.

    Raises ``ImportError`` if Mitsuba is missing, or is a release without plugins here.
    """
    known = ", ".join(MITSUBA_RELEASES) or "no release"
    newest = MITSUBA_RELEASES[-1] if MITSUBA_RELEASES else ""
    install = f"Install it: pip install mitsuba=={newest}" if newest else "Install sgtd anew: it holds no plugins"
    try:
        import mitsuba as mi
    except ImportError as error:
        raise ImportError(
            f"sgtd has plugins for Mitsuba {known}, but none can be imported ({error}). {install}"
        ) from error
    if mi.__version__ not in MITSUBA_RELEASES:
        build = "or build for yours in a checkout: pip install --no-build-isolation ."
        raise ImportError(
            f"sgtd has plugins for Mitsuba {known}, but Mitsuba {mi.__version__} is installed. {install}, {build}"
        )
    folder = str(plugin_dir(mi.__version__))
    resolver = mi.file_resolver()
    if folder not in map(str, resolver):
        resolver.append(folder)


def __getattr__(name: str) -> Any:
    # Loaded on first use: numpy is not needed to render
    if name == "Ndf":
        return importlib.import_module(".ndf", __name__).Ndf
    if name == "fit":
        return importlib.import_module(".fitting", __name__).fit
    if name in ("fit_heights", "fit_slopes"):
        return getattr(importlib.import_module(".slope_fitting", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


try:
    register()
except ImportError as error:
    # Not fatal: arrays need no Mitsuba, and `sgtd doctor` must be able to say what is wrong
    warnings.warn(
        f"the plugins sgtdconductor, sgtddielectric and sgtdplastic are not available: {error}",
        RuntimeWarning,
        stacklevel=2,
    )
