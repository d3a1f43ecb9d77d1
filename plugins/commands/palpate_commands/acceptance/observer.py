"""The arm's states during a run: by a second connection, or as the run itself records them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate import Batch, DeviceError, Link, Observable, ReportsHealth, clock, host_time_ns

from palpate_commands.acceptance.measurement import BrakingTrace, MissedError
from palpate_commands.acceptance.strokes_run import StrokesRun, row_type
from palpate_commands.acceptance.watched_arm import WatchedArm

_NORMAL = 2  # column of the normal in a pose and in a twist: z
# Choices.
_MEAN_STATES = 8  # of the mean velocity: 16 ms of an arm at 500 Hz
_WATCH_INTERVAL = 0.004  # [s] between two heights of an arm that was connected to again
_CLOSING_TIMEOUT = 2.0  # [s] for the thread of a connection to end
_WATCH_TIME = 0.5  # [s] for which it is watched, which shows whether it stands


class Observer(ABC):
    """States of an arm as they come."""

    failure: str | None = None

    def __init__(self, arm: WatchedArm) -> None:
        self._arm = arm
        self._states: dict[str, list[Batch]] = {stream: [] for stream in arm.streams}

    @abstractmethod
    def _batches(self, stream: str) -> list[Batch]:
        """Return all of a stream's batches so far, none of them empty."""

    @property
    def health(self) -> dict[str, object]:
        """The description that the robot gives of itself."""
        return {}

    @property
    def height(self) -> float:
        """Latest height of the tip in the work frame [m]; NaN before the first state."""
        return self._latest(self._arm.pose, _NORMAL)

    @property
    def velocity(self) -> float:
        """Mean velocity outwards [m/s] of the latest states; 0 before the first."""
        batches = self._batches(self._arm.twist)[-_MEAN_STATES:]
        if not batches:
            return 0.0
        velocities = np.concatenate([batch.values[-_MEAN_STATES:, _NORMAL] for batch in batches])
        return float(velocities[-_MEAN_STATES:].mean())

    @property
    def height_now(self) -> float:
        """Height of the tip [m] now, by the latest state and velocity: on a busy computer that state is old."""
        return self.height + self.velocity * self.lag

    @property
    def lag(self) -> float:
        """Age [s] of the latest state; 0 before the first."""
        batches = self._batches(self._arm.pose)
        return (host_time_ns() - int(batches[-1].time[-1])) / 1e9 if batches else 0.0

    @property
    def mode(self) -> int:
        """Latest mode of the channel that reports stops; 0 before the first."""
        mode = self._latest(self._arm.status, self._arm.mode)
        return int(mode) if np.isfinite(mode) else 0

    def _latest(self, stream: str, column: int) -> float:
        batches = self._batches(stream)
        return float(batches[-1].values[-1, column]) if batches else float("nan")

    def trace(self, origin: int) -> BrakingTrace:
        """Return all states so far, in seconds from an instant [ns]; raises MissedError without any."""
        if self.failure is not None:
            raise MissedError(self.failure)
        time, pose = self._joined(self._arm.pose, origin)
        _, twist = self._joined(self._arm.twist, origin)
        count = min(len(pose), len(twist))  # they come one after the other
        return BrakingTrace(time[:count], pose[:count, _NORMAL], twist[:count, _NORMAL])

    def mode_change(self, origin: int, stop: Literal["emergency", "safeguard", "reflex"]) -> float:
        """Return the time [s] at which the mode first reported a stop; raises MissedError where it never did."""
        modes = getattr(self._arm.modes, stop)
        time, status = self._joined(self._arm.status, origin)
        reported_modes = status[:, self._arm.mode].astype(int)
        stop_rows = np.flatnonzero(np.isin(reported_modes, modes))
        if not len(stop_rows):
            texts = ", ".join(str(mode) for mode in np.unique(reported_modes))
            raise MissedError(f"the controller did not report that stop ({self._arm.modes.channel}: {texts})")
        return float(time[stop_rows[0]])

    def _joined(self, stream: str, origin: int) -> tuple[np.ndarray, np.ndarray]:
        batches = list(self._batches(stream))
        if not batches:
            raise MissedError(self.failure or "the arm sent no states")
        times = np.concatenate([batch.time for batch in batches])
        values = np.concatenate([batch.values for batch in batches])
        return (times - origin) / 1e9, values


