"""Checks that any expression of a depth has to pass: one value for every kind of number, without jumps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from palpate import Floats

from palpate_testing.failure_messages import demand, demand_close

DEPTHS = np.geomspace(1e-6, 6e-3, 60)  # [m], a palpation's range
ROUNDING = 1e-12  # of a value
MAX_JUMP = 1e-3  # of the largest value, across a billionth of an interval of depths
BISECTIONS = 30


def values_of(function: Callable[[Any], Any], depths: Floats, name: str) -> Floats:
    """Return the values (n,) at depths (n,) [m], one at a time, so that what raises is named with its depth."""
    values = []
    for depth in depths.tolist():
        try:
            value = float(function(depth))
        except Exception as error:
            raise AssertionError(f"{name} raises at depth {depth:.3g} m: {type(error).__name__}: {error}") from error
        demand(np.isfinite(value), f"{name} is {value} at depth {depth:.3g} m")
        values.append(value)
    return np.array(values)


def demand_rising(values: Floats, depths: Floats, name: str) -> None:
    """Raise AssertionError where values (n,) fall over depths (n,) [m]."""
    falls = np.flatnonzero(np.diff(values) < -ROUNDING * np.abs(values[1:]))
    where = depths[falls[0]] if len(falls) else 0.0
    demand(not len(falls), f"{name} is not monotone: it falls beyond a depth of {where:.3g} m")


def demand_continuous(function: Callable[[Any], Any], depths: Floats, name: str) -> None:
    """Raise AssertionError where a function of the depth jumps.

    Each interval is halved again and again to the side of the larger change; a change that is left is a jump.
    """
    left, right = depths[:-1].copy(), depths[1:].copy()
    at_left, at_right = (np.asarray(function(side), float) + 0.0 * side for side in (left, right))
    scale = float(np.max(np.abs(at_right)))
    for _ in range(BISECTIONS):
        middle = (left + right) / 2
        at_middle = np.asarray(function(middle), float) + 0.0 * middle
        is_left = np.abs(at_middle - at_left) >= np.abs(at_right - at_middle)
        right, at_right = np.where(is_left, middle, right), np.where(is_left, at_middle, at_right)
        left, at_left = np.where(is_left, left, middle), np.where(is_left, at_left, at_middle)
    jump = np.abs(at_right - at_left)
    worst = int(np.argmax(jump))
    demand(jump[worst] <= MAX_JUMP * scale, f"{name} jumps by {jump[worst]:.3g} at a depth of {left[worst]:.3g} m")


def demand_same_everywhere(function: Callable[[Any], Any], depths: Floats, name: str) -> None:
    """Raise AssertionError unless floats, an array and a CasADi symbol give the same values."""
    import casadi

    floats = np.array([float(function(float(depth))) for depth in depths])
    demand_close(answer_on(function, depths, f"{name} on an array"), floats, 1e-12, f"{name} on an array")
    symbol = casadi.SX.sym("d")
    compiled = casadi.Function("f", [symbol], [answer_on(function, symbol, f"{name} on a CasADi symbol")])
    demand_close([float(compiled(float(d))) for d in depths], floats, 1e-9, f"{name} on a CasADi symbol")


def answer_on(function: Callable[[Any], Any], argument: Any, name: str) -> Any:
    """Return a function's answer; raises AssertionError with the remedy where it raises."""
    try:
        return function(argument)
    except Exception as error:
        remedy = "use plain operators, or log, sqrt, tanh, arctan, select of palpate"
        raise AssertionError(f"{name} raises {type(error).__name__}: {error}; {remedy}") from error
