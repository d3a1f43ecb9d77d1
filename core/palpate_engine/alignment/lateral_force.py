"""The force across the tool: what share of the force along it a record has sideways."""

from __future__ import annotations

import math

import numpy as np
from palpate.alignment_report import SidewaysShare
from palpate.device import Batch
from palpate.vectors import Floats

_PER_NEWTON = 1e3  # whole millinewtons: their sums do not depend on how a record is cut into batches
_MAX_READING = (
    1e6  # [mN]; 1 kN, which no sensor of a palpation reads: a choice, which keeps the products within 64 bits
)
_MIN_READINGS = 100  # before a share is stated: a choice


class LateralForce:
    """Regresses the two forces across the tool on the one along it, over all readings of a record."""

    def __init__(self, columns: tuple[int, int, int]) -> None:
        self._columns = list(columns)  # along, and both across
        self._count = 0
        self._sums = [0] * 3
        self._products = [[0] * 3 for _ in range(3)]

    def feed(self, batch: Batch) -> None:
        """Take in readings of the force's stream."""
        self.add(batch.values[:, self._columns])

    def add(self, forces: Floats) -> None:
        """Take in forces (n, 3) [N]: the one along, and both across."""
        columns = np.multiply(forces.T, _PER_NEWTON, order="C")  # sums are over whole columns
        along, first, second = np.abs(columns) < _MAX_READING
        if not (usable := along & first & second).all():
            columns = columns[:, usable]
        whole = np.rint(columns).astype(np.int64)
        self._count += whole.shape[1]
        for i in range(3):
            self._sums[i] += int(whole[i].sum())
            for j in range(i, 3):
                self._products[i][j] += int((whole[i] * whole[j]).sum())

    @property
    def share(self) -> SidewaysShare | None:
        """Share of the force that is sideways; None where there are hardly readings, or the force does not change."""
        n = self._count
        if n < _MIN_READINGS:
            return None
        spread = np.array(
            [[(n * self._products[min(i, j)][max(i, j)] - self._sums[i] * self._sums[j]) / n for j in range(3)]
             for i in range(3)]
        )  # fmt: skip
        if spread[0, 0] <= 0:
            return None
        # Slopes of both lateral forces over the one along: covariance over variance.
        x, y = (float(spread[0, i] / spread[0, 0]) for i in (1, 2))
        # Standard uncertainty of the slopes: residual variance over n times the variance along, of two axes together.
        unexplained = spread[1, 1] + spread[2, 2] - (x * x + y * y) * spread[0, 0]
        return SidewaysShare(x, y, float(math.sqrt(max(unexplained, 0.0) / (2 * n) / spread[0, 0])))
