"""Limits that are watched: nothing can be stopped, so a reading beyond one is reported, and an alarm is given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Batch


@dataclass(frozen=True)
class LimitBounds:
    """The least and the greatest reading of a channel [SI]."""

    name: str
    stream: str
    column: int
    unit: str
    low: float
    high: float


@dataclass
class Limit:
    """A bound, and what has gone beyond it."""

    bound: LimitBounds
    beyond: int = 0
    farthest: float = 0.0

    def check(self, batch: Batch) -> bool:
        """Look at a batch; whether a reading of it is beyond."""
        if batch.stream != self.bound.stream or not len(batch.time):
            return False
        values = batch.values[:, self.bound.column]
        excess = np.maximum(values - self.bound.high, self.bound.low - values)
        count = int(np.count_nonzero(excess > 0))  # NaN is not a reading, and counted as invalid elsewhere
        if count and (not self.beyond or float(np.nanmax(excess)) > self._excess(self.farthest)):
            self.farthest = float(values[np.nanargmax(excess)])
        self.beyond += count
        return count > 0

    def _excess(self, value: float) -> float:
        return max(value - self.bound.high, self.bound.low - value)

    def __str__(self) -> str:
        bound = self.bound
        end = bound.high if self.farthest > bound.high else bound.low
        return (
            f"{self.beyond} readings of {bound.name} are beyond its limit of {end:.4g} {bound.unit}, the farthest "
            f"at {self.farthest:.4g} {bound.unit}"
        )
