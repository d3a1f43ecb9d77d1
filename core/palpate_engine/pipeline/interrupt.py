"""Stopping a run from outside: Ctrl-C, SIGTERM and a lost terminal end it between two batches, never within one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """Whether a run has been asked to stop, and by what."""

    def __init__(self) -> None:
        self.reason: str | None = None
        self.signal: int = signal.SIGINT  # for the exit code
        self._trip: Callable[[str], None] | None = None

    def trips(self, trip: Callable[[str], None]) -> None:
        """From now on a request to stop goes to the guard at once; a signal waits for the next batch."""
        self._trip = trip
        if self.reason is not None:
            trip(self.reason)

    def stop(self, reason: str) -> None:
        """Ask for a stop, from any thread; the first reason counts."""
        if self.reason is None:
            self.reason = f"stopped: {reason}; the result is what was found until then"
        if self._trip is not None:
            self._trip(self.reason)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.reason is not None and number == signal.SIGINT:
            raise KeyboardInterrupt  # a second Ctrl-C does not wait
        self.signal = number
        name = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        self.reason = f"stopped by {name}; the result is what was found until then"


@contextmanager
def interruptible() -> Iterator[Interrupt]:
    """For as long as the context lives, signals only take note; outside the main thread no signal arrives.

    A lost terminal (SIGHUP) counts like SIGTERM, unless it was ignored before, as under nohup.
    """
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, interrupt._ask) for number in numbers}
    try:
        yield interrupt
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
