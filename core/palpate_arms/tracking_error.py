"""Whether an arm follows its commands, by the poses that it reports."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from palpate import Floats

from palpate_arms.setpoint_buffer import PERIOD

_STILL = 10  # states that are the same to the last bit
_STILL_WAY = 0.1e-3  # [m] that commands go on meanwhile
_RECENT, _EXACT, _MOVES, _COPIES = 5, 1e-9, 1e-6, 25  # commands, [m] from one, [m] of a step, states in a row
_STUCK, _STUCK_WAY, _STUCK_PART = 40, 0.8e-3, 0.1  # periods, [m], part of the commanded way


class TrackingError:
    """Commands and measured places of a motion, side by side; a soft servo is allowed twice its own lag [s].

    An arm with a deadband [m] stands still, also to the last bit, until its command is so far away.
    """

    def __init__(self, lag: float, deadband: float = 0.0) -> None:
        self._still_way = _STILL_WAY + deadband
        self._window = _STUCK + round(2.0 * lag / PERIOD)
        self._past: deque[tuple[int, Floats, Floats]] = deque()
        self._cycles = 0  # of the motion
        self._same, self._anchor, self._last = 0, np.zeros(3), [0.0, 0.0, 0.0]
        self._recent: deque[list[float]] = deque(maxlen=_RECENT)
        self._copies = 0  # states in a row that are one of these

    def begin(self, command: Floats) -> None:
        """A motion begins, from rest."""
        self._past.clear()
        self._cycles = 0
        self._same, self._anchor = 0, command.copy()
        self._recent.clear()
        self._copies = 0

    def complaint(self, command: Floats, position: Floats, fresh: bool, give: float = 0.0) -> str | None:
        """A pose that stands still while commands continue, to the last bit or nearly, or that is the command itself.

        `fresh`: it is a new one; `give` [m]: dry friction holds an arm whose controller gives way until its command is
        so far away.
        """
        self._cycles += 1
        steps = not self._recent or math.dist(command.tolist(), self._recent[-1]) > _MOVES
        self._recent.append(command.tolist())
        if not fresh:
            return None
        if position.tolist() == self._last:
            self._same += 1
        else:
            self._same, self._anchor = 0, command.copy()
        self._last = position.tolist()
        gone = length(command - self._anchor)
        if self._same >= _STILL and gone > self._still_way:
            return f"the measured pose does not change in any digit while the arm was commanded to move by {mm(gone)}"
        if steps:
            exact = any(math.dist(place, self._last) < _EXACT for place in self._recent)
            self._copies = self._copies + 1 if exact else 0
        if self._copies >= _COPIES:
            return "the pose that the arm reports is its command, in every digit: what was measured is needed"
        return self._lags(command, position, give)

    def _lags(self, command: Floats, position: Floats, give: float) -> str | None:
        """Return an arm that has gone hardly any of its way within a time of commands, however many states came
        meanwhile."""
        past = self._past
        past.append((self._cycles, command.copy(), position))
        while len(past) > 1 and self._cycles - past[1][0] >= self._window:
            past.popleft()
        began, first_command, first_place = past[0]
        commanded = length(command - first_command)
        expected = commanded - give
        if self._cycles - began < self._window or expected <= _STUCK_WAY:
            return None
        done = length(position - first_place)
        if done < _STUCK_PART * expected:
            # A swing that has turned round meanwhile is back where it was, and has moved all the same.
            done = max(length(place - first_place) for _, _, place in past)
        if done < _STUCK_PART * expected:
            within = f"within {1e3 * self._window * PERIOD:.0f} ms (is it held, or do its poses come late?)"
            return f"the arm was commanded to move by {mm(commanded)} and has moved by {mm(done)} {within}"
        return None


def length(vector: Floats) -> float:
    """Of a vector (3,), by plain floats: numpy takes longer."""
    return math.hypot(*vector.tolist())


def mm(way: float) -> str:
    """Return a way [m] as people read it."""
    return f"{1e3 * way:.4g} mm"
