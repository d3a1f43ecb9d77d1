"""Files that are read as logs: regular ones, with their errors as messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from stat import S_ISREG
from typing import IO

from palpate import LogError


def regular(path: Path) -> Path:
    """Return the path, if it is a file on a disk; raises LogError: a pipe or a device would be waited for, or have
    no end."""
    try:
        there, usual = True, S_ISREG(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        there = usual = False
    except (OSError, ValueError) as error:  # a name that is too long, or holds a zero
        raise LogError(f"{str(path)[:80]!r}: no file can have this name: {error}") from error
    if not there:
        raise LogError(f"{path}: no such file")
    if not usual:
        raise LogError(f"{path}: is not a regular file")
    return path


@contextmanager
def readable(path: Path) -> Iterator[IO[bytes]]:
    """The bytes of a file; raises LogError where they cannot be read."""
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from error
