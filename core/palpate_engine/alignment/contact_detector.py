"""Contact detection: when the tip is in contact, and when it began to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate.alignment_report import Tare
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.air_line import FIRST_READINGS, decides, may_decide, record_tare, tare_in_contact
from palpate_engine.alignment.contact_hysteresis import ContactHysteresis
from palpate_engine.alignment.contact_onset import ContactOnset
from palpate_engine.alignment.contact_threshold import ContactThreshold
from palpate_engine.alignment.held_samples import FIRST_SAMPLES, Lookback
from palpate_engine.alignment.load_compensation import LoadCompensation
from palpate_engine.alignment.record_touch import RecordTouch, TouchSearch, resolution
from palpate_engine.alignment.tare import measured_tare, stated_tare, where

_MIN_AIR_SAMPLES = 50  # before the first touch, to decide whether the force is zero there; a choice


class AirForce:
    """Mean force before the first touch, where it should be none."""

    def __init__(self) -> None:
        self._sum, self._count = 0.0, 0

    def add(self, force: Floats) -> None:
        """Take in forces (n,) [N] in air."""
        finite = force[np.isfinite(force)]
        # A cumulative sum adds one by one, so the bits are the same however the record is cut.
        self._sum = float(np.cumsum(np.concatenate([[self._sum], finite]))[-1])
        self._count += len(finite)

    @property
    def mean(self) -> float | None:
        """Mean [N]; None where there is too little air."""
        return self._sum / self._count if self._count >= _MIN_AIR_SAMPLES else None


class ContactDetector:
    """Turns raw force into the force of the contact, and marks the samples in contact.

    Samples wait for the tare; then they are held back until the first touch, `touch_lag` at most, so that the begin of
    contact is located before they are marked. After the first touch nothing is held back. Where a record's own noise
    says what counts as touch, all of them wait for it, and what precedes it is the air that gives the tare.
    """

    def __init__(self, settings: AlignmentSettings, max_mass: float = 0.0) -> None:
        """Take the settings, and the largest mass [kg] that the tip may have where none is declared."""
        self._settings = settings
        self._search = TouchSearch(max_mass) if may_decide(settings) else None  # by the noise of the record
        self._waiting: list[Samples] = []  # before the tare
        self._load: LoadCompensation | None = None  # since the tare
        self._onset: ContactOnset | None = None  # from the tare to the first touch
        self._hysteresis: ContactHysteresis | None = None  # since the first touch
        self._air = AirForce()
        self.first_touch: tuple[float, float] | None = None  # time [s], position [m]
        self.by_change_point = False  # else the first touch is where the threshold was passed

    @property
    def tare(self) -> Tare | None:
        """Force that is subtracted; None where it is not settled yet."""
        return self._load.tare if self._load is not None else None

    @property
    def threshold(self) -> ContactThreshold:
        """Force that counts as touch."""
        return ContactThreshold.of(self._settings, self.tare)

    @property
    def touches(self) -> int:
        """Number of times that contact began."""
        return self._hysteresis.touches if self._hysteresis is not None else 0

    @property
    def air_force(self) -> float | None:
        """Mean force [N] before the first touch; None where there is too little of that."""
        return self._air.mean

    @property
    def pull(self) -> float:
        """Force [N] by which the contact pulls, for some samples in a row."""
        return self._load.pull if self._load is not None else 0.0

    def feed(self, samples: Samples, final: bool = False) -> Samples:
        """Return the samples whose contact is decided; all remaining ones where `final`."""
        if self._load is None:
            return self._before_tare(samples, final)
        samples = self._load.compensated(samples)
        self._load.watch_pull(samples)
        if self._onset is None:
            return self._after_touch(samples)
        self._onset.feed(samples)
        return self._before_touch(self._onset, final)

    def _before_tare(self, samples: Samples, final: bool) -> Samples:
        """Let samples wait until the tare can be settled, then begin the search for contact."""
        self._waiting.append(samples)
        if self._search is not None:
            return self._search_by_noise(self._search, final)
        samples = Samples.joined(self._waiting)
        if not final and not self._can_settle(samples):
            self._waiting = [samples]
            return samples[:0]
        self._waiting = []
        # The first `searched` samples have been searched already, for a contact within the window of the tare.
        self._load, onset, searched = _settle_tare(self._settings, samples)
        samples = self._load.compensated(samples)
        self._load.watch_pull(samples)
        onset.feed(samples[searched:])
        self._onset = onset
        return self._before_touch(onset, final)

    def _search_by_noise(self, search: TouchSearch, final: bool) -> Samples:
        """Return all samples once their own noise shows the first touch; none as long as it does not.

        A record that ends without a touch is air. Where its noise cannot decide, the threshold does.
        """
        no_samples = self._waiting[-1][:0]
        if not final and sum(map(len, self._waiting)) < max(search.due, FIRST_READINGS):
            return no_samples
        samples = Samples.joined(self._waiting)
        self._waiting = [samples]
        noise_decides = decides(samples)
        touch, tare = self._touch_with_tare(search, samples, final) if noise_decides else (None, None)
        if touch is not None and tare is not None:
            return self._mark_record(samples, touch, tare)
        if touch is None and noise_decides and not final:
            return no_samples
        # The search has ended without a touch that has air before it: all is air, or the threshold decides.
        self._search, self._waiting = None, []
        if touch is None and noise_decides and search.is_air(samples):
            tare = record_tare(self._settings, samples, resolution(samples.force)) or Tare(0.0, None, None)
            self._load = LoadCompensation(self._settings, tare)
            samples = self._load.compensated(samples)
            self._air.add(samples.force)
            return samples
        return self._before_tare(samples, final)

    def _touch_with_tare(
        self, search: TouchSearch, samples: Samples, final: bool
    ) -> tuple[RecordTouch | None, Tare | None]:
        """Return the first touch that has air before it, and the tare of that air; None without one.

        Touches without air count in whole records only, for the begin of a bend looks like one.
        """
        while (touch := search.next_touch(samples, final)) is not None:
            if (tare := record_tare(self._settings, samples[: touch.begin], touch.step)) is not None:
                return touch, tare
        touch = search.of_record(samples) if final else None
        return touch, None if touch is None else tare_in_contact(self._settings, touch.noise)

    def _mark_record(self, samples: Samples, touch: RecordTouch, tare: Tare) -> Samples:
        """Return all samples of a record so far, less the tare, marked from a touch on."""
        self._waiting, self._load = [], LoadCompensation(self._settings, tare)
        samples = self._load.compensated(samples)
        self._load.watch_pull(samples)
        self.first_touch, self.by_change_point = (float(samples.time[touch.begin]), touch.surface), True
        self._air.add(samples.force[: touch.begin])
        self._hysteresis = ContactHysteresis(self.threshold, above=0, surface=touch.surface)
        contact = np.zeros(len(samples), bool)
        contact[touch.begin :] = self._hysteresis.contact(samples[touch.begin :])
        return replace(samples, contact=contact, active=contact & samples.active)

    def _can_settle(self, samples: Samples) -> bool:
        """Return True if the tare can be settled: contact that shows within the lag still shortens its window."""
        if len(samples) < FIRST_SAMPLES:
            return False
        tare_end = self._settings.tare_duration + self._settings.touch_lag
        return self._settings.tare != "free-air" or bool(samples.time[-1] > tare_end)

    def _before_touch(self, onset: ContactOnset, final: bool) -> Samples:
        """Return samples in air that need not be held back; from the first touch on all, marked from its begin."""
        while onset.detection is not None:
            if not onset.is_whole(final):
                return onset.held.samples[:0]
            if not onset.reject_false_contact():
                return self._mark_held(onset, onset.detection)
        released = onset.held.release(final)
        no_contact = np.zeros(len(released), bool)
        self._air.add(released.force)
        return replace(released, contact=no_contact, active=no_contact)

    def _mark_held(self, onset: ContactOnset, detection_index: int) -> Samples:
        """Return the samples that were held back, marked from where contact began; the search ends.

        `detection_index` is that of the held sample at which contact showed; behind it the hysteresis decides.
        """
        held = onset.held.samples
        # Contact begins before it shows: at the change point of the force, where there is one.
        begin, change_point = onset.located()
        surface = float(held.position[begin]) if change_point is None else change_point.surface
        self.first_touch = float(held.time[begin]), surface
        self.by_change_point = change_point is not None
        self._air.add(held.force[:begin])
        self._onset = None
        # The hysteresis goes on from the detection: the count above the threshold, and the surface of a rise.
        self._hysteresis = ContactHysteresis(
            self.threshold, above=onset.above, surface=surface if onset.by_rise else None
        )
        contact = np.arange(len(held)) >= begin
        following = slice(detection_index + 1, None)
        if len(held) > detection_index + 1:
            contact[following] = self._hysteresis.contact(held[following])
        return replace(held, contact=contact, active=contact & held.active)

    def _after_touch(self, samples: Samples) -> Samples:
        """Return samples after the first touch, marked by the hysteresis."""
        assert self._hysteresis is not None
        if not len(samples):
            return samples
        contact = self._hysteresis.contact(samples)
        return replace(samples, contact=contact, active=contact & samples.active)


def _settle_tare(settings: AlignmentSettings, samples: Samples) -> tuple[LoadCompensation, ContactOnset, int]:
    """Return tare and search for contact by the beginning of a record, and the number of samples that are searched.

    A tare in free air is measured twice where contact begins within its window: it ends there.
    """
    lookback = Lookback.of(settings, samples)
    if (tare := stated_tare(settings)) is not None:
        return *_with_tare(settings, tare, lookback), 0
    beginning = where(samples, samples.time <= settings.tare_duration + settings.touch_lag)
    load, onset = _with_tare(settings, measured_tare(settings, beginning), lookback)
    if not lookback.back:
        return load, onset, 0
    # Contact that begins within the window ends it: the tare is measured again, before that.
    onset.feed(load.compensated(beginning))
    if onset.detection is not None:
        begin, change = onset.located()
        touch_time = float(onset.held.samples.time[begin])
        if change is not None and touch_time < settings.tare_duration:
            return *_with_tare(settings, measured_tare(settings, beginning, touch_time), lookback), 0
    return load, onset, len(beginning)


def _with_tare(settings: AlignmentSettings, tare: Tare, lookback: Lookback) -> tuple[LoadCompensation, ContactOnset]:
    """Return the compensation by a tare, and a search for contact whose threshold is of its noise."""
    return LoadCompensation(settings, tare), ContactOnset(settings, ContactThreshold.of(settings, tare), lookback)
