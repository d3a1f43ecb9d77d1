"""The least value of a function of one number between two others, without the import of `scipy.optimize`."""

from __future__ import annotations

import math
from collections.abc import Callable

_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
_PRECISION = math.sqrt(2.2e-16)
_MOST = 500


def bounded_minimum(
    function: Callable[[float], float], low: float, high: float, tolerance: float
) -> tuple[float, float]:
    """Where a function is least between `low` and `high`, to a tolerance, and its value there.

    By golden sections, and parabolas through the three best points where they stay within (Brent 1973).
    """
    x = second = third = low + _GOLDEN * (high - low)
    fx = f_second = f_third = function(x)
    step = before = 0.0
    for _ in range(_MOST - 1):
        middle, near = 0.5 * (low + high), _PRECISION * abs(x) + tolerance / 3.0
        if abs(x - middle) <= 2.0 * near - 0.5 * (high - low):
            break
        parabola = None
        if abs(before) > near:
            parabola = _parabola(x - second, x - third, fx - f_second, fx - f_third, before, low - x, high - x)
            before = step
        if parabola is None:
            before = (low if x >= middle else high) - x
            step = _GOLDEN * before
        else:
            step = parabola
            if x + step - low < 2.0 * near or high - (x + step) < 2.0 * near:
                step = near if middle >= x else -near
        length = max(abs(step), near)
        u = x + length if step >= 0.0 else x - length
        fu = function(u)
        if fu <= fx:
            low, high = (x, high) if u >= x else (low, x)
            third, f_third, second, f_second, x, fx = second, f_second, x, fx, u, fu
            continue
        low, high = (u, high) if u < x else (low, u)
        if fu <= f_second or second == x:
            third, f_third, second, f_second = second, f_second, u, fu
        elif fu <= f_third or third in (x, second):
            third, f_third = u, fu
    return x, fx


def _parabola(
    to_second: float, to_third: float, above_second: float, above_third: float, before: float, low: float, high: float
) -> float | None:
    """The step to the lowest point of the parabola through three points; None where it is too far or leads outside."""
    r, q = to_second * above_third, to_third * above_second
    p, q = to_third * q - to_second * r, 2.0 * (q - r)
    p, q = (-p if q > 0.0 else p), abs(q)
    return p / q if abs(p) < abs(0.5 * q * before) and q * low < p < q * high else None
