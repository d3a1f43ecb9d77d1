"""The faults in the readings of one stream."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.device import Stream
from palpate.last_digit import LastDigit

_SECOND = 1_000_000_000  # [ns]
_MAX_SECONDS = 1000  # a choice: in one batch; more are not those of a clock
_MIN_SECONDS = 4  # a choice: a shorter record shows no drift of a clock
_MIN_INTERVALS = 10  # a choice: fewer do not show a rate
RATE_TOLERANCE = 1.05  # factor, a choice: sensors' clocks are within 2 % of their nominal rate
_COARSE_STEPS = 3.5  # least changes, a choice: a coarse reading changes by up to so many after a repeat
_END_SHARE = 5  # a choice: a drift is taken from a fifth of the record at each end
_USUAL_CHANGE = 1.2  # times the largest usual change, a choice: the same of readings without noise
_QUIET_SHARE = 0.66  # of third differences of readings that change; with a noise of half a step fewer are quiet
_BINS = 8  # a choice: of third differences, to a factor of two
_ORDER = 3  # of the differences that show noise: the course of a force has hardly any (see `last_digit`)


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
    first: int | None = None  # [ns]
    last: int | None = None  # [ns]
    step: float = float("inf")  # the least change from reading to reading
    lowest: float = float("inf")  # reading
    highest: float = float("-inf")
    usual_change: float = 0.0  # the largest between readings neither of which repeats
    shorter: int = 0  # intervals in which the stamps go on clearly less than the announced rate says
    longer: int = 0  # and clearly more
    paused: int = 0  # [ns] in gaps
    began: int | None = None  # [ns] arrival of the first reading
    ended: int = 0  # [ns] and of the last
    has_arrivals: bool = False  # by another clock than that of the time-stamps
    _repeats: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))  # runs that none surpasses in both
    _third_differences: Counter[int] = field(default_factory=Counter)  # by 8 log2 of their size
    _earliest: dict[int, int] = field(default_factory=dict)  # by second: the least time [ns] from stamp to arrival

    def arrived(self, stamps: NDArray[np.int64], received: NDArray[np.int64]) -> None:
        """Count the arrivals of readings, and their lateness by a clock that other streams share."""
        if len(received):
            self.began = int(received[0]) if self.began is None else self.began
            self.ended = int(received[-1])
            self.has_arrivals = self.has_arrivals or bool((received != stamps).any())
        if self.stream.clock != "log" or not len(stamps):
            return
        # The least lateness of each second of the record; arrivals in a log are of one clock for all its streams.
        origin = int(stamps[0]) if self.first is None else self.first
        lateness = received - stamps
        if (stamps[1:] < stamps[:-1]).any():
            order = np.argsort((stamps - origin) // _SECOND, kind="stable")
            lateness, stamps = lateness[order], stamps[order]
        begins = _second_rows(stamps - origin)
        minima = np.minimum.reduceat(lateness, begins)
        seconds = (stamps[begins] - origin) // _SECOND
        for second, minimum in zip(seconds.tolist()[:_MAX_SECONDS], minima.tolist(), strict=False):
            self._earliest[second] = min(self._earliest.get(second, minimum), minimum)

    @property
    def gained(self) -> float | None:
        """The gain of the time-stamps on the clock of the log over the record [s]; None where it is too short.

        The least lateness of a second is that of a message that nothing held up.
        """
        if len(self._earliest) < _MIN_SECONDS:
            return None
        minima = [lateness for _, lateness in sorted(self._earliest.items())]
        count = len(minima) // _END_SHARE + 1
        return float(np.mean(minima[:count]) - np.mean(minima[-count:])) / _SECOND

    def in_order(self, stamps: NDArray[np.int64], gap: int) -> NDArray[np.bool_]:
        """Return True (n,) for readings whose time-stamp is after all those before.

        The others are counted, and so are intervals longer than a `gap` [ns].
        """
        if not len(stamps):
            return np.zeros(0, bool)
        # Each reading against the latest time-stamp before it.
        latest = np.concatenate([[stamps[0] - 1 if self.last is None else self.last], stamps])
        step = np.diff(latest)
        in_order: NDArray[np.bool_] = step > 0
        if not in_order.all():
            latest = np.maximum.accumulate(latest)
            step = stamps - latest[:-1]
            in_order = step > 0
            self.duplicates += int(np.count_nonzero(step == 0))
            self.backwards += int(np.count_nonzero(step < 0))
        self.samples += len(stamps)
        # The intervals: gaps, and those that contradict the announced rate.
        interval = step[1:] if self.first is None else step
        is_gap = interval > gap
        self.gaps += int(np.count_nonzero(is_gap))
        self.paused += int(interval[is_gap].sum())
        if self.stream.rate:
            forward, announced = interval[interval > 0], _SECOND / self.stream.rate
            self.shorter += int(np.count_nonzero(forward * RATE_TOLERANCE < announced))
            self.longer += int(np.count_nonzero(forward > announced * RATE_TOLERANCE))
        self.first = int(stamps[0]) if self.first is None else self.first
        self.last = int(latest[-1])
        return in_order

    def repeated(self, counts: NDArray[np.int64], changes: NDArray[np.float64]) -> None:
        """Count runs (n,) of equal readings, with the larger change next to each; keep those that none surpasses."""
        # Of single readings, which are most, only the largest change counts.
        single = counts <= 1
        largest_single = changes[single].max(initial=-1.0)
        repeats = np.column_stack([counts[~single], changes[~single]])
        runs = np.concatenate([self._repeats, np.array([[1.0, largest_single]]), repeats])
        # From the longest run on, those whose change is larger than that of every longer one.
        runs = runs[np.lexsort((-runs[:, 1], -runs[:, 0]))]
        largest_change = np.maximum.accumulate(np.concatenate([[-1.0], runs[:-1, 1]]))
        self._repeats = np.asarray(runs[runs[:, 1] > largest_change], float)

    @property
    def longest_repeat(self) -> int:
        """The longest run of exactly equal readings apart from coarse readings, which change by a step or two."""
        counts, changes = self._repeats.T
        stuck = (changes > _COARSE_STEPS * self.step) | np.isinf(self.step)
        return int(counts[stuck].max(initial=0.0))

    def changed(self, values: NDArray[np.float64], before: int) -> None:
        """Take note of the range of readings (n,), and of how roughly they change; `before` of them are known already.

        Four equal readings are of a signal that stands, and show no noise.
        """
        self.lowest = min(self.lowest, float(values[before:].min(initial=np.inf)))
        self.highest = max(self.highest, float(values[before:].max(initial=-np.inf)))
        # Third differences that need a new reading, but for those of equal readings, counted by their size.
        changes = np.diff(values[max(before - _ORDER, 0) :])
        if len(changes) < _ORDER:
            return
        third_differences = np.abs(np.diff(changes, _ORDER - 1))
        moving = third_differences[(changes[2:] != 0.0) | (changes[1:-1] != 0.0) | (changes[:-2] != 0.0)]
        sizes = np.floor(_BINS * np.log2(np.maximum(moving, np.finfo(float).tiny))).astype(int)
        bins, counts = np.unique(sizes, return_counts=True)
        self._third_differences.update(dict(zip(bins.tolist(), counts.tolist(), strict=True)))

    @property
    def _is_quiet(self) -> bool:
        """True if readings that change have a noise below about half of their step, or none at all."""
        quiet_change = 0.0
        if math.isfinite(self.step):
            quiet_change = LastDigit(self.step).quiet_change(self.highest - self.lowest)
        total = sum(self._third_differences.values())
        if not total or not quiet_change > 0.0:
            return False
        # The share of third differences that readings without noise have.
        quiet_bin = math.floor(_BINS * math.log2(quiet_change))
        quiet = sum(count for number, count in self._third_differences.items() if number <= quiet_bin)
        return quiet >= _QUIET_SHARE * total

    @property
    def longest_stand(self) -> int:
        """The longest run of equal readings at which the signal itself does not stand.

        Without noise, in a computed force and below the last digit of a coarse one, a force stands as long as the tip
        does, and then goes on by a usual change.
        """
        counts, changes = self._repeats.T
        usual = _USUAL_CHANGE * self.usual_change if self._is_quiet else 0.0
        stuck = (changes > max(_COARSE_STEPS * self.step, usual)) | np.isinf(self.step)
        return int(counts[stuck].max(initial=0.0))

    @property
    def rate(self) -> float | None:
        """The mean rate [Hz] of the readings in order, from their time-stamps; None of fewer than two instants."""
        count = self.samples - self.duplicates - self.backwards
        if self.first is None or self.last is None or self.last == self.first:
            return None
        return (count - 1) * _SECOND / (self.last - self.first)

    @property
    def rate_ratio(self) -> float | None:
        """The rate by the time-stamps over the announced one, where both their mean and most intervals contradict it.

        A mean without gaps, unless these are most of the record. A lost reading leaves most intervals as they are, and
        readings that arrive in bunches leave the mean. None where nothing contradicts the rate, where none is
        announced, and where the clock of the arrivals confirms the time-stamps: an arm may send its states more slowly.
        """
        intervals = self.samples - self.duplicates - self.backwards - 1
        if not self.stream.rate or intervals < _MIN_INTERVALS or self.first is None or self.last is None:
            return None
        # The arrivals confirm the time-stamps.
        arrival_span = 0 if self.began is None else self.ended - self.began
        stamp_span = self.last - self.first
        if self.has_arrivals and arrival_span < RATE_TOLERANCE * stamp_span < RATE_TOLERANCE**2 * arrival_span:
            return None
        # The mean rate, without gaps unless these are most of the record, and the contradiction by most intervals.
        mostly_gaps = 2 * self.gaps > intervals
        count = intervals if mostly_gaps else intervals - self.gaps
        seconds = (stamp_span - (0 if mostly_gaps else self.paused)) / _SECOND
        ratio = count / seconds / self.stream.rate
        if 2 * self.shorter > intervals and ratio >= RATE_TOLERANCE:
            return ratio
        return ratio if 2 * self.longer > intervals and ratio * RATE_TOLERANCE <= 1.0 else None


def _second_rows(time: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows at which times (n,) [ns], sorted by their seconds, begin another second."""
    first, last = int(time[0]) // _SECOND, int(time[-1]) // _SECOND
    if last - first > _MAX_SECONDS:
        return np.flatnonzero(np.diff(time // _SECOND, prepend=first - 1))
    begins = np.searchsorted(time, np.arange(first, last + 1) * _SECOND)
    begins[0] = 0
    return begins[np.diff(begins, append=len(time)) > 0]
