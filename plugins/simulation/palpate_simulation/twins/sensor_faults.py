"""What the electronics of a sensor make of the wrench that it feels, when they fail."""

from __future__ import annotations

import math

import numpy as np
from palpate import Floats


class Electronics:
    """Passes readings on; may be stuck, or clip the forces."""

    def __init__(self) -> None:
        self._latest = np.zeros(6)
        self.restore()

    def restore(self) -> None:
        """Without a fault."""
        self._stuck, self._level = False, math.inf

    def stick(self) -> None:
        """Repeat the latest reading from now on."""
        self._stuck = True

    def clip(self, level: float) -> None:
        """Let no force be larger than a level [N]."""
        self._level = level

    def read(self, wrench: Floats) -> Floats:
        """The readings (n, 6) of a wrench (n, 6)."""
        if self._stuck:
            return np.tile(self._latest, (len(wrench), 1))
        readings = wrench.copy()
        readings[:, :3] = readings[:, :3].clip(-self._level, self._level)
        self._latest = readings[-1]
        return readings
