"""One signal on its way to the samples: readings wait here until their instant can be served."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_settings import Signal
from palpate.device import Batch
from palpate.stream_health import Health
from palpate.vectors import Floats

_SECOND = 1_000_000_000  # [ns]
_CARRIED = 3  # readings that a batch leaves to the next: a third difference is of a new reading and the three before


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
        self._carried: Floats = np.zeros(0)  # the last readings of the batch before, _CARRIED at most
        # The run of equal readings that goes on: readings so far, and the change of the reading at its begin.
        self._open_run_length = 0
        self._open_run_change = 0.0
        self._last_run_length = 0  # readings of the run before it

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
        """Count in `health` how readings (n,) change, and how often they repeat; keep what the next batch needs."""
        if not len(values):
            return
        carried_count = len(self._carried)
        readings = np.concatenate([self._carried, values])
        health.changed(readings, carried_count)
        self._carried = readings[-_CARRIED:]
        # Of the carried readings the last one alone: it belongs to the run that goes on.
        self._count_runs(readings[max(carried_count - 1, 0) :], health)

    def _count_runs(self, readings: Floats, health: Health) -> None:
        """Count in `health` the runs of equal readings, and the changes between them.

        `readings` (n,) begin with the last one of the batch before, if there was one: the run that it belongs to has
        `_open_run_length` readings, itself included, and goes on here. The last run of the batch goes on likewise; it
        is counted so far, and again with the next batch.
        """
        # The last reading of each run. The run before the open one ended so many readings ago, at an index below 0.
        changing_rows = np.flatnonzero(readings[1:] != readings[:-1])
        end_before = -max(self._open_run_length, 1)
        run_ends = np.concatenate([[end_before], changing_rows, [len(readings) - 1]])
        run_lengths = np.diff(run_ends)
        # The change of the reading at the begin of each run, and at its end: 0 for the last one, which goes on.
        new_changes = np.abs(readings[changing_rows + 1] - readings[changing_rows])
        changes_at_begin = np.concatenate([[self._open_run_change], new_changes])
        changes_at_end = np.append(new_changes, 0.0)
        health.repeated(run_lengths, np.maximum(changes_at_begin, changes_at_end))
        health.step = min(health.step, float(new_changes.min(initial=np.inf)))

        # A change is usual where the runs on both sides have one reading each. The last run's length is not known yet.
        whole_runs = run_lengths[:-1]
        runs_before = np.concatenate([[self._last_run_length], whole_runs])[: len(whole_runs)]
        is_usual = (whole_runs == 1) & (runs_before == 1)
        usual_changes = changes_at_begin[:-1][is_usual]
        health.usual_change = max(health.usual_change, float(usual_changes.max(initial=0.0)))

        if len(whole_runs):
            self._last_run_length = int(whole_runs[-1])
        self._open_run_length = int(run_lengths[-1])
        self._open_run_change = float(changes_at_begin[-1])

    @property
    def last(self) -> int | None:
        """True time [ns] of the latest reading."""
        return int(self.stamps[-1]) if len(self.stamps) else None

    def at(self, instants: NDArray[np.int64]) -> Floats:
        """Return values (n,) by linear interpolation; NaN outside the readings, across a gap, or by a saturated one."""
        count = len(instants)
        if np.array_equal(self.stamps[:count], instants) and (instants[1:] > instants[:-1]).all():  # of one stream
            # A -0.0 becomes 0.0, as by interpolation.
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
