"""The force across the tool, in parts of the force along it."""

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
        """The slopes of both lateral forces over the one along, by least squares.

        None of fewer than 100 readings, or where the force along does not change.
        """
        n = self._count
        if n < _MIN_READINGS:
            return None
        # Scatter (3, 3) [mN^2]: n times the covariance of the forces along and across.
        scatter = np.empty((3, 3))
        for i in range(3):
            for j in range(i, 3):
                scatter[i, j] = scatter[j, i] = (n * self._products[i][j] - self._sums[i] * self._sums[j]) / n
        along = scatter[0, 0]
        if along <= 0:
            return None
        x, y = (float(scatter[0, i] / along) for i in (1, 2))
        # Standard uncertainty of a slope: the residual variance of both axes, over n times the variance along.
        residual_scatter = scatter[1, 1] + scatter[2, 2] - (x * x + y * y) * along
        return SidewaysShare(x, y, float(math.sqrt(max(residual_scatter, 0.0) / (2 * n) / along)))
