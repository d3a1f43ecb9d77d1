"""A tip whose arm was stopped: whether it stands, by its states, and whether the arm obeys."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from palpate.vectors import Floats

from palpate_engine.safety import SafetySettings
from palpate_engine.safety.emergency import EMERGENCY
from palpate_engine.safety.rest_window import RestWindow

_TOLERANCE = 1e-3  # [m] that a tip may go on beyond what reaction and braking take (0321)
_ADVICE = " Nothing moves it any more: keep the emergency stop within reach, find the cause at the pendant, and"
_LIFT = " lift the tip in freedrive"


class StoppedTip:
    """Height of the tip by the latest readings, and what it did since its arm was to stop."""

    def __init__(self) -> None:
        self.height = math.inf  # [m]
        self._at_stop = math.inf  # [m]
        self._window: RestWindow | None = None  # since the stop

    def stop(self) -> None:
        """Take note that the arm is to stop now."""
        self._at_stop, self._window = self.height, RestWindow()

    def note(self, times: NDArray[np.int64], heights: Floats) -> None:
        """Take times (n,) [ns] and heights (n,) [m] of states."""
        self.height = float(heights[-1])
        if self._window is not None:
            for time, height in zip(times.tolist(), heights.tolist(), strict=True):
                self._window.add(time, (height,))

    @property
    def shows_rest(self) -> bool:
        """True if states since the stop show that the tip stands."""
        return self._window is not None and self._window.shows_rest

    @property
    def speed(self) -> float | None:
        """Mean speed [m/s] along the normal over the last 0.1 s since the stop; None where states do not show it."""
        return self._window.speed if self._window is not None and self._window.is_full else None

    def rest_sentence(self, felt: float, stands: bool, speed: float | None) -> str:
        """Return where the tip stands and what it feels [N]; of one that does not the call for the emergency stop.

        `speed` [m/s] of a tip that moves; None where no states show it.
        """
        is_known = math.isfinite(self.height)
        place = f"at a height of {1e3 * self.height:.1f} mm"
        if stands:
            return f" The tip stands {place} and feels {felt:.1f} N." if is_known else ""
        if speed is None:
            where = f"; at last it was {place} and felt {felt:.1f} N" if is_known else ""
            return f" {EMERGENCY}: no states show that the tip stands{where}."
        where = f", is {place}" if is_known else ""
        return f" {EMERGENCY}: the tip moves at {1e3 * speed:.1f} mm/s{where} and feels {felt:.1f} N."

    def pressed_in(self, felt: float) -> str:
        """Return the sentence on a tip that stands where its way out was stopped, with the force [N] that it feels."""
        return (
            f"; a later Ctrl-C stopped the way out: the tip stands at a height of {1e3 * self.height:.1f} mm, pressed "
            f"in at {felt:.1f} N: lift it in freedrive"
        )

    def stranded(self, fault: str, stands: bool, standstill: str) -> str:
        """Return the second fault of an arm that did not leave after a stop, with its `standstill` and advice."""
        advice = _ADVICE + _LIFT if stands else " Then" + _LIFT
        return f"; the arm was to leave, and that has failed: {fault.rstrip('.')}.{standstill}{advice}"

    def disobedience(self, limits: SafetySettings) -> str | None:
        """Return the sentence to add where the tip goes deeper than v t + v^2/(2 a) after a stop; None while it
        obeys."""
        allowed = limits.speed * limits.latency + limits.speed**2 / (2.0 * limits.deceleration) + _TOLERANCE
        deeper = self._at_stop - self.height
        if not (math.isfinite(deeper) and deeper > allowed):
            return None
        return (
            f"; the arm does not obey: since it was to stop, the tip has gone {1e3 * deeper:.1f} mm deeper, of "
            f"{1e3 * allowed:.1f} mm that [safety] latency and deceleration allow."
        )
