"""Reserve of a live run for its end: room on the disk for its log's close, and an open file for its result."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from palpate.errors import OutputError

_MEGABYTE = 1 << 20  # [bytes]
_SIZE = 4 * _MEGABYTE  # [bytes]; the index of a log of 20 minutes is as large
_MODE = 0o666  # read and write for everybody, less the umask: as any new file


class ClosingReserve:
    """An unnamed file in the run folder, if there is one: `release` frees its disk space, `write` gives it a name."""

    def __init__(self, file: IO[bytes] | None) -> None:
        self._file = file

    def release(self) -> None:
        """Give the room on the disk up."""
        if self._file is not None:
            with suppress(OSError):
                self._file.truncate(0)

    def write(self, path: Path, text: str) -> bool:
        """Write a new file of this text without opening one; return False where that is not possible."""
        if self._file is None:
            return False
        try:
            self._file.truncate(0)
            self._file.seek(0)
            self._file.write(text.encode())
            os.fsync(self._file.fileno())
            # With a descriptor for the absolute path's folder, which does not count, Python follows the link.
            number = self._file.fileno()
            os.link(f"/proc/self/fd/{number}", path, src_dir_fd=number, follow_symlinks=True)
        except OSError:
            return False
        return True


@contextmanager
def closing_reserve(folder: Path, is_live: bool) -> Iterator[ClosingReserve]:
    """Yield the reserve of a run, a file that keeps place on the disk free for its end; an empty one if it is not live.

    Raises OutputError where the disk is full.
    """
    if not is_live:
        yield ClosingReserve(None)
        return
    file = None
    try:
        file = _unnamed_file(folder)
        os.posix_fallocate(file.fileno(), 0, _SIZE)
    except OSError as error:
        if file is not None:
            file.close()
        raise OutputError(
            f"{folder}: {_SIZE // _MEGABYTE} MB cannot be kept back for the end of the run: {error.strerror}"
        ) from error
    with file:
        yield ClosingReserve(file)


def _unnamed_file(folder: Path) -> IO[bytes]:
    """Open a file without a name, which may get one where the file system can do that (open(2), O_TMPFILE)."""
    with suppress(AttributeError, OSError):
        return os.fdopen(os.open(folder, os.O_TMPFILE | os.O_RDWR, _MODE), "r+b", buffering=0)
    return tempfile.TemporaryFile(dir=folder, buffering=0)
