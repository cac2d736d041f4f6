"""Output files that appear whole or not at all.

Each file is written under a temporary name in the folder where it will stand, and all of them get their real
names at the end, when nothing can fail any more for a reason that the user could meet. An error on the way
leaves the folder as it was: the temporary files are removed, and so are the folders that were made for them.
:func:`check` finds out beforehand whether files could be written, so that no work is done for nothing.
"""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from types import TracebackType
from typing import final

from .errors import UserError, os_reason


def check(folder: Path, names: tuple[str, ...]) -> None:
    """Raises an error if these files could not be written into the folder; leaves everything as it was."""
    with AtomicOutput(folder) as files:
        for name in names:
            files.path(name)
        files.refuse_folders()
        files.discard(*names)
        files.forget_folders()


@final
class AtomicOutput:
    """A set of files for one folder::

    with AtomicOutput(folder) as files:
        write_something(files.path("left.exr"))
    # here left.exr exists, unless an exception passed through
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._token = secrets.token_hex(4)
        self._names: dict[Path, Path] = {}
        self._made: list[Path] = []

    def path(self, name: str) -> Path:
        """Where to write the file ``name`` now. The ending is kept: writers choose the format by it."""
        temporary = self.folder / f".{self._token}-{name}"
        self._names[temporary] = self.folder / name
        return temporary

    def discard(self, *names: str) -> None:
        """Gives up these files."""
        for temporary in [key for key, place in self._names.items() if place.name in names]:
            temporary.unlink(missing_ok=True)
            del self._names[temporary]

    def refuse_folders(self) -> None:
        """Raises an error if a folder has the name of one of the files."""
        for place in self._names.values():
            if place.is_dir():
                raise UserError(f"cannot write {place}: it is a folder")

    def forget_folders(self) -> None:
        """Removes the folders that were made for the files, as far as they are empty."""
        for folder in reversed(self._made):
            if not any(folder.iterdir()):
                folder.rmdir()

    def __enter__(self) -> AtomicOutput:
        try:
            self._make_folder()
            probe = self.path("probe")
            probe.touch()
            probe.unlink()
            del self._names[probe]
        except OSError as error:
            self._undo()
            raise UserError(f"cannot write into {self.folder}: {os_reason(error)}") from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            self._undo()
            if isinstance(error, OSError):
                raise UserError(f"cannot write into {self.folder}: {os_reason(error)}") from error
            return
        try:
            self.refuse_folders()
            for temporary, final in self._names.items():
                os.replace(temporary, final)
        except OSError as failure:
            self._undo()
            raise UserError(f"cannot write into {self.folder}: {os_reason(failure)}") from failure
        except UserError:
            self._undo()
            raise

    def _make_folder(self) -> None:
        missing = []
        folder = self.folder
        while not folder.exists():
            missing.append(folder)
            folder = folder.parent
        for folder in reversed(missing):
            folder.mkdir()
            self._made.append(folder)
        if not self.folder.is_dir():
            raise NotADirectoryError(20, "it is not a folder")

    def _undo(self) -> None:
        for temporary in self._names:
            temporary.unlink(missing_ok=True)
        self.forget_folders()
