"""Inverse rendering of the shape: a material from an image of it.

:func:`recover` finds the parameters of a material with which a scene looks like a target image, by Levenberg–Marquardt on residuals of log radiance;
:class:`Variables` (of a member of the family) and :class:`Numbers` (of a table or a mixture) are the coordinates it works in, and work for other optimizers as well; :func:`figure` shows what it did.
"""

from __future__ import annotations

from .figure import figure
from .numbers import Numbers
from .recover import Recovery, recover
from .variables import Variables

__all__ = ["Numbers", "Recovery", "Variables", "figure", "recover"]
