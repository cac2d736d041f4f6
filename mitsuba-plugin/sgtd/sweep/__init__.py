"""A scene rendered over a grid of settings: one image for each combination and seed, and a sheet, a table and a page of all of them."""

from .grid import Axis, combinations, parse_axis
from .result import Cell, Sweep
from .study import FILES, PAGE, make, tasks

__all__ = ["FILES", "PAGE", "Axis", "Cell", "Sweep", "combinations", "make", "parse_axis", "tasks"]
