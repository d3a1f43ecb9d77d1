"""Internal states that fade each by itself, over an interval of any length: no step is too long for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_SMALL = 0.25  # of forgetting in an interval, below which series are exact
_TERMS = 10


def fade_states(slope: Callable[[float, Any], Any], step: Any, memory: Any) -> Any | None:
    """States (k, 1) after an interval, from slopes dq/dt = l - c q at shares 0, 1/2 and 1 of it; None of any others.

    q(h) = e^-z q(0) + h int_0^1 e^(-z (1 - u)) l(u) du with z = h c by Simpson's rule and l the parabola through its
    three values: an exponential integrator (Hochbruck and Ostermann 2010), exact for any z where c stays the same and l
    is a parabola. Runge and Kutta's method of order 4 leaves for infinity from z = 2.8 on.
    """
    import casadi as ca

    count = int(memory.numel())
    loads, rates = [], []
    for share in (0.0, 0.5, 1.0):
        change = slope(share, memory)
        jacobian = ca.jacobian(change, memory)
        if (jacobian.sparsity() + ca.Sparsity.diag(count)).nnz() > count or ca.depends_on(jacobian, memory):
            return None
        rates.append(-ca.diag(jacobian))
        loads.append(ca.substitute(change, memory, ca.SX.zeros(count)))
    z = step * (rates[0] + 4.0 * rates[1] + rates[2]) / 6.0
    first, middle, last = loads
    constant, linear, square = _moments(z)
    rising = -3.0 * first + 4.0 * middle - last
    bent = 2.0 * first - 4.0 * middle + 2.0 * last
    return ca.exp(-z) * memory + step * (first * constant + rising * linear + bent * square)


def _moments(z: Any) -> tuple[Any, Any, Any]:
    """int_0^1 e^(-z (1 - u)) u^k du for k = 0, 1, 2."""
    import casadi as ca

    small = z < _SMALL
    away = ca.if_else(small, 1.0 + 0.0 * z, z)  # both branches are evaluated, and so are their slopes
    near = ca.if_else(small, z, 0.0 * z)
    found, before = [], None
    for k in range(3):
        far = (1.0 - (ca.exp(-away) if before is None else k * before)) / away
        term: Any = 1.0 / (k + 1.0)
        series = term + 0.0 * near
        for j in range(1, _TERMS):
            term = -term * near / (k + j + 1.0)
            series = series + term
        found.append(ca.if_else(small, series, far))
        before = far
    return found[0], found[1], found[2]
