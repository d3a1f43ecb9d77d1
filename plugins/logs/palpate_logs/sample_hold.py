"""Readings that a table repeats, since their device is slower than the loop that wrote its rows."""

from __future__ import annotations

import numpy as np
from palpate import Floats, LastDigit

_MIN_RUNS = 20  # a choice: fewer runs of equal readings show no rhythm
_MIN_RHYTHM_SHARE = 0.9  # of the runs that are as long as the median one, or by one row longer or shorter (choice)
_MAX_SINGLE_SHARE = 0.15  # of runs of one reading; noise of less than a digit, of median 2, leaves 30 % (geometric)
_MAX_STEP_DIGITS = 1.5  # in the median, which the last digit explains: a slow signal passes each digit; a choice


def rows_per_reading(values: Floats) -> int:
    """Return the rows (n,) for which a reading stands in the median; 1 if the column is not one of held readings.

    A held signal changes in a rhythm, and by more than its last digit. A coarse one repeats as well, but changes by one
    digit at a time, or with noise in no rhythm (docs/decisions/0520-a-held-reading-counts-once.md).
    """
    finite = values[np.isfinite(values)]
    changes = np.flatnonzero(np.diff(finite))
    if len(changes) <= _MIN_RUNS:
        return 1
    # Runs of equal readings, between the first and the last change.
    lengths = np.diff(changes)
    median_length = float(np.median(lengths))  # [rows]
    is_in_rhythm = np.abs(lengths - median_length) <= 1.0
    if median_length < 2.0 or np.mean(is_in_rhythm) < _MIN_RHYTHM_SHARE:
        return 1
    if np.mean(lengths == 1) > _MAX_SINGLE_SHARE:
        return 1
    # The steps between runs are more than one digit.
    steps = np.abs(np.diff(finite)[changes])
    exceeds_digits = float(np.median(steps)) > _MAX_STEP_DIGITS * LastDigit.of(finite).step
    return int(median_length) if exceeds_digits else 1


class SampleHold:
    """The memory that takes the repeats out of the held columns of a table, block by block."""

    def __init__(self) -> None:
        self.rows: tuple[int, ...] = ()  # per reading, of each column; empty before the first block
        self._last_row: Floats | None = None  # (1, k) of the block before

    def without_repeats(self, columns: Floats) -> Floats:
        """Return the next rows (n, k) of a table with NaN for repeats; the first call decides on the held columns."""
        if not self.rows:
            self.rows = tuple(rows_per_reading(column) for column in columns.T)
        held_columns = [column for column, rows in enumerate(self.rows) if rows > 1]
        if not held_columns or not len(columns):
            return columns
        # A reading is a repeat if it equals that of the row before; none of the first row is.
        row_before = columns[:1] + np.nan if self._last_row is None else self._last_row
        is_repeat = np.diff(np.concatenate([row_before, columns])[:, held_columns], axis=0) == 0.0
        self._last_row = columns[-1:]
        readings = columns.copy()
        readings[:, held_columns] = np.where(is_repeat, np.nan, columns[:, held_columns])
        return readings
