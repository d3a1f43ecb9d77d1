"""Bounded least squares for a few unknowns (Levenberg 1944, Marquardt 1963), from the normal equations alone.

The import of `scipy.optimize` takes longer than most fits, and its least squares keep every sample's slopes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from operator import mul

import numpy as np
from palpate import Floats

MIN_DAMPING = 1e-13  # of the scaled diagonal, which is 1 (choice): an undetermined direction stays where it is
FIRST_DAMPING = 1e-3  # after the first step uphill (Marquardt 1963)
MAX_DAMPING = 1e12  # beyond which a step is shorter than the rounding of the unknowns (choice)
COST_ROUNDING = 1e-13  # of the cost, below which two costs differ by rounding alone (some 500 units of a double)
STEP_ROUNDING = 1e-13  # of an unknown, below which a step is rounding
DIFFERENCE_STEP = 1.5e-8  # of an unknown: the square root of a double's resolution, best for one-sided differences
STALLED_DECREASE = 0.9  # of the decrease before (choice): with less progress the steps are rounding
POOR_GAIN, GOOD_GAIN = 0.25, 0.75  # gain ratios that raise and lower the damping (Fletcher 1971)
UPHILL_FACTOR, POOR_FACTOR, GOOD_FACTOR = 10.0, 2.0, 0.1  # of the damping, by the gain of a step (choice)
POOR_DAMPING = 1e-2 * FIRST_DAMPING  # at least, after a step of poor gain (choice)
MIN_KEPT_DAMPING = 1e-3 * FIRST_DAMPING  # below which a step is that of Gauss and Newton (choice)
RELEASE_ROUNDING = 1e-12  # of the largest slope, up to which a force on a bound is rounding
TINY = 1e-300  # guards against a division by 0
MAX_EVALUATIONS = 200  # (choice)
MIN_GAIN = 1e-22  # of the cost: a step of 1e-8 standard deviations with a million samples (0143)
SETS_PER_UNKNOWN = 8  # active sets that are tried (choice); a problem of few unknowns needs 1 or 2 each


@dataclass(frozen=True)
class Minimum:
    """The least sum of squares, and how it was reached."""

    x: Floats  # (p,)
    cost: float  # half of the sum
    evaluations: int
    converged: bool


def least_squares(
    normal: Callable[[Floats], Floats],
    x: Floats,
    low: Floats,
    high: Floats,
    most: int = MAX_EVALUATIONS,
    gain: float = MIN_GAIN,
) -> Minimum:
    """Return the minimum of r^T r/2 within bounds (p,), from a start x (p,).

    `normal` gives [r, J]^T [r, J] (1 + p, 1 + p) at unknowns (p,); at `most` so many evaluations. Ends where another
    step would lower the cost by less than a share `gain` of it, and takes that step: with n independent residuals it is
    sqrt(n gain) standard deviations long.
    """
    x = _clipped(x, low, high)
    equations = normal(x)
    evaluations, damping, earlier_decrease = 1, 0.0, np.inf
    if not _is_finite(equations):
        return Minimum(x, _cost(equations), evaluations, False)
    while evaluations < most:
        cost = _cost(equations)
        step, predicted_decrease = bounded_step(equations, low - x, high - x, damping)
        # Converged: the step is worth nothing, or is rounding. Undamped it is the last one.
        if predicted_decrease <= gain * cost or _is_rounding(step, x):
            if damping <= FIRST_DAMPING:
                x, cost = _clipped(x + step, low, high), max(cost - predicted_decrease, 0.0)
            return Minimum(x, cost, evaluations, True)
        trial = _clipped(x + step, low, high)
        trial_equations = normal(trial)
        evaluations += 1
        decrease = cost - _cost(trial_equations) if _is_finite(trial_equations) else -np.inf
        # The difference of two costs says whether a step was good only above its rounding.
        is_significant = predicted_decrease > COST_ROUNDING * cost
        if decrease >= -COST_ROUNDING * cost and (decrease > 0 or not is_significant):
            has_stalled = not is_significant and predicted_decrease > STALLED_DECREASE * earlier_decrease
            x, equations, earlier_decrease = trial, trial_equations, predicted_decrease
            if has_stalled:
                return Minimum(x, _cost(equations), evaluations, True)
            damping = next_damping(damping, decrease / predicted_decrease if is_significant else 1.0)
        elif damping >= MAX_DAMPING:
            return Minimum(x, cost, evaluations, not is_significant)
        else:
            damping = max(UPHILL_FACTOR * damping, FIRST_DAMPING)
    return Minimum(x, _cost(equations), evaluations, False)


def normal_by_differences(residual: Callable[[Floats], Floats], high: Floats) -> Callable[[Floats], Floats]:
    """Return the normal equations of a residual (n,) of unknowns (p,) of size 1, by differences below `high` (p,)."""

    def normal(x: Floats) -> Floats:
        """Return [r, J]^T [r, J] with forward differences, backward ones at the upper bound."""
        base = residual(x)
        columns = np.empty((1 + len(x), len(base)))
        columns[0] = base
        for i in range(len(x)):
            changed = x.copy()
            step = DIFFERENCE_STEP * max(abs(float(x[i])), 1.0)
            changed[i] += step if x[i] + step <= high[i] else -step
            columns[1 + i] = (residual(changed) - base) / (changed[i] - x[i])
        return columns @ columns.T

    return normal


def next_damping(damping: float, gain_ratio: float) -> float:
    """Return the damping after a step, by its gain ratio: actual over predicted decrease of the cost."""
    if gain_ratio < POOR_GAIN:
        return max(POOR_FACTOR * damping, POOR_DAMPING)
    if gain_ratio < GOOD_GAIN:
        return damping
    # Near the minimum the step is that of Gauss and Newton.
    return GOOD_FACTOR * damping if damping > MIN_KEPT_DAMPING else 0.0


def bounded_step(equations: Floats, low: Floats, high: Floats, damping: float = 0.0) -> tuple[Floats, float]:
    """Return the damped step of Gauss and Newton (p,) within bounds (p,), and by how much it should lower the cost.

    The equations [r, J]^T [r, J] (1 + p, 1 + p) are scaled, so that the diagonal of A = J^T J is 1.
    """
    lengths, slope, curvature = _scaled(equations)
    damped = [row.copy() for row in curvature]
    for i, row in enumerate(damped):
        row[i] += max(damping, MIN_DAMPING)
    # Without a bound in its way the step is one elimination.
    step = _by_elimination([row.copy() for row in damped], [-value for value in slope])
    if step is None or not _is_within(step, lengths, low.tolist(), high.tolist()):
        step = bounded_quadratic(np.array(damped), np.array(slope), low * lengths, high * lengths).tolist()
    # The decrease by the undamped quadratic: -b^T s - s^T A s/2.
    curved = [sum(map(mul, row, step)) for row in curvature]
    decrease = -sum(map(mul, step, slope)) - 0.5 * sum(map(mul, step, curved))
    return np.array([s / length for s, length in zip(step, lengths, strict=True)]), decrease


def _scaled(equations: Floats) -> tuple[list[float], list[float], list[list[float]]]:
    """Return lengths l (p,) of the columns of J, the slope b = J^T r / l (p,) and A = J^T J / (l l^T), by rows.

    A column of zeros has length 1. Plain floats, since numpy is slower for a few unknowns.
    """
    (_, *gradient), *rows = equations.tolist()
    lengths = [math.sqrt(row[i]) or 1.0 for i, row in enumerate(rows, 1)]
    curvature = []
    for row, length in zip(rows, lengths, strict=True):
        curvature.append([value / length / other for value, other in zip(row[1:], lengths, strict=True)])
    return lengths, [value / length for value, length in zip(gradient, lengths, strict=True)], curvature


def _is_within(step: list[float], lengths: list[float], low: list[float], high: list[float]) -> bool:
    """Return True if a scaled step keeps bounds of the unknowns; all (p,)."""
    for s, length, lower, upper in zip(step, lengths, low, high, strict=True):
        if not lower * length <= s <= upper * length:
            return False
    return True


def bounded_quadratic(curvature: Floats, slope: Floats, low: Floats, high: Floats) -> Floats:
    """Return the s (p,) that minimises s^T A s/2 + b^T s within bounds, low <= 0 <= high; A (p, p) positive definite.

    Active sets: a coordinate that meets its bound is fixed there, one whose force points inwards is released (Nocedal
    and Wright 2006, 16.5).
    """
    s = _unbounded(curvature, slope)
    if bool(((s >= low) & (s <= high)).all()):
        return s
    s, fixed = np.zeros(len(slope)), np.zeros(len(slope), bool)
    for _ in range(SETS_PER_UNKNOWN * len(slope)):
        # The minimum over the free coordinates, and the part of the way to it that is within the bounds.
        target, free = s.copy(), ~fixed
        if free.any():
            force = slope[free] + curvature[np.ix_(free, fixed)] @ s[fixed]
            target[free] = _unbounded(curvature[np.ix_(free, free)], force)
        direction = target - s
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(
                direction > 0, (high - s) / direction, np.where(direction < 0, (low - s) / direction, np.inf)
            )
        share = float(min(1.0, np.min(room, initial=np.inf)))
        s = np.clip(s + share * direction, low, high)
        if share < 1.0:
            blocking = int(np.argmin(room))
            s[blocking] = high[blocking] if direction[blocking] > 0 else low[blocking]
            fixed[blocking] = True
            continue
        # At the minimum of this set: release the coordinate that is pulled inwards most.
        gradient = curvature @ s + slope
        inward_force = np.where(fixed, np.where(s >= high, gradient, -gradient), -np.inf)
        inward_force[low == high] = -np.inf
        released = int(np.argmax(inward_force))
        if inward_force[released] <= RELEASE_ROUNDING * float(np.max(np.abs(slope), initial=TINY)):
            return s
        fixed[released] = False
    return s


def _cost(equations: Floats) -> float:
    """Return r^T r/2."""
    return 0.5 * float(equations[0, 0])


def _is_finite(equations: Floats) -> bool:
    """Return True if every entry is finite."""
    return math.isfinite(float(np.add.reduce(equations, axis=None))) or bool(np.isfinite(equations).all())


def _clipped(x: Floats, low: Floats, high: Floats) -> Floats:
    """Return unknowns (p,) within their bounds."""
    return np.minimum(np.maximum(x, low), high)


def _is_rounding(step: Floats, x: Floats) -> bool:
    """Return True if a step (p,) changes no unknown by more than its rounding."""
    return all(abs(s) <= STEP_ROUNDING * abs(value) for s, value in zip(step.tolist(), x.tolist(), strict=True))


def _unbounded(curvature: Floats, slope: Floats) -> Floats:
    """Return the s (p,) with A s = -b, A (p, p) positive definite."""
    s = _by_elimination(curvature.tolist(), (-slope).tolist())
    return np.asarray(np.linalg.solve(curvature, -slope), np.float64) if s is None else np.array(s)


def _by_elimination(matrix: list[list[float]], s: list[float]) -> list[float] | None:
    """Return the x (p,) with A x = s, A (p, p) positive definite; None where rounding makes it none. Changes both.

    L D L^T in plain numbers, faster than a call of LAPACK.
    """
    for k, row in enumerate(matrix):
        pivot = row[k]
        if not pivot > 0.0:
            return None
        for i in range(k + 1, len(s)):
            below = matrix[i]
            share = below[k] / pivot
            if share:
                for j in range(k + 1, i + 1):
                    below[j] -= share * matrix[j][k]
                s[i] -= share * s[k]
    # Back substitution.
    for k in range(len(s) - 1, -1, -1):
        for i in range(k + 1, len(s)):
            s[k] -= matrix[i][k] * s[i]
        s[k] /= matrix[k][k]
    return s
