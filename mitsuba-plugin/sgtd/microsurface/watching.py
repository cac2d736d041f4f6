"""Long calls of the core: progress while they run, and an end when the user wants one."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Optional, TypeVar

from .. import _core

T = TypeVar("T")

# Told how much more has been done
Advance = Optional[Callable[[int], None]]

_SECONDS = 0.1


def watched(call: Callable[[_core.Watch], T], advance: Advance = None) -> T:
    """Runs a call in a thread, so that Ctrl-C is seen here and ends it."""
    watch = _core.Watch()
    told = 0
    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(call, watch)
        try:
            done = False
            while not done:
                done = bool(wait([running], timeout=_SECONDS).done)
                if advance is not None and watch.done > told:
                    advance(watch.done - told)
                    told = watch.done
            return running.result()
        except BaseException:
            watch.stop()
            raise
