"""Statistics of the numbers of a topic, block by block in memory that does not grow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_records.recording import FieldSurvey

# Choices.
_MIN_BINS = 64  # means over equal stretches of the record for a sparkline; of twice as many, pairs are joined
_WIDTH = 24  # characters of a sparkline
_MARKS = "▁▂▃▄▅▆▇█"
_SECOND_DIFFERENCE_VARIANCE = 6.0  # of white noise of variance 1: 1 + 4 + 1


class FieldStatistics:
    """Statistics of each field of a topic; values that are not finite are only counted."""

    def __init__(self, names: Sequence[str]) -> None:
        """Begin without values, for fields of these names; arrays have an entry for each field."""
        self.names = tuple(names)
        count = len(self.names)
        self._finite_counts = np.zeros(count, np.int64)
        self._odd_counts = np.zeros(count, np.int64)
        self._low = np.full(count, np.inf)
        self._high = np.full(count, -np.inf)
        # Sums of the values minus the first ones, which keep their digits; of second differences, by which noise is
        # separated from smooth movement.
        self._shift: Floats | None = None
        self._sum = np.zeros(count)
        self._square_sum = np.zeros(count)
        self._bend_square_sum = np.zeros(count)
        self._bend_counts = np.zeros(count, np.int64)
        self._bin_rows = 1
        self._bins: list[Floats] = []
        self._open_bin = np.zeros((2, count))  # sums and counts of the bin that is being filled
        self._open_rows = 0  # of that bin

    def add(self, values: Floats) -> None:
        """Add a block of values (n, k) of the fields to counts, extremes, sums, second differences and bins.

        Variances are computed by sums of squares of the values less the first one, `_shift`.
        """
        is_finite = np.isfinite(values)
        self._odd_counts += (~is_finite).sum(axis=0)
        self._finite_counts += is_finite.sum(axis=0)
        self._low = np.minimum(self._low, np.where(is_finite, values, np.inf).min(axis=0, initial=np.inf))
        self._high = np.maximum(self._high, np.where(is_finite, values, -np.inf).max(axis=0, initial=-np.inf))
        if self._shift is None and len(values):
            self._shift = np.where(is_finite[0], values[0], 0.0)
        if self._shift is None:
            return
        with np.errstate(over="ignore", invalid="ignore"):
            shifted = np.where(is_finite, values - self._shift, 0.0)
            self._sum += shifted.sum(axis=0)
            self._square_sum += (shifted**2).sum(axis=0)
            # Second differences of smooth movement are small, and those of noise are not.
            bend = np.diff(values, 2, axis=0)
            has_bend = np.isfinite(bend)
            self._bend_square_sum += np.where(has_bend, bend, 0.0).__pow__(2).sum(axis=0)
            self._bend_counts += has_bend.sum(axis=0)
            self._add_to_bins(shifted, is_finite)

    def _add_to_bins(self, shifted: Floats, is_finite: NDArray[np.bool_]) -> None:
        """Add rows (n, k) to the bins of the sparkline."""
        begin = 0
        while begin < len(shifted):
            end = min(begin + self._bin_rows - self._open_rows, len(shifted))
            self._open_bin += [shifted[begin:end].sum(axis=0), is_finite[begin:end].sum(axis=0)]
            self._open_rows += end - begin
            begin = end
            if self._open_rows == self._bin_rows:
                self._close_bin()

    def _close_bin(self) -> None:
        """Add the mean of the full bin; of too many bins join pairs."""
        sums, counts = self._open_bin
        self._bins.append(sums / np.maximum(counts, 1))
        self._open_bin = np.zeros_like(self._open_bin)
        self._open_rows = 0
        if len(self._bins) == 2 * _MIN_BINS:
            self._bins = [(mean + other) / 2 for mean, other in zip(self._bins[::2], self._bins[1::2], strict=True)]
            self._bin_rows *= 2

    def surveys(self) -> tuple[FieldSurvey, ...]:
        """Return the statistics of each field that has a finite value."""
        counts = np.maximum(self._finite_counts, 1)
        with np.errstate(over="ignore", invalid="ignore"):
            variance = np.maximum(self._square_sum / counts - (self._sum / counts) ** 2, 0.0)
            # White noise of standard deviation s has second differences of sqrt(6) s.
            bend_variance = self._bend_square_sum / np.maximum(self._bend_counts, 1)
            noise = np.sqrt(bend_variance / _SECOND_DIFFERENCE_VARIANCE)
        # Means over equal stretches of the record (bins, k), which a sparkline draws.
        course = np.array(self._bins) if self._bins else np.zeros((0, len(self.names)))
        return tuple(
            FieldSurvey(
                name,
                low=float(self._low[k]),
                high=float(self._high[k]),
                std=float(np.sqrt(variance[k])),
                noise=float(noise[k]),
                odd=int(self._odd_counts[k]),
                course=sparkline(course[:, k]),
            )
            for k, name in enumerate(self.names)
            if self._finite_counts[k]
        )


def sparkline(values: Floats, width: int = _WIDTH) -> str:
    """Return the course of a signal in a few characters; a flat line if it does not move.

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
    levels = np.rint((means - means.min()) / span * (len(_MARKS) - 1)).astype(int)
    return "".join(_MARKS[level] for level in levels)
