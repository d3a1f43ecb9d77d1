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
from pathlib import Path
from typing import Any, Protocol
from weakref import WeakKeyDictionary

_REMEDY = (
    "give palpate real-time priority (`palpate doctor` shows whether it is granted), end other programs, and open the "
    "page on another computer"
)
_LOAD = Path("/proc/loadavg")
_CROWD = 2.0  # a choice: threads that are ready, for each core; a run by itself has one or two in all
URGENT = 20  # a choice: real-time priority of threads that watch an arm, below those of robots and sensors
_MAX_INTERRUPTION = 20_000  # [ns], a choice: two readings of a clock so close have no interruption between them


class Event(Protocol):
    """A flag that threads can wait for, as `threading.Event`."""

    def set(self) -> None:
        """Raise the flag."""

    def clear(self) -> None:
        """Lower the flag."""

    def is_set(self) -> bool:
        """Return True if the flag is raised."""
        ...

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the flag is raised, for up to `timeout` [s]; return True if it is."""
        ...


class Queue(Protocol):
    """A first-in, first-out queue between threads, as `queue.SimpleQueue`; raises `queue.Empty`."""

    def put(self, item: Any) -> None:
        """Append an item."""

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Remove and return the first item, waiting for one for up to `timeout` [s]."""
        ...

    def get_nowait(self) -> Any:
        """Remove and return the first item, if there is one."""
        ...

    def qsize(self) -> int:
        """Return the number of items."""
        ...

    def empty(self) -> bool:
        """Return True if the queue is empty."""
        ...


class Thread(Protocol):
    """A thread of control, as `threading.Thread`."""

    @property
    def ident(self) -> int | None:
        """The number of the thread; None before it was started."""
        ...

    def start(self) -> None:
        """Start the thread."""

    def join(self, timeout: float | None = None) -> None:
        """Wait until the thread has ended, for up to `timeout` [s]."""

    def is_alive(self) -> bool:
        """Return True if the thread runs."""
        ...


class Clock(Protocol):
    """The time of code that runs in real time: reading it, sleeping, waiting, threads."""

    simulated: bool

    def now_ns(self) -> int:
        """Return the monotonic time [ns]."""
        ...

    def now(self) -> float:
        """Return the monotonic time [s]."""
        ...

    def epoch_ns(self) -> int:
        """Return the time since 1970 [ns]."""
        ...

    def processor_time(self) -> float:
        """Return the processor time [s] that this process and its children have used; 0 in simulated time."""
        ...

    def contention(self) -> str | None:
        """Return what competes for the processor at this moment, in words; None where nothing does."""
        ...

    def late_computer(self, cause: str | None = None) -> str:
        """Return a clause that the computer was late, by a known cause or by what competes now; else nothing."""
        likely = self.contention() if cause is None else cause
        if likely is None:
            return ""
        return f"; the computer was {'probably ' if cause is None else ''}late ({likely}): {_REMEDY}"

    def sleep(self, duration: float, /) -> None:
        """Sleep [s]."""

    def wait(self, readable: Sequence[Any], timeout: float | None) -> list[Any]:
        """Return those of some open files that can be read, waiting for up to `timeout` [s] until there is one."""
        ...

    def event(self) -> Event:
        """Return a new flag."""
        ...

    def queue(self, most: int = 0) -> Queue:
        """Return a new queue, in real time of at most so many items (0: any number): one more waits."""
        ...

    def thread(self, target: Callable[[], Any], name: str, urgent: bool = False) -> Thread:
        """Return a new daemon thread, not started yet; an urgent one precedes other programs where permitted."""
        ...


class WallClock(Clock):
    """The computer's own clock."""

    simulated = False

    def now_ns(self) -> int:
        """Return the monotonic time [ns]."""
        return time.monotonic_ns()

    def now(self) -> float:
        """Return the monotonic time [s]."""
        return time.monotonic()

    def epoch_ns(self) -> int:
        """Return the time since 1970 [ns]."""
        return time.time_ns()

    def sleep(self, duration: float, /) -> None:
        """Sleep [s]."""
        time.sleep(duration)

    def processor_time(self) -> float:
        """Return the processor time [s] of this process and of its children that have ended."""
        return sum(os.times()[:4])  # user and system time of the process, then of its children

    def contention(self) -> str | None:
        """Count by the fourth field of ``/proc/loadavg``, "ready/all" of the threads of all programs (proc(5))."""
        return contention(_LOAD)

    def wait(self, readable: Sequence[Any], timeout: float | None) -> list[Any]:
        """See `Clock.wait`."""
        return select.select(readable, [], [], timeout)[0]

    def event(self) -> Event:
        """Return a `threading.Event`."""
        return threading.Event()

    def queue(self, most: int = 0) -> Queue:
        """Return a `queue.SimpleQueue`, or a `queue.Queue` where its length is limited."""
        return queue.Queue(most) if most else queue.SimpleQueue()

    def thread(self, target: Callable[[], Any], name: str, urgent: bool = False) -> Thread:
        """Return a `threading.Thread`."""
        return threading.Thread(target=partial(_urgently, target) if urgent else target, daemon=True, name=name)


def contention(load: Path) -> str | None:
    """Return that more threads are ready to run than an ordinary run has, by a file; None of one that is not there."""
    try:
        ready = int(load.read_text().split()[3].partition("/")[0])
    except (OSError, IndexError, ValueError):
        return None
    cores = os.cpu_count() or 1
    return f"{ready} threads compete for its {cores} cores" if ready > _CROWD * cores else None


def _urgently(target: Callable[[], Any]) -> None:
    """Call a function at real-time priority, which its own threads and processes do not inherit."""
    with suppress(AttributeError, OSError):  # not permitted
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(URGENT))
    target()


_WALL = WallClock()
_clocks: list[Clock] = [_WALL]


def clock() -> Clock:
    """Return the clock of this process."""
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
    """Return host time since the epoch less monotonic time [ns]: one number for the whole life of a process."""
    current = clock()
    if current not in _offsets:
        _offsets[current] = _measure_offset(current)
    return _offsets[current]


def host_time_ns() -> int:
    """Return the host time [ns] of batches: it advances evenly where the computer's clock is set during a run."""
    return clock().now_ns() + epoch_offset()


_offsets: WeakKeyDictionary[Clock, int] = WeakKeyDictionary()


def _measure_offset(source: Clock) -> int:
    """Return time since 1970 less monotonic time [ns], both read without an interruption between them."""
    while True:
        before, epoch, after = source.now_ns(), source.epoch_ns(), source.now_ns()
        if after - before < _MAX_INTERRUPTION:
            return epoch - (before + after) // 2
