"""Hesitations of an arm whose servo loop was held up, by the states that nobody read meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.vectors import Floats

_GAP = 1.75  # usual intervals, a choice: one missing state makes an interval of two
_SERVO_PERIOD = 0.002  # [s] of the commands: between two of them no missing state is a hold-up
_BEFORE = 0.005  # [s], a choice: the arm slows down as soon as commands are missing
_SETTLING = 0.04  # [s], a choice: after commands arrive again; the paper's law has a time constant of 50 ms
_CATCH_UP = 10.0  # hold-ups: an arm catches up at a tenth more than the planned speed
_MAX_CATCH_UP = 0.5  # [s], a choice: longest time of catching up


@dataclass(frozen=True)
class Hesitations:
    """Stretches of a motion that differ from the plan: from just before each hold-up until it has been made up for.

    The motion is real there and measured, so that a method that uses the measured motion may use it. A method that
    assumes a known form (a sine) may not.
    """

    begin: Floats  # (k,) [s]
    end: Floats  # (k,) [s], in rising order

    def hold(self, time: Floats) -> NDArray[np.bool_]:
        """Return True (n,) at the times [s] within a hesitation."""
        if not len(self.begin):
            return np.zeros(len(time), bool)
        latest = np.searchsorted(self.begin, time, side="right") - 1
        return np.asarray((latest >= 0) & (time < self.end[np.maximum(latest, 0)]))

    def count(self, begin: float, end: float) -> int:
        """Return the number of hesitations that begin in [begin, end) [s]."""
        return int(np.diff(np.searchsorted(self.begin, [begin, end]))[0])


def hesitations(time: Floats) -> Hesitations:
    """Return the hesitations of an arm by the time-stamps (n,) [s] of its states."""
    step = np.diff(time)
    usual = max(float(np.median(step)), _SERVO_PERIOD) if len(step) else 0.0
    gaps = np.flatnonzero(step > _GAP * usual)
    catch_up = np.minimum(_CATCH_UP * (step[gaps] - usual), _MAX_CATCH_UP)
    end = time[gaps + 1] + _SETTLING + catch_up
    return Hesitations(np.asarray(time[gaps] - _BEFORE), np.maximum.accumulate(end))
