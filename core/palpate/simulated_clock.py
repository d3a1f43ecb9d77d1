"""Simulated time: threads take turns in the order of the times for which they wait.

Exactly one thread runs at a time. It runs until it waits; then the time goes to the earliest instant for which any
thread waits, and that thread runs. What a thread computes takes no time, so that the order of events, and with it every
result, depends on nothing but the code and its seeds. The method is that of deterministic simulation testing.
"""

from __future__ import annotations

import heapq
import math
import queue
import select
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from palpate.clocks import use_clock

_BEGIN = 1_000_000_000  # [ns]; a monotonic time of 0 would be mistaken for none
_EPOCH = 946_684_800_000_000_000  # [ns]; 2000-01-01, which nobody takes for the time of a measurement


class ThreadEnded(BaseException):
    """Ends a thread of a simulated process that was killed, or whose simulation is over."""


class DeadlockError(RuntimeError):
    """Every thread of a simulation waits for another one."""


@dataclass(frozen=True)
class HoldUp:
    """A process that is kept waiting for a `duration` [s], `first` at a time [s], then `every` [s], if at all.

    The name "robot" stands for "robot 1", "robot 2" and so on, too.
    """

    process: str
    duration: float
    first: float = 0.0
    every: float | None = None

    def until(self, now: int) -> int:
        """When [ns after the start] a thread that is due `now` may run."""
        begin, length = round(self.first * 1e9), round(self.duration * 1e9)
        if now < begin:
            return now
        if self.every is not None:
            begin += (now - begin) // round(self.every * 1e9) * round(self.every * 1e9)
        return max(now, begin + length) if now < begin + length else now


def _nanoseconds(duration: float) -> int:
    """A duration [s] in [ns], rounded up: a loop that waits for what is left must get there."""
    return max(math.ceil(duration * 1e9), 0)


class _Actor:
    """A thread of the simulation."""

    def __init__(self, name: str, process: str) -> None:
        self.name, self.process = name, process
        self.turn = threading.Lock()  # free while it is this actor's turn
        self.turn.acquire()
        self.waits = 0  # number of the wait that is under way: an entry of the agenda for an earlier one is void
        self.watched: Any = None  # a `select.poll` of the files that it waits for
        self.roused = False  # one of them can be read: its turn will come
        self.killed = self.ended = False
        self.joiners: list[_Actor] = []


class SimulatedClock:
    """A clock that goes to the next instant at which anything happens (a `palpate.Clock`).

    A thread that was made by `thread`, and the one that enters `running`, may wait by it; any other thread may read it
    and set its events. Files must not be waited for elsewhere: a thread that blocks in the operating system keeps all
    others waiting.
    """

    simulated = True

    def __init__(self, hold_ups: Sequence[HoldUp] = ()) -> None:
        self._now = _BEGIN
        self._hold_ups = tuple(hold_ups)
        self._agenda: list[tuple[int, int, _Actor, int]] = []  # time [ns], order, who, number of its wait
        self._order = 0
        self._actors: dict[int, _Actor] = {}  # by the number of the thread
        self._watching: list[_Actor] = []
        self._outside: deque[_SimulatedEvent] = deque()  # set by threads that take no turns
        self._main: _Actor | None = None
        self._over = False
        self._deadlock: str | None = None

    # What `palpate.Clock` asks for.

    def now_ns(self) -> int:
        """Simulated time [ns]."""
        return self._now

    def now(self) -> float:
        """Simulated time [s]."""
        return self._now / 1e9

    def epoch_ns(self) -> int:
        """Simulated time since 1970 [ns]; the simulation begins with the year 2000."""
        return _EPOCH + self._now

    def processor_time(self) -> float:
        """Nothing: what is computed takes no simulated time."""
        return 0.0

    def sleep(self, duration: float) -> None:
        """Let others run until a duration [s] has passed."""
        self.wait_until(self._now + _nanoseconds(duration))

    def wait(self, readable: Sequence[Any], timeout: float | None) -> list[Any]:
        """Those of some open files that can be read; see `palpate.Clock`."""
        me, poll = self._me(), select.poll()
        by_number = {entry if isinstance(entry, int) else entry.fileno(): entry for entry in readable}
        for number in by_number:
            poll.register(number, select.POLLIN)
        if not (ready := poll.poll(0)) and (timeout is None or timeout > 0):
            me.watched = poll
            self._watching.append(me)
            try:
                self._block(me, None if timeout is None else self._now + _nanoseconds(timeout))
            finally:
                me.roused = False
                self._watching.remove(me)
            ready = poll.poll(0)
        return [by_number[number] for number, _ in ready]

    def event(self) -> _SimulatedEvent:
        """A new flag."""
        return _SimulatedEvent(self)

    def queue(self, most: int = 0) -> _SimulatedQueue:
        """A new queue, of any length: what is put is taken at the same instant."""
        return _SimulatedQueue(self)

    def thread(self, target: Callable[[], Any], name: str) -> _SimulatedThread:
        """A new thread of the process of the thread that asks."""
        return self.process_thread(target, name, self._me().process)

    # What a simulation asks for.

    @contextmanager
    def running(self, process: str = "main") -> Iterator[None]:
        """The calling thread takes part, and the whole process goes by this clock; at the end all other threads end."""
        me = self._main = self._actors[threading.get_ident()] = _Actor("main", process)
        try:
            with use_clock(self):
                yield
        finally:
            self._over = True
            for actor in reversed(list(self._actors.values())):  # those that were started last end first
                if actor is not me and not actor.ended:
                    actor.killed = True
                    actor.turn.release()
                    me.turn.acquire()
            del self._actors[threading.get_ident()]

    def process_thread(self, target: Callable[[], Any], name: str, process: str) -> _SimulatedThread:
        """A new thread of a simulated process."""
        return _SimulatedThread(self, target, _Actor(name, process))

    def kill(self, process: str) -> None:
        """End all threads of a process but the calling one, wherever they wait."""
        for actor in list(self._actors.values()):
            if actor.process == process and actor is not self._actors.get(threading.get_ident()):
                actor.killed = True
                self._wake(actor)

    def wait_until(self, instant: int) -> None:
        """Let others run until a time [ns]."""
        self._block(self._me(), instant)

    # The order of turns.

    def _me(self) -> _Actor:
        actor = self._actors.get(threading.get_ident())
        if actor is None:
            name = threading.current_thread().name
            raise RuntimeError(f"thread {name} waits in simulated time, and was not made by clock().thread")
        return actor

    def _wake(self, actor: _Actor) -> None:
        """Let an actor run now, whatever it waits for."""
        self._order += 1
        heapq.heappush(self._agenda, (self._now, self._order, actor, actor.waits))

    def _block(self, me: _Actor, until: int | None) -> None:
        """Give the turn away until a time [ns], or until somebody wakes this actor."""
        if me.killed:
            raise ThreadEnded
        if until is not None:
            self._order += 1
            heapq.heappush(self._agenda, (until, self._order, me, me.waits))
        following = self._next()
        if following is not me:
            following.turn.release()
            me.turn.acquire()
        if me.killed:
            raise ThreadEnded
        if self._deadlock is not None:
            raise DeadlockError(self._deadlock)

    def _pass_on(self) -> None:
        """Give the turn away for ever."""
        assert self._main is not None
        following = self._main if self._over else self._next()
        following.turn.release()

    def _next(self) -> _Actor:
        """Whose turn it is; the time goes on to it."""
        assert self._main is not None
        while True:
            while self._outside:
                self._outside.popleft().wake()
            for actor in self._watching:
                if not actor.roused and actor.watched.poll(0):
                    actor.roused = True
                    self._wake(actor)
            if not self._agenda:
                waiting = ", ".join(sorted(f"{a.process}: {a.name}" for a in self._actors.values()))
                self._deadlock = f"at {self._now / 1e9:.6f} s each of these waits for another: {waiting}"
                return self._main
            instant, _, actor, number = heapq.heappop(self._agenda)
            if actor.ended or number != actor.waits:
                continue
            instant = max(instant, self._now)
            free = self._free(actor, instant)
            if free > instant:
                self._order += 1
                heapq.heappush(self._agenda, (free, self._order, actor, number))
                continue
            self._now = instant
            actor.waits += 1
            return actor

    def _free(self, actor: _Actor, instant: int) -> int:
        """When [ns] the computer lets an actor run that is due at an instant [ns]."""
        for hold_up in self._hold_ups:
            if actor.process.partition(" ")[0] == hold_up.process:
                instant = _BEGIN + hold_up.until(instant - _BEGIN)
        return instant


