"""Stopping a run from outside: Ctrl-C and SIGTERM end it between two batches, never within one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """Whether a run has been asked to stop, and by what."""

    def __init__(self) -> None:
        self.reason: str | None = None

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.reason is not None and number == signal.SIGINT:
            raise KeyboardInterrupt  # a second Ctrl-C does not wait
        name = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        self.reason = f"stopped by {name}; the result is what was found until then"


@contextmanager
def interruptible() -> Iterator[Interrupt]:
    """For as long as the context lives, signals only take note; outside the main thread there are none to take."""
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, interrupt._ask) for number in numbers}
    try:
        yield interrupt
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
