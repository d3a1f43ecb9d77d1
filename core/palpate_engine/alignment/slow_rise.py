"""A force that rises slowly: averages over a tenth of a second against the second before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate.vectors import Floats

# Lengths in blocks of 10 ms; choices of decision 0104.
_BLOCK = 0.01  # [s]
_AVERAGE = 10  # blocks of an average
_BASELINE = 100  # blocks of the baseline
_GAP = 50  # blocks between baseline and average
_MIN_BASELINE = 50  # blocks, below which a baseline is too short
_MIN_DURATION = 10  # blocks in a row that are above it, after which a rise counts
_SPAN = _BASELINE + _GAP + _AVERAGE  # blocks from the begin of a baseline to the end of its average
_MAX_ROWS = 4096  # averages in one go, a choice: the memory is limited
_WHITE_SURPLUS = 1.5  # of the variance of white noise: a second determines a variance no better
_SIGMAS = 5.0  # scatter of the averages, above which a rise counts; a choice


class RiseFinder:
    """Finds the sample at which a force has been above its own baseline for long enough.

    The means of 10 ms are averaged over 100 ms. These averages scatter as the channel does, whatever its filter, so
    their own scatter over the baseline, a second that ends half a second before, says what counts as a rise. A drift is
    part of the baseline. All sums are over whole windows of the record, so nothing depends on how it is cut.
    """

    def __init__(self, interval: float, min_rise: float) -> None:
        self._block_size = max(round(_BLOCK / interval), 1) if interval > 0 else 1  # samples
        self._min_rise = min_rise  # [N]
        self._incomplete = np.zeros(0)  # [N] readings of the block that is not complete
        self._means = np.zeros(0)  # [N] of the latest blocks
        self._first = 0  # number of the first of these blocks
        self._duration = 0  # blocks in a row that are above their baseline

    def feed(self, force: Floats) -> list[int]:
        """Return the indices, from the first sample ever fed, at which a rise has lasted long enough."""
        # Means of the blocks that are complete now.
        readings = np.concatenate([self._incomplete, force])
        count = len(readings) // self._block_size
        blocks = readings[: count * self._block_size].reshape(count, self._block_size)
        self._incomplete = readings[count * self._block_size :]
        begin = self._first + len(self._means)
        self._means = np.concatenate([self._means, blocks.mean(axis=1)])

        # Averages that end with these blocks, against their baselines.
        rises: list[int] = []
        for row in range(begin, begin + count, _MAX_ROWS):
            rows = np.arange(row, min(row + _MAX_ROWS, begin + count))
            for block, is_above in zip(rows.tolist(), self._is_above(rows - self._first).tolist(), strict=True):
                self._duration = self._duration + 1 if is_above else 0
                if self._duration >= _MIN_DURATION:
                    rises.append((block + 1) * self._block_size - 1)
                    self._duration = 0

        # Blocks that no later average or baseline needs.
        surplus = max(len(self._means) - _SPAN, 0)
        self._means = self._means[surplus:]
        self._first += surplus
        return rises

    def _is_above(self, last: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return True if the average that ends with each of these blocks (n,) is above its baseline."""
        padded = np.concatenate([np.full(_SPAN, np.nan), self._means])
        begins = last[:, None] + 1  # of each baseline, in what is padded
        average = np.ascontiguousarray(padded[begins + np.arange(_SPAN - _AVERAGE, _SPAN)]).mean(axis=1)
        baseline = np.ascontiguousarray(padded[begins + np.arange(_BASELINE)])
        mean, _ = _moments(baseline)
        is_long = np.isfinite(baseline).sum(axis=1) >= _MIN_BASELINE
        is_above: NDArray[np.bool_] = np.asarray(is_long & (average - mean > self._min_rise))
        # The scatter of the few that remain takes longer.
        if is_above.any():
            is_above[is_above] = self._exceeds_scatter(baseline[is_above], average[is_above])
        return is_above

    def _exceeds_scatter(self, baseline: Floats, average: Floats) -> NDArray[np.bool_]:
        """Return True if averages (n,) are above baselines (n, m) by more than averages within these scatter."""
        mean, block_variance = _moments(baseline)
        _, scatter = _moments(baseline.reshape(len(average), -1, _AVERAGE).mean(axis=2))
        variance = np.maximum(scatter, _average_variance(baseline, block_variance))
        return np.asarray(average - mean > np.maximum(_SIGMAS * np.sqrt(variance), self._min_rise))


def _moments(rows: Floats) -> tuple[Floats, Floats]:
    """Return mean and variance (n,) of the finite values of each row (n, m)."""
    finite = np.isfinite(rows)
    count = finite.sum(axis=1)
    mean = np.where(finite, rows, 0.0).sum(axis=1) / np.maximum(count, 1)
    variance = np.where(finite, (rows - mean[:, None]) ** 2, 0.0).sum(axis=1) / np.maximum(count - 1, 1)
    return mean, variance


def _average_variance(rows: Floats, block_variance: Floats) -> Floats:
    """Return the variance (n,) of an average: what neighbours share of it does not average out, the rest does.

    The white part is half the mean square of the differences of neighbours (von Neumann 1941).
    """
    steps = np.diff(rows, axis=1)
    finite = np.isfinite(steps)
    white = np.where(finite, steps**2, 0.0).sum(axis=1) / (2.0 * np.maximum(finite.sum(axis=1), 1))
    shared = np.maximum(block_variance - _WHITE_SURPLUS * white, 0.0)
    return np.asarray(shared + white / _AVERAGE)
