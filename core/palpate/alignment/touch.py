"""Touch: when the tip is in contact, and when it began to be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.alignment.change_point import ChangePoint, change_point
from palpate.alignment.rise import RiseFinder
from palpate.alignment.settings import AlignmentSettings
from palpate.alignment.tare import Tare, given_tare, measured_tare, where
from palpate.estimation import Samples
from palpate.vectors import Floats

GRAVITY = 9.80665  # [m/s^2], standard
_PAPER_NOISE = 0.05  # [N], standard deviation of the sensor in the paper; where there is no free air to measure it in
_TOUCH_SIGMAS = 5.0
_FOR_DRIFT = 0.1  # of the threshold
_LEAST_TOUCH = 0.05  # [N]; a sensor without noise still feels the tip's inertia
_LEAST_RISE = 0.03  # [N] of a tenth of a second's mean
_BELIEVED = 0.1  # of the rise: what the law of a change point may leave, beside the noise
_NEAR = 3.0  # touch forces, up to which contact is looked at
_AFTER = 0.2  # of the lag: contact that is awaited before its begin is located; the rest is looked back over
_AIR_SAMPLES = 50  # before the first touch, to decide whether the force is zero there
_IN_A_ROW = 3  # samples that must agree before contact is found or lost
_BASELINE = 1.0  # [s] of air that the begin of contact is located against
_FIRST = 11  # samples, from which the interval is taken


@dataclass(frozen=True)
class _Told:
    """The touch as found in the samples that the tare is settled on."""

    shown: int  # index of the sample at which it shows
    above: int  # samples above the threshold in a row, up to that one
    doubtful: bool
    end: int  # index up to which the change point was looked for
    change: ChangePoint | None


class TouchFinder:
    """Takes raw force to tared force and marks the samples in contact.

    Until the first touch, samples are held back, `touch_lag` at most: a threshold is passed, or a slow rise found,
    later than contact begins, and a change point in what is held back locates it. The tare is taken before it. After
    the first touch nothing is held back.
    """

    def __init__(self, settings: AlignmentSettings) -> None:
        self._settings = settings
        self._waiting: list[Samples] = []  # before the tare
        self._held: Samples | None = None  # tared, before the first touch
        self._past: Samples | None = None  # the latest that were given away before the first touch
        self._lag = self._after = self._baseline = 0  # [samples] looked back over, waited for, of air before
        self._shown: int | None = None  # index within what is held of the sample at which touch showed
        self._rise: RiseFinder | None = None
        self._told: _Told | None = None  # where the tare is that of the trial
        self._seen = 0  # samples that touch was looked for in
        self.tare: Tare | None = None
        self.first_touch: tuple[float, float] | None = None  # time [s], position [m]
        self.by_change_point = False  # else the first touch is where the threshold was passed
        self.touches = 0
        self.pull = 0.0  # [N] how far below none the force stays for some samples in a row
        self._air_sum, self._air_count = 0.0, 0
        self._in_contact = False
        self._doubtful = False  # found by a rise; the force has not passed the threshold yet
        self._above = self._below = self._over = 0

    @property
    def threshold(self) -> float:
        """Force [N] that counts as touch."""
        return self._threshold(self.tare)

    def _threshold(self, tare: Tare | None) -> float:
        if self._settings.touch_force is not None:
            return self._settings.touch_force
        noise = tare.noise if tare and tare.noise else _PAPER_NOISE
        return max(_TOUCH_SIGMAS * noise, _LEAST_TOUCH)

    def _limit(self, time: Floats) -> Floats:
        """Force (n,) [N] that counts as touch at a time [s]: the threshold, of which a tenth is for drift, or more."""
        return np.maximum(self.threshold, (1.0 - _FOR_DRIFT) * self.threshold + self._settings.drift * time)

    def run(self, samples: Samples, final: bool = False) -> Samples:
        """The samples known to be in contact or not; all remaining ones where `final`."""
        if self.tare is None:
            self._waiting.append(samples)
            samples = Samples.joined(self._waiting)
            if not final and not self._enough(samples):
                self._waiting = [samples]
                return samples[:0]
            self._waiting = []
            self._prepare(samples)
        samples = self._tared(samples)
        if self.first_touch is None:
            return self._before_touch(samples, final)
        return self._mark(samples) if len(samples) else samples

    def _enough(self, samples: Samples) -> bool:
        """Whether the tare can be settled: contact that is found within the lag still shortens it."""
        if self._settings.tare != "free-air":
            return len(samples) >= _FIRST
        return bool(len(samples) and samples.time[-1] > self._settings.tare_duration + self._settings.touch_lag)

    def _prepare(self, samples: Samples) -> None:
        """Settle lag and tare on the beginning of the record, the same however much more has come."""
        settings = self._settings
        first = np.sort(samples.interval[1:_FIRST]).tolist()
        interval = 0.5 * (first[(len(first) - 1) // 2] + first[len(first) // 2]) if first else 0.0  # the median
        lag = int(settings.touch_lag / interval) if interval > 0 else 0
        self._after = int(_AFTER * lag)
        self._lag = lag - self._after
        self._baseline = int(_BASELINE / interval) if interval > 0 else 0
        if settings.touch_force is None and self._lag:
            self._rise = RiseFinder(interval, _LEAST_RISE)
        self.tare = given_tare(settings)
        if self.tare is None:
            head = where(samples, samples.time <= settings.tare_duration + settings.touch_lag)
            self.tare = measured_tare(settings, head)
            begin, told = self._touch_within(head, interval)
            if begin < settings.tare_duration:
                self.tare = measured_tare(settings, head, begin)
            else:
                self._told = told

    def _touch_within(self, head: Samples, interval: float) -> tuple[float, _Told | None]:
        """When [s] contact begins among the samples that the tare is settled on, infinite where it does not; and what
        they say of it."""
        trial = TouchFinder(self._settings)
        trial.tare, trial._lag, trial._after, trial._baseline = self.tare, self._lag, self._after, self._baseline
        if self._rise is not None:
            trial._rise = RiseFinder(interval, _LEAST_RISE)
        if not self._lag or (shown := trial._found(held := trial._tared(head), held)) is None:
            return np.inf, None
        begin, end, change = trial._begin(held, shown)
        told = _Told(shown, trial._above, trial._doubtful, end, change)
        return float(held.time[begin]) if change is not None else np.inf, told

    def _tared(self, samples: Samples) -> Samples:
        assert self.tare is not None
        force = samples.force - self.tare.offset
        if self._settings.weight == "removed" and self._settings.tip_mass is not None:
            force = force + self._settings.tip_mass * GRAVITY
        if len(force) >= _IN_A_ROW:
            rest = len(force) - _IN_A_ROW + 1
            highest = force[:rest]
            for i in range(1, _IN_A_ROW):
                highest = np.maximum(highest, force[i : i + rest])  # NaN where one is
            self.pull = max(self.pull, -float(np.fmin.reduce(highest, initial=0.0)))
        return replace(samples, force=force)

    def _before_touch(self, samples: Samples, final: bool) -> Samples:
        """Hold samples back until the first touch is found, and mark them from where it began."""
        held = samples if self._held is None else Samples.joined([self._held, samples])
        if self._shown is None:
            self._shown = self._found(samples, held)
        if self._shown is None:
            ready = len(held) if final else max(len(held) - self._lag, 0)
            none = np.zeros(ready, bool)
            given, self._held = replace(held[:ready], contact=none, active=none), held[ready:]
            past = given if self._past is None else Samples.joined([self._past, given])
            self._past = past[max(len(past) - self._baseline, 0) :]
            self._listen_to_the_air(given.force)
            return given
        if len(held) <= self._shown + self._after and not final:
            self._held = held
            return held[:0]
        return self._touched(held, self._shown)

    def _touched(self, held: Samples, shown: int) -> Samples:
        """What was held back, marked from where contact began to the sample at which it showed, and after that."""
        begin, _, change = self._begin(held, shown)
        at = float(held.position[begin]) if change is None else change.surface
        self.first_touch, self.by_change_point = (float(held.time[begin]), at), change is not None
        self.touches, self._in_contact = 1, True
        self._held = self._past = self._rise = self._told = None
        self._listen_to_the_air(held.force[:begin])
        contact = np.arange(len(held)) >= begin
        if len(held) > shown + 1:
            contact[shown + 1 :] = self._marks(held[shown + 1 :])
        return replace(held, contact=contact, active=contact & held.active)

    def _begin(self, held: Samples, shown: int) -> tuple[int, int, ChangePoint | None]:
        """Index at which contact began that showed at another, the one up to which its change point was looked for, and
        that."""
        after = held.force[shown : shown + 1 + self._after]
        beyond = np.flatnonzero(_in_a_row(after > _NEAR * self.threshold, 0) >= _IN_A_ROW)
        end = shown + (int(beyond[0]) if len(beyond) else len(after))
        told = self._told
        change = told.change if told is not None and told.end == end else self._change(held, shown, end)
        if change is None:
            return shown, end, None
        first = self._earliest(held, shown)
        above = np.flatnonzero(held.position[first : shown + 1] >= change.surface)
        return min(first + int(above[-1]) + 1, shown) if len(above) else first, end, change

    def _found(self, samples: Samples, held: Samples) -> int | None:
        """Index within what is held of the sample at which touch shows; None: not yet."""
        if not len(samples):
            return None
        if self._told is not None:  # of the same samples, which these begin with
            self._above, self._doubtful = self._told.above, self._told.doubtful
            return self._told.shown
        offset = len(held) - len(samples)
        above = _in_a_row(samples.force > self._limit(samples.time), self._above)
        passed = np.flatnonzero(above >= _IN_A_ROW)
        found = int(passed[0]) if len(passed) else None
        before = samples.force[:found]  # what rises later does not matter
        for risen in self._rise.feed(before) if self._rise is not None else ():
            at = risen - self._seen
            if (found is None or at < found) and self._change(held, at + offset, at + offset + 1) is not None:
                found, self._doubtful = at, True
                break
        self._seen += len(samples)
        self._above = int(above[-1 if found is None else found])
        return None if found is None else found + offset

    def _earliest(self, held: Samples, shown: int) -> int:
        """Index within what is held of the first sample that had not been handed out when touch showed."""
        settled = self._settings.tare_duration + self._settings.touch_lag
        whole = self._settings.tare == "free-air" and held.time[shown] <= settled
        return 0 if whole else max(shown - self._lag, 0)

    def _change(self, held: Samples, shown: int, end: int) -> ChangePoint | None:
        """The change point in the baseline, what is looked back over, and what is held up to `end`."""
        if not self._lag:
            return None
        position, force = held.position[:end], held.force[:end]
        begin = self._earliest(held, shown) - self._baseline
        if (past := self._past) is not None:
            position, force = np.concatenate([past.position, position]), np.concatenate([past.force, force])
            begin += len(past)
        found = change_point(position[max(begin, 0) :], force[max(begin, 0) :])
        noise = self.threshold / _TOUCH_SIGMAS
        return found if found is not None and found.rms < 2.0 * noise + _BELIEVED * found.rise else None

    def _mark(self, samples: Samples) -> Samples:
        """Samples after the first touch, in contact or not."""
        contact = self._marks(samples)
        return replace(samples, contact=contact, active=contact & samples.active)

    def _marks(self, samples: Samples) -> NDArray[np.bool_]:
        """Whether samples (n,) after the first touch are in contact; counts touches."""
        contact = self._contact(samples)
        begins = contact & ~np.concatenate([[self._in_contact], contact[:-1]])
        self.touches += int(np.count_nonzero(begins))
        self._in_contact = bool(contact[-1])
        return contact

    def _listen_to_the_air(self, force: Floats) -> None:
        """What the force is before the first touch, where it should be none."""
        known = force[np.isfinite(force)]
        # One by one, however the record is cut.
        self._air_sum = float(np.cumsum(np.concatenate([[self._air_sum], known]))[-1])
        self._air_count += len(known)

    @property
    def air_force(self) -> float | None:
        """Mean force [N] before the first touch; None where there is too little of that."""
        return self._air_sum / self._air_count if self._air_count >= _AIR_SAMPLES else None

    def _contact(self, samples: Samples) -> NDArray[np.bool_]:
        """Hysteresis: on after some samples in a row above the threshold, off after as many below half of it.

        After a touch that was found by a rise, it is off only where the tip is above the surface again, until the force
        has passed the threshold once.
        """
        limit = self._limit(samples.time)
        above = _in_a_row(samples.force > limit, self._above)
        below = _in_a_row(samples.force < limit - 0.5 * self.threshold, self._below)
        self._above, self._below = int(above[-1]), int(below[-1])
        event = np.where(above >= _IN_A_ROW, 1, np.where(below >= _IN_A_ROW, -1, 0))
        if self._doubtful:
            assert self.first_touch is not None
            over = _in_a_row(samples.position > self.first_touch[1], self._over)
            self._over = int(over[-1])
            settled = np.flatnonzero((above >= _IN_A_ROW) | (over >= _IN_A_ROW))
            event[: settled[0] if len(settled) else len(event)] = 0
            if len(settled):
                event[settled[0]] = 1 if above[settled[0]] >= _IN_A_ROW else -1
                self._doubtful = False
        event = np.concatenate([[1 if self._in_contact else -1], event])
        latest = np.maximum.accumulate(np.where(event != 0, np.arange(len(event)), 0))
        contact: NDArray[np.bool_] = event[latest][1:] > 0
        return contact


def _in_a_row(condition: NDArray[np.bool_], before: int) -> NDArray[np.int64]:
    """How many samples up to each one meet a condition without interruption, `before` of them in the last block."""
    index = np.arange(len(condition))
    broken = np.maximum.accumulate(np.where(condition, -1, index))
    return np.where(broken < 0, index + 1 + before, index - broken)
