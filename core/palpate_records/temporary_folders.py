"""Temporary folders, of which the next one removes those of killed processes."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

_PREFIX = "palpate-"
_LOCK = "in-use"  # file in each folder, locked by its process


@contextmanager
def scratch(beside: Path | None = None) -> Iterator[Path]:
    """Make a folder for intermediate files, in a folder or among the system's temporary files; raises OSError.

    Its process holds a lock, which the system releases when the process ends in any way.
    """
    root = Path(tempfile.gettempdir()) if beside is None else beside
    prefix = _PREFIX if beside is None else f".{_PREFIX}"
    _remove_abandoned(root, prefix)
    folder, lock = _make_locked(root, prefix)
    try:
        with lock:
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _make_locked(root: Path, prefix: str) -> tuple[Path, IO[bytes]]:
    """Return a new folder with its lock held; one that another process removed before that is replaced."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=prefix, dir=root))
        lock = (folder / _LOCK).open("wb")
        fcntl.flock(lock, fcntl.LOCK_EX)
        if os.fstat(lock.fileno()).st_nlink:
            return folder, lock
        lock.close()


def _remove_abandoned(root: Path, prefix: str) -> None:
    """Remove folders of this user whose lock is free; a folder without a lock may be another program's."""
    for lock in root.glob(f"{prefix}*/{_LOCK}"):
        with suppress(OSError):  # of a process that runs, or removed by now
            if lock.stat().st_uid != os.getuid() or lock.is_symlink():
                continue
            with lock.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(lock.parent, ignore_errors=True)
