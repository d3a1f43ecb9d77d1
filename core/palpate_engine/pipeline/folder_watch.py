"""A watch on the run folder: an open log is written on where its folder has been moved or deleted."""

from __future__ import annotations

import os
from pathlib import Path

from palpate.clocks import clock

_LOOK_INTERVAL = 0.1  # [s]; a choice


class FolderWatch:
    """Compares, ten times a second, the folder at a path with the one that was there at first."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._last_look = folder, clock().now()
        self._identity = _identity(folder)

    @property
    def is_gone(self) -> bool:
        """True if the folder is known to have been moved or deleted."""
        if clock().now() - self._last_look < _LOOK_INTERVAL:
            return False
        self._last_look = clock().now()
        return _identity(self._folder) != self._identity


def _identity(folder: Path) -> tuple[int, int] | None:
    """Return device and inode of a folder; None without access to one."""
    try:
        status = os.stat(folder)
    except OSError:
        return None
    return status.st_dev, status.st_ino