class SecondConnection(Observer):
    """States by a connection of its own, read by a thread: it goes on whatever becomes of the run."""

    def __init__(self, arm: WatchedArm, link: Link) -> None:
        super().__init__(arm)
        self._link = link
        self._ending = clock().event()
        self._thread = clock().thread(self._listen, "observer")
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ending.set()
        self._thread.join(_CLOSING_TIMEOUT)

    def _listen(self) -> None:
        try:
            for batch in self._link.batches():
                if batch.stream in self._states and len(batch.time):
                    self._states[batch.stream].append(batch)
                if self._ending.is_set():
                    return
        except DeviceError as error:
            self.failure = str(error)

    def _batches(self, stream: str) -> list[Batch]:
        return self._states[stream]

    @property
    def health(self) -> dict[str, object]:
        """The description that the robot gives of itself."""
        return dict(self._link.health) if isinstance(self._link, ReportsHealth) else {}


class RunRecord(Observer):
    """States that a run writes to disk as they come: all that there is of an arm whose controller serves one program.

    A run that is killed leaves those until then; one that stands still writes those of meanwhile when it goes on.
    """

    def __init__(self, arm: WatchedArm, run: StrokesRun) -> None:
        super().__init__(arm)
        self._run = run
        self._bytes_read = dict.fromkeys(arm.streams, 0)

    def _batches(self, stream: str) -> list[Batch]:
        """Return all batches of a stream, after those that were written since the last call were read."""
        states, layout = self._states[stream], row_type(self._arm.columns(stream))
        with suppress(FileNotFoundError), self._run.record(stream).open("rb") as file:  # the run has not begun
            file.seek(self._bytes_read[stream])
            data = file.read()
            rows = np.frombuffer(data[: len(data) // layout.itemsize * layout.itemsize], layout)
            self._bytes_read[stream] += rows.nbytes
            if len(rows):
                states.append(Batch(stream, rows["time"], rows["time"], rows["values"]))
        return states

    @property
    def health(self) -> dict[str, object]:
        """Description that the robot gave of itself to the run; none of a run that was killed."""
        return dict((self._run.live_facts.get("devices") or {}).get(self._arm.name, {}))


@contextmanager
def observed(arm: WatchedArm, seed: int) -> Iterator[Observer]:
    """Return the arm's states by a second connection, as long as the context lives; raises DeviceError."""
    assert isinstance(arm.device, Observable)
    with arm.device.observe(seed) as link:
        observer = SecondConnection(arm, link)
        try:
            yield observer
        finally:
            observer.close()


def observed_run(arm: WatchedArm, seed: int, run: StrokesRun) -> AbstractContextManager[Observer]:
    """Return the arm's states while a run moves it; raises DeviceError."""
    return nullcontext(RunRecord(arm, run)) if arm.modes.single_connection else observed(arm, seed)


@dataclass(frozen=True)
class StateAfterRun:
    """State of an arm that was connected to again once a run had ended."""

    height: float  # [m] of the tip in the work frame
    movement: float  # [m] by which the tip still moved while it was watched
    mode: int


def state_after_run(arm: WatchedArm, seed: int) -> StateAfterRun:
    """Connect again and watch the arm for a while; return its height, how far it moved, and its mode.

    Raises MissedError where no states come.
    """
    heights: list[float] = []
    try:
        with observed(arm, seed) as observer:
            deadline = clock().now() + _WATCH_TIME
            while clock().now() < deadline:
                clock().sleep(_WATCH_INTERVAL)
                heights.append(observer.height)
            mode, failure = observer.mode, observer.failure
    except DeviceError as error:
        raise MissedError(f"no connection after the run: {error}") from error
    finite_heights = [height for height in heights if np.isfinite(height)]
    if not finite_heights:
        raise MissedError(failure or "the arm sent no states after the run")
    movement = max(finite_heights) - min(finite_heights)
    return StateAfterRun(height=finite_heights[-1], movement=movement, mode=mode)
