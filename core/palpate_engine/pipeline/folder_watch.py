"""Whether the run folder is still where it was: an open log is written on when its folder has gone."""

from __future__ import annotations

import os
from pathlib import Path

from palpate.clocks import clock

_LOOK_EVERY = 0.1  # [s]


class FolderWatch:
    """Looks ten times a second whether a path still leads to the folder that it led to at first."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._looked = folder, clock().now()
        self._identity = _identity(folder)

    @property
    def is_gone(self) -> bool:
        """True if it is known to be somewhere else, or nowhere."""
        if clock().now() - self._looked < _LOOK_EVERY:
            return False
        self._looked = clock().now()
        return _identity(self._folder) != self._identity


def _identity(folder: Path) -> tuple[int, int] | None:
    try:
        found = os.stat(folder)
    except OSError:
        return None
    return found.st_dev, found.st_ino
