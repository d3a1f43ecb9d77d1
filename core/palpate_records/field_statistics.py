"""Statistics of the numbers of a topic, gathered a block at a time in memory that does not grow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_records.recording import FieldSurvey

_BINS = 64  # means over equal stretches of the record, of which a sparkline is drawn; they double when full
_MARKS = "▁▂▃▄▅▆▇█"
_WIDTH = 24  # characters of a sparkline


class FieldStatistics:
    """What has been seen of each field of a topic; every value counts, those that are not finite apart."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        k = len(self.names)
        self._count, self._odd = np.zeros(k, np.int64), np.zeros(k, np.int64)
        self._low, self._high = np.full(k, np.inf), np.full(k, -np.inf)
        self._shift: Floats | None = None
        self._sum, self._square = np.zeros(k), np.zeros(k)
        self._rough, self._steps = np.zeros(k), np.zeros(k, np.int64)
        self._stretch = 1  # rows of a bin
        self._bins: list[Floats] = []
        self._open, self._filled = np.zeros((2, k)), 0  # sums and counts of the bin that is being filled; its rows

    def add(self, values: Floats) -> None:
        """Take in a block (n, k)."""
        good = np.isfinite(values)
        self._odd += (~good).sum(axis=0)
        self._count += good.sum(axis=0)
        self._low = np.minimum(self._low, np.where(good, values, np.inf).min(axis=0, initial=np.inf))
        self._high = np.maximum(self._high, np.where(good, values, -np.inf).max(axis=0, initial=-np.inf))
        if self._shift is None and len(values):
            self._shift = np.where(good[0], values[0], 0.0)
        if self._shift is None:
            return
        with np.errstate(over="ignore", invalid="ignore"):
            near = np.where(good, values - self._shift, 0.0)
            self._sum += near.sum(axis=0)
            self._square += (near**2).sum(axis=0)
            bend = np.diff(values, 2, axis=0)
            smooth = np.isfinite(bend)
            self._rough += np.where(smooth, bend, 0.0).__pow__(2).sum(axis=0)
            self._steps += smooth.sum(axis=0)
            self._bin(near, good)

    def _bin(self, near: Floats, good: NDArray[np.bool_]) -> None:
        at = 0
        while at < len(near):
            end = min(at + self._stretch - self._filled, len(near))
            self._open += [near[at:end].sum(axis=0), good[at:end].sum(axis=0)]
            self._filled += end - at
            at = end
            if self._filled == self._stretch:
                self._close()

    def _close(self) -> None:
        self._bins.append(self._open[0] / np.maximum(self._open[1], 1))
        self._open, self._filled = np.zeros_like(self._open), 0
        if len(self._bins) == 2 * _BINS:
            self._bins = [(a + b) / 2 for a, b in zip(self._bins[::2], self._bins[1::2], strict=True)]
            self._stretch *= 2

    def surveys(self) -> tuple[FieldSurvey, ...]:
        """Return each field in numbers."""
        n = np.maximum(self._count, 1)
        with np.errstate(over="ignore", invalid="ignore"):
            variance = np.maximum(self._square / n - (self._sum / n) ** 2, 0.0)
            noise = np.sqrt(self._rough / np.maximum(self._steps, 1) / 6.0)
        course = np.array(self._bins) if self._bins else np.zeros((0, len(self.names)))
        return tuple(
            FieldSurvey(
                name,
                float(self._low[k]),
                float(self._high[k]),
                float(np.sqrt(variance[k])),
                float(noise[k]),
                int(self._odd[k]),
                sparkline(course[:, k]),
            )
            for k, name in enumerate(self.names)
            if self._count[k]
        )


def sparkline(values: Floats, width: int = _WIDTH) -> str:
    """Return the course of a signal in a few characters; flat where it does not move.

    >>> sparkline(np.array([0.0, 1.0, 2.0, 3.0]), 4)
    '▁▃▆█'
    """
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    means = np.array([part.mean() for part in np.array_split(values, min(width, len(values)))])
    span = means.max() - means.min()
    if not (0 < span < np.inf):
        return _MARKS[0] * len(means)
    places = np.rint((means - means.min()) / span * (len(_MARKS) - 1)).astype(int)
    return "".join(_MARKS[place] for place in places)
