"""Rise of the force as the tip goes deeper, which a saturated sensor does not show, although noise hides that it
repeats itself."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from palpate.sound_force import LONGEST, POSE, SoundForce
from palpate.vectors import Floats

from palpate_engine.safety.contact_search import ContactSearch

_MIN_RISE = 0.2  # of F w/depth (0326): a law F ~ d^n rises by n/2 of it from the mean of one half to that of the other
_SIGNIFICANT = 5.0  # standard errors (0326)
_STEPS = 20  # of a window: a choice, the resolution of ways
_KEPT_WINDOWS = 8  # of steps in memory, before those behind the longest window are dropped: a choice
_SLOWER = 0.9  # of the speed from half to half, which falls by a fifth within the window then (0326)
_STANDS = 0.5  # of the speed at the begin of a window: a hold, in which the force relaxes; a choice
_MAX_SIDEWAYS_SHARE = 0.5  # of a window; a way with more across the skin is not judged: a choice
_AT_SET_FORCE = 0.9  # of the force that a law holds: a choice
_MIN_READINGS = 4  # of half a window, for a mean: a choice
_MIN_COMMANDED_SHARE = 0.5  # of a way: where less was commanded, the tip has done it before its poses show it; a choice
_QUIET, _BLOCK = 0.2, 100  # of the noise at standstill; readings (0326)
_MIN_ELAPSED = 1e-9  # [s] guards against a division by 0
_DIFFERENCES = 2  # order of the differences that show noise: a smooth rise drops out; so many readings are carried over


class _Row(NamedTuple):
    """The readings since contact began, up to a way of the tip."""

    time: float  # [s]
    readings: int
    total: float  # [N] sum of the readings
    place: Sequence[float]  # [m] of the tip
    commanded: float  # [m] way inwards; NaN if not known


class RiseWatch:
    """Looks whether the force rises on the way in, at least as a contact law F ~ d^n with n >= 1 does.

    Over a way w inwards, within contact and ending at a depth d, the mean force of the last half exceeds that of the
    first by F n w/(2 d). Less than a fifth of F w/d is not contact, where noise and inertia are smaller.
    Not judged are ways on which the tip slows down, for a part of the force goes with speed, or goes sideways; nor
    those after a force that a law holds was reached once: the tip then follows a skin that breathes.
    """

    def __init__(self, sound: SoundForce) -> None:
        """Take the force at standstill, whose noise distinguishes a rise from chance."""
        self.sound = self._sound = sound
        self.contact = ContactSearch(sound)
        self._ways: list[float] = []  # [m] inwards, in steps
        self._rows: list[_Row] = []  # one at each of these ways
        self._count, self._sum = 0, 0.0
        self._tail = np.zeros(0)  # [N] the latest two readings
        self._rough, self._differences = 0.0, 0
        self._has_reached_set_force = False

    def add(
        self, time: float, forces: Floats, way: float, place: Sequence[float], commanded: float = math.nan
    ) -> str | None:
        """Return why the force is not to be believed, after readings (n,) [N] that push out, at a time [s]; None where
        it is.

        The tip has gone a `way` [m] inwards, counted from any one place, of which `commanded` [m] were commanded, NaN
        if that is not known; it is at a `place` (3,) [m].
        """
        if not len(forces):
            return None
        count, total = len(forces), float(forces.sum())
        if not math.isfinite(total):
            return None  # no reading is judged elsewhere
        self.contact.note(way, count, total)
        if self.contact.mean is not None:
            self._has_reached_set_force |= self.contact.mean > _AT_SET_FORCE * self._sound.set_force
        joined = np.concatenate([self._tail, forces])
        self._tail = joined[-_DIFFERENCES:]
        if self.contact.foot is None:
            self._forget()
            return None
        self._count, self._sum = self._count + count, self._sum + total
        return self._quiet(joined) or self._flat(time, way, place, commanded)

    def _forget(self) -> None:
        """Forget the readings and ways of a contact that is over."""
        self._ways.clear()
        self._rows.clear()
        self._count, self._sum = 0, 0.0
        self._rough, self._differences = 0.0, 0

    def _quiet(self, readings: Floats) -> str | None:
        """Return why the noise in contact is not that of a sensor that measures; None where it is, or of fewer than 100
        readings.

        The noise is the root mean square of second differences [N], from which a smooth rise drops out.
        """
        usual = self._sound.roughness
        second = np.diff(readings, _DIFFERENCES)
        self._rough, self._differences = self._rough + float(second @ second), self._differences + len(second)
        if self._differences < _BLOCK:
            return None
        roughness = math.sqrt(self._rough / self._differences)
        self._rough, self._differences = 0.0, 0
        if roughness >= _QUIET * usual:
            return None
        return (
            f"the noise of {self._sound.name} in contact is {100 * roughness / usual:.0f} % of that at standstill: the "
            "sensor is saturated or stuck, and the force is unknown"
        )

    def _flat(self, time: float, way: float, place: Sequence[float], commanded: float) -> str | None:
        """Return why the force does not rise over a whole window of the way in; None where it does, or on other
        ways."""
        windows = self._sound.windows
        if not windows or self._has_reached_set_force:
            return None
        step = windows[0] / _STEPS
        if self._ways and way < self._ways[-1] + step:
            if way < self._ways[-1] - max(POSE * self._sound.position_std, step):  # it goes out
                self._ways.clear()
                self._rows.clear()
            return None
        self._ways.append(way)
        self._rows.append(_Row(time, self._count, self._sum, place, commanded))
        complaint = next((text for window in windows if (text := self._judge(window)) is not None), None)
        if len(self._ways) > _KEPT_WINDOWS * _STEPS and self._ways[2 * _STEPS] < way - LONGEST:
            del self._ways[:_STEPS], self._rows[:_STEPS]
        return complaint

    def _slows_down(self, first: int, middle: int) -> bool:
        """Return True if the tip slows down from half to half of a window, or nearly stands within it."""
        last = len(self._ways) - 1
        edges = first, (first + middle) // 2, middle, (middle + last) // 2, last
        quarters = [self._speed(begin, end) for begin, end in pairwise(edges)]
        return (
            self._speed(middle, last) < _SLOWER * self._speed(first, middle)
            or min(quarters[1:]) < _STANDS * quarters[0]
        )

    def _speed(self, begin: int, end: int) -> float:
        """Return the mean speed [m/s] inwards between two rows."""
        return (self._ways[end] - self._ways[begin]) / max(self._rows[end].time - self._rows[begin].time, _MIN_ELAPSED)

    def _judge(self, window: float) -> str | None:
        """Return why the rise over the last way of a `window` [m] is not that of a contact; None where it is, or is not
        judged.

        With the means F1 and F2 of both halves of a way w that ends at a depth d, F2 - F1 < _MIN_RISE F w/d is not
        contact, where that bound is five standard errors, and what inertia adds, or more.
        """
        ways, sound = self._ways, self._sound
        first = bisect_right(ways, ways[-1] - window) - 1
        middle = bisect_right(ways, ways[-1] - 0.5 * window) - 1
        if first < 0 or middle <= first or self.contact.foot is None:
            return None
        begin, half_way, end = self._rows[first], self._rows[middle], self._rows[-1]
        # Counts and sums are totals since contact began; a half is the difference of two of them.
        count_1, count_2 = half_way.readings - begin.readings, end.readings - half_way.readings
        if min(count_1, count_2) < _MIN_READINGS:
            return None
        # A way across the skin is not judged, nor one on which the tip slows down; of a way that goes sideways by a
        # share s the length in space is sqrt(1 + s^2) times that inwards.
        length = ways[-1] - ways[first]
        if math.dist(end.place, begin.place) > math.hypot(1.0, _MAX_SIDEWAYS_SHARE) * length:
            return None
        if self._slows_down(first, middle):
            return None
        # F2 - F1, and both bounds, by the mean force of the whole way.
        rise = (end.total - half_way.total) / count_2 - (half_way.total - begin.total) / count_1
        force = (end.total - begin.total) / (end.readings - begin.readings)
        min_rise = _MIN_RISE * force * length / (ways[-1] - self.contact.foot)
        std = math.hypot(sound.standard_error(count_1), sound.standard_error(count_2))
        if min_rise < _SIGNIFICANT * std + sound.inertia or rise >= min_rise:
            return None
        return (
            f"{sound.name} rises by {rise:.2f} N at {force:.1f} N while the tip goes {1e3 * length:.2f} mm "
            f"deeper, where any contact gives {min_rise:.2f} N or more: {self._cause(first)}"
        )

    def _cause(self, first: int) -> str:
        """Return what explains that the force did not rise from a row on: its sensor, or poses that come late.

        A tip whose command did not go in meanwhile was there before: its force had risen by then.
        """
        commanded = self._rows[-1].commanded - self._rows[first].commanded
        if not commanded < _MIN_COMMANDED_SHARE * (self._ways[-1] - self._ways[first]):
            return "the sensor is saturated, and the force is unknown"
        return (
            f"its command went {1e3 * commanded:.2f} mm meanwhile, so that the poses come late, by more than the force "
            "does: where the tip stands is not known (does its driver report old poses?)"
        )
