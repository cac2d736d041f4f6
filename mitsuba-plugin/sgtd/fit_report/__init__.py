"""``sgtd fit``: files of measurements become materials and pages, one or many at once.

``one`` fits a file and writes its folder, ``many`` does so for many on all cores or on a cluster and writes a page on all of them.
"""

from __future__ import annotations

from .many import fit_files
from .options import Options

__all__ = ["Options", "fit_files"]
