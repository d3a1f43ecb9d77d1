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

_LEAST = 1e-13  # damping, of the scaled squares: what is not determined at all stays where it is
_FIRST, _MOST = 1e-3, 1e12  # damping after a step that led uphill, and where there is nothing left to gain
_ROUNDING = 1e-13  # of the cost, below which a difference of two of them is rounding
_DIFFERENCE = 1.5e-8  # of a value, over which a slope is taken
_STILL = 1e-13  # of a value
_SLOW = 0.9  # of the gain before: less than that, and steps no longer come nearer


@dataclass(frozen=True)
class Minimum:
    """Where a sum of squares is least."""

    x: Floats  # (p,)
    cost: float  # half of the sum
    evaluations: int
    converged: bool


def least_squares(
    normal: Callable[[Floats], Floats], x: Floats, low: Floats, high: Floats, most: int = 200, gain: float = 1e-22
) -> Minimum:
    """The minimum of r^T r/2 within bounds (p,), from a start x (p,).

    `normal` gives [r, J]^T [r, J] (1 + p, 1 + p) at unknowns (p,). Ends where another step would lower the cost by less
    than a share `gain` of it, and takes that step: with n independent residuals it is sqrt(n gain) standard deviations
    long.
    """
    x = _within(x, low, high)
    square, evaluations, damping, before = normal(x), 1, 0.0, np.inf
    if not _finite(square):
        return Minimum(x, 0.5 * float(square[0, 0]), evaluations, False)
    while evaluations < most:
        cost = 0.5 * float(square[0, 0])
        step, gained = bounded_step(square, low - x, high - x, damping)
        still = all(abs(s) <= _STILL * abs(v) for s, v in zip(step.tolist(), x.tolist(), strict=True))
        if gained <= gain * cost or still:
            if damping <= _FIRST:
                x, cost = _within(x + step, low, high), max(cost - gained, 0.0)
            return Minimum(x, cost, evaluations, True)
        there = _within(x + step, low, high)
        tried = normal(there)
        evaluations += 1
        fallen = cost - 0.5 * float(tried[0, 0]) if _finite(tried) else -np.inf
        if fallen >= -_ROUNDING * cost and (fallen > 0 or gained <= _ROUNDING * cost):
            significant = gained > _ROUNDING * cost  # by the difference of the costs, whether the step was good
            slow = not significant and gained > _SLOW * before
            x, square, before = there, tried, gained
            if slow:
                return Minimum(x, 0.5 * float(square[0, 0]), evaluations, True)
            damping = _eased(damping, fallen / gained if significant else 1.0)
        elif damping >= _MOST:
            return Minimum(x, cost, evaluations, gained <= _ROUNDING * cost)
        else:
            damping = max(10.0 * damping, _FIRST)
    return Minimum(x, 0.5 * float(square[0, 0]), evaluations, False)


def normal_by_differences(residual: Callable[[Floats], Floats], high: Floats) -> Callable[[Floats], Floats]:
    """The normal equations of a residual (n,) of unknowns (p,) of size 1, its slopes by differences below `high`."""

    def normal(x: Floats) -> Floats:
        at = residual(x)
        both = np.empty((1 + len(x), len(at)))
        both[0] = at
        for i in range(len(x)):
            there = x.copy()
            step = _DIFFERENCE * max(abs(float(x[i])), 1.0)
            there[i] += step if x[i] + step <= high[i] else -step
            both[1 + i] = (residual(there) - at) / (there[i] - x[i])
        return both @ both.T

    return normal


def _finite(square: Floats) -> bool:
    return math.isfinite(float(np.add.reduce(square, axis=None))) or bool(np.isfinite(square).all())


def _within(x: Floats, low: Floats, high: Floats) -> Floats:
    return np.minimum(np.maximum(x, low), high)


def _eased(damping: float, ratio: float) -> float:
    """The damping after a step that gained so much of what it promised."""
    if ratio < 0.25:
        return max(2.0 * damping, 1e-2 * _FIRST)
    return damping if ratio < 0.75 else (0.1 * damping if damping > 1e-3 * _FIRST else 0.0)


