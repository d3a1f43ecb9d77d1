"""The least value of a function of one number between two others, without the import of `scipy.optimize`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))  # share of the interval that a golden section cuts off
_PRECISION = math.sqrt(2.2e-16)  # relative: near a minimum a double shows no smaller step (Brent 1973)
_MAX_EVALUATIONS = 500  # a choice: golden sections alone reach the precision in 40


def bounded_minimum(
    function: Callable[[float], float], low: float, high: float, tolerance: float
) -> tuple[float, float]:
    """Return the minimiser of a function between `low` and `high`, to a tolerance, and the minimum.

    By golden sections, and parabolas through the three best points where they stay within (R. P. Brent, Algorithms for
    Minimization without Derivatives, 1973, chapter 5). A parabola's step must be below half of the last step but one,
    so that the steps shrink; no step is below the precision, and none ends so near a bound. The search ends where both
    bounds are within twice the least step of the best point.
    """
    first = low + _GOLDEN * (high - low)
    points = _BestPoints.at(first, function(first))
    step = step_before = 0.0
    for _ in range(_MAX_EVALUATIONS - 1):
        x = points.x
        middle = 0.5 * (low + high)
        min_step = _PRECISION * abs(x) + tolerance / 3.0
        if abs(x - middle) <= 2.0 * min_step - 0.5 * (high - low):
            break
        # A parabola's step where it is admitted, else a golden section of the longer side.
        parabola_step = None
        if abs(step_before) > min_step:
            parabola_step = points.parabola_step(step_before, low, high)
            step_before = step
        if parabola_step is None:
            step_before = (low if x >= middle else high) - x
            step = _GOLDEN * step_before
        elif x + parabola_step - low < 2.0 * min_step or high - (x + parabola_step) < 2.0 * min_step:
            step = min_step if middle >= x else -min_step
        else:
            step = parabola_step
        length = max(abs(step), min_step)
        trial = x + length if step >= 0.0 else x - length
        f_trial = function(trial)
        # The bracket keeps the better of the two points within, with what lies beyond it.
        if f_trial <= points.fx:
            low, high = (x, high) if trial >= x else (low, x)
        else:
            low, high = (trial, high) if trial < x else (low, trial)
        points.insert(trial, f_trial)
    return points.x, points.fx


@dataclass
class _BestPoints:
    """The three best points of a search in their order, with the function's values there; some may be the same."""

    x: float
    fx: float
    second: float
    f_second: float
    third: float
    f_third: float

    @classmethod
    def at(cls, x: float, fx: float) -> _BestPoints:
        """Return one point as all three."""
        return cls(x=x, fx=fx, second=x, f_second=fx, third=x, f_third=fx)

    def insert(self, trial: float, f_trial: float) -> None:
        """Sort a further point among the three."""
        if f_trial <= self.fx:
            self.third, self.f_third = self.second, self.f_second
            self.second, self.f_second = self.x, self.fx
            self.x, self.fx = trial, f_trial
        elif f_trial <= self.f_second or self.second == self.x:
            self.third, self.f_third = self.second, self.f_second
            self.second, self.f_second = trial, f_trial
        elif f_trial <= self.f_third or self.third in (self.x, self.second):
            self.third, self.f_third = trial, f_trial

    def parabola_step(self, step_before: float, low: float, high: float) -> float | None:
        """Return the step from x to the lowest point of the parabola through the three.

        With the others at x - a and x - b, where the function is higher than at x by A and B, that step is

            (b^2 A - a^2 B) / (2 (a B - b A)).

        None where it is not below half of `step_before`, or ends outside `low` and `high`.
        """
        # The step is p/q, with q turned positive so that the comparisons need no division.
        to_second, to_third = self.x - self.second, self.x - self.third
        r, q = to_second * (self.fx - self.f_third), to_third * (self.fx - self.f_second)
        p, q = to_third * q - to_second * r, 2.0 * (q - r)
        p, q = (-p if q > 0.0 else p), abs(q)
        is_admitted = abs(p) < abs(0.5 * q * step_before) and q * (low - self.x) < p < q * (high - self.x)
        return p / q if is_admitted else None
