"""Limits of readings: a reading beyond one is reported and raises an alarm, but stops nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Batch


@dataclass(frozen=True)
class LimitBounds:
    """The lowest and the highest permitted reading of a channel [SI]."""

    name: str
    stream: str
    column: int  # of the channel within its stream
    unit: str
    low: float
    high: float

    def excess(self, readings: Any) -> Any:
        """Return how far readings, one or (n,), are outside the bounds; negative within, NaN for a missing reading."""
        return np.maximum(readings - self.high, self.low - readings)


@dataclass
class Limit:
    """A limit with the number of readings beyond it and the farthest of them."""

    bound: LimitBounds
    beyond: int = 0  # readings
    farthest: float = 0.0  # reading, in SI; counts only where `beyond` is not 0

    def check(self, batch: Batch) -> bool:
        """Count the readings of a batch that are beyond the limit; return True if there are any."""
        if batch.stream != self.bound.stream or not len(batch.time):
            return False
        readings = batch.values[:, self.bound.column]
        excess = self.bound.excess(readings)
        count = int(np.count_nonzero(excess > 0))  # NaN is not a reading, and counted as invalid elsewhere
        is_farther = count and (not self.beyond or np.nanmax(excess) > self.bound.excess(self.farthest))
        if is_farther:
            self.farthest = float(readings[np.nanargmax(excess)])
        self.beyond += count
        return count > 0

    def __str__(self) -> str:
        bound = self.bound
        exceeded = bound.high if self.farthest > bound.high else bound.low
        return (
            f"{self.beyond} readings of {bound.name} are beyond its limit of {exceeded:.4g} {bound.unit}, the farthest "
            f"at {self.farthest:.4g} {bound.unit}"
        )
