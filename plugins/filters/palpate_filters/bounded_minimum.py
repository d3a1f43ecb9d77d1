"""The least value of a function of one number between two others, without the import of `scipy.optimize`."""

from __future__ import annotations

import math
from collections.abc import Callable

_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))  # share of the interval that a golden section cuts off
_PRECISION = math.sqrt(2.2e-16)  # relative: near a minimum a double shows no smaller step (Brent 1973)
_MAX_EVALUATIONS = 500  # a choice: golden sections alone reach the precision in 40


def bounded_minimum(
    function: Callable[[float], float], low: float, high: float, tolerance: float
) -> tuple[float, float]:
    """Return the minimiser of a function between `low` and `high`, to a tolerance, and the minimum.

    By golden sections, and parabolas through the three best points where they stay within (R. P. Brent, Algorithms for
    Minimization without Derivatives, 1973, chapter 5). A parabola's step must be below half of the last step but one,
    so that the steps shrink; no step is below the precision, and none ends so near a bound.
    """
    x = second = third = low + _GOLDEN * (high - low)  # the three best points
    fx = f_second = f_third = function(x)
    step = step_before = 0.0
    for _ in range(_MAX_EVALUATIONS - 1):
        middle = 0.5 * (low + high)
        min_step = _PRECISION * abs(x) + tolerance / 3.0
        if abs(x - middle) <= 2.0 * min_step - 0.5 * (high - low):
            break
        # A parabola's step where it is admitted, else a golden section of the longer side.
        parabola = None
        if abs(step_before) > min_step:
            parabola = _parabola(
                to_second=x - second,
                to_third=x - third,
                above_second=fx - f_second,
                above_third=fx - f_third,
                step_before=step_before,
                low=low - x,
                high=high - x,
            )
            step_before = step
        if parabola is None:
            step_before = (low if x >= middle else high) - x
            step = _GOLDEN * step_before
        else:
            step = parabola
            if x + step - low < 2.0 * min_step or high - (x + step) < 2.0 * min_step:
                step = min_step if middle >= x else -min_step
        length = max(abs(step), min_step)
        trial = x + length if step >= 0.0 else x - length
        f_trial = function(trial)
        # The bracket shrinks to the better side, and the three best points are sorted again.
        if f_trial <= fx:
            low, high = (x, high) if trial >= x else (low, x)
            third, f_third = second, f_second
            second, f_second = x, fx
            x, fx = trial, f_trial
            continue
        low, high = (trial, high) if trial < x else (low, trial)
        if f_trial <= f_second or second == x:
            third, f_third = second, f_second
            second, f_second = trial, f_trial
        elif f_trial <= f_third or third in (x, second):
            third, f_third = trial, f_trial
    return x, fx


def _parabola(
    to_second: float,
    to_third: float,
    above_second: float,
    above_third: float,
    step_before: float,
    low: float,
    high: float,
) -> float | None:
    """Return the step to the lowest point of the parabola through three points; None if too long or outside."""
    r, q = to_second * above_third, to_third * above_second
    p, q = to_third * q - to_second * r, 2.0 * (q - r)
    p, q = (-p if q > 0.0 else p), abs(q)
    return p / q if abs(p) < abs(0.5 * q * step_before) and q * low < p < q * high else None
