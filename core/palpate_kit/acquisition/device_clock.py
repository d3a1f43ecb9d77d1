"""Clocks: a device's own time on the host's clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SECOND = 1_000_000_000  # [ns]
LEAK = 200e-6  # clocks may run apart by so much (0063)
_EVERY = 200_000_000  # [ns] between the points of the map that are kept, at first
_MAX_POINTS = 4096  # of them, a choice: where there would be more, every other one is forgotten
_MIN_POINTS = 5  # of the map, for a deviation: a choice


class ClockMap:
    """From a device's clock to the host's, by the lower envelope of (received - stamped).

    Transport only ever adds delay, so the smallest difference is nearest to the truth; it may rise again by 200 ppm so
    that a device whose clock is slow is followed. The remainder is the smallest delay, some tenths of a millisecond,
    of one sign: it belongs in the declared uncertainty. Depends on the rows alone, not on how they were
    cut into batches.
    """

    def __init__(self) -> None:
        self._offset: float | None = None  # [ns] over the first difference
        self._first = 0
        self._device = 0
        self._last: int | None = None
        self._bounds = [np.inf, -np.inf]
        self._began = 0
        self._kept: list[tuple[int, float]] = []  # stamp and offset [ns]
        self._every = _EVERY

    def to_host(self, device: NDArray[np.int64], received: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the host time [ns] (n,) of device time-stamps [ns] (n,) received at host times [ns] (n,).

        It is the stamp plus an offset: the smallest difference (received - stamp) so far, since transport only adds
        delay. The offset may rise by 200 ppm of the time that passes. It is held less the first difference, as a small
        float.
        """
        mapped = np.empty(len(device), np.int64)
        for i, (stamp, arrival) in enumerate(zip(device.tolist(), received.tolist(), strict=True)):
            if self._offset is None:
                self._first, self._device, self._offset, self._began = arrival - stamp, stamp, 0.0, stamp
            is_new = stamp != self._device
            # The offset may rise by what clocks run apart, and falls to any smaller difference at once.
            envelope = self._offset + LEAK * max(stamp - self._device, 0)
            self._offset, self._device = min(float(arrival - stamp - self._first), envelope), stamp
            host = stamp + self._first + round(self._offset)
            # Host times of different stamps never fall back.
            if self._last is not None and host <= self._last and is_new:
                host = self._last + 1
            mapped[i] = self._last = host
            # The range of the offset, and points of the map, without the first second, in which it settles.
            if stamp - self._began > _SECOND:
                self._bounds = [min(self._bounds[0], self._offset), max(self._bounds[1], self._offset)]
                if not self._kept or stamp - self._kept[-1][0] >= self._every:
                    self._keep(stamp, self._offset)
        return mapped

    def _keep(self, stamp: int, offset: float) -> None:
        self._kept.append((stamp, offset))
        if len(self._kept) == _MAX_POINTS:
            del self._kept[1::2]
            self._every *= 2

    @property
    def wander(self) -> float:
        """Range [s] of the offset between device clock and host clock after the first second; 0 before that."""
        low, high = self._bounds
        return float(high - low) / _SECOND if high >= low else 0.0

    @property
    def deviation(self) -> float:
        """Deviation [s] of the map from a clock that runs evenly, however fast: half of its range."""
        if len(self._kept) < _MIN_POINTS:
            return 0.0
        stamps, offsets = np.array(self._kept).T
        deviations = offsets - np.polyval(np.polyfit(stamps - stamps[0], offsets, 1), stamps - stamps[0])
        return float(deviations.max() - deviations.min()) / (2 * _SECOND)
