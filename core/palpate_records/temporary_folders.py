"""Temporary folders that outlive no killed process for long: making the next one removes those whose owner is gone."""

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
_LOCK = "in-use"


@contextmanager
def scratch(beside: Path | None = None) -> Iterator[Path]:
    """A folder for intermediate files, in that folder or among the system's temporary files; raises OSError.

    Its owner holds a lock, which the system takes back when the process ends, however it ends.
    """
    root = Path(tempfile.gettempdir()) if beside is None else beside
    prefix = _PREFIX if beside is None else f".{_PREFIX}"
    _remove_left(root, prefix)
    folder, lock = _locked(root, prefix)
    try:
        with lock:
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _locked(root: Path, prefix: str) -> tuple[Path, IO[bytes]]:
    """Return a new folder with its lock held: another process may remove it as long as it is not."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=prefix, dir=root))
        lock = (folder / _LOCK).open("wb")
        fcntl.flock(lock, fcntl.LOCK_EX)
        if os.fstat(lock.fileno()).st_nlink:
            return folder, lock
        lock.close()


def _remove_left(root: Path, prefix: str) -> None:
    """Remove our folders whose lock is free; those without a lock are not known to be ours."""
    for lock in root.glob(f"{prefix}*/{_LOCK}"):
        with suppress(OSError):  # another's, or gone
            if lock.stat().st_uid != os.getuid() or lock.is_symlink():
                continue
            with lock.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(lock.parent, ignore_errors=True)
