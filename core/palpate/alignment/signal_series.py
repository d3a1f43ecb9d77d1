"""One signal on its way to the samples: readings wait here until their instant can be served."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.alignment.settings import Signal
from palpate.device import Batch, Stream
from palpate.vectors import Floats

_SECOND = 1_000_000_000  # [ns]
_SECONDS = 1000  # in one batch; more are no clock
_LEAST_SECONDS = 4


@dataclass
class Health:
    """The faults in one stream's readings."""

    stream: Stream
    samples: int = 0
    invalid: int = 0  # not finite
    duplicates: int = 0  # time-stamp equal to the one before
    backwards: int = 0  # time-stamp before an earlier one
    gaps: int = 0
    saturated: int = 0
    longest_repeat: int = 0  # the longest run of exactly equal readings
    first: int | None = None  # [ns]
    last: int | None = None  # [ns]
    _earliest: dict[int, int] = field(default_factory=dict)  # by second: the least time [ns] from stamp to arrival

    def arrived(self, stamps: NDArray[np.int64], received: NDArray[np.int64]) -> None:
        """Take note of how late readings arrived, against a clock that other streams share."""
        if self.stream.clock != "log" or not len(stamps):
            return
        origin = int(stamps[0]) if self.first is None else self.first
        late = received - stamps
        if (stamps[1:] < stamps[:-1]).any():
            order = np.argsort((stamps - origin) // _SECOND, kind="stable")
            late, stamps = late[order], stamps[order]
        begins = _seconds(stamps - origin)
        leasts = np.minimum.reduceat(late, begins)
        seconds = (stamps[begins] - origin) // _SECOND
        for second, least in zip(seconds.tolist()[:_SECONDS], leasts.tolist(), strict=False):
            self._earliest[second] = min(self._earliest.get(second, least), least)

    @property
    def gained(self) -> float | None:
        """How much the time-stamps gained on the clock of the log over the record [s]; None where it is too short.

        The least lateness of a second is that of a message that nothing held up.
        """
        if len(self._earliest) < _LEAST_SECONDS:
            return None
        least = [late for _, late in sorted(self._earliest.items())]
        few = len(least) // 5 + 1
        return float(np.mean(least[:few]) - np.mean(least[-few:])) / _SECOND

    def in_order(self, stamps: NDArray[np.int64], gap: int) -> NDArray[np.bool_]:
        """(n,) True for readings whose time-stamp is after all those before it; counts the others, and gaps [ns]."""
        if not len(stamps):
            return np.zeros(0, bool)
        before = np.concatenate([[stamps[0] - 1 if self.last is None else self.last], stamps])
        step = np.diff(before)
        good: NDArray[np.bool_] = step > 0
        if not good.all():
            before = np.maximum.accumulate(before)
            step = stamps - before[:-1]
            good = step > 0
            self.duplicates += int(np.count_nonzero(step == 0))
            self.backwards += int(np.count_nonzero(step < 0))
        self.samples += len(stamps)
        fresh = self.first is None
        self.gaps += int(np.count_nonzero(step[1:] > gap if fresh else step > gap))
        self.first = int(stamps[0]) if self.first is None else self.first
        self.last = int(before[-1])
        return good

    @property
    def rate(self) -> float | None:
        """Mean rate [Hz] of the readings in order, from their time-stamps."""
        count = self.samples - self.duplicates - self.backwards
        if self.first is None or self.last is None or self.last == self.first:
            return None
        return (count - 1) * _SECOND / (self.last - self.first)


def _seconds(since: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where times (n,) [ns], sorted by their seconds, begin another second."""
    first, last = int(since[0]) // _SECOND, int(since[-1]) // _SECOND
    if last - first > _SECONDS:
        return np.flatnonzero(np.diff(since // _SECOND, prepend=first - 1))
    begins = np.searchsorted(since, np.arange(first, last + 1) * _SECOND)
    begins[0] = 0
    return begins[np.diff(begins, append=len(since)) > 0]


class Series:
    """The readings of one signal in the order of true time: late ones moved back by the declared delay."""

    def __init__(
        self, signal: Signal, column: int, gap: float, limits: tuple[float, float] | None, watched: bool
    ) -> None:
        self.signal = signal
        self._watched = watched  # for a sensor that is stuck
        self._column = column
        self._delay = round(signal.delay * _SECOND)
        self._gap = round(gap * _SECOND)
        self._limits = limits
        self.stamps: NDArray[np.int64] = np.zeros(0, np.int64)
        self.values: Floats = np.zeros(0)
        self._saturated: NDArray[np.bool_] = np.zeros(0, bool)
        self._repeated = 0
        self._previous = np.nan

    def feed(self, stamps: NDArray[np.int64], batch: Batch, rows: NDArray[np.bool_], health: Health) -> None:
        """Take over the rows of a batch that are in order and finite."""
        values, usable = batch.values[:, self._column], rows & np.isfinite(batch.values[:, self._column])
        if not usable.all():
            values, stamps = values[usable], stamps[usable]
        saturated = self._beyond_limits(values)
        health.saturated += int(np.count_nonzero(saturated))
        if self._watched:
            health.longest_repeat = max(health.longest_repeat, self._longest_repeat(values))
        stamps, values = stamps - self._delay, values * self.signal.sign
        if len(self.stamps):
            stamps, values = np.concatenate([self.stamps, stamps]), np.concatenate([self.values, values])
            saturated = np.concatenate([self._saturated, saturated])
        self.stamps, self.values, self._saturated = stamps, values, saturated

    def _beyond_limits(self, values: Floats) -> NDArray[np.bool_]:
        if self._limits is None:
            return np.zeros(len(values), bool)
        low, high = self._limits
        return (values <= low) | (values >= high)

    def _longest_repeat(self, values: Floats) -> int:
        joined = np.concatenate([[self._previous], values])
        changes = np.flatnonzero(joined[1:] != joined[:-1])
        edges = np.concatenate([changes, [len(values)]])
        if len(changes):
            longest = max(int(np.diff(edges).max()), self._repeated + int(changes[0]))
            self._repeated = int(len(values) - changes[-1])
        else:
            self._repeated += len(values)
            longest = self._repeated
        self._previous = values[-1] if len(values) else self._previous
        return longest

    @property
    def last(self) -> int | None:
        """True time [ns] of the latest reading."""
        return int(self.stamps[-1]) if len(self.stamps) else None

    def at(self, instants: NDArray[np.int64]) -> Floats:
        """Values (n,) by linear interpolation; NaN outside the readings, across a gap, or beside a saturated one."""
        count = len(instants)
        if np.array_equal(self.stamps[:count], instants) and (instants[1:] > instants[:-1]).all():  # of one stream
            return np.where(self._saturated[:count], np.nan, self.values[:count]) + 0.0
        values = np.full(count, np.nan)
        if not len(self.stamps):
            return values
        left = np.searchsorted(self.stamps, instants, side="right") - 1
        inside = (left >= 0) & (instants <= self.stamps[-1])
        left = left[inside]
        exact = self.stamps[left] == instants[inside]
        right = np.where(exact, left, left + 1)
        width = self.stamps[right] - self.stamps[left]
        weight = (instants[inside] - self.stamps[left]) / np.maximum(width, 1)
        found = self.values[left] + weight * (self.values[right] - self.values[left])
        lost = (width > self._gap) | self._saturated[left] | self._saturated[right]
        values[inside] = np.where(lost, np.nan, found)
        return values

    def forget_before(self, instant: int) -> None:
        """Drop the readings that no instant from this one [ns] on can need."""
        self.drop(max(int(np.searchsorted(self.stamps, instant, side="right")) - 1, 0))

    def drop(self, count: int) -> None:
        """Drop the first readings."""
        self.stamps, self.values, self._saturated = self.stamps[count:], self.values[count:], self._saturated[count:]
