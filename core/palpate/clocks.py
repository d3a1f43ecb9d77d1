"""The clock of a live run: time, waiting, threads.

Whatever runs in real time asks `clock()` for the time, sleeps by it and waits by it. It is the computer's own clock,
unless a simulation puts another one in its place: then the very same code runs in simulated time, deterministically and
as fast as the computer can.
"""

from __future__ import annotations

import os
import queue
import select
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, Protocol
from weakref import WeakKeyDictionary

URGENT = 20  # real-time priority of threads that watch an arm; below those of robots and sensors


class Event(Protocol):
    """A flag that threads can wait for, as `threading.Event`."""

    def set(self) -> None:
        """Raise the flag."""

    def clear(self) -> None:
        """Lower the flag."""

    def is_set(self) -> bool:
        """Whether it is raised."""
        ...

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is raised, for up to `timeout` [s]; whether it is."""
        ...


class Queue(Protocol):
    """A first-in, first-out queue between threads, as `queue.SimpleQueue`; raises `queue.Empty`."""

    def put(self, item: Any) -> None:
        """Append an item."""

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Remove the first item, waiting for one for up to `timeout` [s]."""
        ...

    def get_nowait(self) -> Any:
        """Remove the first item, if there is one."""
        ...

    def qsize(self) -> int:
        """The number of items."""
        ...

    def empty(self) -> bool:
        """Whether it is empty."""
        ...


class Thread(Protocol):
    """A thread of control, as `threading.Thread`."""

    @property
    def ident(self) -> int | None:
        """Its number; None before it was started."""
        ...

    def start(self) -> None:
        """Start it."""

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has ended, for up to `timeout` [s]."""

    def is_alive(self) -> bool:
        """Whether it runs."""
        ...


class Clock(Protocol):
    """What code that runs in real time may know and do about time."""

    simulated: bool

    def now_ns(self) -> int:
        """Monotonic time [ns]."""
        ...

    def now(self) -> float:
        """Monotonic time [s]."""
        ...

    def epoch_ns(self) -> int:
        """Time since 1970 [ns]."""
        ...

    def processor_time(self) -> float:
        """Processor time [s] that this process and its children have used; 0 in simulated time."""
        ...

    def sleep(self, duration: float, /) -> None:
        """Sleep [s]."""

    def wait(self, readable: Sequence[Any], timeout: float | None) -> list[Any]:
        """Those of some open files that can be read, waiting for up to `timeout` [s] until there is one."""
        ...

    def event(self) -> Event:
        """A new flag."""
        ...

    def queue(self, most: int = 0) -> Queue:
        """A new queue, in real time of at most so many items (0: any number): who puts one more waits."""
        ...

    def thread(self, target: Callable[[], Any], name: str, urgent: bool = False) -> Thread:
        """A new daemon thread, not started yet; an urgent one goes before other programs where that is permitted."""
        ...


class WallClock:
    """The computer's own clock."""

    simulated = False
    now_ns = staticmethod(time.monotonic_ns)
    now = staticmethod(time.monotonic)
    epoch_ns = staticmethod(time.time_ns)
    sleep = staticmethod(time.sleep)

    def processor_time(self) -> float:
        """Processor time [s] of this process and of its children that have ended."""
        return sum(os.times()[:4])

    def wait(self, readable: Sequence[Any], timeout: float | None) -> list[Any]:
        """See `Clock.wait`."""
        return select.select(readable, [], [], timeout)[0]

    def event(self) -> Event:
        """A `threading.Event`."""
        return threading.Event()

    def queue(self, most: int = 0) -> Queue:
        """A `queue.SimpleQueue`, or a `queue.Queue` where its length is limited."""
        return queue.Queue(most) if most else queue.SimpleQueue()

    def thread(self, target: Callable[[], Any], name: str, urgent: bool = False) -> Thread:
        """A `threading.Thread`."""
        return threading.Thread(target=partial(_urgently, target) if urgent else target, daemon=True, name=name)


def _urgently(target: Callable[[], Any]) -> None:
    """Call a function at real-time priority, which what it starts does not inherit."""
    with suppress(AttributeError, OSError):  # not permitted
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(URGENT))
    target()


_WALL = WallClock()
_clocks: list[Clock] = [_WALL]


def clock() -> Clock:
    """The clock of this process."""
    return _clocks[-1]


@contextmanager
def use_clock(other: Clock) -> Iterator[None]:
    """Give this process another clock within the context."""
    _clocks.append(other)
    try:
        yield
    finally:
        _clocks.remove(other)


def epoch_offset() -> int:
    """What makes host time [ns], since the epoch, out of monotonic time: one for the whole life of a process."""
    by = clock()
    if by not in _offsets:
        _offsets[by] = _measured_offset(by)
    return _offsets[by]


def host_time_ns() -> int:
    """Host time [ns], as batches bear it: it goes on evenly where the computer's clock is set during a run."""
    return clock().now_ns() + epoch_offset()


_offsets: WeakKeyDictionary[Clock, int] = WeakKeyDictionary()


def _measured_offset(by: Clock) -> int:
    while True:
        before, epoch, after = by.now_ns(), by.epoch_ns(), by.now_ns()
        if after - before < 20_000:  # nothing came in between
            return epoch - (before + after) // 2
