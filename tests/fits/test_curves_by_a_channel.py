"""Curves of one log, told apart by a channel whose value changes."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from palpate import Batch
from palpate_fits.curve_files import curves_by

NONE = np.nan


def batch_of(marks, first):
    """Return a batch of readings with these marks, by its first time-stamp."""
    time = np.arange(len(marks), dtype=np.int64) + first
    return Batch("log", time, time, np.column_stack([time.astype(float), np.array(marks, float)]))


def log_of(*parts):
    """Return a log that sends batches with these marks."""
    batches = [batch_of(marks, 10 * i) for i, marks in enumerate(parts)]
    channels = [SimpleNamespace(name="z"), SimpleNamespace(name="mark")]
    link = SimpleNamespace(batches=lambda: iter(batches))
    return SimpleNamespace(streams=[SimpleNamespace(channels=channels)], connect=lambda seed: nullcontext(link))


@pytest.mark.parametrize(
    ("parts", "lengths"),
    [
        ([[1, 1, 2], [2, 3]], [2, 2, 1]),
        ([[1, 1], [2, 2]], [2, 2]),  # the change is where one batch ends
        ([[1, NONE], [1, 1]], [4]),  # the mark is missing there
        ([[1, NONE], [NONE, 2]], [3, 1]),
        ([[NONE, 1], [1, 2]], [3, 1]),  # the first mark is missing
        ([[], [1, 1], [], [2]], [2, 1]),
        ([[NONE, NONE]], [2]),
    ],
)
def test_a_curve_ends_where_the_mark_changes_and_nowhere_else(parts, lengths):
    curves = list(curves_by([log_of(*parts)], "mark"))
    assert [sum(len(batch.time) for batch in curve.batches) for curve in curves] == lengths
    assert [curve.name for curve in curves] == [str(i) for i in range(len(lengths))]
