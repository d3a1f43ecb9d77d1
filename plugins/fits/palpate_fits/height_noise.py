"""Noise of the height in a fit: what it adds to the residual, and what it takes from the stiffness."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual
from palpate_fits.solvers import Solution
from palpate_fits.unknowns import Unknowns

_STEP = 0.2  # of the depth over which contact sets in, 1 um in a palpation of 5 mm: no derivative is taken across it
_SAMPLES = 20_000
_AT_EDGE = 1e-3  # standard deviations
_FARTHEST = {False: 0.1, True: 0.5}  # of a value; without and with memory
_STEPS = 30
_SETTLED = 0.02  # standard deviations
_PATTERNS = 4  # of signs, of a model with memory
_SEED = 20_260_000


def force_noise(residual: Residual, record: FitRecord, x: Floats, surface: int) -> float:
    """Standard deviation [N] that the noise of the height gives the residual: its own times the RMS of its slopes."""
    thinned = record if residual.model.memory else record.thinned(_SAMPLES)
    slopes = [
        (residual.errors(high, above) - residual.errors(low, below)) / (2 * _STEP * record.transition)
        for (high, above), (low, below) in _displacements(residual, thinned, x, surface)
    ]
    return record.height_noise * float(np.sqrt(np.mean(np.square(slopes)[:, thinned.used])))


def correct_attenuation(residual: Residual, record: FitRecord, unknowns: Unknowns, solution: Solution) -> Solution:
    """Return the minimum without what the noise of the height has taken from it (errors in variables).

    With noise of standard deviation s on every height z_j the sum of squares grows by s^2 sum (dr_i/dz_j)^2, which a
    softer material makes smaller. So this solves J^T r = s^2 sum dr_i/dz_j d(dr_i/dz_j)/dtheta (Fuller
    1987, section 3.2), by steps of (J^T J)^-1 from the minimum: one where the model has no memory, else until they end,
    for what hardly exceeds the noise is moved by more than first order. Without memory a height concerns its own
    sample only. With it, it concerns all that follow, and the double sums are means over heights displaced by random
    signs (Hutchinson 1990). Bounds hold; where no end is near, the minimum stays.
    """
    free = list(residual.free)
    if not free:
        return solution
    thinned = record if residual.model.memory else record.thinned(_SAMPLES)
    low, high = unknowns.bounds(free)
    place = unknowns.index("surface")
    loose, x, first = _loose(residual, thinned, unknowns, solution), solution.x.copy(), np.zeros(len(free))
    for step in range(_STEPS if residual.model.memory else 1):
        square = residual.normal(thinned, x)
        first = square[1:, 0] if step == 0 else first  # of a thinned record not 0 at the minimum
        pull = _pull(residual, thinned, x, place) * record.height_noise**2
        inverse, moved = scaled_inverse(square[1:, 1:][np.ix_(loose, loose)]), np.zeros(len(free))
        moved[loose] = inverse @ (pull - square[1:, 0] + first)[loose]
        before, x[free] = x[free], np.where(loose, np.clip(x[free] + moved, low, high), x[free])
        share = [abs(a - b) / abs(b) for a, b, i in zip(x[free], solution.x[free], free) if i != place and b]
        if not np.isfinite(x).all() or max(share, default=0.0) > _FARTHEST[bool(residual.model.memory)]:
            return solution
        if np.all(np.abs(x[free] - before)[loose] < _SETTLED * _sigma(record, solution) * np.sqrt(inverse.diagonal())):
            break
    else:
        if residual.model.memory:
            return solution
    return replace(solution, x=x, moved=x - solution.x)


def _pull(residual: Residual, record: FitRecord, x: Floats, surface: int) -> Floats:
    """Half of the gradient (p,) of sum (dr_i/dz_j)^2 by the free unknowns [1/m^2]."""
    found = np.zeros(len(residual.free))
    for (higher, above), (lower, below) in _displacements(residual, record, x, surface):
        high, rising = residual.whole(higher, above)
        low, falling = residual.whole(lower, below)
        found += (rising - falling).T @ (high - low) / (4 * (_STEP * record.transition) ** 2)
    return found / (_PATTERNS if residual.model.memory else 1)


def _loose(residual: Residual, record: FitRecord, unknowns: Unknowns, solution: Solution) -> NDArray[np.bool_]:
    """Free unknowns (p,) that are not at a bound."""
    free = list(residual.free)
    values, (low, high) = solution.x[free], unknowns.bounds(free)
    inverse = scaled_inverse(residual.normal(record, solution.x)[1:, 1:])
    edge = _AT_EDGE * _sigma(record, solution) * np.sqrt(np.maximum(inverse.diagonal(), 0.0))
    return np.asarray((values - low > edge) & (high - values > edge))


def _sigma(record: FitRecord, solution: Solution) -> float:
    """Standard deviation of the residual [N]."""
    return float(np.sqrt(2.0 * solution.cost / max(int(np.count_nonzero(record.used)), 1)))


_Displaced = tuple[FitRecord, Floats]


def _displacements(
    residual: Residual, record: FitRecord, x: Floats, surface: int
) -> Iterator[tuple[_Displaced, _Displaced]]:
    """Pairs of records and parameters at depths that are larger and smaller by a step."""
    if record.history is None or not residual.model.memory:
        up, down = x.copy(), x.copy()
        up[surface] += _STEP * record.transition
        down[surface] -= _STEP * record.transition
        yield (record, up), (record, down)
        return
    random = np.random.default_rng(_SEED)
    for _ in range(_PATTERNS):
        step, rate_step = _STEP * record.transition * random.choice([-1.0, 1.0], (2, len(record)))
        rate_step = rate_step * (record.rate_noise / max(record.height_noise, 1e-12))
        yield (record.displaced(step, rate_step), x), (record.displaced(-step, -rate_step), x)
