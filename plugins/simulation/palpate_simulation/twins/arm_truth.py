"""Record of the true motion of the twin's arm: speeds of joints and tip, positions, and the force on the skin."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from palpate import Floats

from palpate_simulation.twins.arm import TICK

KEPT_TICKS = 30_000  # a minute (a choice)
MEAN_TICKS = 10  # over which an acceleration is averaged, 20 ms (a choice)
COLUMNS = ("time", "x", "y", "z", "vx", "vy", "vz", "turning", "joint_speed", "force", "commands")


class Truth:
    """Every tick of the last minute, and extremes since the last mark."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, ...]] = deque(maxlen=KEPT_TICKS)
        self.mark()

    def mark(self) -> None:
        """Forget the extremes."""
        self._recent_velocities: deque[Floats] = deque(maxlen=MEAN_TICKS + 1)
        self.acceleration = self.force = 0.0  # [m/s^2] over 20 ms, [N] on the skin
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._fastest = {"fastest_tip": 0.0, "fastest_turn": 0.0, "fastest_joint": 0.0}

    def add(
        self, now: float, place: Floats, velocity: Floats, turning: float, joint: float, force: float, commands: int
    ) -> None:
        """Add a tick at a monotonic time [s]: position [m] and velocity [m/s] (3,) of the tip in the work frame.

        `turning` [rad/s] is the angular speed of the tool, `joint` [rad/s] that of the fastest joint, `force` [N] that
        on the skin, `commands` the number of commands that the controller read.
        """
        self._rows.append((now, *place.tolist(), *velocity.tolist(), turning, joint, force, commands))
        self._low, self._high = np.minimum(self._low, place), np.maximum(self._high, place)
        self.force = max(self.force, force)
        # Mean acceleration over 20 ms.
        self._recent_velocities.append(velocity)
        if len(self._recent_velocities) > MEAN_TICKS:
            change = math.dist(velocity.tolist(), self._recent_velocities[0].tolist())
            self.acceleration = max(self.acceleration, change / (MEAN_TICKS * TICK))
        speeds = {"fastest_tip": math.hypot(*velocity.tolist()), "fastest_turn": turning, "fastest_joint": joint}
        self._fastest = {key: max(self._fastest[key], speed) for key, speed in speeds.items()}

    def facts(self) -> dict[str, Any]:
        """Return the extremes since the last mark, in SI."""
        return {
            **self._fastest,
            "largest_acceleration": self.acceleration,
            "low": self._low.tolist(),
            "high": self._high.tolist(),
        }

    def write(self, path: str) -> None:
        """Write the last minute as a table (n, columns) to a file of numpy."""
        np.save(path, np.array(self._rows))
