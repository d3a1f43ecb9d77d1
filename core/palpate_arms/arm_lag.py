"""How far an arm is behind its commands: by its lag, which its own states show, and by what it gives way."""

from __future__ import annotations

import numpy as np
from palpate import Floats

from palpate_arms.setpoint_buffer import PERIOD

DELAY = 0.045  # [s] of an arm beyond the lag of its servo: states, commands, and what its servo does not report
STATIC_ERROR = 0.2e-3  # [m] that an arm at rest may be off its command
_ENOUGH = 0.5e-3**2  # [m^2/s^2] variance of the commanded speed, from which a lag shows


def deflection(force: float, stiffness: float | None) -> float:
    """How far [m] an arm gives way to a force [N] by its controller's stiffness [N/m]; None of one that does not.

    So far it stands behind its command at a force, of a specimen or of its own joints' dry friction, and so far on the
    other side where it turns round.
    """
    return 0.0 if stiffness is None else force / stiffness


class LagMeter:
    """Least squares of the distance to the command on the commanded speed, about their means.

    About their means, so that what an arm gives way to a constant force, or hangs below its command, is not a lag.
    """

    def __init__(self) -> None:
        self._count = 0
        self._speed, self._away = np.zeros(3), np.zeros(3)
        self._speed_squared = self._product = 0.0

    def add(self, command: Floats, before: Floats, position: Floats) -> None:
        """A command and the one before it, and the measured place (3,) [m]."""
        speed, away = (command - before) / PERIOD, command - position
        self._count += 1
        self._speed, self._away = self._speed + speed, self._away + away
        self._speed_squared += float(speed @ speed)
        self._product += float(speed @ away)

    @property
    def lag(self) -> float | None:
        """The lag [s], delays of commands and states with it; None where the motion shows none."""
        if self._count == 0:
            return None
        mean = self._speed / self._count
        variance = self._speed_squared / self._count - float(mean @ mean)
        if variance < _ENOUGH:
            return None
        return (self._product / self._count - float(mean @ self._away) / self._count) / variance
