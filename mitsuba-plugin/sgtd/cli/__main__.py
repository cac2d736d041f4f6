"""``python -m sgtd.cli``."""

from .entry import main

main()
