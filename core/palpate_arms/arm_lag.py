"""The distance of an arm behind its commands: by its lag, which its states show, and by what it gives way."""

from __future__ import annotations

import numpy as np
from palpate import Floats

from palpate_arms.setpoint_buffer import PERIOD

# Choices.
DELAY = 0.045  # [s] of an arm beyond the lag of its servo: states, commands, and what its servo does not report (0215)
STATIC_ERROR = 0.2e-3  # [m] that an arm at rest may be off its command (0215)
_MIN_SPEED_VARIANCE = 0.5e-3**2  # [m^2/s^2] of the commanded speed, from which on a lag shows


def deflection(force: float, stiffness: float | None) -> float:
    """Return how far [m] an arm gives way to a force [N] by its controller's stiffness [N/m]; None: it does not.

    So far it stands behind its command at a force, of a specimen or of its own joints' dry friction, and so far on the
    other side where it turns round.
    """
    return 0.0 if stiffness is None else force / stiffness


class LagMeter:
    """Least squares of the distance to the command on the commanded speed, about their means.

    lag = (mean of v . d - mean v . mean d) / (mean of v . v - mean v . mean v), with v the commanded speed and d the
    distance. About their means, so that what an arm gives way to a constant force, or hangs below its command, is not a
    lag.
    """

    def __init__(self) -> None:
        self._count = 0
        # Sums over the commands.
        self._speed, self._distance = np.zeros(3), np.zeros(3)
        self._speed_squared = self._product = 0.0

    def add(self, command: Floats, previous: Floats, position: Floats) -> None:
        """Add a command and the previous one, and the measured place, each (3,) [m]."""
        speed, distance = (command - previous) / PERIOD, command - position
        self._count += 1
        self._speed, self._distance = self._speed + speed, self._distance + distance
        self._speed_squared += float(speed @ speed)
        self._product += float(speed @ distance)

    @property
    def lag(self) -> float | None:
        """The lag [s], delays of commands and states with it; None where the motion shows none."""
        if self._count == 0:
            return None
        mean_speed = self._speed / self._count
        variance = self._speed_squared / self._count - float(mean_speed @ mean_speed)
        if variance < _MIN_SPEED_VARIANCE:
            return None
        return (self._product / self._count - float(mean_speed @ self._distance) / self._count) / variance
