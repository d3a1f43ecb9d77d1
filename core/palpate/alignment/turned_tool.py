"""A tool that turns: what its weight did over a record, and whether the readings in free air follow it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.alignment.tool_frame import Load, Vector
from palpate.vectors import Floats

# Whole tenths of a millinewton and micrometres: sums of them do not depend on how a record is cut into blocks.
_PER_NEWTON, _PER_METRE = 1e4, 1e6
_LARGEST = 1e7  # of such parts; what is beyond is no reading
_FEWEST = 100  # samples
_READING, _WEIGHT, _ALONG, _PLACE, _HEIGHT = slice(0, 3), slice(3, 6), 6, slice(7, 10), 10


@dataclass(frozen=True)
class TurnedTool:
    """The weight in the axes of the sensor, in the air before contact and in contact, and the motion in contact."""

    turn: float  # [N] distance of the mean weights in contact and in air; 0 where there is one of them only
    along: float  # [N] how much more of it is along the normal in contact than in the air
    weight: float  # [N] along the normal in contact
    spread: float  # [N] rms of the weight about its mean in free air
    apart: float | None  # how far the readings in free air are from following it, in parts of `spread`; None: no turn
    apart_std: float  # by noise
    slope: float  # tangent of the angle between the normal and the motion in contact; 0 without a stated normal


class ToolWatch:
    """Sums over all samples; what is in contact is known later than the readings."""

    def __init__(self) -> None:
        self._waiting = np.zeros((0, 11), np.int64)
        self._air, self._contact = _Sums(), _Sums()

    def add(self, load: Load, place: Vector, height: Floats) -> None:
        """Take in samples that are to be released: forces [N], and where the tip is [m]."""
        forces = np.column_stack([*load.reading, *load.weight, load.weight_along]) * _PER_NEWTON
        columns = np.column_stack([forces, np.column_stack([*place, height]) * _PER_METRE])
        columns = np.where(np.isfinite(columns), columns, 2.0 * _LARGEST).clip(-2.0 * _LARGEST, 2.0 * _LARGEST)
        self._waiting = np.concatenate([self._waiting, np.rint(columns).astype(np.int64)])

    def release(self, contact: NDArray[np.bool_]) -> None:
        """The first of the samples that wait, with whether they are in contact."""
        rows, self._waiting = self._waiting[: len(contact)], self._waiting[len(contact) :]
        usable = (np.abs(rows) < _LARGEST).all(axis=1)
        if not self._contact.count:  # later air may be wet, or not yet free
            before = np.cumsum(contact) == 0
            self._air.add(rows[before & usable])
        self._contact.add(rows[contact & usable])

    @property
    def turned(self) -> TurnedTool | None:
        """Of what was released; None where that is nothing."""
        air, contact = self._air, self._contact
        if not air.count and not contact.count:
            return None
        now, before = (contact if contact.count else air).mean, (air if air.count else contact).mean
        spread, apart, std = air.disagreement() if air.count >= _FEWEST else (0.0, None, 0.0)
        turn, weight = float(np.linalg.norm(now[_WEIGHT] - before[_WEIGHT])), float(now[_ALONG])
        slope = contact.slope() if contact.count >= _FEWEST else 0.0
        return TurnedTool(turn, weight - float(before[_ALONG]), weight, spread, apart, std, slope)


class _Sums:
    """Sums and products of whole numbers (n, 11)."""

    def __init__(self) -> None:
        self.count = 0
        self._sum = [0] * 11
        self._products: dict[tuple[int, int], int] = {}

    def add(self, rows: NDArray[np.int64]) -> None:
        """Take in rows."""
        self.count += len(rows)
        for i in range(11):
            self._sum[i] += int(rows[:, i].sum())
        pairs = [(i, j) for i in range(6) for j in range(i, 6)] + [(i, i) for i in range(7, 11)]
        for i, j in pairs:
            self._products[i, j] = self._products.get((i, j), 0) + int((rows[:, i] * rows[:, j]).sum())

    def _moment(self, i: int, j: int) -> float:
        n, pair = self.count, (min(i, j), max(i, j))
        return (n * self._products[pair] - self._sum[i] * self._sum[j]) / (n * n)

    @property
    def mean(self) -> Floats:
        """(11,) of forces [N] and places [m]."""
        return np.array(self._sum, float) / self.count / np.repeat([_PER_NEWTON, _PER_METRE], [7, 4])

    def slope(self) -> float:
        """Tangent of the angle between the normal and the motion; 0 where there is no motion along it."""
        along = self._moment(_HEIGHT, _HEIGHT)
        whole = sum(self._moment(i, i) for i in range(*_PLACE.indices(11)))
        return math.sqrt(max(whole / along - 1.0, 0.0)) if along > 0 else 0.0

    def disagreement(self) -> tuple[float, float | None, float]:
        """Spread of the weight w [N]; |cov(f - w, w)| / |cov(w, w)| of readings f, and its uncertainty by noise."""
        moments = np.array([[self._moment(i, j) for j in range(6)] for i in range(6)]) / _PER_NEWTON**2
        read, mixed, own = moments[:3, :3], moments[:3, 3:], moments[3:, 3:]
        spread, size = math.sqrt(max(float(np.trace(own)), 0.0)), float(np.linalg.norm(own))
        if size <= 0.0:
            return spread, None, 0.0
        left = max(float(np.trace(read) - 2.0 * np.trace(mixed) + np.trace(own)) / 3.0, 0.0)
        noise = math.sqrt(3.0 * left / self.count) * spread / size
        return spread, float(np.linalg.norm(mixed - own)) / size, noise
