"""Where an arm stood still since its servo loop was held up, by the states that nobody read meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.vectors import Floats

_GAP = 1.75  # usual intervals; one state that is missing makes two
_BEFORE = 0.005  # [s]; the arm slows down as soon as the commands stay away
_SETTLING = 0.04  # [s] after they come again: the paper's law has a time constant of 50 ms
_MADE_UP = 10.0  # times the hold-up: an arm makes up for it at a tenth more than the planned speed
_MOST_MADE_UP = 0.5  # [s]


@dataclass(frozen=True)
class Hesitations:
    """Stretches of a motion that are not as planned: from just before each hold-up until it has been made up for.

    The motion is real there and measured, so that whatever uses the measured motion may use it. What takes the motion
    for one of known form (a sine) may not.
    """

    begin: Floats  # (k,) [s]
    end: Floats  # (k,) [s], in rising order

    def hold(self, time: Floats) -> NDArray[np.bool_]:
        """(n,) True at the times [s] within one of them."""
        if not len(self.begin):
            return np.zeros(len(time), bool)
        latest = np.searchsorted(self.begin, time, side="right") - 1
        return np.asarray((latest >= 0) & (time < self.end[np.maximum(latest, 0)]))

    def count(self, begin: float, end: float) -> int:
        """How many begin in [begin, end) [s]."""
        return int(np.diff(np.searchsorted(self.begin, [begin, end]))[0])


def hesitations(time: Floats) -> Hesitations:
    """Hesitations of the arm whose states have these time-stamps (n,) [s]."""
    step = np.diff(time)
    usual = float(np.median(step)) if len(step) else 0.0
    gaps = np.flatnonzero(step > _GAP * usual)
    made_up = np.minimum(_MADE_UP * (step[gaps] - usual), _MOST_MADE_UP)
    end = time[gaps + 1] + _SETTLING + made_up
    return Hesitations(np.asarray(time[gaps] - _BEFORE), np.maximum.accumulate(end))
