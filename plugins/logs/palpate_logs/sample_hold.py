"""Readings that a table repeats, since their device is slower than the loop that wrote its rows."""

from __future__ import annotations

import numpy as np
from palpate import Floats, LastDigit

_MIN_RUNS = 20  # a choice: fewer runs of equal readings show no rhythm
_RHYTHM_SHARE = 0.9  # of the runs that are as long as the median one, or by one row longer or shorter (choice)
_MAX_SINGLE_SHARE = 0.15  # of runs of one reading; noise of less than a digit, of median 2, leaves 30 % (geometric)
_DIGITS = 1.5  # between runs, up to which the last digit explains them: a slow signal passes one after the other


def rows_per_reading(values: Floats) -> int:
    """Return the rows (n,) for which a reading stands in the median; 1 if the column is not one of held readings.

    A held signal changes in a rhythm, and by more than its last digit. A coarse one repeats as well, but changes by one
    digit at a time, or with noise in no rhythm.
    """
    finite = values[np.isfinite(values)]
    changes = np.flatnonzero(np.diff(finite))
    if len(changes) <= _MIN_RUNS:
        return 1
    # Runs between the first and the last change, and the steps between them.
    lengths = np.diff(changes)
    usual = float(np.median(lengths))
    in_rhythm = np.abs(lengths - usual) <= 1.0
    if usual < 2.0 or np.mean(in_rhythm) < _RHYTHM_SHARE or np.mean(lengths == 1) > _MAX_SINGLE_SHARE:
        return 1
    steps = np.abs(np.diff(finite)[changes])
    return int(usual) if float(np.median(steps)) > _DIGITS * LastDigit.of(finite).step else 1


class SampleHold:
    """The columns of a table without the repeats of what is held in them."""

    def __init__(self) -> None:
        self.rows: tuple[int, ...] = ()  # of each column, for which a reading stands; empty before the first block
        self._latest: Floats | None = None  # row

    def without_repeats(self, columns: Floats) -> Floats:
        """Return the next rows (n, k) of a table with NaN for repeats; its first ones decide which columns are held."""
        if not self.rows:
            self.rows = tuple(rows_per_reading(column) for column in columns.T)
        held = [k for k, rows in enumerate(self.rows) if rows > 1]
        if not held or not len(columns):
            return columns
        before = columns[:1] + np.nan if self._latest is None else self._latest
        is_repeat = np.diff(np.concatenate([before, columns])[:, held], axis=0) == 0.0
        self._latest = columns[-1:]
        fresh = columns.copy()
        fresh[:, held] = np.where(is_repeat, np.nan, columns[:, held])
        return fresh
