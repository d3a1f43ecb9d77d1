"""Threads that take turns in the order of the times for which they wait.

Exactly one thread runs at a time. It runs until it waits; then the time goes to the earliest instant for which any
thread waits, and that thread runs. What a thread computes takes no time, so that the order of events, and with it every
result, depends on nothing but the code and its seeds. The method is that of deterministic simulation testing.
"""

from __future__ import annotations

import heapq
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from palpate import HoldUp

BEGIN = 1_000_000_000  # [ns]; a monotonic time of 0 would be mistaken for none
_SECOND = 1e9  # [ns]
_LATELY, _LOOK = 1_000_000_000, 1_000_000  # [ns] before now, and between instants that are looked at


class EndOfThread(BaseException):
    """Ends a thread of a simulated process that was killed, or whose simulation is over."""


class DeadlockError(RuntimeError):
    """Every thread of a simulation waits for another one."""


class Actor:
    """A thread of the simulation."""

    def __init__(self, name: str, process: str) -> None:
        self.name, self.process = name, process
        self.turn = threading.Lock()  # free while it is this actor's turn
        self.turn.acquire()
        self.waits = 0  # number of the wait that is under way: an entry of the agenda for an earlier one is void
        self.watched: Any = None  # a `select.poll` of the files that it waits for
        self.roused = False  # one of them can be read: its turn will come
        self.killed = self.ended = False
        self.joiners: list[Actor] = []


class Turns:
    """Order of the actors, and the time."""

    def __init__(self, hold_ups: Sequence[HoldUp]) -> None:
        self.now = BEGIN  # [ns]
        self.actors: dict[int, Actor] = {}  # by the number of the thread
        self._hold_ups = tuple(hold_ups)
        self._agenda: list[tuple[int, int, Actor, int]] = []  # time [ns], order, who, number of its wait
        self._order = 0
        self._watching: list[Actor] = []
        self._outside: deque[Callable[[], None]] = deque()  # what threads that take no turns want done
        self._main: Actor | None = None
        self._over = False
        self._deadlock: str | None = None

    def begin(self, process: str) -> None:
        """Let the calling thread take part as the first one, whose turn it is."""
        self._main = self.actors[threading.get_ident()] = Actor("main", process)

    def end(self) -> None:
        """End all other threads; those that were started last end first."""
        me, self._over = self.me(), True
        for actor in reversed(list(self.actors.values())):
            if actor is not me and not actor.ended:
                actor.killed = True
                actor.turn.release()
                me.turn.acquire()
        del self.actors[threading.get_ident()]

    def run(self, actor: Actor, target: Callable[[], Any], registered: Callable[[], None]) -> None:
        """Run `target` on this thread as an actor (a simulated thread), from its first turn to its end.

        `registered` is called once the actor is known, before it waits for its turn.
        """
        self.actors[threading.get_ident()] = actor
        registered()
        actor.turn.acquire()
        try:
            if not actor.killed:
                target()
        except EndOfThread:
            pass
        finally:
            actor.ended = True
            del self.actors[threading.get_ident()]
            for joiner in actor.joiners:
                self.wake(joiner)
            self._pass_on()

    def kill(self, process: str) -> None:
        """End all threads of a process but the calling one, wherever they wait."""
        for actor in list(self.actors.values()):
            if actor.process == process and actor is not self.actors.get(threading.get_ident()):
                actor.killed = True
                self.wake(actor)

    def me(self) -> Actor:
        """Return the actor whose thread this is; raises RuntimeError on a thread that takes no turns."""
        actor = self.actors.get(threading.get_ident())
        if actor is None:
            name = threading.current_thread().name
            raise RuntimeError(f"thread {name} waits in simulated time, and was not made by clock().thread")
        return actor

    def wake(self, actor: Actor) -> None:
        """Let an actor run now, whatever it waits for."""
        self._order += 1
        heapq.heappush(self._agenda, (self.now, self._order, actor, actor.waits))

    def outside(self, action: Callable[[], None]) -> None:
        """Do something before the next turn, for a thread that takes no turns."""
        self._outside.append(action)

    def watch(self, me: Actor, poll: Any, until: int | None) -> None:
        """Give the turn away until a time [ns], or until a file of a `select.poll` can be read."""
        me.watched = poll
        self._watching.append(me)
        try:
            self.block(me, until)
        finally:
            me.roused = False
            self._watching.remove(me)

    def block(self, me: Actor, until: int | None) -> None:
        """Give the turn of an actor (a simulated thread) away until a time [ns], or until another one wakes it.

        Raises EndOfThread if it was killed, DeadlockError if all wait for each other.
        """
        if me.killed:
            raise EndOfThread
        if until is not None:
            self._order += 1
            heapq.heappush(self._agenda, (until, self._order, me, me.waits))
        following = self._next()
        if following is not me:
            following.turn.release()
            me.turn.acquire()
        if me.killed:
            raise EndOfThread
        if self._deadlock is not None:
            raise DeadlockError(self._deadlock)

    def _pass_on(self) -> None:
        """Give the turn away for ever."""
        assert self._main is not None
        following = self._main if self._over else self._next()
        following.turn.release()

    def _next(self) -> Actor:
        """Return the actor whose turn it is; the time goes on to it.

        Where all wait for each other the main actor gets the turn, with an error.
        """
        assert self._main is not None
        while True:
            while self._outside:
                self._outside.popleft()()
            # Files that can be read by now wake the actors that wait for them.
            for actor in self._watching:
                if not actor.roused and actor.watched.poll(0):
                    actor.roused = True
                    self.wake(actor)
            if not self._agenda:
                waiting = ", ".join(sorted(f"{a.process}: {a.name}" for a in self.actors.values()))
                self._deadlock = f"at {self.now / _SECOND:.6f} s each of these waits for another: {waiting}"
                return self._main
            # An entry of the agenda is time [ns], order, actor, number of its wait; one for an earlier wait is void.
            instant, _, actor, number = heapq.heappop(self._agenda)
            if actor.ended or number != actor.waits:
                continue
            instant = max(instant, self.now)
            # A process that is held up is due again when that ends.
            free = self._free(actor.process, instant)
            if free > instant:
                self._order += 1
                heapq.heappush(self._agenda, (free, self._order, actor, number))
                continue
            self.now = instant
            actor.waits += 1
            return actor

    def _free(self, process: str, instant: int) -> int:
        """Return when [ns] the computer lets a process run that is due at an instant [ns]."""
        for hold_up in self._hold_ups:
            if process.partition(" ")[0] == hold_up.process:
                instant = BEGIN + hold_up.until(instant - BEGIN)
        return instant

    def is_held_up(self, process: str) -> bool:
        """Return True if the computer keeps a process waiting now."""
        return self._free(process, self.now) > self.now

    def held_up_lately(self) -> list[str]:
        """Return the processes that the computer has kept waiting since a second before now."""
        instants = range(max(self.now - _LATELY, BEGIN), self.now + 1, _LOOK)
        names = dict.fromkeys(hold_up.process for hold_up in self._hold_ups)
        return [name for name in names if any(self._free(name, instant) > instant for instant in instants)]
