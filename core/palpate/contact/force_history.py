"""Forces over a motion, for models with and without memory."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.contact.interfaces import ContactModel, contact_force
from palpate.vectors import Floats

_LEAST_STEPS = 4  # steps of the integration from one sample to the next
_MOST_STEPS = 64
_STEP_TIMES_RATE = 0.25  # Runge-Kutta's local error is then some 1e-5 of what a state forgets in the step
_TOGETHER = 64  # intervals in one call
# By identity: a third-party model need not be hashable.
_BUILT: dict[int, tuple[weakref.ref[Any], dict[tuple[int, int], Any]]] = {}


def force_over_time(
    model: ContactModel,
    time: Floats,
    depth: Floats,
    rate: Floats,
    theta: Sequence[float],
    *,
    memory: Sequence[float] | None = None,
    pulls: bool = True,
) -> Floats:
    """Force (n,) [N] at instants (n,) [s] of a motion given by depth (n,) [m] and its rate (n,) [m/s].

    Internal states start from `memory` (none given: 0, a material at rest) and are integrated by the Runge-Kutta method
    of order 4 between the instants, over which the depth is the cubic that has the given depths and rates. Steps are
    chosen from the fastest of the model's own rates. `pulls` as in `contact_force`. Raises ValueError where the states
    change so fast that the instants are too far apart.
    """
    time, depth, rate = (np.asarray(values, float) for values in (time, depth, rate))
    if not model.memory:
        return np.asarray(contact_force(model, depth, rate, theta, pulls=pulls), float)
    states = memory_over_time(model, time, depth, rate, theta, memory)
    return np.asarray(contact_force(model, depth, rate, theta, list(states.T), pulls=pulls), float)


def memory_over_time(
    model: ContactModel,
    time: Floats,
    depth: Floats,
    rate: Floats,
    theta: Sequence[float],
    memory: Sequence[float] | None = None,
) -> Floats:
    """Internal states (n, k) over a motion; see `force_over_time`."""
    count = len(model.memory)
    states = np.zeros((len(time), count))
    if not len(time):
        return states
    states[0] = 0.0 if memory is None else memory
    steps = _steps(model, time, depth, rate, theta)
    ends = np.column_stack([np.diff(time), depth[:-1], rate[:-1], depth[1:], rate[1:]])
    done = 0
    for together in (_TOGETHER, 1):
        rest = len(ends) - done
        whole = rest - rest % together
        _follow(_kept(model, steps, together), states[done:], ends[done : done + whole], theta, together)
        done += whole
    return states


def _follow(function: Any, states: Floats, ends: Floats, theta: Sequence[float], together: int) -> None:
    """Fill in the states (m + 1, k) after intervals (m, 5), so many at a time; the first is there."""
    state, values = np.empty(states.shape[1]), np.tile(np.array(theta, float), (together, 1))
    given, after = np.empty((together, 5)), np.empty((together, states.shape[1]))
    buffer, advance = function.buffer()  # a call through it costs a twentieth of an ordinary one
    for i, array in enumerate((state, given, values)):
        buffer.set_arg(i, memoryview(array.data))
    buffer.set_res(0, memoryview(after.data))
    for i in range(0, len(ends), together):
        state[:], given[:] = states[i], ends[i : i + together]
        advance()
        states[i + 1 : i + 1 + together] = after


def _steps(model: ContactModel, time: Floats, depth: Floats, rate: Floats, theta: Sequence[float]) -> int:
    """How many steps an interval needs, from the largest rate at which any state forgets [1/s]."""
    import casadi

    forgetting = _kept(model, 0)
    rows = np.linspace(0, len(depth) - 1, min(len(depth), 50)).astype(int)
    motion = casadi.DM(np.array([depth[rows], rate[rows]]))
    at_rest, values = casadi.DM.zeros(len(model.memory), len(rows)), casadi.DM(np.array(theta, float))
    fastest = float(np.max(np.array(forgetting(at_rest, motion, casadi.repmat(values, 1, len(rows))))))
    longest = float(np.max(np.diff(time), initial=0.0))
    if not math.isfinite(fastest):
        raise ValueError(f"{type(model).__name__}.memory_rate is not finite")
    steps = max(_LEAST_STEPS, math.ceil(fastest * longest / _STEP_TIMES_RATE))
    if steps > _MOST_STEPS:
        raise ValueError(
            f"{type(model).__name__} forgets within {1e3 / fastest:.3g} ms: too fast for samples every "
            f"{1e3 * longest:.3g} ms"
        )
    return steps


def _kept(model: ContactModel, steps: int, together: int = 1) -> Any:
    """The function of so many intervals of so many steps, or that of the forgetting (0), built once for each model."""
    known = _BUILT.get(id(model))
    if known is None or known[0]() is not model:
        own = id(model)
        known = _BUILT[own] = (weakref.ref(model, lambda _: _BUILT.pop(own, None)), {})
    if (steps, together) not in known[1]:
        if together > 1:
            made = _kept(model, steps).mapaccum("intervals", together)
        else:
            made = _interval(model, steps) if steps else _forgetting(model)
        known[1][steps, together] = made
    return known[1][steps, together]


def _forgetting(model: ContactModel) -> Any:
    """CasADi function: the rate at which the states forget [1/s], from states, depth and rate, and parameters."""
    import casadi

    state, motion = casadi.SX.sym("m", len(model.memory)), casadi.SX.sym("d", 2)
    theta = casadi.SX.sym("p", len(model.parameters))
    change = casadi.vertcat(*model.memory_rate(motion[0], motion[1], casadi.vertsplit(theta), casadi.vertsplit(state)))
    return casadi.Function("j", [state, motion, theta], [casadi.norm_1(casadi.jacobian(change, state))])


def _interval(model: ContactModel, steps: int) -> Any:
    """CasADi function: states at the end of an interval from those at its start, its ends, and the parameters."""
    import casadi

    state, theta = casadi.SX.sym("m", len(model.memory)), casadi.SX.sym("p", len(model.parameters))
    ends = casadi.SX.sym("e", 5)  # length, depth and rate before, depth and rate after
    length = ends[0]

    def change(fraction: float, at: Any) -> Any:
        depth, rate = _cubic(fraction, length, ends[1], ends[2], ends[3], ends[4])
        return casadi.vertcat(*model.memory_rate(depth, rate, casadi.vertsplit(theta), casadi.vertsplit(at)))

    step, after = length / steps, state
    for i in range(steps):
        begin, middle, end = i / steps, (i + 0.5) / steps, (i + 1) / steps
        k1 = change(begin, after)
        k2 = change(middle, after + step / 2 * k1)
        k3 = change(middle, after + step / 2 * k2)
        k4 = change(end, after + step * k3)
        after = after + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return casadi.Function("interval", [state, ends, theta], [after], {"cse": True})


def _cubic(fraction: float, length: Any, depth0: Any, rate0: Any, depth1: Any, rate1: Any) -> tuple[Any, Any]:
    """Depth and rate at a fraction of an interval: Hermite's cubic through both ends."""
    s = fraction
    depth = (
        (1 + 2 * s) * (1 - s) ** 2 * depth0
        + s * (1 - s) ** 2 * length * rate0
        + s**2 * (3 - 2 * s) * depth1
        + s**2 * (s - 1) * length * rate1
    )
    slope = 6 * s * (1 - s) * (depth1 - depth0) / length
    return depth, slope + (1 - s) * (1 - 3 * s) * rate0 + s * (3 * s - 2) * rate1
