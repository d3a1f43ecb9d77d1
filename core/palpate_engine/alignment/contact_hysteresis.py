"""Hysteresis of the contact: on and off by the force, from the first touch on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate.estimation import Samples

from palpate_engine.alignment.contact_threshold import SAMPLES_IN_A_ROW, ContactThreshold, run_lengths


class ContactHysteresis:
    """Contact is on after some samples in a row above the threshold, off after as many below half of it.

    After a touch that shows by a rise, it is off only where the tip is above the surface again, until the force has
    passed the threshold once.
    """

    def __init__(self, threshold: ContactThreshold, above: int, surface: float | None) -> None:
        self._threshold = threshold
        self._above, self._below, self._over = above, 0, 0  # samples in a row
        self._surface = surface  # [m] of a touch that shows by a rise; None once the force decides
        self._in_contact = True
        self.touches = 1

    def contact(self, samples: Samples) -> NDArray[np.bool_]:
        """Return True if samples (n,), at least one, are in contact; counts touches."""
        event = np.concatenate([[1 if self._in_contact else -1], self._events(samples)])
        latest = np.maximum.accumulate(np.where(event != 0, np.arange(len(event)), 0))
        contact: NDArray[np.bool_] = event[latest][1:] > 0
        begins = contact & ~np.concatenate([[self._in_contact], contact[:-1]])
        self.touches += int(np.count_nonzero(begins))
        self._in_contact = bool(contact[-1])
        return contact

    def _events(self, samples: Samples) -> NDArray[np.int64]:
        """For each sample (n,) 1 where contact is on, -1 where it is off, 0 where it stays as it was."""
        limit = self._threshold.at(samples.time)
        above = run_lengths(samples.force > limit, self._above)
        below = run_lengths(samples.force < limit - 0.5 * self._threshold.force, self._below)
        self._above, self._below = int(above[-1]), int(below[-1])
        event = np.where(above >= SAMPLES_IN_A_ROW, 1, np.where(below >= SAMPLES_IN_A_ROW, -1, 0))
        if self._surface is not None:
            over = run_lengths(samples.position > self._surface, self._over)
            self._over = int(over[-1])
            settled = np.flatnonzero((above >= SAMPLES_IN_A_ROW) | (over >= SAMPLES_IN_A_ROW))
            event[: settled[0] if len(settled) else len(event)] = 0
            if len(settled):
                event[settled[0]] = 1 if above[settled[0]] >= SAMPLES_IN_A_ROW else -1
                self._surface = None
        return event
