"""The onset of contact: where the first touch shows, and where it began."""

from __future__ import annotations

import numpy as np
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples

from palpate_engine.alignment.change_point import ChangePoint, change_point
from palpate_engine.alignment.contact_threshold import SAMPLES_IN_A_ROW, ContactThreshold, run_lengths
from palpate_engine.alignment.held_samples import HeldSamples, Lookback
from palpate_engine.alignment.slow_rise import RiseFinder

# Choices of decision 0104.
_MAX_MISFIT_SHARE = 0.1  # of the rise: what the law of a change point may leave, in addition to the noise
_MAX_NOISE_RATIO = 2.0  # times the noise of the force: the same
_MAX_ASCENT_SHARE = 0.1  # of its way down, that a tip may have come up and still be on it
_FIT_UP_TO = 3.0  # touch forces, up to which contact is fitted


class ContactOnset:
    """Searches the samples before the first touch, which it holds back, for where contact begins.

    Contact shows where the force passes the threshold, or by a slow rise, both of which are late; a change point in
    what is held back locates its begin.
    """

    def __init__(self, settings: AlignmentSettings, threshold: ContactThreshold, lookback: Lookback) -> None:
        """Take the settings, the threshold of the force, and how far back the onset may lie."""
        self._settings, self._threshold, self._lookback = settings, threshold, lookback
        self._rise: RiseFinder | None = None
        if not isinstance(settings.touch_force, float) and lookback.back:
            self._rise = RiseFinder(lookback.interval, threshold.least_rise)
        self._rise_count = 0  # samples that the search for a slow rise has had
        self._change: tuple[int, ChangePoint | None] | None = None  # the latest, with the end of its stretch
        self.held = HeldSamples(lookback)
        self.detection: int | None = None  # index within what is held of the sample at which contact shows
        self.above = 0  # samples above the threshold in a row, up to that one
        self.by_rise = False  # else it shows by the threshold

    def feed(self, samples: Samples) -> None:
        """Hold samples back, and search them unless contact shows already."""
        self.held.add(samples)
        if self.detection is None:
            self._search(samples)

    def _search(self, samples: Samples) -> None:
        """Search samples, the last of those that are held, for contact: by the threshold, or earlier by a rise."""
        if not len(samples):
            return
        offset = len(self.held) - len(samples)
        above = run_lengths(samples.force > self._threshold.at(samples.time), self.above)
        passages = np.flatnonzero(above >= SAMPLES_IN_A_ROW)
        detection = int(passages[0]) if len(passages) else None

        # A slow rise that shows before the threshold is passed, and has a change point.
        force = self._threshold.above_air(samples[:detection])
        for rise in self._rise.feed(force) if self._rise is not None else ():
            index = rise - self._rise_count
            is_earlier = detection is None or index < detection
            if is_earlier and self._change_point(index + offset, index + offset + 1) is not None:
                detection, self.by_rise = index, True
                break
        self._rise_count += len(force)

        self.above = int(above[-1 if detection is None else detection])
        self.detection = None if detection is None else detection + offset

    def is_whole(self, final: bool) -> bool:
        """Return True if as much contact is held as is needed to locate its begin, or no more comes."""
        return self.detection is not None and (final or len(self.held) > self.detection + self._lookback.after)

    def reject_false_contact(self) -> bool:
        """Restart the search behind a spurious contact; return True if the detected one was.

        An arm that starts again after a hold-up pushes the tip's mass: the force passes the threshold and is gone while
        the tip goes on downwards, as it never is in contact.
        """
        assert self.detection is not None
        if self.by_rise:
            return False
        held, detection = self.held.samples, self.detection

        # The first sample at which contact would end again.
        after = held[detection + 1 : detection + 1 + self._lookback.after]
        is_low = after.force < self._threshold.at(after.time) - self._threshold.hysteresis
        ends = np.flatnonzero(run_lengths(is_low, 0) >= SAMPLES_IN_A_ROW)
        if not len(ends):
            return False
        end = detection + 1 + int(ends[0])

        # A tip that has come up meanwhile was in contact, for a moment.
        position = held.position[detection : end + 1]
        lowest = float(position.min())
        if not position[-1] - lowest <= _MAX_ASCENT_SHARE * (position[0] - lowest):
            return False
        self._search_after(end)
        return True

    def _search_after(self, end: int) -> None:
        """Search what is held after an index for contact."""
        held, detection = self.held.samples, self.detection
        if self._rise is not None:
            force = self._threshold.above_air(held[detection : end + 1])
            self._rise.feed(force)
            self._rise_count += len(force)
        self.detection, self.above, self._change = None, 0, None
        self._search(held[end + 1 :])

    def located(self) -> tuple[int, ChangePoint | None]:
        """Return the index among the held samples at which contact began, and the change point by which it is known.

        Without a change point (None) it began at the sample at which it was detected.
        """
        assert self.detection is not None
        held, detection = self.held.samples, self.detection

        # The change point among the held samples up to three touch forces; computed again only if more have come.
        after = held[detection : detection + 1 + self._lookback.after]
        is_strong = self._threshold.above_air(after) > _FIT_UP_TO * self._threshold.force
        strong = np.flatnonzero(run_lengths(is_strong, 0) >= SAMPLES_IN_A_ROW)
        end = detection + (int(strong[0]) if len(strong) else len(after))
        if self._change is None or self._change[0] != end:
            self._change = end, self._change_point(detection, end)
        change = self._change[1]
        if change is None:
            return detection, None

        # Contact begins after the last sample above the surface.
        first = self._first_held(detection)
        above = np.flatnonzero(held.position[first : detection + 1] >= change.surface)
        return min(first + int(above[-1]) + 1, detection) if len(above) else first, change

    def _first_held(self, detection: int) -> int:
        """Return the index within what is held of the first sample that was not released when contact showed."""
        tare_end = self._settings.tare_duration + self._settings.touch_lag
        is_in_tare = self._settings.tare == "free-air" and self.held.samples.time[detection] <= tare_end
        return 0 if is_in_tare else max(detection - self._lookback.back, 0)

    def _change_point(self, detection: int, end: int) -> ChangePoint | None:
        """Return the change point in the baseline, what is looked back over, and what is held up to `end`.

        None as well where its law leaves more than noise and a part of its rise.
        """
        if not self._lookback.back:
            return None
        stretch = self.held.stretch(self._first_held(detection), end)
        change = change_point(stretch.position, self._threshold.above_air(stretch))
        if (
            change is None
            or not change.rms < _MAX_NOISE_RATIO * self._threshold.noise + _MAX_MISFIT_SHARE * change.rise
        ):
            return None
        return change
