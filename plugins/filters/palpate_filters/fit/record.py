"""The samples of a fit, as a residual wants them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

COLUMNS = 9
_GOLDEN = 0.6180339887498949  # its multiples fill the interval from 0 to 1 evenly
_TRANSITION = 1e-3  # of the travel


@dataclass(frozen=True)
class Record:
    """The samples of a fit: columns height [m], rate [m/s], acceleration [m/s^2], force [N], time from the middle [s],
    weight, interval [s], and height and rate of the sample before."""

    columns: Floats  # (n, 9)
    transition: float  # [m] over which contact sets in; far below anything that is measured

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def height(self) -> Floats:
        """(n,) [m]."""
        return self.columns[:, 0]

    @property
    def force(self) -> Floats:
        """(n,) [N]."""
        return self.columns[:, 3]

    @property
    def weight(self) -> Floats:
        """(n,) square root of the weight in the sum of squares; 0 for samples that are only there for their history."""
        return self.columns[:, 5]

    @cached_property
    def used(self) -> NDArray[np.bool_]:
        """(n,) samples that count."""
        return self.weight > 0

    def with_force(self, force: Floats) -> Record:
        """The same motion with another force (n,) [N]."""
        columns = self.columns.copy()
        columns[:, 3] = force
        return Record(columns, self.transition)

    def thinned(self, most: int) -> Record:
        """About `most` samples, one from each stretch of equal length, at places that no period of a motion shares."""
        step = len(self) / most
        if step <= 1:
            return self
        order = np.arange(most)
        return Record(self.columns[((order + order * _GOLDEN % 1.0) * step).astype(int)], self.transition)


def make_record(
    height: Floats, rate: Floats, acceleration: Floats, force: Floats, time: Floats, weight: Floats
) -> Record:
    """A record from its columns, each (n,)."""
    n = len(height)
    columns = np.empty((n, COLUMNS))
    columns[:, 0], columns[:, 1], columns[:, 2], columns[:, 3] = height, rate, acceleration, force
    columns[:, 4] = time - 0.5 * (time[0] + time[-1]) if n else time
    columns[:, 5] = weight
    columns[:1, 6:9] = 0.0
    columns[0, 7], columns[0, 8] = height[0], rate[0]
    columns[1:, 6], columns[1:, 7], columns[1:, 8] = np.diff(time), height[:-1], rate[:-1]
    return Record(columns, _TRANSITION * max(float(np.ptp(height)), 1e-12))
