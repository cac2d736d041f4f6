"""What a user reads when something is wrong: one line, no traceback."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator

# Mitsuba puts the place in its own sources in front of each message: "[parser.cpp:1718] ...".
_SOURCE_PLACE = re.compile(r"\[\w+\.(?:cpp|h):\d+\]\s*")


class UserError(Exception):
    """Something that the user can mend; ``str(error)`` is one line that says what."""


def one_line(error: BaseException | str) -> str:
    """The message of an error on one line, without the places in Mitsuba's own sources."""
    text = _SOURCE_PLACE.sub("", str(error))
    return re.sub(r"\s+", " ", text).strip() or type(error).__name__


@contextlib.contextmanager
def mitsuba_errors(doing: str = "") -> Iterator[None]:
    """Turns whatever Mitsuba raises in this block into a :class:`UserError`; ``doing`` goes in front."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        prefix = f"{doing}: " if doing else ""
        raise UserError(prefix + one_line(error)) from error


def os_reason(error: OSError) -> str:
    """The reason alone ("Permission denied"), for messages that name the path themselves."""
    return error.strerror or str(error)
