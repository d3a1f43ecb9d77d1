"""Checks that any expression of a depth has to pass: one value for every kind of number, without jumps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from palpate import Floats

from palpate_testing.failure_messages import demand, demand_close

DEPTHS = np.geomspace(1e-6, 6e-3, 60)  # [m], a palpation's range
ROUNDING = 1e-12  # of a value (a choice: some thousand units of a double)
SYMBOL_ROUNDING = 1e-9  # of the largest value: CasADi may order the operations otherwise (a choice)
MAX_JUMP = 1e-3  # of the largest value, across a billionth of an interval of depths (a choice)
BISECTIONS = 30  # 2^-30 is a billionth


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
    first = depths[falls[0]] if len(falls) else 0.0
    demand(not len(falls), f"{name} is not monotone: it falls beyond a depth of {first:.3g} m")


def demand_continuous(function: Callable[[Any], Any], depths: Floats, name: str) -> None:
    """Raise AssertionError where a function of the depth jumps.

    Each interval between depths (n,) [m] is halved again and again, to the half with the larger change of the function.
    A change that remains over a billionth of the interval is a jump.
    """
    low, high = depths[:-1].copy(), depths[1:].copy()
    f_low, f_high = _array_values(function, low), _array_values(function, high)
    scale = float(np.max(np.abs(f_high)))
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        f_middle = _array_values(function, middle)
        is_lower_half = np.abs(f_middle - f_low) >= np.abs(f_high - f_middle)
        high, f_high = np.where(is_lower_half, middle, high), np.where(is_lower_half, f_middle, f_high)
        low, f_low = np.where(is_lower_half, low, middle), np.where(is_lower_half, f_low, f_middle)
    jump = np.abs(f_high - f_low)
    worst = int(np.argmax(jump))
    demand(jump[worst] <= MAX_JUMP * scale, f"{name} jumps by {jump[worst]:.3g} at a depth of {low[worst]:.3g} m")


def _array_values(function: Callable[[Any], Any], depths: Floats) -> Floats:
    """Return the values (n,) at depths (n,) [m], also of a function that gives one number for all."""
    return np.asarray(np.asarray(function(depths), float) + 0.0 * depths)


def demand_same_everywhere(function: Callable[[Any], Any], depths: Floats, name: str) -> None:
    """Raise AssertionError unless floats, an array and a CasADi symbol give the same values."""
    import casadi

    floats = np.array([float(function(float(depth))) for depth in depths])
    demand_close(answer_on(function, depths, f"{name} on an array"), floats, ROUNDING, f"{name} on an array")
    symbol = casadi.SX.sym("d")
    compiled = casadi.Function("f", [symbol], [answer_on(function, symbol, f"{name} on a CasADi symbol")])
    symbolic = [float(compiled(float(depth))) for depth in depths]
    demand_close(symbolic, floats, SYMBOL_ROUNDING, f"{name} on a CasADi symbol")


def answer_on(function: Callable[[Any], Any], argument: Any, name: str) -> Any:
    """Return a function's answer; raises AssertionError with the remedy where it raises."""
    try:
        return function(argument)
    except Exception as error:
        remedy = "use plain operators, or log, sqrt, tanh, arctan, select of palpate"
        raise AssertionError(f"{name} raises {type(error).__name__}: {error}; {remedy}") from error
