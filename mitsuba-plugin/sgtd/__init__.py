"""Microfacet BSDFs of the skewed generalized t-distribution (SGTD) family for Mitsuba 3.

Importing this package makes the plugins ``sgtdconductor``, ``sgtddielectric`` and ``sgtdplastic`` known to Mitsuba::

    import mitsuba as mi
    import sgtd

    mi.set_variant("llvm_ad_rgb")
    bsdf = mi.load_dict({"type": "sgtdconductor", "material": "Au", "gamma": 1.8})

The import may come before or after ``mi.set_variant``: Mitsuba has one search path for the whole process, shared by all variants and
threads. Only ``mi.set_file_resolver`` with a new resolver loses them; :func:`register` adds it again.

``MITSUBA_RELEASE`` is the release of Mitsuba that the plugins were built for; they work with no other.

:class:`sgtd.Ndf` evaluates the distributions over numpy arrays, without Mitsuba's variants.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._core import mitsuba_release as MITSUBA_RELEASE

if TYPE_CHECKING:
    from .fitting import fit
    from .ndf import Ndf

__all__ = ["Ndf", "MITSUBA_RELEASE", "PLUGIN_DIR", "__version__", "fit", "register"]

__version__ = importlib.metadata.version("sgtd")

#: The folder that Mitsuba searches for ``plugins/sgtdconductor.so`` and the others.
PLUGIN_DIR = Path(__file__).resolve().parent


def register() -> None:
    """Puts the plugins on Mitsuba's search path; does nothing if they are there.

    Raises ``ImportError`` if Mitsuba is missing, or is another release than the one that they were built for.
    """
    mend = f"Install the matching one: pip install mitsuba=={MITSUBA_RELEASE}"
    try:
        import mitsuba as mi
    except ImportError as error:
        raise ImportError(
            f"sgtd needs Mitsuba {MITSUBA_RELEASE}, which cannot be imported ({error}). {mend}"
        ) from error
    if mi.__version__ != MITSUBA_RELEASE:
        raise ImportError(
            f"sgtd was built for Mitsuba {MITSUBA_RELEASE}, but Mitsuba {mi.__version__} is installed. {mend}"
        )
    resolver = mi.file_resolver()
    if str(PLUGIN_DIR) not in map(str, resolver):
        resolver.append(str(PLUGIN_DIR))


def __getattr__(name: str) -> Any:
    # Loaded on first use: numpy is not needed to render
    if name == "Ndf":
        return importlib.import_module(".ndf", __name__).Ndf
    if name == "fit":
        return importlib.import_module(".fitting", __name__).fit
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
