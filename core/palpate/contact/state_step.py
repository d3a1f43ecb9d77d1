"""One step of a material's internal states, from the expression of their rate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_SERIES_BELOW = 0.25  # z of an interval, below which the moments are taken from their series
_SERIES_TERMS = 10  # the next one is at most 0.25^10 2/12!, 4e-15 of 1


def advance_states(slope: Callable[[float, Any], Any], step: Any, memory: Any) -> Any:
    """Return states x (k, 1) after a step h [s], from the `memory` at its beginning and the rate f(u, x), the `slope`.

    The rate is a function of the share u of the step, 0 to 1, and of the states there.

    By `fade_states` where each state fades by itself, with no limit to the step, else by the classical Runge-Kutta
    method of order 4::

        x + h/6 (k1 + 2 k2 + 2 k3 + k4)    k1 = f(0, x)    k2 = f(1/2, x + h/2 k1)
        k3 = f(1/2, x + h/2 k2)            k4 = f(1, x + h k3)
    """
    faded = fade_states(slope, step, memory)
    if faded is not None:
        return faded
    k1 = slope(0.0, memory)
    k2 = slope(0.5, memory + 0.5 * step * k1)
    k3 = slope(0.5, memory + 0.5 * step * k2)
    k4 = slope(1.0, memory + step * k3)
    return memory + step / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)


def fade_states(slope: Callable[[float, Any], Any], step: Any, memory: Any) -> Any | None:
    """Return states q(h) (k, 1) after a step h [s], from q(0), the `memory`, and their slopes dq/dt = l(u) - c(u) q.

    `slope` returns dq/dt at a share u of the step and at states. None where c of a state depends on a state, or the
    slope of a state on another one.

        q(h) = e^-z q(0) + h int_0^1 e^(-z (1 - u)) l(u) du

    z is h times the mean of c, by Simpson's rule from c at u = 0, 1/2 and 1. The load l is the parabola through its
    values there, and its integral is exact. This is an exponential integrator (Hochbruck and Ostermann 2010), exact for
    any z where c stays the same and l is a parabola. Where an arm fades much faster than the step, q = l/c remains,
    which is the force of a damper. Runge and Kutta's method of order 4 leaves for infinity from z = 2.8 on.
    """
    import casadi as ca

    count = int(memory.numel())
    loads, fading_rates = [], []
    for share in (0.0, 0.5, 1.0):
        # The step begins at an expression; the derivative needs a symbol.
        state = ca.SX.sym("q", count)
        state_rate = slope(share, state)  # dq/dt = l - c q
        jacobian = ca.jacobian(state_rate, state)
        if not fades_separately(jacobian, state):
            return None
        fading_rates.append(-ca.diag(jacobian))  # c
        loads.append(ca.substitute(state_rate, state, ca.SX.zeros(count)))  # l, the rate at q = 0
    # Simpson's rule for the mean of c over the step.
    z = step * (fading_rates[0] + 4.0 * fading_rates[1] + fading_rates[2]) / 6.0
    # The parabola l = l0 + l1 u + l2 u^2 through the loads at u = 0, 1/2, 1, and its integral.
    first, middle, last = loads
    linear = -3.0 * first + 4.0 * middle - last
    quadratic = 2.0 * first - 4.0 * middle + 2.0 * last
    moment_0, moment_1, moment_2 = _moments(z)
    return ca.exp(-z) * memory + step * (first * moment_0 + linear * moment_1 + quadratic * moment_2)


def fades_separately(jacobian: Any, states: Any) -> bool:
    """Return True where the Jacobian (k, k) of the states' rates is diagonal and does not depend on the states."""
    import casadi as ca

    count = int(states.numel())
    is_diagonal = (jacobian.sparsity() + ca.Sparsity.diag(count)).nnz() <= count
    return is_diagonal and not ca.depends_on(jacobian, states)


def _moments(z: Any) -> tuple[Any, Any, Any]:
    """Return the moments M_k = int_0^1 e^(-z (1 - u)) u^k du for k = 0, 1, 2.

    M_0 = (1 - e^-z)/z and M_k = (1 - k M_(k-1))/z, which cancel for a small z: there M_2 is the series
    1/3 - z/(3 4) + z^2/(3 4 5) - ..., and M_(k-1) = (1 - z M_k)/k.
    """
    import casadi as ca

    # Both branches of a choice are evaluated, with their slopes: neither may divide by 0.
    is_small = z < _SERIES_BELOW
    large_z = ca.if_else(is_small, 1.0 + 0.0 * z, z)
    small_z = ca.if_else(is_small, z, 0.0 * z)
    forward_0 = (1.0 - ca.exp(-large_z)) / large_z
    forward_1 = (1.0 - forward_0) / large_z
    forward_2 = (1.0 - 2.0 * forward_1) / large_z
    # The series by Horner's rule, from its last term.
    series_2: Any = 1.0
    for j in range(_SERIES_TERMS + 2, 3, -1):
        series_2 = 1.0 - small_z / j * series_2
    series_2 = series_2 / 3.0
    series_1 = (1.0 - small_z * series_2) / 2.0
    series_0 = 1.0 - small_z * series_1
    return (
        ca.if_else(is_small, series_0, forward_0),
        ca.if_else(is_small, series_1, forward_1),
        ca.if_else(is_small, series_2, forward_2),
    )
