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

# Choices.
_STEP_SHARE = 0.2  # of the depth over which contact sets in, 1 um of a palpation of 5 mm: no slope is taken across it
_SAMPLES = 20_000  # of the thinned record
_BOUND_DISTANCE = 1e-3  # [standard deviations], within which an unknown is at its bound
_MAX_CORRECTION = 0.1  # of a value
_MAX_CORRECTION_WITH_MEMORY = 0.5  # of a value
_MAX_STEPS = 30  # of the iteration with memory
_LAST_STEP = 0.02  # [standard deviations], below which the iteration has converged
_SIGN_PATTERNS = 4  # over which the sums of a model with memory are averaged
_SEED = 20_260_000  # of the signs
_MIN_HEIGHT_NOISE = 1e-12  # [m] in a quotient, in place of 0: below any resolution


def force_noise(residual: Residual, record: FitRecord, x: Floats, surface: int) -> float:
    """Return the standard deviation [N] of the residual by the noise of the height: that times the RMS of dr/dz."""
    thinned = record if residual.model.memory else record.thinned(_SAMPLES)
    slopes = [
        (residual.errors(high, above) - residual.errors(low, below)) / (2 * _STEP_SHARE * record.transition)
        for (high, above), (low, below) in _displacements(residual, thinned, x, surface)
    ]
    return record.height_noise * float(np.sqrt(np.mean(np.square(slopes)[:, thinned.used])))


def correct_attenuation(residual: Residual, record: FitRecord, unknowns: Unknowns, solution: Solution) -> Solution:
    """Return the minimum corrected for the noise of the height (errors in variables).

    With noise of standard deviation s on every height z_j the sum of squares grows by s^2 sum (dr_i/dz_j)^2, which a
    softer material makes smaller. So this solves J^T r = s^2 sum dr_i/dz_j d(dr_i/dz_j)/dtheta (Fuller
    1987, section 3.2), by steps of (J^T J)^-1 from the minimum: one where the model has no memory, else until they are
    small, since an estimate that hardly exceeds its noise is corrected by more than first order. Without memory a
    height concerns its own sample only. With it, it concerns all samples that follow, and the double sums are means
    over heights displaced by random signs (Hutchinson 1990). Bounds hold. The minimum is returned unchanged where the
    steps do not become small, or lead farther than a tenth of a value (half with memory).
    """
    free, has_memory = list(residual.free), bool(residual.model.memory)
    if not free:
        return solution
    thinned = record if has_memory else record.thinned(_SAMPLES)
    surface = unknowns.index("surface")
    parameters = [place for place in free if place != surface]
    residual_std = _residual_std(record, solution)
    normal = residual.normal(thinned, solution.x)  # [r, J]^T [r, J]
    minimum_gradient = normal[1:, 0]  # J^T r: 0 at the minimum of the whole record, and not of a thinned one
    low, high = unknowns.bounds(free)
    inner = _is_inside_bounds(solution.x[free], (low, high), normal, _residual_std(thinned, solution))
    x = solution.x.copy()
    for step in range(_MAX_STEPS if has_memory else 1):
        if step > 0:
            normal = residual.normal(thinned, x)
        # A step of (J^T J)^-1 of the unknowns that are not at a bound.
        attenuation = _attenuation_gradient(residual, thinned, x, surface) * record.height_noise**2
        inverse = scaled_inverse(normal[1:, 1:][np.ix_(inner, inner)])
        change = np.zeros(len(free))
        change[inner] = inverse @ (attenuation - normal[1:, 0] + minimum_gradient)[inner]
        previous = x[free]
        x[free] = np.where(inner, np.clip(previous + change, low, high), previous)
        if not np.isfinite(x).all() or _is_far(x, solution.x, parameters, has_memory):
            return solution
        # Converged where the step is a small share of each standard deviation.
        last_step = _LAST_STEP * residual_std * np.sqrt(inverse.diagonal())
        if np.all(np.abs(x[free] - previous)[inner] < last_step):
            break
    else:
        if has_memory:
            return solution
    return replace(solution, x=x, moved=x - solution.x)


def _is_far(x: Floats, minimum: Floats, places: list[int], has_memory: bool) -> bool:
    """Return True if the parameter of any place has been corrected by more than the largest share of its value."""
    shares = [abs(x[i] - minimum[i]) / abs(minimum[i]) for i in places if minimum[i]]
    largest = _MAX_CORRECTION_WITH_MEMORY if has_memory else _MAX_CORRECTION
    return bool(max(shares, default=0.0) > largest)


def _attenuation_gradient(residual: Residual, record: FitRecord, x: Floats, surface: int) -> Floats:
    """Return half of the gradient (p,) of sum (dr_i/dz_j)^2 by the free unknowns [1/m^2], by central differences."""
    gradient = np.zeros(len(residual.free))
    for (record_up, x_up), (record_down, x_down) in _displacements(residual, record, x, surface):
        residual_up, jacobian_up = residual.whole(record_up, x_up)
        residual_down, jacobian_down = residual.whole(record_down, x_down)
        square_step = 4 * (_STEP_SHARE * record.transition) ** 2  # of both differences, over two steps each
        gradient += (jacobian_up - jacobian_down).T @ (residual_up - residual_down) / square_step
    return gradient / (_SIGN_PATTERNS if residual.model.memory else 1)


def _is_inside_bounds(
    values: Floats, bounds: tuple[Floats, Floats], normal: Floats, residual_std: float
) -> NDArray[np.bool_]:
    """Return True (p,) for the values (p,) of free unknowns that are not at a bound, lower or upper (p,).

    Their standard deviations follow from [r, J]^T [r, J] (1 + p, 1 + p) and the standard deviation of the residual [N].
    """
    low, high = bounds
    std = residual_std * np.sqrt(np.maximum(scaled_inverse(normal[1:, 1:]).diagonal(), 0.0))
    margin = _BOUND_DISTANCE * std
    return np.asarray((values - low > margin) & (high - values > margin))


def _residual_std(record: FitRecord, solution: Solution) -> float:
    """Return the standard deviation of the residual [N]."""
    return float(np.sqrt(2.0 * solution.cost / max(int(np.count_nonzero(record.used)), 1)))


_Displaced = tuple[FitRecord, Floats]


def _displacements(
    residual: Residual, record: FitRecord, x: Floats, surface: int
) -> Iterator[tuple[_Displaced, _Displaced]]:
    """Yield pairs of records and parameters whose depths are larger, and smaller, by a step.

    Without memory by the surface; with memory by heights and rates of the samples, with random signs.
    """
    if record.history is None or not residual.model.memory:
        up, down = x.copy(), x.copy()
        up[surface] += _STEP_SHARE * record.transition
        down[surface] -= _STEP_SHARE * record.transition
        yield (record, up), (record, down)
        return
    random = np.random.default_rng(_SEED)
    for _ in range(_SIGN_PATTERNS):
        step, rate_step = _STEP_SHARE * record.transition * random.choice([-1.0, 1.0], (2, len(record)))
        rate_step = rate_step * (record.rate_noise / max(record.height_noise, _MIN_HEIGHT_NOISE))
        yield (record.displaced(step, rate_step), x), (record.displaced(-step, -rate_step), x)
