"""The place at which the force first shows on a way inwards."""

from __future__ import annotations

import math
from collections import deque

from palpate.sound_force import SoundForce

_SIGNIFICANT = 5.0  # standard errors of a mean, above which it is contact (0326)
_LOST = 0.5  # of that force; a mean below it is free air again: a choice
_READINGS = 20  # over which contact is looked for (0470)


class ContactSearch:
    """Finds where contact begins, by means over 20 readings of a tared force."""

    def __init__(self, sound: SoundForce) -> None:
        self._sound = sound
        self._recent: deque[tuple[float, int, float]] = deque()  # way [m], readings, sum [N]
        self._way_before = math.inf  # [m] of the readings before those
        self.mean: float | None = None  # [N] of the latest 20 readings; None of fewer
        self.threshold = 0.0  # [N] that counts as contact
        self.foot: float | None = None  # way [m] at which contact began; None in the air

    def note(self, way: float, count: int, total: float) -> None:
        """Take readings, so many with a sum [N], at a way [m] of the tip inwards."""
        self._recent.append((way, count, total))
        # The fewest of the latest batches that have 20 readings; a row has way, number and sum of those of a batch.
        readings = sum(row[1] for row in self._recent)
        while readings - self._recent[0][1] >= _READINGS:
            self._way_before, count_before, _ = self._recent.popleft()
            readings -= count_before
        if readings < _READINGS:
            return
        self.mean = sum(row[2] for row in self._recent) / readings
        self.threshold = _SIGNIFICANT * self._sound.standard_error(readings) + self._sound.inertia
        # Contact began after the last readings in free air: where others are missing meanwhile, the first in contact
        # may be from deep within.
        if self.foot is None and self.mean > self.threshold:
            self.foot = min(self._way_before, self._recent[0][0])
        elif self.mean < _LOST * self.threshold:
            self.foot = None
        if self.foot is not None:
            self.foot = min(self.foot, way)  # where the material was left behind it is touched again no deeper
