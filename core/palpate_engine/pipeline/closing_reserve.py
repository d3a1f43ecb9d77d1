"""Room on the disk that a run keeps back for its end: the close of its log, and its result."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from palpate.errors import OutputError

_SIZE = 4 << 20  # [bytes]; the index of a log of 20 minutes is as large


class ClosingReserve:
    """Disk space reserved by an unnamed file in the run folder, until `release` or the end of the process frees it."""

    def __init__(self, file: IO[bytes] | None) -> None:
        self._file = file

    def release(self) -> None:
        """Give the room up."""
        if self._file is not None:
            self._file.close()
            self._file = None


@contextmanager
def closing_reserve(folder: Path, wanted: bool) -> Iterator[ClosingReserve]:
    """The reserve of a run, or an empty one if not requested; raises OutputError if the disk is full."""
    file = None
    try:
        if wanted:
            file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  (its owner closes it)
            os.posix_fallocate(file.fileno(), 0, _SIZE)
    except OSError as error:
        if file is not None:
            file.close()
        raise OutputError(
            f"{folder}: {_SIZE >> 20} MB cannot be kept back for the end of the run: {error.strerror}"
        ) from error
    reserve = ClosingReserve(file)
    try:
        yield reserve
    finally:
        reserve.release()
