"""How soon and how hard an arm braked, from its states around a stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

_BEFORE = 0.03  # [s] over which a speed is averaged
_STEADY = 0.7  # of the speed of the strokes: what is slower was hit at a turn
_HIGH, _LOW = 0.8, 0.2  # of the speed, between which braking is measured
_SMOOTH = 3  # states


class MissedError(Exception):
    """A stop that shows nothing, and why."""


@dataclass(frozen=True)
class BrakingTrace:
    """What an arm did: times (n,) [s], and along the normal, outwards, heights (n,) [m] and speeds (n,) [m/s]."""

    time: Floats
    height: Floats
    velocity: Floats


@dataclass(frozen=True)
class Braking:
    """A stop as it was measured."""

    speed: float  # [m/s] the most until it brakes: an arm that was held up goes on faster
    reaction: float  # [s] from the event to the beginning of braking
    deceleration: float  # [m/s^2]
    deceleration_most: float  # [m/s^2] that the spacing of the states leaves possible
    way: float  # [m] from the event to where the tip reversed or stood
    resolution: float  # [s] between two states


def measure_braking(trace: BrakingTrace, event: float, planned: float, inwards: bool) -> Braking:
    """The stop after an event at a time [s], in strokes at a planned speed [m/s]; raises MissedError.

    `inwards`: only a stop on the way in shows something, for an arm that retracts does not brake on the way out.

    Braking is taken as even: it begins where the line through the times at 0.8 and 0.2 of the speed meets the speed.
    """
    time, step = trace.time, float(np.median(np.diff(trace.time)))
    before = (time > event - _BEFORE) & (time <= event)
    if np.count_nonzero(before) < 3 or time[-1] < event + _BEFORE:
        raise MissedError(f"the arm's states around the stop at {event:.2f} s are missing; they go to {time[-1]:.2f} s")
    signed = float(trace.velocity[before].mean())
    speed, direction = abs(signed), float(np.sign(signed))
    if speed < _STEADY * planned:
        raise MissedError(f"the arm turned just then, at {1e3 * speed:.1f} of {1e3 * planned:.1f} mm/s")
    if inwards and direction > 0:
        raise MissedError("the arm was on its way up just then")
    along = np.convolve(direction * trace.velocity, np.full(_SMOOTH, 1 / _SMOOTH), "same")
    after = time > event
    late, fast = time[after], along[after]
    slow = np.flatnonzero(fast <= _LOW * speed)
    if not len(slow):
        raise MissedError("the arm did not stop")
    last_fast = np.flatnonzero(fast[: slow[0]] >= _HIGH * speed)
    high = float(late[last_fast[-1]]) if len(last_fast) else event
    # From above 0.8 to below 0.2 of the speed: each edge is known to one step, and smoothing adds one.
    took = max(float(late[slow[0]]) - high - step, step / 2)
    share = _HIGH - _LOW
    began = high + step / 2 - took * (1.0 - _HIGH) / share
    start = float(np.interp(event, time, trace.height))
    way = float((direction * (trace.height[after] - start))[: slow[0] + round(0.1 / step)].max())
    until = direction * trace.velocity[(time > event - _BEFORE) & (time <= max(high, event))]
    window = min(max(round(_BEFORE / step), 1), len(until))
    fastest = float(np.convolve(until, np.full(window, 1 / window), "valid").max())
    return Braking(
        max(speed, fastest),
        max(began - event, 0.0),
        share * speed / took,
        share * speed / max(took - step, step / 2),
        max(way, 0.0),
        step,
    )


def first_beyond(time: Floats, values: Floats, limit: float) -> float:
    """When (n,) values first pass a limit either way; raises MissedError."""
    beyond = np.flatnonzero(np.abs(values) > limit)
    if not len(beyond):
        reached = float(np.abs(values).max(initial=0.0))
        raise MissedError(f"the force reached {reached:.2f} N of {limit:.2f} N")
    return float(time[beyond[0]])
