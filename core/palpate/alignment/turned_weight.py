"""The weight of a tool that turns: what it did over a record, and whether the readings in free air follow it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.alignment.tool_frame import Load
from palpate.vectors import Floats

_PER_NEWTON = 1e4  # whole tenths of a millinewton: their sums do not depend on how a record is cut into blocks
_LARGEST = 1e7  # of such parts; what is beyond is no reading
_FEWEST = 100  # samples


@dataclass(frozen=True)
class TurnedWeight:
    """The weight in the axes of the sensor, in free air and in contact."""

    turn: float  # [N] distance of the mean weights in contact and in the air before it; 0 where there is one of them
    along: float  # [N] how much more of it is along the normal in contact than in the air; all of it without the air
    spread: float  # [N] rms of the weight about its mean in free air
    apart: float | None  # how far the readings in free air are from following it, in parts of `spread`; None: no turn
    apart_std: float  # by noise


class WeightWatch:
    """Sums over all samples; what is in contact is known later than the readings."""

    def __init__(self) -> None:
        self._waiting = np.zeros((0, 7), np.int64)  # reading, weight, weight along
        self._sums = {kind: _Sums() for kind in (False, True)}  # in the air before contact; in contact
        self._touched = False

    def add(self, load: Load) -> None:
        """Take in forces of samples that are to be released."""
        columns = np.column_stack([*load.reading, *load.weight, load.weight_along]) * _PER_NEWTON
        columns = np.where(np.isfinite(columns), columns, 2.0 * _LARGEST)
        self._waiting = np.concatenate(
            [self._waiting, np.rint(np.clip(columns, -2 * _LARGEST, 2 * _LARGEST)).astype(np.int64)]
        )

    def release(self, contact: NDArray[np.bool_]) -> None:
        """The first of the samples that wait, with whether they are in contact."""
        rows, self._waiting = self._waiting[: len(contact)], self._waiting[len(contact) :]
        usable = (np.abs(rows) < _LARGEST).all(axis=1)
        if contact.any():
            first = len(contact) if self._touched else int(np.argmax(contact))
            self._sums[True].add(rows[contact & usable])
            before = np.arange(len(contact)) < (0 if self._touched else first)
            self._touched = True
        else:
            before = np.full(len(contact), not self._touched)
        self._sums[False].add(rows[before & usable])

    @property
    def turned(self) -> TurnedWeight | None:
        """Of what was released; None where that is nothing."""
        air, touch = self._sums[False], self._sums[True]
        if not air.count and not touch.count:
            return None
        turn = 0.0
        along = float((touch if touch.count else air).mean[6])
        if air.count and touch.count:
            turn = float(np.linalg.norm(touch.mean[3:6] - air.mean[3:6]))
            along -= float(air.mean[6])
        spread, apart, std = air.disagreement() if air.count >= _FEWEST else (0.0, None, 0.0)
        return TurnedWeight(turn, along, spread, apart, std)


class _Sums:
    """Sums and products of whole numbers (n, 7)."""

    def __init__(self) -> None:
        self.count = 0
        self._sum = [0] * 7
        self._products = [[0] * 6 for _ in range(6)]

    def add(self, rows: NDArray[np.int64]) -> None:
        self.count += len(rows)
        for i in range(7):
            self._sum[i] += int(rows[:, i].sum())
        for i in range(6):
            for j in range(i, 6):
                self._products[i][j] += int((rows[:, i] * rows[:, j]).sum())

    @property
    def mean(self) -> Floats:
        """(7,) [N]."""
        return np.array(self._sum, float) / self.count / _PER_NEWTON

    def disagreement(self) -> tuple[float, float | None, float]:
        """Spread of the weight w [N]; |cov(f - w, w)| / |cov(w, w)| of readings f, and its uncertainty by noise."""
        n, products = self.count, self._products
        moments = np.array(
            [
                [(n * products[min(i, j)][max(i, j)] - self._sum[i] * self._sum[j]) / n / n for j in range(6)]
                for i in range(6)
            ]
        )
        moments /= _PER_NEWTON**2
        own, mixed, read = moments[3:, 3:], moments[:3, 3:], moments[:3, :3]
        spread, size = math.sqrt(max(float(np.trace(own)), 0.0)), float(np.linalg.norm(own))
        left = max(float(np.trace(read) - 2.0 * np.trace(mixed) + np.trace(own)) / 3.0, 0.0)
        if size <= 0.0:
            return spread, None, 0.0
        return spread, float(np.linalg.norm(mixed - own)) / size, math.sqrt(3.0 * left / n) * spread / size
