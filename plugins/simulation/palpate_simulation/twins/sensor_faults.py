"""What the electronics of a sensor make of the wrench that it feels, when they fail."""

from __future__ import annotations

import math

import numpy as np
from palpate import Floats


class Electronics:
    """Passes readings on; may be stuck, clip the forces, or read a multiple of what it feels."""

    def __init__(self, seed: int = 0) -> None:
        self._latest, self._rng = np.zeros(6), np.random.default_rng(seed)
        self.restore()

    def restore(self) -> None:
        """Without a fault."""
        self._stuck, self._level, self._noise, self._scale = False, math.inf, 0.0, 1.0

    def stick(self) -> None:
        """Repeat the latest reading from now on."""
        self._stuck = True

    def clip(self, level: float, noise: float = 0.0) -> None:
        """Let no force be larger than a level [N], with noise of a standard deviation [N] on top."""
        self._level, self._noise = level, noise

    def rescale(self, scale: float) -> None:
        """Read so many times what is felt."""
        self._scale = scale

    def read(self, wrench: Floats) -> Floats:
        """The readings (n, 6) of a wrench (n, 6)."""
        if self._stuck:
            return np.tile(self._latest, (len(wrench), 1))
        readings = self._scale * wrench
        forces = readings[:, :3].clip(-self._level, self._level)
        if self._noise:
            forces += self._noise * self._rng.standard_normal(forces.shape)
        readings[:, :3] = forces
        self._latest = readings[-1]
        return readings
