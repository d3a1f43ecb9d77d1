"""A force that rises slowly: averages over a tenth of a second against the second before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate.vectors import Floats

_BLOCK = 0.01  # [s]
_AVERAGED = 10  # blocks
_BEFORE, _APART = 150, 50  # blocks: the baseline ends half a second before the average
_LEAST = 50  # blocks of baseline
_MARGIN = 1.5  # of the variance of white noise, which a second determines no better
_SIGMAS = 5.0
_LASTING = 10  # blocks in a row
_ROWS = 4096  # blocks in one go
_WIDTH = _BEFORE + _AVERAGED


class RiseFinder:
    """Finds the sample at which a force has been above its own baseline for long enough.

    The means of 10 ms are averaged over 100 ms. These averages scatter as the channel does, whatever its filter, so
    their own scatter over the baseline, a second that ends half a second before, says what counts as a rise. A drift is
    part of the baseline. All sums are over whole windows of the record, so nothing depends on how it is cut.
    """

    def __init__(self, interval: float, least: float) -> None:
        self._samples = max(round(_BLOCK / interval), 1) if interval > 0 else 1
        self._least = least  # [N]
        self._force = np.zeros(0)  # of the block that is not complete
        self._means = np.zeros(0)  # of the latest blocks
        self._forgotten = 0  # blocks
        self._lasting = 0

    def feed(self, force: Floats) -> list[int]:
        """Indices, from the first sample ever fed, of the samples at which a rise has lasted long enough."""
        found: list[int] = []
        force = np.concatenate([self._force, force])
        whole = len(force) // self._samples
        self._force = force[whole * self._samples :]
        new = force[: whole * self._samples].reshape(whole, self._samples).mean(axis=1)
        begin = self._forgotten + len(self._means)
        self._means = np.concatenate([self._means, new])
        for block in range(begin, begin + whole, _ROWS):
            count = min(_ROWS, begin + whole - block)
            risen = self._risen(np.arange(block, block + count) - self._forgotten)
            for i, is_risen in enumerate(risen.tolist()):
                self._lasting = self._lasting + 1 if is_risen else 0
                if self._lasting >= _LASTING:
                    found.append((block + i + 1) * self._samples - 1)
                    self._lasting = 0
        drop = max(len(self._means) - _WIDTH, 0)
        self._means = self._means[drop:]
        self._forgotten += drop
        return found

    def _risen(self, last: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return True if the average that ends with each of these blocks is above its baseline."""
        padded = np.concatenate([np.full(_WIDTH, np.nan), self._means])
        begins = last + 1
        latest = begins[:, None] + np.arange(_WIDTH - _AVERAGED, _WIDTH)
        now = np.ascontiguousarray(padded[latest]).mean(axis=1)
        baseline = np.ascontiguousarray(padded[begins[:, None] + np.arange(_BEFORE - _APART)])
        known = np.isfinite(baseline)
        count = known.sum(axis=1)
        mean = np.where(known, baseline, 0.0).sum(axis=1) / np.maximum(count, 1)
        likely: NDArray[np.bool_] = np.asarray((count >= _LEAST) & (now - mean > self._least))
        if likely.any():
            likely[likely] = self._beyond(baseline[likely], now[likely])
        return likely

    def _beyond(self, baseline: Floats, now: Floats) -> NDArray[np.bool_]:
        """Return True if averages (n,) are above baselines (n, m) by more than these scatter."""
        mean, square = _moments(baseline)
        parts = baseline.reshape(len(now), -1, _AVERAGED).mean(axis=2)
        scatter = np.maximum(_moments(parts)[1], _uneven(baseline, square))
        level = np.maximum(_SIGMAS * np.sqrt(scatter), self._least)
        return np.asarray(now - mean > level)


def _moments(rows: Floats) -> tuple[Floats, Floats]:
    """Mean and variance of what is known in each row."""
    known = np.isfinite(rows)
    count = known.sum(axis=1)
    mean = np.where(known, rows, 0.0).sum(axis=1) / np.maximum(count, 1)
    square = np.where(known, (rows - mean[:, None]) ** 2, 0.0).sum(axis=1) / np.maximum(count - 1, 1)
    return mean, square


def _uneven(rows: Floats, square: Floats) -> Floats:
    """Variance of an average: what neighbours share of the variance does not average out, the rest does."""
    steps = np.diff(rows, axis=1)
    known = np.isfinite(steps)
    white = np.where(known, steps**2, 0.0).sum(axis=1) / (2.0 * np.maximum(known.sum(axis=1), 1))
    return np.asarray(np.maximum(square - _MARGIN * white, 0.0) + white / _AVERAGED)
