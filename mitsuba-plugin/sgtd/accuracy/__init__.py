"""``sgtd accuracy``: what accuracy costs in time.

The dial ``accuracy`` is swept from 1e-1 to 1e-10 and 0 (quadrature or a closed form on every call), and its errors and times are
measured twice: for the functions over arrays, and for images. How each number comes about is in ``docs/accuracy.md``.

===================  ============================================================================
``published``        formulas of other authors, the comparison lines
``function_errors``  random and hard arguments; errors of masking, D and sampling against quadrature; a whole
                     material in single precision against the core in double
``function_timing``  nanoseconds per call, in processes of their own with a fixed number of threads
``images``           scenes with one shape and one setting each: bias, noise, equal samples and equal time
``advice``           which setting suffices, in numbers and in words
``study``            runs all of it
``conclusions``      what the numbers say in words
``figures``          the plots
``output``           JSON, CSV, ``report.html`` and the terminal; the whole command
===================  ============================================================================
"""

from __future__ import annotations

# The dial: decades, then quadrature.
SETTINGS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 0.0)
QUICK_SETTINGS = (1e-1, 1e-3, 1e-5, 1e-7, 0.0)

# What the plugin and sgtd.Ndf take when nothing is said.
DEFAULT_SETTING = 1e-5


def setting_text(setting: float) -> str:
    """ "1e-5", or "quadrature"."""
    return "quadrature" if setting == 0.0 else f"{setting:.0e}".replace("e-0", "e-")