class _SimulatedThread:
    """A thread that takes turns (a `palpate.clocks.Thread`)."""

    def __init__(self, clock: SimulatedClock, target: Callable[[], Any], actor: _Actor) -> None:
        self._clock, self._target, self._actor = clock, target, actor
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
        self._clock._wake(self._actor)

    def join(self, timeout: float | None = None) -> None:
        """Let others run until it has ended, for up to `timeout` [s]."""
        clock, actor = self._clock, self._actor
        until = None if timeout is None else clock.now_ns() + _nanoseconds(timeout)
        while not actor.ended and (until is None or clock.now_ns() < until):
            me = clock._me()
            actor.joiners.append(me)
            clock._block(me, until)

    def is_alive(self) -> bool:
        """Whether it runs."""
        return self._thread.ident is not None and not self._actor.ended

    def _run(self) -> None:
        clock, actor = self._clock, self._actor
        clock._actors[threading.get_ident()] = actor
        self._registered.set()
        actor.turn.acquire()
        try:
            if not actor.killed:
                self._target()
        except ThreadEnded:
            pass
        finally:
            actor.ended = True
            del clock._actors[threading.get_ident()]
            for joiner in actor.joiners:
                clock._wake(joiner)
            clock._pass_on()


class _SimulatedEvent:
    """A flag (a `palpate.clocks.Event`)."""

    def __init__(self, clock: SimulatedClock) -> None:
        self._clock = clock
        self._raised = False
        self._waiting: list[_Actor] = []

    def set(self) -> None:
        """Raise the flag: those that wait for it run at this instant."""
        self._raised = True
        if threading.get_ident() not in self._clock._actors:
            self._clock._outside.append(self)  # it is looked at before the next turn
            return
        self.wake()

    def wake(self) -> None:
        """Let those run that wait for it."""
        for actor in self._waiting:
            self._clock._wake(actor)

    def clear(self) -> None:
        """Lower the flag."""
        self._raised = False

    def is_set(self) -> bool:
        """Whether it is raised."""
        return self._raised

    def wait(self, timeout: float | None = None) -> bool:
        """Let others run until it is raised, for up to `timeout` [s]; whether it is."""
        clock = self._clock
        until = None if timeout is None else clock.now_ns() + _nanoseconds(timeout)
        while not self._raised and (until is None or clock.now_ns() < until):
            me = clock._me()
            self._waiting.append(me)
            try:
                clock._block(me, until)
            finally:
                self._waiting.remove(me)
        return self._raised


class _SimulatedQueue:
    """A queue (a `palpate.clocks.Queue`)."""

    def __init__(self, clock: SimulatedClock) -> None:
        self._items: deque[Any] = deque()
        self._filled = _SimulatedEvent(clock)

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
        """The number of items."""
        return len(self._items)

    def empty(self) -> bool:
        """Whether there are none."""
        return not self._items
