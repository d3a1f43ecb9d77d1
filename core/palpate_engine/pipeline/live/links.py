"""Live devices: each has a thread that takes its batches, past the guard, to the one that aligns and records."""

from __future__ import annotations

import queue
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from functools import partial

import numpy as np
from palpate.clocks import clock
from palpate.device import Arm, Batch, Device, Link, SeparateReceiver
from palpate.errors import DeviceError
from palpate.vectors import read_only

from palpate_engine.pipeline.arrivals import declared_batches, open_link
from palpate_engine.pipeline.live.guard import Guard
from palpate_engine.pipeline.rig import Rig

_GATHER = (
    0.006  # [s] over which the guard's batches are joined; with the next one a reading waits 10 ms at most: a choice
)
_GATHER_BEHIND = 0.05  # [s] likewise, while the consumer is behind: fewer and larger pieces cost it less
_MAX_WAITING = 20_000  # pieces that wait to be recorded (0108)
_JOIN = 2.0  # [s] for the threads to end; links give them an opportunity every 0.1 s: a choice
_LOOK = 0.05  # [s] without any batch, after which it is asked whether the run is to continue: a choice


class LiveLinks:
    """Batches of several live links, merged as they come."""

    def __init__(self, links: Mapping[str, Link], devices: Mapping[str, Device], guard: Guard) -> None:
        """Take connected links and their devices, with a thread for each, and the guard that sees all batches."""
        self._links, self._devices, self._guard = links, devices, guard
        self._queue = clock().queue()  # of pairs: name, batch or None
        self._ending = clock().event()
        self._moving = {name for name, link in links.items() if isinstance(link, Arm)}
        self._running = set(links)
        self.largest_backlog = 0
        self.behind = False  # whether the consumer of the batches is busy rather than waiting for them
        self._threads = [
            clock().thread(partial(self._pump, name, link), f"{name} batches", urgent=True)
            for name, link in links.items()
        ]

    @property
    def links(self) -> Mapping[str, Link]:
        """The links by name."""
        return self._links

    def start(self) -> None:
        """Start the threads."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Let the threads end; live links give them an opportunity every 0.1 s."""
        self._ending.set()
        deadline = clock().now() + _JOIN
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(max(deadline - clock().now(), 0.0))

    def _pump(self, name: str, link: Link) -> None:
        """Take the batches of a link past the guard, and put them into the queue in pieces; the body of its thread."""
        gathered: dict[str, list[Batch]] = {}
        last_pass = clock().now()
        receiver = (
            link if isinstance(link, SeparateReceiver) else None
        )  # a protocol's check takes longer than a batch's
        try:
            for batch in declared_batches(name, link, self._devices[name].streams):
                self._guard.check(name, batch, None if receiver is None else receiver.attended)
                gathered.setdefault(batch.stream, []).append(batch)
                if (now := clock().now()) - last_pass > (_GATHER_BEHIND if self.behind else _GATHER):
                    self._pass_on(name, gathered)
                    gathered, last_pass = {}, now
                if self._ending.is_set():
                    break
        except DeviceError as error:
            self._guard.stop.failed(str(error), name, error)
        except BaseException as error:  # whatever a device's code raises, SystemExit as well: the arms must stop
            self._guard.stop.failed(f"{name}: {type(error).__name__}: {error}", name)
        finally:
            self._guard.ended(name)
            self._pass_on(name, gathered)
            self._queue.put((name, None))

    def _pass_on(self, name: str, gathered: Mapping[str, list[Batch]]) -> None:
        """Put the gathered batches of each stream into the queue, joined; stop the arms where too many wait."""
        for batches in gathered.values():
            joined = _joined(batches)
            if len(joined.time):
                self._queue.put((name, joined))
        if self._queue.qsize() > _MAX_WAITING:
            self._guard.trip(
                f"recording cannot keep up: {_MAX_WAITING} pieces wait; is the disk, or the computer, too slow?"
            )

    def until(self, deadline: float) -> Iterator[list[tuple[str, Batch]]]:
        """Yield what comes up to a monotonic time [s], or until every link has ended or the guard has tripped."""
        while (remaining_time := deadline - clock().now()) > 0 and self._running and self._guard.reason is None:
            yield self._next(min(remaining_time, _LOOK))

    def to_the_end(self, patience: float) -> Iterator[list[tuple[str, Batch]]]:
        """Yield what comes until every arm, or without arms every link, is done; an empty list where there is nothing.

        Once the guard has tripped, arms have `patience` [s] to come to rest.
        """
        while self._running & (self._moving or self._running):
            tripped = self._guard.stop.tripped
            if tripped is not None and (not self._moving or clock().now() - tripped > patience):
                return
            yield self._next(_LOOK)

    def after_the_end(self) -> Iterator[list[tuple[str, Batch]]]:
        """Yield what comes once the arms are done, for as long as the guard waits for what was felt before."""
        began = clock().now()
        while self._running and self._guard.awaits_readings(clock().now() - began):
            yield self._next(_GATHER)

    def remaining(self) -> Iterator[list[tuple[str, Batch]]]:
        """Yield what is still in the queue after `stop`."""
        while not self._queue.empty():
            yield self._next(0.0)

    def _next(self, timeout: float) -> list[tuple[str, Batch]]:
        """Return all that waits in the queue; the first of it may take until `timeout` [s] to come.

        A device that has ended has None for a batch there.
        """
        arrivals: list[tuple[str, Batch]] = []
        self.largest_backlog = max(self.largest_backlog, self._queue.qsize() - 1)
        try:
            wait = timeout > 0 and not self.behind
            name, batch = self._queue.get(timeout=timeout) if wait else self._queue.get_nowait()
            while True:
                if batch is None:
                    self._running.discard(name)
                else:
                    arrivals.append((name, batch))
                name, batch = self._queue.get_nowait()
        except queue.Empty:
            return arrivals


def _joined(batches: list[Batch]) -> Batch:
    if len(batches) == 1:
        return batches[0]
    columns = ([getattr(batch, name) for batch in batches] for name in ("time", "received", "values"))
    return read_only(Batch(batches[0].stream, *(np.concatenate(column) for column in columns)))


def connect_devices(rig: Rig, stack: ExitStack) -> dict[str, Link]:
    """Return the links of all devices, connected in parallel; those that came about are left with the stack if one
    fails."""
    contexts = {name: open_link(name, device, rig.run.seed) for name, device in rig.devices.items()}
    links: dict[str, Link] = {}
    failures: dict[str, BaseException] = {}

    def enter(name: str) -> None:
        try:
            links[name] = contexts[name].__enter__()
        except BaseException as error:  # it is raised where the run can handle it
            failures[name] = error

    threads = [clock().thread(partial(enter, name), f"connect {name}") for name in contexts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for name in contexts:
        if name in links:
            stack.push(contexts[name])
    for name in contexts:
        if name in failures:
            raise failures[name]
    return {name: links[name] for name in contexts}
