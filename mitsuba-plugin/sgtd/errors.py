"""What a user reads when something is wrong: one line, no traceback."""

from __future__ import annotations

import contextlib
import importlib.util
import re
from collections.abc import Iterator

# Mitsuba puts the place in its own sources in front of each message: "[parser.cpp:1718] ...".
_SOURCE_PLACE = re.compile(r"\[\w+\.(?:cpp|h):\d+\]\s*")


class UserError(Exception):
    """Something that the user can mend; ``str(error)`` is one line that says what."""


#: The packages of each extra of the installation, by the names that they are imported under.
EXTRAS = {
    "compare": ("matplotlib", "flip_evaluator"),
    "report": ("matplotlib", "jinja2", "scipy"),
    "fit": ("matplotlib", "jinja2", "scipy"),
    "heights": ("SurfaceTopography", "scipy"),
    "dask": ("distributed",),
}


class MissingPackage(UserError, ImportError):
    """A package of an extra is not installed; the message has the command that installs it."""


def require(extra: str) -> None:
    """Raises :class:`MissingPackage` unless all packages of an extra are installed; long work calls it first."""
    missing = [name for name in EXTRAS[extra] if importlib.util.find_spec(name) is None]
    if missing:
        names = " and ".join(name.replace("_", "-") for name in missing)
        verb = "is" if len(missing) == 1 else "are"
        raise MissingPackage(f"{names} {verb} not installed, which this needs: pip install 'sgtd[{extra}]'")


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
