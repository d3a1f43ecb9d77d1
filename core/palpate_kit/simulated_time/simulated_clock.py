"""Simulated time: a clock that goes on to the next instant at which anything happens."""

from __future__ import annotations

import math
import queue
import select
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from palpate import Clock, HoldUp, use_clock

from palpate_kit.simulated_time.simulated_turns import Actor, Turns

_EPOCH = 946_684_800_000_000_000  # [ns]; 2000-01-01, which nobody takes for the time of a measurement


_SECOND = 1e9  # [ns]


def _nanoseconds(duration: float) -> int:
    """Return a duration [s] in [ns], rounded up: a loop that waits for what is left must get there."""
    return max(math.ceil(duration * _SECOND), 0)


class SimulatedClock(Clock):
    """A clock that goes to the next instant at which anything happens (a `palpate.Clock`).

    A thread that was made by `thread`, and the one that enters `running`, may wait by it; any other thread may read it
    and set its events. Files must not be waited for elsewhere: a thread that blocks in the operating system keeps all
    others waiting.
    """

    simulated = True

    def __init__(self, hold_ups: Sequence[HoldUp] = ()) -> None:
        self._turns = Turns(hold_ups)

    # What `palpate.Clock` asks for.

    def now_ns(self) -> int:
        """Return the simulated time [ns]."""
        return self._turns.now

    def now(self) -> float:
        """Return the simulated time [s]."""
        return self._turns.now / _SECOND

    def epoch_ns(self) -> int:
        """Return the simulated time since 1970 [ns]; the simulation begins with the year 2000."""
        return _EPOCH + self._turns.now

    def processor_time(self) -> float:
        """Return 0: what is computed takes no simulated time."""
        return 0.0

    def contention(self) -> str | None:
        """Return what the computer has kept waiting lately; None without that."""
        names = ", ".join(self._turns.held_up_lately())
        return f"it kept waiting: {names}" if names else None

    def is_held_up(self, process: str) -> bool:
        """Return True if the computer keeps a process waiting now."""
        return self._turns.is_held_up(process)

    def sleep(self, duration: float) -> None:
        """Let others run until a duration [s] has passed."""
        self.wait_until(self._turns.now + _nanoseconds(duration))

    def wait(self, readable: Sequence[Any], timeout: float | None) -> list[Any]:
        """Return the open files that can be read, waiting for up to `timeout` [s] for one; see `palpate.Clock`."""
        me, poll = self._turns.me(), select.poll()
        by_number = {entry if isinstance(entry, int) else entry.fileno(): entry for entry in readable}
        for number in by_number:
            poll.register(number, select.POLLIN)
        if not (ready := poll.poll(0)) and (timeout is None or timeout > 0):
            self._turns.watch(me, poll, None if timeout is None else self.now_ns() + _nanoseconds(timeout))
            ready = poll.poll(0)
        return [by_number[number] for number, _ in ready]

    def event(self) -> _SimulatedEvent:
        """Return a new flag."""
        return _SimulatedEvent(self._turns)

    def queue(self, most: int = 0) -> _SimulatedQueue:
        """Return a new queue, of any length: what is put is taken at the same instant."""
        return _SimulatedQueue(self._turns)

    def thread(self, target: Callable[[], Any], name: str, urgent: bool = False) -> _SimulatedThread:
        """Return a new thread of the process of the thread that asks."""
        return self.process_thread(target, name, self._turns.me().process)

    # What a simulation asks for.

    @contextmanager
    def running(self, process: str = "main") -> Iterator[None]:
        """Let the calling thread take part, and the whole process use this clock; at the end all other threads end."""
        self._turns.begin(process)
        try:
            with use_clock(self):
                yield
        finally:
            self._turns.end()

    def process_thread(self, target: Callable[[], Any], name: str, process: str) -> _SimulatedThread:
        """Return a new thread of a simulated process."""
        return _SimulatedThread(self._turns, target, Actor(name, process))

    def kill(self, process: str) -> None:
        """End all threads of a process but the calling one, wherever they wait."""
        self._turns.kill(process)

    def wait_until(self, instant: int) -> None:
        """Let others run until a time [ns]."""
        self._turns.block(self._turns.me(), instant)


class _SimulatedThread:
    """A thread that takes turns (a `palpate.clocks.Thread`)."""

    def __init__(self, turns: Turns, target: Callable[[], Any], actor: Actor) -> None:
        self._turns, self._target, self._actor = turns, target, actor
        self._registered = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name=actor.name)

    @property
    def ident(self) -> int | None:
        """Its number; None before it was started."""
        return self._thread.ident

    def start(self) -> None:
        """Let it run when its turn comes: the one that starts it goes on."""
        self._thread.start()
        self._registered.wait()
        self._turns.wake(self._actor)

    def join(self, timeout: float | None = None) -> None:
        """Let others run until it has ended, for up to `timeout` [s]."""
        turns, actor = self._turns, self._actor
        until = None if timeout is None else turns.now + _nanoseconds(timeout)
        while not actor.ended and (until is None or turns.now < until):
            me = turns.me()
            actor.joiners.append(me)
            turns.block(me, until)

    def is_alive(self) -> bool:
        """Return True if it runs."""
        return self._thread.ident is not None and not self._actor.ended

    def _run(self) -> None:
        self._turns.run(self._actor, self._target, self._registered.set)


class _SimulatedEvent:
    """A flag (a `palpate.clocks.Event`)."""

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self._raised = False
        self._waiting: list[Actor] = []

    def set(self) -> None:
        """Raise the flag: those that wait for it run at this instant."""
        self._raised = True
        if threading.get_ident() not in self._turns.actors:
            self._turns.outside(self.wake)  # it is looked at before the next turn
            return
        self.wake()

    def wake(self) -> None:
        """Let those run that wait for it."""
        for actor in self._waiting:
            self._turns.wake(actor)

    def clear(self) -> None:
        """Lower the flag."""
        self._raised = False

    def is_set(self) -> bool:
        """Return True if it is raised."""
        return self._raised

    def wait(self, timeout: float | None = None) -> bool:
        """Let others run until it is raised, for up to `timeout` [s]; return True if it is."""
        turns = self._turns
        until = None if timeout is None else turns.now + _nanoseconds(timeout)
        while not self._raised and (until is None or turns.now < until):
            me = turns.me()
            self._waiting.append(me)
            try:
                turns.block(me, until)
            finally:
                self._waiting.remove(me)
        return self._raised


class _SimulatedQueue:
    """A queue (a `palpate.clocks.Queue`)."""

    def __init__(self, turns: Turns) -> None:
        self._items: deque[Any] = deque()
        self._filled = _SimulatedEvent(turns)

    def put(self, item: Any) -> None:
        """Append an item."""
        self._items.append(item)
        self._filled.set()

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Remove the first item; raises queue.Empty."""
        if block and not self._items:
            self._filled.clear()
            self._filled.wait(timeout)
        if not self._items:
            raise queue.Empty
        return self._items.popleft()

    def get_nowait(self) -> Any:
        """Remove the first item; raises queue.Empty."""
        return self.get(block=False)

    def qsize(self) -> int:
        """Return the number of items."""
        return len(self._items)

    def empty(self) -> bool:
        """Return True if it is empty."""
        return not self._items
