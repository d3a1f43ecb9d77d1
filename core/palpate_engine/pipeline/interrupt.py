"""Stopping a run from outside: Ctrl-C, SIGTERM and a lost terminal end it between two batches, never within one."""

from __future__ import annotations

import multiprocessing
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from palpate.clocks import clock

_ONE_PRESS = 1.0  # [s] within which presses of Ctrl-C count as one (0458): a key bounces, and a person insists


class Interrupt:
    """Request to stop a run, and its reason.

    While arms are connected no press of Ctrl-C ends the process: a later one asks for a halt where the arm is.
    """

    def __init__(self) -> None:
        self.reason: str | None = None
        self.signal: int = signal.SIGINT  # for the exit code
        self.asks_for_halt = False  # the arm is to stop where it is, also on its way out
        self._pressed: float | None = None  # [s] the first Ctrl-C
        self._holds_arms = False
        self._trip: Callable[[str], None] | None = None

    def trips(self, trip: Callable[[str], None]) -> None:
        """Pass a request to stop on to the guard at once from now on; a signal waits for the next batch."""
        self._trip = trip
        if self.reason is not None:
            trip(self.reason)

    def stop(self, reason: str) -> None:
        """Ask for a stop, from any thread; the first reason counts."""
        if self.reason is None:
            self.reason = f"stopped: {reason}; the result is what was found until then"
        if self._trip is not None:
            self._trip(self.reason)

    @contextmanager
    def holding_arms(self) -> Iterator[None]:
        """Let Ctrl-C end nothing before the arms stand, within the context."""
        self._holds_arms = True
        try:
            yield
        finally:
            self._holds_arms = False

    def take(self, number: int, frame: FrameType | None) -> None:
        """Take a signal."""
        if number == signal.SIGINT:
            self._take_press()
            return
        self.signal = number
        self.reason = f"stopped by {signal.Signals(number).name}; the result is what was found until then"

    def _take_press(self) -> None:
        """Take a press of Ctrl-C; raises KeyboardInterrupt where nobody waits for an arm, and the run was to stop
        before."""
        now = clock().now()
        # A later press counts by itself after a while; a first one that finds the run stopped already does at once.
        is_first, self._pressed = self._pressed is None, now if self._pressed is None else self._pressed
        if now - self._pressed > _ONE_PRESS or (is_first and self.reason is not None):
            if not self._holds_arms:
                raise KeyboardInterrupt  # it does not wait
            if not is_first:
                self.asks_for_halt = True
        if self.reason is None:
            self.signal = signal.SIGINT
            self.reason = "stopped by Ctrl-C; the result is what was found until then"
        _say(self._answer(is_first))

    def _answer(self, is_first: bool) -> str:
        """Return the sentence that answers a Ctrl-C, the first one or a later one."""
        if self.asks_for_halt:
            return "Ctrl-C: the arm stops where it is; the run ends once it stands"
        if not is_first:
            return (
                f"Ctrl-C: counts as the first one, {_ONE_PRESS:g} s after which another one stops the arm where it is"
            )
        if self._holds_arms:
            return "Ctrl-C: the arm stops and leaves the material"
        return "Ctrl-C: the run is stopped, and what was found is written"


@contextmanager
def interruptible() -> Iterator[Interrupt]:
    """Yield the request to stop; in the context signals only take note, and outside the main thread no signal arrives.

    A lost terminal (SIGHUP) counts like SIGTERM, unless it was ignored before, as under nohup.
    """
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    former_handlers = {number: signal.signal(number, interrupt.take) for number in numbers}
    try:
        yield interrupt
    finally:
        for number, handler in former_handlers.items():
            signal.signal(number, handler)


def _say(text: str) -> None:
    """Print a line for the person at the terminal, from a handler of signals: what it interrupts may be writing as
    well.

    Processes of a pool say nothing: the one that started them does.
    """
    if multiprocessing.parent_process() is not None:
        return
    with suppress(Exception):
        print(f"palpate: {text}", file=sys.stderr, flush=True)
