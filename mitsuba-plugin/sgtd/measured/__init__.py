"""Files of measured reflectance: what each holds, as directions and values.

==========================  ================================================================================================
``merl``                    MERL ``.binary``: isotropic, 90 × 90 × 180 cells of half and difference angles
``rgl``                     RGL ``.bsdf``: a tensor file of Mitsuba's ``measured``, isotropic or anisotropic, sRGB or spectral
``utia``                    UTIA ``.bin``: anisotropic, 6 × 48 × 6 × 48 directions, three planes
``table``                   CSV: a line for each pair of directions, or scans in the plane of incidence
``npz``                     the same columns, or ``wi``, ``wo``, ``value``, as numpy's arrays
==========================  ================================================================================================

:func:`read` guesses the format by what a file contains, never by its name. All refusals name the file, the place and what to do.
"""

from __future__ import annotations

from .detect import HEIGHTS, kind_of, read
from .source import Source

__all__ = ["HEIGHTS", "Source", "kind_of", "read"]
