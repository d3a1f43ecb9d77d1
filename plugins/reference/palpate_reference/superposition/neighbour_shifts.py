"""The first shifts of sweeps: each onto its neighbour, by the rows that overlap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats

from palpate_reference.superposition.temperature_sweeps import TemperatureSweep, shift_signs

DECADE = math.log(10.0)
# Choices.
_MAX_SHIFT = 10.0 * DECADE
_SHIFT_STEP = 0.05 * DECADE
MIN_OVERLAP = 3  # rows that neighbours share
_MAX_MISMATCH = 0.25  # rms of logarithms (0274): beyond it neighbours do not meet
_GOOD_RMS = 0.01  # below it more rows count for more than a smaller rms


@dataclass(frozen=True)
class ReducedRows:
    """All readings in logarithms, with the signs that make shifts additive."""

    x: Floats  # (r,), such that ln a_T is added
    y: Floats  # (r, c), such that ln b_T is added
    sweep: NDArray[np.intp]  # (r,) index of the sweep of each row


def reduced_rows(sweeps: Sequence[TemperatureSweep], columns: int) -> ReducedRows:
    """Return the rows of all sweeps, with the first so many columns of their moduli."""
    xs, ys, indexes = [], [], []
    for k, sweep in enumerate(sweeps):
        for table in sweep.tables:
            x_sign, y_sign = shift_signs(table)
            order = np.argsort(table.x)
            xs.append(x_sign * np.log(table.x[order]))
            ys.append(y_sign * np.log(table.y[order, :columns]))
            indexes.append(np.full(len(order), k))
    return ReducedRows(np.concatenate(xs), np.concatenate(ys), np.concatenate(indexes))


def first_shifts(rows: ReducedRows, sweeps: Sequence[TemperatureSweep], reference: int) -> Floats:
    """Return ln a_T (n,) by shifting each sweep onto its neighbour; raises ConfigurationError if they do not meet."""
    steps = [0.0]
    for k, (cold, warm) in enumerate(pairwise(sweeps)):
        shift, rms = _neighbour_shift(*_sorted_sweep(rows, k), *_sorted_sweep(rows, k + 1))
        if rms > _MAX_MISMATCH:
            hint = " (or --by storage, if the loss is that of the instrument)" if rows.y.shape[1] > 1 else ""
            raise ConfigurationError(
                f"the sweeps at {cold.temperature:.4g} °C and {warm.temperature:.4g} °C do not meet, wherever one is "
                f"shifted along the other ({100 * rms:.2g} % apart at best): measure a temperature in between{hint}"
            )
        steps.append(shift)
    shifts = np.cumsum(steps)
    return np.asarray(shifts - shifts[reference], np.float64)


def _sorted_sweep(rows: ReducedRows, index: int) -> tuple[Floats, Floats]:
    """Return x (m,) and y (m, c) of one sweep, with x rising."""
    x, y = rows.x[rows.sweep == index], rows.y[rows.sweep == index]
    order = np.argsort(x, kind="stable")
    return x[order], y[order]


def _neighbour_shift(x: Floats, y: Floats, x_next: Floats, y_next: Floats) -> tuple[float, float]:
    """Return the shift of the next sweep at which both agree best where they overlap, and their rms.

    The mean square over the number of rows decides, so that many rows count for more; infinite rms without overlap.
    """
    best = (math.inf, 0.0, math.inf)
    for shift in np.arange(-_MAX_SHIFT, _MAX_SHIFT + _SHIFT_STEP, _SHIFT_STEP):
        x_shifted = x_next + shift
        is_inside = (x_shifted >= x[0]) & (x_shifted <= x[-1])
        count = int(is_inside.sum())
        if count < MIN_OVERLAP:
            continue
        column_squares = []
        for column in range(y.shape[1]):
            difference = np.interp(x_shifted[is_inside], x, y[:, column]) - y_next[is_inside, column]
            column_squares.append(np.mean(difference**2))
        mean_square = np.mean(column_squares)
        best = min(best, ((mean_square + _GOOD_RMS**2) / count, float(shift), math.sqrt(mean_square)))
    _, best_shift, best_rms = best
    return best_shift, best_rms
