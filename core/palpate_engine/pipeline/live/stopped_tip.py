"""Where the tip stands once its arm was stopped, and whether the arm obeys."""

from __future__ import annotations

import math

from palpate_engine.safety import SafetySettings

_MORE = 1e-3  # [m] that a tip may go on beyond what reaction and braking take


class StoppedTip:
    """Height of the tip by the latest readings, and where it was when its arm was to stop."""

    def __init__(self) -> None:
        self.height = math.inf  # [m]
        self._at_stop = math.inf  # [m]
        self._is_disobeyed = False

    def stop(self) -> None:
        """The arm is to stop now."""
        self._at_stop = self.height

    def standing(self, text: str, felt: float) -> str:
        """The sentence of a failed arm, where the tip is, and the force [N] that it feels."""
        where = f" The tip stands at a height of {1e3 * self.height:.1f} mm and feels {felt:.1f} N."
        return text.rstrip(".") + "." + (where if math.isfinite(self.height) else "")

    def stranded(self, text: str, felt: float) -> str:
        """What is added to the reason of a stop after which the arm did not leave, by a second fault; `felt` [N]."""
        return (
            f"; the arm was to leave, and that has failed: {self.standing(text, felt)} Nothing moves it any more: keep "
            "the emergency stop within reach, find the cause at the pendant, and lift the tip in freedrive"
        )

    def disobedience(self, limits: SafetySettings) -> str | None:
        """The sentence to add, once, if the tip goes deeper than v t + v^2/(2 a) after a stop; None while it obeys."""
        allowed = limits.speed * limits.latency + limits.speed**2 / (2.0 * limits.deceleration) + _MORE
        deeper = self._at_stop - self.height
        if self._is_disobeyed or not (math.isfinite(deeper) and deeper > allowed):
            return None
        self._is_disobeyed = True
        return (
            f"; the arm does not obey: since it was to stop, the tip has gone {1e3 * deeper:.1f} mm deeper, of "
            f"{1e3 * allowed:.1f} mm that [safety] latency and deceleration allow: press the emergency stop"
        )
