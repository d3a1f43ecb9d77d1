"""Checks by reported poses that an arm follows its commands."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from palpate import Floats

from palpate_arms.echoed_pose import EXACT
from palpate_arms.setpoint_buffer import PERIOD

# Choices. A pose that does not change in any digit:
_MAX_SAME = 10  # states
_STILL_WAY = 0.1e-3  # [m] that commands go on meanwhile
# A pose that is a command:
_RECENT_COMMANDS = 5  # that it may be
_MIN_STEP = 1e-6  # [m] of a command: at rest every pose is its command
_MAX_COPIES = 25  # states in a row
# An arm that does not move (0406):
_STUCK_PERIODS = 40
_STUCK_WAY = 0.8e-3  # [m] that is commanded meanwhile
_STUCK_SHARE = 0.1  # of the way, which an arm goes at least
_LAGS = 2.0  # of the arm, that are granted on top of the periods
_MS = _MM = 1e3  # per second, per metre


class TrackingError:
    """Commands and measured places of a motion, side by side; a soft servo is allowed twice its own lag [s].

    An arm with a deadband [m] stands still, also to the last bit, until its command is so far away.
    """

    def __init__(self, lag: float, deadband: float = 0.0) -> None:
        self._still_way = _STILL_WAY + deadband
        self._window = _STUCK_PERIODS + round(_LAGS * lag / PERIOD)
        self._past: deque[tuple[int, Floats, Floats]] = deque()
        self._cycles = 0  # of the motion
        self._same, self._anchor, self._last = 0, np.zeros(3), [0.0, 0.0, 0.0]
        self._recent: deque[list[float]] = deque(maxlen=_RECENT_COMMANDS)
        self._copies = 0  # states in a row that are one of these

    def begin(self, command: Floats) -> None:
        """Begin a motion, from rest."""
        self._past.clear()
        self._cycles = 0
        self._same, self._anchor = 0, command.copy()
        self._recent.clear()
        self._copies = 0

    def complaint(self, command: Floats, position: Floats, fresh: bool, give: float = 0.0) -> str | None:
        """Return why a pose is not credible: it stands, to the last bit or nearly, or it is the command; else None.

        `fresh`: it is a new one; `give` [m]: dry friction holds an arm whose controller gives way until its command is
        so far away.
        """
        self._cycles += 1
        is_step = not self._recent or math.dist(command.tolist(), self._recent[-1]) > _MIN_STEP
        self._recent.append(command.tolist())
        if not fresh:
            return None
        # The same in every digit, while commands go on.
        if position.tolist() == self._last:
            self._same += 1
        else:
            self._same, self._anchor = 0, command.copy()
        self._last = position.tolist()
        way = length(command - self._anchor)
        if self._same >= _MAX_SAME and way > self._still_way:
            return f"the measured pose does not change in any digit while the arm was commanded to move by {mm(way)}"
        # A command itself.
        if is_step:
            is_copy = any(math.dist(place, self._last) < EXACT for place in self._recent)
            self._copies = self._copies + 1 if is_copy else 0
        if self._copies >= _MAX_COPIES:
            return "the pose that the arm reports is its command, in every digit: what was measured is needed"
        return self._lags(command, position, give)

    def _lags(self, command: Floats, position: Floats, give: float) -> str | None:
        """Return why an arm counts as held: it has gone hardly any of the way that the last commands led it.

        None of an arm that follows. The window is one of commands, however many states arrived meanwhile; `give` [m] of
        the way is not expected of an arm that gives way.
        """
        # Commands and places over the window, the oldest just beyond it.
        past = self._past
        past.append((self._cycles, command.copy(), position))
        while len(past) > 1 and self._cycles - past[1][0] >= self._window:
            past.popleft()
        began, first_command, first_place = past[0]
        commanded = length(command - first_command)
        expected = commanded - give
        if self._cycles - began < self._window or expected <= _STUCK_WAY:
            return None
        way = length(position - first_place)
        if way < _STUCK_SHARE * expected:
            # A swing that has turned round meanwhile is back where it was, and has moved all the same.
            way = max(length(place - first_place) for _, _, place in past)
        if way < _STUCK_SHARE * expected:
            within = f"within {_MS * self._window * PERIOD:.0f} ms (is it held, or do its poses come late?)"
            return f"the arm was commanded to move by {mm(commanded)} and has moved by {mm(way)} {within}"
        return None


def length(vector: Floats) -> float:
    """Return the length of a vector (3,), by plain floats: numpy takes longer."""
    return math.hypot(*vector.tolist())


def mm(way: float) -> str:
    """Return a way [m] as people read it."""
    return f"{_MM * way:.4g} mm"
