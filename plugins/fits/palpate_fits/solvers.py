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


@dataclass(frozen=True)
class Solution:
    """A minimum."""

    x: Floats  # (P,) all parameters
    cost: float  # half of the sum of losses
    evaluations: int
    converged: bool
    moved: Floats | None = None  # (P,) by what the parameters have been corrected since; None: by nothing

    @property
    def least(self) -> Floats:
        """(P,) where the sum of losses is least."""
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
    """Levenberg and Marquardt on the normal equations, which one compiled function sums up over all samples."""
    free = list(residual.free)
    full = x.copy()

    def normal(values: Floats) -> Floats:
        full[free] = values
        return residual.normal(record, full, loss)

    found = least_squares(normal, x[free], *unknowns.bounds(free), gain=gain)
    full[free] = found.x
    return Solution(full, found.cost, found.evaluations, found.converged)


def solve_trf(
    residual: Residual, unknowns: Unknowns, record: FitRecord, x: Floats, loss: LossFunction, most: int = 200
) -> Solution:
    """Trust-region reflective (Branch, Coleman and Li 1999; scipy), on the triangular factor of [J, r].

    The factor has the cost, the gradient and the J^T J of the whole, so the steps are those of the whole problem.
    """
    from scipy import optimize

    free = list(residual.free)
    low, high = unknowns.bounds(free)
    seen = _LastTriangle(residual, record, x, loss)
    if not free:
        return Solution(x, 0.5 * float(seen.triangle(x[free])[-1, -1] ** 2), 1, True)
    first = seen.triangle(x[free])
    # In units of the first residual, so that tolerances mean the same for every record.
    scale, size = _scales(first, x[free]), max(abs(float(first[-1, -1])), 1e-300)
    solve: Any = optimize.least_squares  # its annotations know no function for the Jacobian
    found = solve(
        lambda p: seen.triangle(p * scale)[:, -1] / size,
        _strictly_inside(x[free], low, high) / scale,
        lambda p: seen.triangle(p * scale)[:, :-1] * scale / size,
        bounds=(low / scale, high / scale),
        method="trf",
        ftol=1e-12,
        xtol=1e-10,
        gtol=1e-9,
        max_nfev=most,
    )
    full = x.copy()
    full[free] = np.clip(found.x * scale, low, high)
    return Solution(full, float(found.cost) * size**2, int(found.nfev), bool(found.status > 0))


class _LastTriangle:
    """Remembers the last triangle: residual and Jacobian are asked for one after the other."""

    def __init__(self, residual: Residual, record: FitRecord, x: Floats, loss: LossFunction) -> None:
        self._residual, self._record, self._x, self._loss = residual, record, x.copy(), loss
        self._last: tuple[bytes, Floats] | None = None

    def triangle(self, free: Floats) -> Floats:
        key = np.asarray(free).tobytes()
        if self._last is None or self._last[0] != key:
            self._x[list(self._residual.free)] = free
            self._last = key, self._residual.triangle(self._record, self._x, self._loss)
        return self._last[1]


def _scales(triangle: Floats, values: Floats) -> Floats:
    """Typical steps: what moves the residual by its own size over the square root of the samples; never 0."""
    lengths = np.sqrt(np.sum(triangle[:, :-1] ** 2, axis=0))
    size = max(abs(float(triangle[-1, -1])), 1e-12)
    fallback = np.where(values != 0, np.abs(values), 1.0)
    return np.where(lengths > 0, size / np.where(lengths > 0, lengths, 1.0), fallback)


def _strictly_inside(x: Floats, low: Floats, high: Floats) -> Floats:
    """Trust-region reflective starts inside the bounds, not on them."""
    width = np.where(np.isfinite(high - low), high - low, np.maximum(np.abs(x), 1.0))
    margin = 1e-9 * width
    return np.clip(x, np.where(np.isfinite(low), low + margin, low), np.where(np.isfinite(high), high - margin, high))
