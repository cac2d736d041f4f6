"""The command line ``sgtd``: options and messages, one file for each command. What a command does is in the module that it names.

``entry`` has the group and the entry point, ``options`` the arguments that several commands share, ``session`` what is around a
command: the variant of Mitsuba, the console, the progress bars.
"""

from .entry import main

__all__ = ["main"]
