"""What the twin's arm truly did: how fast its joints and its tip were, how far it went, and the force on the skin."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from palpate import Floats

from palpate_simulation.twins.arm import TICK

_KEPT = 30_000  # ticks, a minute
_MEAN = 10  # ticks over which an acceleration is averaged
COLUMNS = ("time", "x", "y", "z", "vx", "vy", "vz", "turning", "joint_speed", "force", "commands")


class Truth:
    """Every tick of the last minute, and extremes since the last mark."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, ...]] = deque(maxlen=_KEPT)
        self.mark()

    def mark(self) -> None:
        """Forget the extremes."""
        self._recent: deque[Floats] = deque(maxlen=_MEAN + 1)
        self.acceleration = self.force = 0.0  # [m/s^2] over 20 ms, [N] on the skin
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._fastest = {"fastest_tip": 0.0, "fastest_turn": 0.0, "fastest_joint": 0.0}

    def add(
        self, now: float, place: Floats, velocity: Floats, turning: float, joint: float, force: float, commands: int
    ) -> None:
        """One tick, at a monotonic time [s]: place [m] and velocity [m/s] (3,) in the work frame, speeds [rad/s]."""
        self._rows.append((now, *place.tolist(), *velocity.tolist(), turning, joint, force, commands))
        self._low, self._high = np.minimum(self._low, place), np.maximum(self._high, place)
        self.force = max(self.force, force)
        self._recent.append(velocity)
        if len(self._recent) > _MEAN:
            change = math.dist(velocity.tolist(), self._recent[0].tolist())
            self.acceleration = max(self.acceleration, change / (_MEAN * TICK))
        found = math.hypot(*velocity.tolist()), turning, joint
        self._fastest = {key: max(value, new) for (key, value), new in zip(self._fastest.items(), found, strict=True)}

    def facts(self) -> dict[str, Any]:
        """Extremes since the last mark, in SI."""
        return {
            **self._fastest,
            "largest_acceleration": self.acceleration,
            "low": self._low.tolist(),
            "high": self._high.tolist(),
        }

    def write(self, path: str) -> None:
        """The last minute as a table (n, columns) in a file of numpy."""
        np.save(path, np.array(self._rows))
