"""Largest force of a motion, and how long after it readings of it may still come."""

from __future__ import annotations

import numpy as np
from palpate.vectors import Floats

from palpate_engine.safety import SafetySettings

_MAX_WAIT = 1.0  # [s] for readings, once the arms stand: a choice
_FALLEN = 0.5  # of the force that stops; a latest reading below it is of a tip that has left: a choice


class PeakForce:
    """The largest reading so far, and the latest; a reading that is not a number counts for nothing."""

    def __init__(self) -> None:
        self.tared = self.untared = 0.0  # [N] of any component
        self.latest = 0.0  # [N] the largest component, tared

    def note(self, values: Floats, tare: Floats) -> float:
        """Return the largest tared component [N] of readings (n, components)."""
        sizes = np.abs(values - tare)
        largest = float(np.fmax.reduce(sizes, axis=None, initial=0.0))
        self.latest = float(np.fmax.reduce(sizes[-1], initial=0.0)) if len(sizes) else self.latest
        self.tared = max(self.tared, largest)
        self.untared = max(self.untared, float(np.fmax.reduce(np.abs(values), axis=None, initial=0.0)))
        return largest

    def may_rise(self, waited: float, late: float, limits: SafetySettings) -> bool:
        """Return True if readings from before the arms stood may still come, a time [s] after that, `late` [s] as they
        are.

        Where the force has not fallen, they may be later than is known.
        """
        return waited <= _MAX_WAIT and (waited < late or self.latest > _FALLEN * limits.stop_force)
