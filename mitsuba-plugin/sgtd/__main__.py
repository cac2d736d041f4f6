"""``python -m sgtd``: the command line, where its folder is not on the path."""

from .cli import main

main()
