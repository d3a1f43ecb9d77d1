"""A hand that leads the simulator's arm."""

from __future__ import annotations

import numpy as np
from palpate import Floats

SPEED = 0.3  # [rad/s] of the joints, a choice
REST = 0.1  # [s] for which the arm has to stand where it began until the hand lets go, a choice


class Hand:
    """A hand that leads the joints (7,) [rad] of an arm to others and holds it there; where it began, it lets go."""

    def __init__(self, start: Floats) -> None:
        self._start = self._joints = start
        self._goal: Floats | None = None

    @property
    def leads(self) -> bool:
        """True from the beginning of a lead until the hand lets go."""
        return self._goal is not None

    def lead(self, joints: Floats, goal: Floats | None = None) -> None:
        """Begin to lead the arm from its joints to others, by default to those with which it began."""
        self._joints, self._goal = joints, self._start if goal is None else goal

    def joints_after(self, interval: float) -> Floats:
        """Return the joints to which the hand has led the arm after another interval [s]."""
        assert self._goal is not None  # it leads
        step = SPEED * interval
        self._joints = self._joints + np.clip(self._goal - self._joints, -step, step)
        return self._joints

    def let_go(self, stands: float) -> bool:
        """Let go of an arm that has stood for a time [s] where it began; return True if so."""
        if self._goal is not self._start or stands <= REST:
            return False
        self._goal = None
        return True
