"""The faults in the readings of one stream."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.device import Stream

_SECOND = 1_000_000_000  # [ns]
_SECONDS = 1000  # in one batch; more are not a clock
_LEAST_SECONDS = 4
_LEAST_INTERVALS = 10  # by which a rate is compared with the announced one
RATE_TOLERANCE = 1.05  # factor; sensors' clocks are within 2 % of their nominal rate
_STEPS = 3.5  # of a coarse reading, by which it may go on after a repeat


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
    shorter: int = 0  # intervals in which the stamps go on clearly less than the announced rate says
    longer: int = 0  # and clearly more
    paused: int = 0  # [ns] in gaps
    began: int | None = None  # [ns] arrival of the first reading
    ended: int = 0  # [ns] and of the last
    has_arrivals: bool = False  # by another clock than that of the time-stamps
    _repeats: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))  # runs that none surpasses in both
    _earliest: dict[int, int] = field(default_factory=dict)  # by second: the least time [ns] from stamp to arrival

    def arrived(self, stamps: NDArray[np.int64], received: NDArray[np.int64]) -> None:
        """Take note of when readings arrived, and how late, against a clock that other streams share."""
        if len(received):
            self.began = int(received[0]) if self.began is None else self.began
            self.ended = int(received[-1])
            self.has_arrivals = self.has_arrivals or bool((received != stamps).any())
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
        between = step[1:] if self.first is None else step
        is_gap = between > gap
        self.gaps += int(np.count_nonzero(is_gap))
        self.paused += int(between[is_gap].sum())
        if self.stream.rate:
            forward, usual = between[between > 0], _SECOND / self.stream.rate
            self.shorter += int(np.count_nonzero(forward * RATE_TOLERANCE < usual))
            self.longer += int(np.count_nonzero(forward > usual * RATE_TOLERANCE))
        self.first = int(stamps[0]) if self.first is None else self.first
        self.last = int(before[-1])
        return good

    def repeated(self, counts: NDArray[np.int64], changes: NDArray[np.float64]) -> None:
        """Take note of runs (n,) of equal readings, and of the larger change adjacent to each."""
        every = np.concatenate([self._repeats, np.column_stack([counts, changes])])
        every = every[np.lexsort((-every[:, 1], -every[:, 0]))]
        before = np.maximum.accumulate(np.concatenate([[-1.0], every[:-1, 1]]))
        self._repeats = np.asarray(every[every[:, 1] > before], float)

    @property
    def longest_repeat(self) -> int:
        """The longest run of exactly equal readings apart from coarse readings, which change by a step or two."""
        counts, changes = self._repeats.T
        stuck = (changes > _STEPS * self.step) | np.isinf(self.step)
        return int(counts[stuck].max(initial=0.0))

    @property
    def rate(self) -> float | None:
        """Mean rate [Hz] of the readings in order, from their time-stamps."""
        count = self.samples - self.duplicates - self.backwards
        if self.first is None or self.last is None or self.last == self.first:
            return None
        return (count - 1) * _SECOND / (self.last - self.first)

    @property
    def rate_ratio(self) -> float | None:
        """Rate by the time-stamps over the announced one, where both their mean and most intervals contradict it.

        A mean without gaps, unless these are most of the record. A lost reading leaves most intervals as they are, and
        readings that arrive in bunches leave the mean. None where nothing contradicts the rate, where none is
        announced, and where the clock of the arrivals confirms the time-stamps: an arm may send its states more slowly.
        """
        intervals = self.samples - self.duplicates - self.backwards - 1
        if not self.stream.rate or intervals < _LEAST_INTERVALS or self.first is None or self.last is None:
            return None
        lasted = 0 if self.began is None else self.ended - self.began
        if self.has_arrivals and lasted < RATE_TOLERANCE * (self.last - self.first) < RATE_TOLERANCE**2 * lasted:
            return None
        mostly_gaps = 2 * self.gaps > intervals
        count = intervals if mostly_gaps else intervals - self.gaps
        seconds = (self.last - self.first - (0 if mostly_gaps else self.paused)) / _SECOND
        ratio = count / seconds / self.stream.rate
        if 2 * self.shorter > intervals and ratio >= RATE_TOLERANCE:
            return ratio
        return ratio if 2 * self.longer > intervals and ratio * RATE_TOLERANCE <= 1.0 else None


def _seconds(since: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where times (n,) [ns], sorted by their seconds, begin another second."""
    first, last = int(since[0]) // _SECOND, int(since[-1]) // _SECOND
    if last - first > _SECONDS:
        return np.flatnonzero(np.diff(since // _SECOND, prepend=first - 1))
    begins = np.searchsorted(since, np.arange(first, last + 1) * _SECOND)
    begins[0] = 0
    return begins[np.diff(begins, append=len(since)) > 0]
