"""Regular files that are read as logs, with their errors as messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from stat import S_ISREG
from typing import IO

from palpate import LogError

_MAX_SHOWN = 80  # characters of a name in a message: a choice


def regular(path: Path) -> Path:
    """Return the path of a file on a disk; raises LogError for others: a pipe or a device may block, or never end."""
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise LogError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # a name that is too long, or holds a zero
        raise LogError(f"{str(path)[:_MAX_SHOWN]!r}: no file can have this name: {error}") from error
    if not S_ISREG(mode):
        raise LogError(f"{path}: is not a regular file")
    return path


@contextmanager
def readable(path: Path) -> Iterator[IO[bytes]]:
    """Open a file for reading of bytes; raises LogError for errors of the system, also while it is read."""
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from error
