"""The extremes of what MuJoCo's arm did, in the work frame."""

from __future__ import annotations

import math

import numpy as np
from palpate import Floats

STANDSTILL_SPEED = 1e-3  # [m/s] below which the tip counts as standing


class ArmRecord:
    """Extremes of the tip's place, of its and the joints' speeds, and of the force on it, since the last mark."""

    def __init__(self, nominal: Floats) -> None:
        self._nominal = nominal  # (3, 3) orientation of the tool that the work frame has
        self.stands = 0.0  # [s] for which the tip has stood
        self.place = np.full(3, np.nan)
        self.mark()

    def mark(self) -> None:
        """Forget the extremes."""
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.fastest = self.force = self.askew = self.fastest_joint = 0.0

    def add(
        self, place: Floats, velocity: Floats, force: Floats, turn: Floats, joint_speed: float, interval: float
    ) -> None:
        """Add an instant: place [m], velocity [m/s] and force [N] (3,), the tool's orientation (3, 3), joints [rad/s].

        `interval` [s] is the time since the instant before.
        """
        self.place = place
        self.low, self.high = np.minimum(self.low, place), np.maximum(self.high, place)
        speed = math.hypot(*velocity.tolist())
        self.fastest = max(self.fastest, speed)
        self.stands = self.stands + interval if speed < STANDSTILL_SPEED else 0.0
        self.force = max(self.force, math.hypot(*force.tolist()))
        # The angle of a rotation R has the cosine (trace R - 1) / 2.
        cosine = (float((self._nominal * turn).sum()) - 1.0) / 2.0
        self.askew = max(self.askew, math.acos(max(min(cosine, 1.0), -1.0)))
        self.fastest_joint = max(self.fastest_joint, joint_speed)

    def facts(self) -> dict[str, object]:
        """Return the extremes, in SI."""
        return {
            "low": self.low.tolist(),
            "high": self.high.tolist(),
            "fastest": self.fastest,
            "force": self.force,
            "askew": self.askew,
            "fastest_joint": self.fastest_joint,
            "stands": self.stands,
            "place": self.place.tolist(),
        }