def bounded_step(square: Floats, low: Floats, high: Floats, damping: float = 0.0) -> tuple[Floats, float]:
    """The damped step of Gauss and Newton (p,) between `low` and `high`, and by how much it lowers the cost if it is
    right."""
    (_, *slope), *rows = square.tolist()
    lengths = [math.sqrt(row[i]) or 1.0 for i, row in enumerate(rows, 1)]
    scaled = [
        [value / one / other for value, other in zip(row[1:], lengths, strict=True)]
        for row, one in zip(rows, lengths, strict=True)
    ]
    slope = [value / length for value, length in zip(slope, lengths, strict=True)]
    damped = [row.copy() for row in scaled]
    for i, row in enumerate(damped):
        row[i] += max(damping, _LEAST)
    edges = low.tolist(), high.tolist()
    step = _eliminated([row.copy() for row in damped], [-value for value in slope])
    inside = step is not None and all(
        lo * length <= s <= hi * length for s, length, lo, hi in zip(step, lengths, *edges, strict=True)
    )
    if step is None or not inside:
        step = bounded_quadratic(np.array(damped), np.array(slope), low * lengths, high * lengths).tolist()
    bent = [sum(map(mul, row, step)) for row in scaled]
    gained = -sum(map(mul, step, slope)) - 0.5 * sum(map(mul, step, bent))
    return np.array([s / length for s, length in zip(step, lengths, strict=True)]), gained


def bounded_quadratic(curvature: Floats, slope: Floats, low: Floats, high: Floats) -> Floats:
    """The s (p,) that makes s^T A s/2 + b^T s least between bounds, low <= 0 <= high; A (p, p) positive definite.

    Active sets: what leaves its bounds is held there, what pulls inwards is let go (Nocedal and Wright 2006, 16.5).
    """
    s = _solved(curvature, slope)
    if bool(((s >= low) & (s <= high)).all()):
        return s
    s, held = np.zeros(len(slope)), np.zeros(len(slope), bool)
    for _ in range(8 * len(slope)):
        wanted = s.copy()
        loose = ~held
        if loose.any():
            pull = slope[loose] + curvature[np.ix_(loose, held)] @ s[held]
            wanted[loose] = _solved(curvature[np.ix_(loose, loose)], pull)
        way = wanted - s
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(way > 0, (high - s) / way, np.where(way < 0, (low - s) / way, np.inf))
        share = float(min(1.0, np.min(room, initial=np.inf)))
        s = np.clip(s + share * way, low, high)
        if share < 1.0:
            blocking = int(np.argmin(room))
            s[blocking] = high[blocking] if way[blocking] > 0 else low[blocking]
            held[blocking] = True
            continue
        force = curvature @ s + slope
        inwards = np.where(held, np.where(s >= high, force, -force), -np.inf)
        inwards[low == high] = -np.inf
        loosest = int(np.argmax(inwards))
        if inwards[loosest] <= 1e-12 * float(np.max(np.abs(slope), initial=1e-300)):
            return s
        held[loosest] = False
    return s


def _solved(curvature: Floats, slope: Floats) -> Floats:
    """The s (p,) with A s = -b, A (p, p) positive definite."""
    found = _eliminated(curvature.tolist(), (-slope).tolist())
    return np.asarray(np.linalg.solve(curvature, -slope), np.float64) if found is None else np.array(found)


def _eliminated(left: list[list[float]], s: list[float]) -> list[float] | None:
    """The x (p,) with A x = s, A (p, p) positive definite; None where rounding makes it none. Changes both.

    L D L^T in plain numbers, faster than a call of LAPACK.
    """
    for k, row in enumerate(left):
        pivot = row[k]
        if not pivot > 0.0:
            return None
        for i in range(k + 1, len(s)):
            below = left[i]
            share = below[k] / pivot
            if share:
                for j in range(k + 1, i + 1):
                    below[j] -= share * left[j][k]
                s[i] -= share * s[k]
    for k in range(len(s) - 1, -1, -1):
        for i in range(k + 1, len(s)):
            s[k] -= left[i][k] * s[i]
        s[k] /= left[k][k]
    return s
