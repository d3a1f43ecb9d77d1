"""The onset of contact: where the first touch shows, and where it began."""

from __future__ import annotations

import numpy as np
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples

from palpate_engine.alignment.change_point import ChangePoint, change_point
from palpate_engine.alignment.contact_threshold import SAMPLES_IN_A_ROW, ContactThreshold, run_lengths
from palpate_engine.alignment.held_samples import HeldSamples, Lookback
from palpate_engine.alignment.slow_rise import RiseFinder

_BELIEVED = 0.1  # of the rise: what the law of a change point may leave, in addition to the noise
_COME_UP = 0.1  # of its way down, that a tip may have come up and still be on it
_NEAR = 3.0  # touch forces, up to which contact is looked at


class ContactOnset:
    """Searches the samples before the first touch, which it holds back, for where contact begins.

    Contact shows where the force passes the threshold, or by a slow rise, both of which are late; a change point in
    what is held back locates its begin.
    """

    def __init__(self, settings: AlignmentSettings, threshold: ContactThreshold, lookback: Lookback) -> None:
        self._settings, self._threshold, self._lookback = settings, threshold, lookback
        self._rise: RiseFinder | None = None
        if not isinstance(settings.touch_force, float) and lookback.back:
            self._rise = RiseFinder(lookback.interval, threshold.least_rise)
        self._searched = 0  # samples
        self._change: tuple[int, ChangePoint | None] | None = None  # the latest, with the end of what it was sought in
        self.held = HeldSamples(lookback)
        self.shown: int | None = None  # index within what is held of the sample at which contact shows
        self.above = 0  # samples above the threshold in a row, up to that one
        self.by_rise = False  # else it shows by the threshold

    def feed(self, samples: Samples) -> None:
        """Hold samples back, and search them unless contact shows already."""
        self.held.add(samples)
        if self.shown is None:
            self._search(samples)

    def _search(self, samples: Samples) -> None:
        """Look for contact in samples, the last of those that are held."""
        if not len(samples):
            return
        offset = len(self.held) - len(samples)
        above = run_lengths(samples.force > self._threshold.at(samples.time), self.above)
        passed = np.flatnonzero(above >= SAMPLES_IN_A_ROW)
        found = int(passed[0]) if len(passed) else None
        before = self._threshold.above_air(samples[:found])  # what rises later does not matter
        for risen in self._rise.feed(before) if self._rise is not None else ():
            at = risen - self._searched
            if (found is None or at < found) and self._change_point(at + offset, at + offset + 1) is not None:
                found, self.by_rise = at, True
                break
        self._searched += len(before)
        self.above = int(above[-1 if found is None else found])
        self.shown = None if found is None else found + offset

    def is_whole(self, final: bool) -> bool:
        """Return True if as much contact is held as is needed to locate its begin, or no more comes."""
        return self.shown is not None and (final or len(self.held) > self.shown + self._lookback.after)

    def is_lost(self) -> bool:
        """Return True if the contact that shows proves to be none; if so, the search has gone on after it.

        An arm that starts again after a hold-up pushes the tip's mass: the force passes the threshold and is gone while
        the tip goes on downwards, as it never is in contact.
        """
        assert self.shown is not None
        if self.by_rise:
            return False
        held, shown = self.held.samples, self.shown
        rest = held[shown + 1 : shown + 1 + self._lookback.after]
        low = rest.force < self._threshold.at(rest.time) - 0.5 * self._threshold.force
        off = np.flatnonzero(run_lengths(low, 0) >= SAMPLES_IN_A_ROW)
        if not len(off):
            return False
        lost = shown + 1 + int(off[0])
        position = held.position[shown : lost + 1]
        deepest = float(position.min())
        goes_down = position[-1] - deepest <= _COME_UP * (position[0] - deepest)
        if not goes_down:
            return False
        self._search_after(lost)
        return True

    def _search_after(self, lost: int) -> None:
        held, shown = self.held.samples, self.shown
        if self._rise is not None:
            unseen = self._threshold.above_air(held[shown : lost + 1])
            self._rise.feed(unseen)
            self._searched += len(unseen)
        self.shown, self.above, self._change = None, 0, None
        self._search(held[lost + 1 :])

    def located(self) -> tuple[int, ChangePoint | None]:
        """Index within what is held at which contact began, and its change point; None: where it shows."""
        assert self.shown is not None
        held, shown = self.held.samples, self.shown
        after = held[shown : shown + 1 + self._lookback.after]
        far = self._threshold.above_air(after) > _NEAR * self._threshold.force
        beyond = np.flatnonzero(run_lengths(far, 0) >= SAMPLES_IN_A_ROW)
        end = shown + (int(beyond[0]) if len(beyond) else len(after))
        if self._change is None or self._change[0] != end:
            self._change = end, self._change_point(shown, end)
        change = self._change[1]
        if change is None:
            return shown, None
        first = self._earliest(shown)
        above = np.flatnonzero(held.position[first : shown + 1] >= change.surface)
        return min(first + int(above[-1]) + 1, shown) if len(above) else first, change

    def _earliest(self, shown: int) -> int:
        """Index within what is held of the first sample that had not been released when contact showed."""
        settled = self._settings.tare_duration + self._settings.touch_lag
        whole = self._settings.tare == "free-air" and self.held.samples.time[shown] <= settled
        return 0 if whole else max(shown - self._lookback.back, 0)

    def _change_point(self, shown: int, end: int) -> ChangePoint | None:
        """Return the change point in the baseline, what is looked back over, and what is held up to `end`."""
        if not self._lookback.back:
            return None
        stretch = self.held.stretch(self._earliest(shown), end)
        found = change_point(stretch.position, self._threshold.above_air(stretch))
        return found if found is not None and found.rms < 2.0 * self._threshold.noise + _BELIEVED * found.rise else None
