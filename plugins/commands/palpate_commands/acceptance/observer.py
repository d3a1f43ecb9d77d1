"""A second pair of eyes: the arm's states by a connection of its own, which lives whatever becomes of the run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate import (
    Batch,
    ConfigurationError,
    Device,
    DeviceError,
    Link,
    Observable,
    ReportsHealth,
    ReportsStops,
    StopModes,
    clock,
    host_time_ns,
)
from palpate_engine import Pipeline, own_motions

from palpate_commands.acceptance.measurement import BrakingTrace, MissedError

_Z = 2  # column of the normal
_RECENT = 8  # states


@dataclass(frozen=True)
class WatchedArm:
    """A robot that can be listened to while a run commands it, and where its states are."""

    name: str
    device: Device
    pose: str
    twist: str
    status: str
    mode: int  # column of the mode that reports its stops
    modes: StopModes

    @classmethod
    def of(cls, pipeline: Pipeline) -> WatchedArm:
        """The one robot of a pipeline; raises ConfigurationError."""
        names = list(own_motions(pipeline.devices))
        if len(names) != 1:
            raise ConfigurationError(f"{pipeline.path}: expected one robot, not {len(names)} ({', '.join(names)})")
        device = pipeline.devices[names[0]]
        layouts = {stream.layout: stream.name for stream in device.streams}
        modes = device.stop_modes if isinstance(device, ReportsStops) else None
        columns = [
            (stream.name, [channel.name for channel in stream.channels].index(modes.channel))
            for stream in device.streams
            if modes is not None and modes.channel in [channel.name for channel in stream.channels]
        ]
        sound = device.live and isinstance(device, Observable) and {"pose", "twist"} <= layouts.keys()
        if modes is None or not (sound and columns):
            raise ConfigurationError(
                f"{pipeline.path}: [device.{names[0]}] cannot be watched while a run moves it: a live robot whose "
                "pose, twist and stops a second connection can observe is needed"
            )
        return cls(names[0], device, layouts["pose"], layouts["twist"], *columns[0], modes)


class Observer:
    """States of an arm as they come, from a thread."""

    def __init__(self, arm: WatchedArm, link: Link) -> None:
        self._arm, self._link = arm, link
        self._kept: dict[str, list[Batch]] = {arm.pose: [], arm.twist: [], arm.status: []}
        self._ending = clock().event()
        self.failure: str | None = None
        self._thread = clock().thread(self._listen, "observer")
        self._thread.start()

    def close(self) -> None:
        """Listen no more."""
        self._ending.set()
        self._thread.join(2.0)

    def _listen(self) -> None:
        try:
            for batch in self._link.batches():
                if batch.stream in self._kept and len(batch.time):
                    self._kept[batch.stream].append(batch)
                if self._ending.is_set():
                    return
        except DeviceError as error:
            self.failure = str(error)

    @property
    def health(self) -> dict[str, object]:
        """What the robot says of itself."""
        return dict(self._link.health) if isinstance(self._link, ReportsHealth) else {}

    @property
    def height(self) -> float:
        """Of the tip in the work frame [m], the latest; NaN before there is one."""
        return self._latest(self._arm.pose, _Z)

    @property
    def velocity(self) -> float:
        """Outwards [m/s], the mean of the latest states."""
        recent = self._kept[self._arm.twist][-_RECENT:]
        if not recent:
            return 0.0
        return float(np.concatenate([batch.values[-_RECENT:, _Z] for batch in recent])[-_RECENT:].mean())

    @property
    def height_now(self) -> float:
        """Of the tip [m], carried on from the latest state: on a busy computer that is of some time ago."""
        return self.height + self.velocity * self.lag

    @property
    def lag(self) -> float:
        """How long ago [s] the latest state was; 0 before there is one."""
        batches = self._kept[self._arm.pose]
        return (host_time_ns() - int(batches[-1].time[-1])) / 1e9 if batches else 0.0

    @property
    def mode(self) -> int:
        """The mode that reports its stops, the latest; 0 before the first."""
        found = self._latest(self._arm.status, self._arm.mode)
        return int(found) if np.isfinite(found) else 0

    def _latest(self, stream: str, column: int) -> float:
        batches = self._kept[stream]
        return float(batches[-1].values[-1, column]) if batches else float("nan")

    def trace(self, origin: int) -> BrakingTrace:
        """Everything so far, in seconds from an instant [ns]; raises MissedError where there is nothing."""
        if self.failure is not None:
            raise MissedError(self.failure)
        time, pose = self._joined(self._arm.pose, origin)
        _, twist = self._joined(self._arm.twist, origin)
        count = min(len(pose), len(twist))  # they come one after the other
        return BrakingTrace(time[:count], pose[:count, _Z], twist[:count, _Z])

    def mode_change(self, origin: int, stop: Literal["emergency", "safeguard"]) -> float:
        """When [s] the mode first reported a stop; raises MissedError where it never did."""
        modes = self._arm.modes.emergency if stop == "emergency" else self._arm.modes.safeguard
        time, status = self._joined(self._arm.status, origin)
        found = status[:, self._arm.mode].astype(int)
        there = np.flatnonzero(np.isin(found, modes))
        if not len(there):
            seen = ", ".join(str(mode) for mode in np.unique(found))
            raise MissedError(f"the controller did not report that stop ({self._arm.modes.channel}: {seen})")
        return float(time[there[0]])

    def _joined(self, stream: str, origin: int) -> tuple[np.ndarray, np.ndarray]:
        batches = list(self._kept[stream])
        if not batches:
            raise MissedError(self.failure or "the arm sent no states")
        times = np.concatenate([batch.time for batch in batches])
        values = np.concatenate([batch.values for batch in batches])
        return (times - origin) / 1e9, values


@contextmanager
def observed(arm: WatchedArm, seed: int) -> Iterator[Observer]:
    """The arm's states for as long as the context lives; raises DeviceError."""
    assert isinstance(arm.device, Observable)
    with arm.device.observe(seed) as link:
        observer = Observer(arm, link)
        try:
            yield observer
        finally:
            observer.close()
