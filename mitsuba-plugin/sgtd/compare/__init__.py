"""``sgtd compare``: one scene with Mitsuba's rough materials and with ours, side by side.

==============  ======================================================================
``comparison``  both sides rendered, measured and written: :func:`compare_scene`
``difference``  what two renderings differ by, and how much of that is noise
``table``       the numbers on the terminal, as CSV and as JSON
``figure``      the picture: left, right, signed difference, FLIP
==============  ======================================================================
"""

from .comparison import FILES, PICTURE, compare_scene

__all__ = ["FILES", "PICTURE", "compare_scene"]
