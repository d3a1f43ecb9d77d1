"""One signal on its way to the samples: readings wait here until their instant can be served."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_settings import Signal
from palpate.device import Batch
from palpate.stream_health import Health
from palpate.vectors import Floats

_SECOND = 1_000_000_000  # [ns]
_CARRIED = 3  # readings that a batch leaves to the next, for its health counts third differences


class Series:
    """The readings of one signal in the order of true time: late ones moved back by the declared delay."""

    def __init__(
        self, signal: Signal, column: int, gap: float, limits: tuple[float, float] | None, watched: bool
    ) -> None:
        """Take a signal, its column, longest gap [s] and limits, and True to watch for a sensor that is stuck."""
        self.signal = signal
        self._watched = watched  # for a sensor that is stuck
        self._column = column
        self._delay = round(signal.delay * _SECOND)
        self.gap = round(gap * _SECOND)  # [ns]
        self._limits = limits
        self.stamps: NDArray[np.int64] = np.zeros(0, np.int64)
        self.values: Floats = np.zeros(0)
        self._saturated: NDArray[np.bool_] = np.zeros(0, bool)
        self._repeated = 0  # the reading that goes on
        self._ran = 0  # readings of the run before that
        self._previous: Floats = np.zeros(0)  # the last readings of the batch before, _CARRIED at most
        self._change = 0.0  # before that

    def feed(self, stamps: NDArray[np.int64], batch: Batch, rows: NDArray[np.bool_], health: Health) -> None:
        """Take over the rows of a batch that are in order and finite."""
        values, usable = batch.values[:, self._column], rows & np.isfinite(batch.values[:, self._column])
        if not usable.all():
            values, stamps = values[usable], stamps[usable]
        saturated = self._beyond_limits(values)
        health.saturated += int(np.count_nonzero(saturated))
        if self._watched:
            self._count_repeats(values, health)
        stamps, values = stamps - self._delay, values * self.signal.sign
        if len(self.stamps):
            stamps, values = np.concatenate([self.stamps, stamps]), np.concatenate([self.values, values])
            saturated = np.concatenate([self._saturated, saturated])
        self.stamps, self.values, self._saturated = stamps, values, saturated

    def _beyond_limits(self, values: Floats) -> NDArray[np.bool_]:
        """Return True for readings (n,) at or beyond the ends of the sensor's range."""
        if self._limits is None:
            return np.zeros(len(values), bool)
        low, high = self._limits
        return (values <= low) | (values >= high)

    def _count_repeats(self, values: Floats, health: Health) -> None:
        """Take note of the runs of equal readings, the one that goes on as well, and of how readings change."""
        if not len(values):
            return
        readings = np.concatenate([self._previous, values])
        carried = len(self._previous)
        health.changed(readings, carried)
        self._previous = readings[-_CARRIED:]
        readings = readings[max(carried - 1, 0) :]
        # Runs of equal readings end where a reading changes; the first continues one of the batch before.
        places = np.flatnonzero(readings[1:] != readings[:-1])
        changes = np.concatenate([[self._change], np.abs(readings[places + 1] - readings[places])])
        edges = np.concatenate([[-max(self._repeated, 1)], places, [len(readings) - 1]])
        runs = np.diff(edges)
        health.repeated(runs, np.maximum(changes, np.append(changes[1:], 0.0)))
        health.step = min(health.step, float(changes[1:].min(initial=np.inf)))
        # A change is usual where both runs at it are of one reading; the run that goes on is not known yet.
        single = runs[:-1] == 1
        usual = changes[:-1][single & np.concatenate([[self._ran == 1], single[:-1]])[: len(single)]]
        health.usual_change = max(health.usual_change, float(usual.max(initial=0.0)))
        if len(runs) > 1:
            self._ran = int(runs[-2])
        self._repeated, self._change = int(runs[-1]), float(changes[-1])

    @property
    def last(self) -> int | None:
        """True time [ns] of the latest reading."""
        return int(self.stamps[-1]) if len(self.stamps) else None

    def at(self, instants: NDArray[np.int64]) -> Floats:
        """Return values (n,) by linear interpolation; NaN outside the readings, across a gap, or by a saturated one."""
        count = len(instants)
        if np.array_equal(self.stamps[:count], instants) and (instants[1:] > instants[:-1]).all():  # of one stream
            return np.where(self._saturated[:count], np.nan, self.values[:count]) + 0.0
        values = np.full(count, np.nan)
        if not len(self.stamps):
            return values
        earlier = np.searchsorted(self.stamps, instants, side="right") - 1
        # Only instants between the first reading and the last can be interpolated.
        inside = (earlier >= 0) & (instants <= self.stamps[-1])
        earlier = earlier[inside]
        exact = self.stamps[earlier] == instants[inside]
        later = np.where(exact, earlier, earlier + 1)
        # Value at t between stamps t0 and t1: v0 + (v1 - v0)(t - t0)/(t1 - t0).
        width = self.stamps[later] - self.stamps[earlier]
        weight = (instants[inside] - self.stamps[earlier]) / np.maximum(width, 1)
        interpolated = self.values[earlier] + weight * (self.values[later] - self.values[earlier])
        missing = (width > self.gap) | self._saturated[earlier] | self._saturated[later]
        values[inside] = np.where(missing, np.nan, interpolated)
        return values

    def forget_before(self, instant: int) -> None:
        """Drop the readings that no instant from this one [ns] on can need."""
        self.drop(max(int(np.searchsorted(self.stamps, instant, side="right")) - 1, 0))

    def drop(self, count: int) -> None:
        """Drop the first readings."""
        self.stamps, self.values, self._saturated = self.stamps[count:], self.values[count:], self._saturated[count:]
