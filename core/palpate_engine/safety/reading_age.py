"""Age of readings when they arrive: how much later they come than the promptest since the standstill."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate.clocks import clock

_SECOND = 1e9  # [ns]
DRIFT = 200e-6  # by which two clocks may run apart (0325)
_FITTED = 60.0  # [s] from which the drift is determined: a choice, which bounds its error
_CHANGE = 20e-6  # of the drift afterwards: a quartz changes by less within a room


class ReadingAge:
    """The age of the newest reading of each batch: its lateness, above the promptest since the beginning.

    Lateness is the time of arrival less the stamp of the device's clock. What two clocks run apart by is not lateness:
    up to `drift` within the first minute. It then is fitted to the least lateness of each second (Theil and Sen: the
    median of the slopes of all pairs, which hold-ups do not change), within +-`drift`, and may exceed the fit by 20 ppm
    from then on. What was late from the start, and what grows more slowly, is not seen. The newest counts alone: where
    the computer was held up, the last of many readings is fresh.
    """

    def __init__(self, drift: float = DRIFT) -> None:
        """Take the largest drift of the device's clock against the host's [1]; 0 for a stream on the host's clock."""
        self._bound = self._drift = drift
        self._first: tuple[int, int] | None = None  # arrival and lateness [ns]
        self._promptest = 0.0  # [s] least lateness, without drift
        self._seconds: list[tuple[float, float]] = []  # arrival and lateness [s] of the promptest of each second
        self._second = -1  # number of the latest
        self._is_fitted = drift == 0.0
        self._before = self.latest = 0.0  # [s] of the last two batches

    def add(self, stamps: Sequence[int], arrivals: Sequence[int]) -> None:
        """Take a batch: stamps [ns] and arrivals [ns], in their order."""
        if not len(stamps):
            return
        if self._first is None:
            self._first = arrivals[0], arrivals[0] - stamps[0]
        began, usual = self._first  # arrival and lateness of the first reading [ns]; later ones are compared with it
        late = elapsed = 0.0
        for stamp, arrival in zip(stamps, arrivals, strict=True):
            elapsed, late = (arrival - began) / _SECOND, (arrival - stamp - usual) / _SECOND
            if not self._is_fitted:
                self._note_second(elapsed, late)
            # Lateness above the envelope of the promptest, which rises by the drift.
            without_drift = late - self._drift * elapsed
            if without_drift < self._promptest:
                self._promptest = without_drift
        self._before, self.latest = self.latest, late - self._drift * elapsed - self._promptest

    def _note_second(self, elapsed: float, late: float) -> None:
        """Keep the least lateness of each second; after a minute the drift is fitted to them."""
        second = int(elapsed)
        if second >= _FITTED:
            self._fit_drift()
        elif second != self._second:
            self._second = second
            self._seconds.append((elapsed, late))
        elif late < self._seconds[-1][1]:
            self._seconds[-1] = elapsed, late

    def _fit_drift(self) -> None:
        """Fit the drift to the promptest of each second, by the median of the slopes of all pairs (Theil and Sen)."""
        times, lateness = np.array(self._seconds).T
        first, second = np.triu_indices(len(times), 1)
        slopes = (lateness[second] - lateness[first]) / (times[second] - times[first])
        slope = float(np.median(slopes)) if len(slopes) else self._bound
        self._drift = min(max(slope, -self._bound) + _CHANGE, self._bound)
        self._promptest = float((lateness - self._drift * times).min())
        self._is_fitted, self._seconds = True, []

    def is_over(self, limit: float) -> bool:
        """Return True if the newest readings of the last two batches were older than a limit [s]."""
        return min(self._before, self.latest) > limit

    def complaint(self, name: str, limit: float) -> str | None:
        """Return why the arm has to stop, in words; None where the last two batches were in time."""
        if not self.is_over(limit):
            return None
        return (
            f"{name} come late: the newest is {1e3 * self.latest:.0f} ms old when it arrives, for the second time over "
            f"[safety] reading_age = {1e3 * limit:g} ms; what the tip feels and where it stands now is not known"
            f"{clock().late_computer()}"
        )


class StampAge:
    """The age of the newest reading of each batch by a stamp of the host's own clock: nothing has to be compared."""

    def __init__(self) -> None:
        self._before = self._latest = 0.0  # [s] of the last two batches

    def add(self, stamp: int, arrival: int) -> None:
        """Take stamp and arrival [ns] of the newest reading of a batch."""
        self._before, self._latest = self._latest, (arrival - stamp) / _SECOND

    def complaint(self, name: str, delay: float, limit: float) -> str | None:
        """Return why the arm has to stop, in words; None where one of the last two is younger than sensor and link
        make it."""
        if min(self._before, self._latest) <= delay + limit:
            return None
        return (
            f"{name} are {1e3 * self._latest:.0f} ms old by their time-stamps when they arrive, for the second time "
            f"over [safety] sensor_delay + reading_age = {1e3 * (delay + limit):g} ms; what the tip feels and where it "
            "stands now is not known"
        )
