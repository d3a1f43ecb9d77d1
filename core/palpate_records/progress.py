"""Progress of a long read."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int], object]  # called with the number of messages that were read so far


def silent(_: int) -> None:
    """Report no progress."""
