"""Hysteresis of the contact: on and off by the force, from the first touch on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate.estimation import Samples

from palpate_engine.alignment.contact_threshold import SAMPLES_IN_A_ROW, ContactThreshold, run_lengths

_ON, _OFF, _UNCHANGED = 1, -1, 0  # events


class ContactHysteresis:
    """Contact is on after some samples in a row above the threshold, off after as many below half of it.

    After a touch that shows by a rise, it is off only where the tip is above the surface again, until the force has
    passed the threshold once.
    """

    def __init__(self, threshold: ContactThreshold, above: int, surface: float | None) -> None:
        self._threshold = threshold
        self._above, self._below = above, 0  # samples in a row above the threshold, below half of it
        self._raised = 0  # samples in a row above the surface
        self._surface = surface  # [m] of a touch that shows by a rise; None once the force decides
        self._in_contact = True
        self.touches = 1

    def contact(self, samples: Samples) -> NDArray[np.bool_]:
        """Return True if samples (n,), at least one, are in contact; counts touches."""
        events = np.concatenate([[_ON if self._in_contact else _OFF], self._events(samples)])
        latest = np.maximum.accumulate(np.where(events != _UNCHANGED, np.arange(len(events)), 0))
        contact: NDArray[np.bool_] = events[latest][1:] == _ON
        begins = contact & ~np.concatenate([[self._in_contact], contact[:-1]])
        self.touches += int(np.count_nonzero(begins))
        self._in_contact = bool(contact[-1])
        return contact

    def _events(self, samples: Samples) -> NDArray[np.int64]:
        """Return for each sample (n,) whether contact goes on, off, or stays as it was."""
        # By the force.
        limit = self._threshold.at(samples.time)
        above = run_lengths(samples.force > limit, self._above)
        below = run_lengths(samples.force < limit - self._threshold.hysteresis, self._below)
        self._above, self._below = int(above[-1]), int(below[-1])
        is_on, is_off = above >= SAMPLES_IN_A_ROW, below >= SAMPLES_IN_A_ROW
        events = np.where(is_on, _ON, np.where(is_off, _OFF, _UNCHANGED))
        if self._surface is None:
            return events

        # After a touch by a rise the force decides only from the sample on at which it passes the threshold, or at
        # which the tip has left the surface.
        raised = run_lengths(samples.position > self._surface, self._raised)
        self._raised = int(raised[-1])
        decisions = np.flatnonzero(is_on | (raised >= SAMPLES_IN_A_ROW))
        first = int(decisions[0]) if len(decisions) else len(events)
        events[:first] = _UNCHANGED
        if first < len(events):
            events[first] = _ON if is_on[first] else _OFF
            self._surface = None
        return events
