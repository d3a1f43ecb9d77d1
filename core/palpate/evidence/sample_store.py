"""Samples of a whole record that are kept for diagnoses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.hesitation import hesitations
from palpate.vectors import Floats, read_only_view

_GAP = 2.5  # usual intervals, a choice: a longer one is a gap, of at least two missing samples


@dataclass(frozen=True, eq=False)
class SampleStore:
    """The samples of a track in contact (n,), as blocks of 4096 consecutive ones spread evenly over the record."""

    index: NDArray[np.int64]  # (n,) count of the sample among all in contact; it jumps where blocks were dropped
    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N] as in `Samples`
    position: Floats  # (n,) [m]
    velocity: Floats  # (n,) [m/s]
    lateral: Floats  # (n, 2) [m]; NaN: not known
    used: NDArray[np.bool_]  # (n,) the track has an estimate there
    surface: Floats  # (n,) [m] by that estimate; NaN without one
    innovation: Floats  # (n,) over its own standard deviation; NaN where the estimator reports none

    @cached_property
    def runs(self) -> NDArray[np.int64]:
        """The numbers (n,) of the stretches without a gap."""
        step = np.diff(self.time, prepend=self.time[:1])
        usual = float(np.median(step[1:])) if len(step) > 1 else 0.0
        jumps = np.diff(self.index, prepend=self.index[:1] - 1) != 1
        return read_only_view(np.asarray(np.cumsum(jumps | (step > _GAP * usual)), dtype=np.int64))

    @cached_property
    def hesitating(self) -> NDArray[np.bool_]:
        """True (n,) within a hesitation of the arm, whose jerk no slope over samples shows rightly."""
        # A clock without the jumps at dropped blocks, which are not hesitations.
        step = np.diff(self.time)
        usual = float(np.median(step)) if len(step) else 0.0
        clock = np.cumsum(np.concatenate([[0.0], np.where(np.diff(self.index) == 1, step, usual)]))[: len(self.time)]
        return read_only_view(hesitations(clock).hold(clock))
