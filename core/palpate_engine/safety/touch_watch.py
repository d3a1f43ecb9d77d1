"""Agreement of the force with the place of the tip, which no force sensor can falsify."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from palpate.sound_force import NO_SET_FORCE, SoundForce
from palpate.vectors import Floats

from palpate_engine.safety.contact_search import ContactSearch
from palpate_engine.safety.touch_begin import TouchBegin, TouchSlope

_SIGNIFICANT = 5.0  # standard uncertainties (0470)
_LARGEST_SHIFT = 0.5  # [N] of the zero by a drift that was seen, or of a pull before contact: 5 times a UR's in air
_MIN_EXCESS = 0.1  # [N]; the last digit of a coarse sensor or a material's damping makes less: a choice
_LATE = 0.15  # [s] by which the mean of 20 readings may be late: of a sensor of 100 Hz by 0.1
_MIN_DRIFT_TIME = 10.0  # [s] from which a drift shows: a mean of half a second scatters by some 5 mN
_LEAVING = 0.1  # [s] (0470) after the tip has come to free air, in which readings may still be of the material
_MIN_AIR, _MAX_AIR = 0.1, 0.5  # [s] of readings in free air that are compared with the standstill (0470)
_MIN_STD = 1e-9  # [N] guards against a division by 0


class TouchWatch:
    """Compares the force with what the place of the tip allows.

    In free air it is that of the standstill, within 5 standard uncertainties, what inertia adds, and the drift; before
    contact nothing pulls the tip; and at a depth d past the place of the first contact it is at most K d, with K of the
    stiffest material that may be met. On a way along the skin, which may rise by as much, that counts as depth.
    """

    def __init__(self, sound: SoundForce, contact: ContactSearch, zero_time: float) -> None:
        """Take the force at standstill, the search for contact, and the time [s] at which the zero was determined."""
        self._sound, self._contact = sound, contact
        self._zero_time = zero_time  # [s] at which the zero was determined, as the times of the readings
        self._air_began: float | None = None  # [s] since when the tip is in free air
        self._count, self._sum = 0, 0.0  # of the readings there
        self._first = self._last = 0.0  # [s] of them
        self._drift = sound.drift  # [N/s]
        self._was_touched = False  # since the tip was last in free air
        self._foot: Sequence[float] | None = None  # place (3,) [m] of the first contact
        self._first_way = self._lateral = 0.0  # [m] inwards there; across since then
        self._lately: deque[tuple[float, float]] = deque(maxlen=2)  # begin [s] of two stretches, way inwards [m]
        self._begin: TouchBegin | None = None
        self.slopes: list[TouchSlope] = []  # of the touches so far

    def fault(self, time: float, forces: Floats, way: float, place: Sequence[float], in_air: bool) -> str | None:
        """Return why readings (n,) [N] that push out are not believed at a time [s]; None where they are.

        The tip has gone a `way` [m] inwards and is at a `place` (3,) [m]; `in_air`: that is as high as travel in free
        air. The search for contact has had these readings.
        """
        count, total = len(forces), float(forces.sum())
        if not count or not math.isfinite(total):
            return None
        text = self._air_fault(time, count, total, in_air)
        self._note_way(time, way)
        if self._contact.foot is None:
            self._foot = self._begin = None
            return text or self._pull(time)
        return text or self._excess(time, count, total, way, place)

    def _note_way(self, time: float, way: float) -> None:
        """Keep how deep the tip was within the time for which a reading may be late."""
        if not self._lately or time - self._lately[-1][0] > _LATE:
            self._lately.append((time, way))
        else:
            began, deepest = self._lately[-1]
            self._lately[-1] = began, max(deepest, way)

    def _air_fault(self, time: float, count: int, total: float, in_air: bool) -> str | None:
        """Return why the zero in free air is another one than at standstill; None where it is not.

        It is compared at the end of the way through free air, and after every half second of it.
        """
        # A stretch in free air begins, and its readings are collected after the tip has left the material.
        if in_air and self._air_began is None:
            self._air_began, self._count, self._sum, self._was_touched = time, 0, 0.0, False
        if self._air_began is None:
            return None
        if in_air and time - self._air_began < _LEAVING:
            return None
        if in_air:
            self._first = self._first if self._count else time
            self._count, self._sum, self._last = self._count + count, self._sum + total, time
        duration = self._last - self._first if self._count else 0.0
        if in_air and duration < _MAX_AIR:
            return None
        # It ends with the descent, or after so long that a drift shows, and another one begins.
        mean, readings = self._sum / max(self._count, 1), self._count
        self._count, self._sum = 0, 0.0
        if not in_air:
            self._air_began = None
        return self._zero_fault(mean, readings) if duration >= _MIN_AIR else None

    def _zero_fault(self, mean: float, count: int) -> str | None:
        """Return why a mean of tared readings in free air is not zero; None where it is."""
        sound, elapsed = self._sound, self._last - self._zero_time
        std = math.hypot(sound.standard_error(count), sound.zero_std)
        if abs(mean) <= _SIGNIFICANT * std + sound.inertia + self._shift(self._last):
            self._drift = abs(mean) / max(elapsed, _MIN_DRIFT_TIME)
            return None
        return (
            f"{sound.name} reads {mean:+.2f} N in free air, {abs(mean) / max(std, _MIN_STD):.0f} standard "
            "uncertainties from its zero at standstill: is something pulling at the cable, has the zero of the sensor "
            "moved, do its readings come late, or is the skin higher than stated?"
        )

    def _shift(self, time: float) -> float:
        """Return how far [N] the zero may be off at a time [s]: a drift that was seen may go on, up to a bound."""
        elapsed = time - self._zero_time
        return max(self._sound.drift * elapsed, min(self._drift * elapsed, _LARGEST_SHIFT))

    def _pull(self, time: float) -> str | None:
        """Return what pulls the tip before it touches, in a sentence; None where nothing does."""
        mean, sound = self._contact.mean, self._sound
        if mean is None or self._was_touched:
            return None
        if mean >= -max(self._contact.threshold + self._shift(time), _LARGEST_SHIFT):
            return None
        return (
            f"{sound.name} fell to {mean:.2f} N before a contact was felt: is something pulling at the cable, has the "
            "zero of the sensor moved, or does it count the other way round ([alignment] force sign = -1)?"
        )

    def _excess(self, time: float, count: int, total: float, way: float, place: Sequence[float]) -> str | None:
        """Return by how much the force exceeds that of the stiffest material at this depth, in a sentence; else None.

        `count` new readings have the sum `total` [N]; the tip is at a `place` (3,) [m], after a `way` [m] inwards. At
        the first reading of a touch its place is kept, and its slope once enough of it has come.
        """
        # The contact that was felt, and what force and material may be where the sensor is sound.
        contact, sound = self._contact, self._sound
        if self._foot is None:
            assert contact.foot is not None
            self._foot, self._first_way, self._lateral = tuple(place), contact.foot, 0.0
            self._begin = None if self._was_touched else TouchBegin(self._foot, contact.foot)
            self._was_touched = True
        # The way across the skin is what is left of the whole way without that inwards.
        lateral_square = math.dist(place, self._foot) ** 2 - (way - self._first_way) ** 2
        self._lateral = max(self._lateral, math.sqrt(max(lateral_square, 0.0)))
        if self._begin is not None and self._begin.add(way, count, total):
            self.slopes += self._begin.slopes(sound)
            self._begin = None
        # A tip that a force leads follows a skin that breathes: its way is not its depth.
        if contact.mean is None or sound.set_force < NO_SET_FORCE:
            return None
        # A skin may rise by as much as the tip goes across it. On the way out a force never exceeds that on the way in.
        depth = max(deepest for _, deepest in self._lately) - self._first_way
        depth = max(depth + self._lateral, 0.0) + _SIGNIFICANT * sound.position_std
        # F <= K d + 2 F0 (0470), F0 the force that counts as contact: 5 standard errors and what inertia makes. The
        # zero may be off as well.
        limit = sound.stiffness * depth + max(2.0 * contact.threshold, _MIN_EXCESS) + self._shift(time)
        if contact.mean <= limit:
            return None
        return (
            f"{sound.name} is {contact.mean:.2f} N within {1e3 * depth:.2f} mm of the first contact, where the "
            f"stiffest material gives {limit:.2f} N ([safety] stiffness = {1e-3 * sound.stiffness:g} N/mm): the "
            "material is stiffer than that, the skin comes towards the tip, or the sensor reads too much or too late"
        )
