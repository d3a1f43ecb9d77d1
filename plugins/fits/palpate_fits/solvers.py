"""Solvers: on normal equations, and on triangular factors where those are too coarse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.numerics.least_squares import least_squares

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual
from palpate_fits.unknowns import Unknowns

# Of scipy's trust region, in units of the first residual and of the typical steps (choices).
_COST_TOLERANCE = 1e-12  # of the cost
_STEP_TOLERANCE = 1e-10  # of the unknowns
_GRADIENT_TOLERANCE = 1e-9
_MAX_EVALUATIONS = 200
_SMALLEST_RESIDUAL = 1e-300  # root of the sum of squares, in place of 0 in a quotient: near the smallest double
_EXACT_RESIDUAL = 1e-12  # root of the sum of squares that a fit without error has for the size of steps (choice)
_BOUND_MARGIN = 1e-9  # of the width between bounds, by which a start is inside them (choice)


@dataclass(frozen=True)
class Solution:
    """A minimum."""

    x: Floats  # (P,) all parameters
    cost: float  # half of the sum of losses
    evaluations: int
    converged: bool
    moved: Floats | None = None  # (P,) correction of the parameters since; None: not corrected

    @property
    def least(self) -> Floats:
        """(P,) parameters where the sum of losses is least."""
        return self.x if self.moved is None else self.x - self.moved


def descend(residual: Residual, unknowns: Unknowns, record: FitRecord, x: Floats, loss: LossFunction) -> Solution:
    """Return the minimum near a start, by the fastest solver for the model."""
    solve = solve_trf if residual.model.memory else solve_lm
    return solve(residual, unknowns, record, x, loss)


def solve_lm(
    residual: Residual,
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    loss: LossFunction,
    gain: float = 1e-22,
) -> Solution:
    """Return the minimum by Levenberg and Marquardt, whose normal equations one compiled function sums up.

    It has converged where the next step would lower the cost by less than a share `gain` of it. By default that is
    within 1e-9 standard deviations of the minimum (decision 0143).
    """
    free = list(residual.free)
    full = x.copy()

    def normal(values: Floats) -> Floats:
        full[free] = values
        return residual.normal(record, full, loss)

    minimum = least_squares(normal, x[free], *unknowns.bounds(free), gain=gain)
    full[free] = minimum.x
    return Solution(full, minimum.cost, minimum.evaluations, minimum.converged)


def solve_trf(
    residual: Residual,
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    loss: LossFunction,
    max_evaluations: int = _MAX_EVALUATIONS,
) -> Solution:
    """Return the minimum by trust-region reflective (Branch, Coleman and Li 1999; scipy), in `max_evaluations`.

    It works on the triangular factor of [J, r], which has the cost, the gradient and the J^T J of the whole, so the
    steps are those of the whole problem. The cost is half of the sum of squares.
    """
    from scipy import optimize

    free = list(residual.free)
    low, high = unknowns.bounds(free)
    factor = _LastTriangle(residual, record, x, loss)
    first = factor.triangle(x[free])
    if not free:
        return Solution(x, 0.5 * float(first[-1, -1] ** 2), 1, True)
    # In units of the first residual, so that tolerances mean the same for every record.
    scale, size = _typical_steps(first, x[free]), max(abs(float(first[-1, -1])), _SMALLEST_RESIDUAL)
    solve: Any = optimize.least_squares  # its annotations do not include a function for the Jacobian
    minimum = solve(
        lambda p: factor.triangle(p * scale)[:, -1] / size,
        _strictly_inside(x[free], low, high) / scale,
        lambda p: factor.triangle(p * scale)[:, :-1] * scale / size,
        bounds=(low / scale, high / scale),
        method="trf",
        ftol=_COST_TOLERANCE,
        xtol=_STEP_TOLERANCE,
        gtol=_GRADIENT_TOLERANCE,
        max_nfev=max_evaluations,
    )
    full = x.copy()
    full[free] = np.clip(minimum.x * scale, low, high)
    return Solution(full, float(minimum.cost) * size**2, int(minimum.nfev), bool(minimum.status > 0))


class _LastTriangle:
    """The last triangle, kept: scipy calls for residual and Jacobian one after the other."""

    def __init__(self, residual: Residual, record: FitRecord, x: Floats, loss: LossFunction) -> None:
        self._residual, self._record, self._x, self._loss = residual, record, x.copy(), loss
        self._last: tuple[bytes, Floats] | None = None

    def triangle(self, free: Floats) -> Floats:
        key = np.asarray(free).tobytes()
        if self._last is None or self._last[0] != key:
            self._x[list(self._residual.free)] = free
            self._last = key, self._residual.triangle(self._record, self._x, self._loss)
        return self._last[1]


def _typical_steps(triangle: Floats, values: Floats) -> Floats:
    """Return for each unknown (p,) the step |r|/|J_i| that changes the residual by its own size; never 0."""
    lengths = np.sqrt(np.sum(triangle[:, :-1] ** 2, axis=0))
    size = max(abs(float(triangle[-1, -1])), _EXACT_RESIDUAL)
    fallback = np.where(values != 0, np.abs(values), 1.0)
    return np.where(lengths > 0, size / np.where(lengths > 0, lengths, 1.0), fallback)


def _strictly_inside(x: Floats, low: Floats, high: Floats) -> Floats:
    """Return the nearest start inside the bounds and not on them, as trust-region reflective needs it."""
    width = np.where(np.isfinite(high - low), high - low, np.maximum(np.abs(x), 1.0))
    margin = _BOUND_MARGIN * width
    lowest = np.where(np.isfinite(low), low + margin, low)
    highest = np.where(np.isfinite(high), high - margin, high)
    return np.clip(x, lowest, highest)
