"""The smooth curve that all shifted sweeps have in common, and the shifts that bring them onto it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_reference.superposition.neighbour_shifts import DECADE, ReducedRows

# Choices.
_DEGREE = 3  # of the spline
_KNOTS_PER_DECADE, _MIN_ROWS_PER_KNOT = 4.0, 4
_MAX_ROUNDS, _MIN_STEP = 60, 1e-9  # of Gauss and Newton; logarithm of a shift
_RANK, _STEP_RANK = 1e-10, 1e-12  # relative singular values that count as 0, of the curve and of all unknowns


@dataclass(frozen=True)
class Linearisation:
    """The least squares of shifts and curves about some shifts, linearised."""

    step: Floats  # (n - 1, 1 or 2) change of the free shifts
    residual: Floats  # (r, c)
    information: Floats  # (p, p) J^T J of the shifts, ln a_T first, then of the coefficients of the curves


def best_shifts(rows: ReducedRows, start: Floats, free: Sequence[int], vertical: bool) -> tuple[Floats, Linearisation]:
    """Return the shifts (n, 2) of the least squares by Gauss and Newton, and the problem linearised there."""
    shifts = start.copy()
    knots = _knots(rows.x + shifts[rows.sweep, 0])
    for turn in range(_MAX_ROUNDS):
        step = _linearised(rows, shifts, knots, free, vertical).step
        shifts[free, : step.shape[1]] += step
        if float(np.abs(step).max()) < _MIN_STEP:
            break
        # In the second half of the rounds the knots stay, so that the sum has one minimum.
        if turn < _MAX_ROUNDS // 2:
            knots = _knots(rows.x + shifts[rows.sweep, 0])
    return shifts, _linearised(rows, shifts, knots, free, vertical)


def _knots(x: Floats) -> Floats:
    """Return the knots of the curve over reduced logarithms (r,): at quantiles of the rows, a few rows between two."""
    by_range, by_rows = int(_KNOTS_PER_DECADE * np.ptp(x) / DECADE), len(x) // _MIN_ROWS_PER_KNOT
    count = max(min(by_range, by_rows), 1)
    inner = np.quantile(x, np.linspace(0.0, 1.0, count + 1))
    inner[0], inner[-1] = x.min() - DECADE, x.max() + DECADE
    return np.concatenate([[inner[0]] * _DEGREE, inner, [inner[-1]] * _DEGREE])


def _linearised(rows: ReducedRows, shifts: Floats, knots: Floats, free: Sequence[int], vertical: bool) -> Linearisation:
    """Return the problem about shifts (n, 2), with the curves that fit best there."""
    from scipy.interpolate import BSpline

    reduced_x = np.clip(rows.x + shifts[rows.sweep, 0], knots[0], knots[-1])
    values = rows.y + shifts[rows.sweep, 1][:, None]
    basis = BSpline.design_matrix(reduced_x, knots, _DEGREE).toarray()
    coefficients, *_ = np.linalg.lstsq(basis, values, rcond=_RANK)
    residual = values - basis @ coefficients

    # Columns of the residuals of each modulus: those of the shifts, then those of its own curve.
    curve_slopes = BSpline(knots, coefficients, _DEGREE)(reduced_x, 1)
    is_of_sweep = np.column_stack([rows.sweep == k for k in free]).astype(np.float64)
    column_count = values.shape[1]
    shift_columns = []
    for column in range(column_count):
        horizontal = -curve_slopes[:, column : column + 1] * is_of_sweep
        shift_columns.append(np.hstack([horizontal, is_of_sweep]) if vertical else horizontal)
    design = np.hstack([np.vstack(shift_columns), np.kron(np.eye(column_count), -basis)])
    change, *_ = np.linalg.lstsq(design, -residual.ravel(order="F"), rcond=_STEP_RANK)

    # A step is a decade at most.
    directions = 2 if vertical else 1
    step = np.clip(change[: directions * len(free)], -DECADE, DECADE).reshape(directions, -1).T
    return Linearisation(step, residual, design.T @ design)
