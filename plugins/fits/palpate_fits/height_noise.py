"""Noise of the height in a fit: what it adds to the residual, and what it takes from the stiffness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate import Floats

from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual
from palpate_fits.solvers import Solution
from palpate_fits.uncertainty import scaled_inverse
from palpate_fits.unknowns import Unknowns

_STEP = 0.2  # of the depth over which contact sets in, 1 um in a palpation of 5 mm: no derivative is taken across it
_SAMPLES = 20_000
_AT_EDGE = 1e-3  # standard deviations
_FARTHEST = 0.1  # of a value; a correction beyond that is no first order


def force_noise(residual: Residual, record: FitRecord, x: Floats, surface: int) -> float:
    """Standard deviation [N] that the noise of the height gives the residual: its own times the RMS of dF/dd."""
    thinned, up, down, step = record.thinned(_SAMPLES), x.copy(), x.copy(), _STEP * record.transition
    up[surface] += step
    down[surface] -= step
    slope = (residual.errors(thinned, up) - residual.errors(thinned, down)) / (2 * step)
    return record.height_noise * float(np.sqrt(np.mean(slope**2)))


def correct_attenuation(residual: Residual, record: FitRecord, unknowns: Unknowns, solution: Solution) -> Solution:
    """The minimum without what the noise of the height has taken from it (errors in variables), to first order.

    With noise of standard deviation s on the depth the sum of squares grows by s^2 sum (dF/dd)^2, which a softer
    material makes smaller: the minimum moves by -(J^T J)^-1 s^2 sum dF/dd d(dF/dd)/dtheta, which is added here
    (Fuller 1987, section 3.2). For models without memory; bounds hold.
    """
    free = list(residual.free)
    if not free or residual.model.memory or not record.used.all():
        return solution
    thinned = record.thinned(_SAMPLES)
    slope, change = _by_surface(residual, thinned, solution.x, unknowns.index("surface"))
    squares = residual.normal(thinned, solution.x)[1:, 1:]
    values, (low, high) = solution.x[free], unknowns.bounds(free)
    sigma = np.sqrt(2.0 * solution.cost / len(record))
    inverse, pull = scaled_inverse(squares), change.T @ slope * record.height_noise**2
    edge = _AT_EDGE * sigma * np.sqrt(np.maximum(inverse.diagonal(), 0.0))
    loose = (values - low > edge) & (high - values > edge)
    moved = np.zeros(len(free))
    if loose.all():
        moved = inverse @ pull
    else:
        moved[loose] = scaled_inverse(squares[np.ix_(loose, loose)]) @ pull[loose]
    place = unknowns.index("surface")
    relative = [abs(m) / abs(v) for m, v, i in zip(moved, values, free, strict=True) if i != place and v]
    if not np.isfinite(moved).all() or max(relative, default=0.0) > _FARTHEST:
        return solution
    x = solution.x.copy()
    x[free] = np.where(loose, np.clip(values + moved, low, high), values)
    return replace(solution, x=x, moved=x - solution.x)


def _by_surface(residual: Residual, record: FitRecord, x: Floats, place: int) -> tuple[Floats, Floats]:
    """Slopes in depth of the weighted residual (n,) and of its Jacobian (n, p)."""
    up, down, step = x.copy(), x.copy(), _STEP * record.transition
    up[place] += step
    down[place] -= step
    high, rising = residual.whole(record, up)
    low, falling = residual.whole(record, down)
    return (high - low) / (2 * step), (rising - falling) / (2 * step)
