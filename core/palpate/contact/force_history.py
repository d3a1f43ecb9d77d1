"""Forces over a motion, for models with and without memory."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.contact.interfaces import ContactModel, contact_force
from palpate.contact.state_step import advance_states, fades_separately
from palpate.vectors import Floats

_MIN_STEPS = 4  # a choice: steps of the integration from one sample to the next, for one in which the tip touches
_MAX_STEPS = 64  # a choice: more are too slow, and the samples too far apart
_STEP_TIMES_RATE = 0.25  # a choice: Runge-Kutta's local error is then some 1e-5 of a state's change in the step
_BLOCK = 64  # a choice: intervals in one call
_RATE_CHECKS = 50  # a choice: samples at which the fastest rate is looked for
_INTERVAL_COLUMNS = 5  # length, depth and rate at the beginning, depth and rate at the end
_MS = 1e3  # per second
# By identity: a third-party model need not be hashable.
_FUNCTIONS: dict[int, tuple[weakref.ref[Any], dict[tuple[int, int], Any]]] = {}


def force_over_time(
    model: ContactModel,
    time: Floats,
    depth: Floats,
    rate: Floats,
    theta: Sequence[float] | Floats,
    *,
    memory: Sequence[float] | None = None,
    pulls: bool = True,
) -> Floats:
    """Return the force (n,) [N] at instants (n,) [s] of a motion given by depth (n,) [m] and its rate (n,) [m/s].

    The parameters are one set (k,), or that of each instant (n, k), which also holds for the interval that ends there.
    Internal states start from `memory` (none given: 0, a material at rest) and are integrated by `advance_states`
    between the instants, over which the depth is the cubic that has the given depths and rates. `pulls` as in
    `contact_force`. Raises ValueError where states that depend on each other change so fast that the instants are too
    far apart.
    """
    time, depth, rate, theta = (np.asarray(values, float) for values in (time, depth, rate, theta))
    values = list(theta.T) if theta.ndim > 1 else theta.tolist()
    if not model.memory:
        return np.asarray(contact_force(model, depth, rate, values, pulls=pulls), float)
    states = memory_over_time(model, time, depth, rate, theta, memory)
    return np.asarray(contact_force(model, depth, rate, values, list(states.T), pulls=pulls), float)


def memory_over_time(
    model: ContactModel,
    time: Floats,
    depth: Floats,
    rate: Floats,
    theta: Sequence[float] | Floats,
    memory: Sequence[float] | None = None,
) -> Floats:
    """Return internal states (n, k) over a motion; see `force_over_time`."""
    count = len(model.memory)
    states = np.zeros((len(time), count))
    if not len(time):
        return states
    # Parameters of each instant, and steps for the fastest of the states.
    states[0] = 0.0 if memory is None else memory
    rows = np.broadcast_to(np.asarray(theta, float), (len(time), len(model.parameters)))
    steps = _step_count(model, time, depth, rate, rows)
    # Length of each interval, depth and rate at its beginning and end; whole blocks first, then single intervals.
    intervals = np.column_stack([np.diff(time), depth[:-1], rate[:-1], depth[1:], rate[1:]])
    first = 0
    for block in (_BLOCK, 1):
        remaining = len(intervals) - first
        last = first + remaining - remaining % block
        _integrate(_function(model, steps, block), states[first:], intervals[first:last], rows[first + 1 :], block)
        first = last
    return states


def _integrate(function: Any, states: Floats, intervals: Floats, theta: Floats, block: int) -> None:
    """Fill in the states (m + 1, k) after intervals (m, 5) with parameters (m, p); the first row is given.

    A row of the intervals has length [s], depth [m] and rate [m/s] at its beginning, then both at its end. `function`
    is that of `block` intervals, by which m can be divided.
    """
    # The function reads and writes these arrays: a call through its buffer costs a twentieth of an ordinary one.
    state, values = np.empty(states.shape[1]), np.empty((block, theta.shape[1]))
    block_intervals, block_states = np.empty((block, _INTERVAL_COLUMNS)), np.empty((block, states.shape[1]))
    buffer, evaluate = function.buffer()
    for i, array in enumerate((state, block_intervals, values)):
        buffer.set_arg(i, memoryview(array.data))
    buffer.set_res(0, memoryview(block_states.data))
    for i in range(0, len(intervals), block):
        state[:] = states[i]
        block_intervals[:] = intervals[i : i + block]
        values[:] = theta[i : i + block]
        evaluate()
        states[i + 1 : i + 1 + block] = block_states


def _step_count(model: ContactModel, time: Floats, depth: Floats, rate: Floats, theta: Floats) -> int:
    """Return the number of steps of integration that an interval between two instants needs.

    Where each state fades by itself any step is long enough; else it is by the largest rate at which any forgets [1/s].
    Raises ValueError where that rate is not finite, or an interval needs more than 64 steps.
    """
    import casadi

    # The rate at which states forget, along the motion and from rest.
    rows = np.linspace(0, len(depth) - 1, min(len(depth), _RATE_CHECKS)).astype(int)
    motion = casadi.DM(np.array([depth[rows], rate[rows]]))
    at_rest, values = casadi.DM.zeros(len(model.memory), len(rows)), casadi.DM(theta[rows].T)
    rates, fades = _function(model, 0)(at_rest, motion, values)  # of 0 steps: the rates, and whether states fade
    fastest = float(np.max(np.array(rates)))
    longest = float(np.max(np.diff(time), initial=0.0))
    if not math.isfinite(fastest):
        raise ValueError(f"{type(model).__name__}.memory_rate is not finite")
    if np.all(np.array(fades)):
        return _MIN_STEPS
    steps = max(_MIN_STEPS, math.ceil(fastest * longest / _STEP_TIMES_RATE))
    if steps > _MAX_STEPS:
        raise ValueError(
            f"{type(model).__name__} forgets within {_MS / fastest:.3g} ms: too fast for samples every "
            f"{_MS * longest:.3g} ms"
        )
    return steps


def _function(model: ContactModel, steps: int, block: int = 1) -> Any:
    """Return the function of a block of intervals of so many steps, or of forgetting (0), built once for a model."""
    key = id(model)
    entry = _FUNCTIONS.get(key)
    # An identity may be that of another model, once the first is gone.
    if entry is None or entry[0]() is not model:
        entry = _FUNCTIONS[key] = (weakref.ref(model, lambda _: _FUNCTIONS.pop(key, None)), {})
    functions = entry[1]
    if (steps, block) not in functions:
        if block > 1:
            functions[steps, block] = _function(model, steps).mapaccum("intervals", block)
        else:
            functions[steps, block] = _interval_function(model, steps) if steps else _forgetting_function(model)
    return functions[steps, block]


def _forgetting_function(model: ContactModel) -> Any:
    """Return a CasADi function of states, depth and rate, and parameters.

    It gives the rate at which states forget [1/s], and 1 where each fades by itself, else 0.
    """
    import casadi

    state, motion = casadi.SX.sym("m", len(model.memory)), casadi.SX.sym("d", 2)
    theta = casadi.SX.sym("p", len(model.parameters))
    change = casadi.vertcat(*model.memory_rate(motion[0], motion[1], casadi.vertsplit(theta), casadi.vertsplit(state)))
    jacobian = casadi.jacobian(change, state)
    fades = casadi.SX(float(fades_separately(jacobian, state)))
    return casadi.Function("j", [state, motion, theta], [casadi.norm_1(jacobian), fades])


def _interval_function(model: ContactModel, steps: int) -> Any:
    """Return a CasADi function of states, an interval and parameters: the states after the interval, in equal steps."""
    import casadi

    state, theta = casadi.SX.sym("m", len(model.memory)), casadi.SX.sym("p", len(model.parameters))
    interval = casadi.SX.sym("e", _INTERVAL_COLUMNS)
    length, *ends = casadi.vertsplit(interval)  # depth and rate at the beginning, then at the end

    def rate_of_change(fraction: float, x: Any) -> Any:
        """Return the states' rate f(t, x) at a fraction of the interval."""
        depth, rate = _cubic(fraction, length, *ends)
        return casadi.vertcat(*model.memory_rate(depth, rate, casadi.vertsplit(theta), casadi.vertsplit(x)))

    x = state
    for i in range(steps):

        def step_rate(share: float, states: Any, first: int = i) -> Any:
            """Return the states' rate at a share of this step."""
            return rate_of_change((first + share) / steps, states)

        x = advance_states(step_rate, length / steps, x)
    return casadi.Function("interval", [state, interval, theta], [x], {"cse": True})


def _cubic(fraction: float, length: Any, depth0: Any, rate0: Any, depth1: Any, rate1: Any) -> tuple[Any, Any]:
    """Return depth and rate at a fraction of an interval: Hermite's cubic through both ends, and its derivative."""
    s = fraction
    depth = (
        (1 + 2 * s) * (1 - s) ** 2 * depth0
        + s * (1 - s) ** 2 * length * rate0
        + s**2 * (3 - 2 * s) * depth1
        + s**2 * (s - 1) * length * rate1
    )
    slope = 6 * s * (1 - s) * (depth1 - depth0) / length
    return depth, slope + (1 - s) * (1 - 3 * s) * rate0 + s * (3 * s - 2) * rate1
