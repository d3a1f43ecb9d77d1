"""The samples of a fit, as a residual wants them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

COLUMNS = 9
_GOLDEN = 0.6180339887498949  # its multiples fill the interval from 0 to 1 evenly
_TRANSITION = 1e-3  # of the way that the tip goes in contact


@dataclass(frozen=True)
class FitRecord:
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

    def with_force(self, force: Floats) -> FitRecord:
        """The same motion with another force (n,) [N]."""
        columns = self.columns.copy()
        columns[:, 3] = force
        return FitRecord(columns, self.transition)

    def thinned(self, most: int) -> FitRecord:
        """About `most` samples, one from each stretch of equal length, at places that no period of a motion shares."""
        step = len(self) / most
        if step <= 1:
            return self
        order = np.arange(most)
        return FitRecord(self.columns[((order + order * _GOLDEN % 1.0) * step).astype(int)], self.transition)


def make_record(
    height: Floats,
    rate: Floats,
    acceleration: Floats,
    force: Floats,
    time: Floats,
    weight: Floats,
    travel: float | None = None,
) -> FitRecord:
    """A record from its columns, each (n,).

    Contact sets in over a thousandth of the `travel` [m] in contact, or over the noise of the height where that is
    more, and never over more than a thousandth of all heights.
    """
    n = len(height)
    columns = np.empty((n, COLUMNS))
    columns[:, 0], columns[:, 1], columns[:, 2], columns[:, 3] = height, rate, acceleration, force
    columns[:, 4] = time - 0.5 * (time[0] + time[-1]) if n else time
    columns[:, 5] = weight
    columns[:1, 6:9] = 0.0
    columns[0, 7], columns[0, 8] = height[0], rate[0]
    columns[1:, 6], columns[1:, 7], columns[1:, 8] = np.diff(time), height[:-1], rate[:-1]
    whole = _TRANSITION * max(float(np.ptp(height)), 1e-12)
    third = np.diff(height, 3)
    noise = float(np.sqrt(np.mean(third**2) / 20.0)) if len(third) else 0.0
    return FitRecord(columns, whole if travel is None else min(whole, max(_TRANSITION * travel, noise)))
