"""How soon and how hard an arm braked, from its states around a stop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import Floats

_BEFORE = 0.03  # [s] over which a speed is averaged
_STATES = 3  # in that time, from which a speed is known
_STEADY = 0.7  # of the speed of the strokes: slower ones show nothing
_TURN = 0.15  # of the speed of the strokes: so much it changes at a turn within three times _BEFORE, or none is left
_HIGH, _LOW = 0.8, 0.2  # of the speed, between which braking is measured
_SMOOTH = 3  # states
_LEFT, _FEW = 1e-3, 20  # [m] from the top of the strokes, before which the force is that of free air; readings
_ONSET, _RISEN = 6.0, 0.02  # times the noise, or of the largest force: the force shows
_FREE = 0.3  # [s] between two ways down, at least
_EARLIEST, _LATEST, _FINE = 0.05, 1.0, 5e-4  # [s] of delays that are tried
_EVEN = 0.02  # [s] over which force and speed are averaged
_APART = 0.15  # of the fastest: so much the speeds scatter at least


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
    if time[-1] < event + _BEFORE:
        raise _missing(trace, event)
    velocity = _velocity_before(trace, event, planned)
    speed, direction = abs(velocity), float(np.sign(velocity))
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


@dataclass(frozen=True)
class StandstillAfterEvent:
    """Place at which an arm stood after a run whose record of states ended with the event, such as its kill."""

    speed: float  # [m/s] until the event
    way: float  # [m] from the event to where the tip stood when the arm was connected to again
    resolution: float  # [s] from the last recorded state to the event, and between two states
    movement: float  # [m] by which the tip still moved then


def measure_standstill(
    trace: BrakingTrace, event: float, planned: float, height: float, movement: float
) -> StandstillAfterEvent:
    """Return the way from an event [s] that ended a record to a height [m] found later; raises MissedError.

    From the last state to the event the tip goes on at its speed. States after the event count as well: the way is the
    farthest that any of them shows.
    """
    velocity = _velocity_before(trace, event, planned)
    last = int(np.flatnonzero(trace.time <= event)[-1])
    gap = event - float(trace.time[last])
    place = float(trace.height[last]) + velocity * gap
    ways = np.sign(velocity) * (np.append(trace.height[last + 1 :], height) - place)
    spacing = float(np.median(np.diff(trace.time)))
    return StandstillAfterEvent(abs(velocity), max(float(ways.max()), abs(float(ways[-1]))), gap + spacing, movement)


def _velocity_before(trace: BrakingTrace, event: float, planned: float) -> float:
    """Return the mean velocity [m/s] until an event [s]; raises MissedError where the arm was slower than a stroke."""
    before = (trace.time > event - _BEFORE) & (trace.time <= event)
    if np.count_nonzero(before) < _STATES:
        raise _missing(trace, event)
    velocity = float(trace.velocity[before].mean())
    if abs(velocity) < _STEADY * planned:
        raise _too_slow(trace, event, velocity, planned)
    return velocity


def _missing(trace: BrakingTrace, event: float) -> MissedError:
    return MissedError(
        f"the arm's states around the stop at {event:.2f} s are missing; they go to {trace.time[-1]:.2f} s"
    )


def _too_slow(trace: BrakingTrace, event: float, velocity: float, planned: float) -> MissedError:
    """Why an arm at a velocity [m/s] was slower than planned when it was stopped: at a turn, or all the way."""
    earlier = (trace.time > event - 3 * _BEFORE) & (trace.time <= event - 2 * _BEFORE)
    change = abs(float(trace.velocity[earlier].mean()) - velocity) if earlier.any() else planned
    moves = f"{1e3 * abs(velocity):.1f} of {1e3 * planned:.1f} mm/s"
    if change > _TURN * planned or abs(velocity) < _TURN * planned:
        return MissedError(f"the arm turned just then, at {moves}")
    return MissedError(f"this computer is too busy to move the arm as planned: it went at {moves}")


@dataclass(frozen=True)
class ForceDelay:
    """How much later the force comes than the pose, by their stamps."""

    value: float  # [s]
    std: float  # [s] its standard uncertainty


def measure_force_delay(trace: BrakingTrace, time: Floats, force: Floats) -> ForceDelay:
    """From strokes into a material at different speeds, by times and tared forces (n,) [N]; raises MissedError.

    The force shows a delay after the tip has passed one and the same height on its way down, however fast it goes: the
    delay is that for which these heights scatter least. Where a force only begins to rise the material's own delay is
    small, and makes the result too short; foam that has not yet come back makes it too long.
    """
    down = trace.height < trace.height.max() - _LEFT
    before = time < float(trace.time[int(np.argmax(down))])
    if np.count_nonzero(before) < _FEW:
        raise MissedError("the sensor sent too few readings before the strokes")
    count = max(round(_EVEN / float(np.median(np.diff(time)))), 1)
    even = np.convolve(force, np.full(count, 1 / count), "same")
    above = np.abs(even) > max(_ONSET * float(even[before].std()), _RISEN * float(np.abs(even).max()))
    shown = time[above]
    onsets = shown[np.diff(shown, prepend=-math.inf) > _FREE]
    few = MissedError(f"the force rose on {len(onsets)} ways down: strokes at two speeds into foam show a delay")
    if len(onsets) < 2:
        raise few
    late = np.asarray(np.arange(-_EARLIEST, _LATEST, _FINE), np.float64)
    then = onsets[:, None] - late
    heights = np.interp(then, trace.time, trace.height)  # (strokes, delays)
    speeds = (np.interp(then - _EVEN, trace.time, trace.height) - heights) / _EVEN
    scatter = np.where((speeds > 0.0).all(axis=0), heights.std(axis=0), math.inf)
    best = int(np.argmin(scatter))
    apart = float(np.std(speeds[:, best]))
    if apart < _APART * float(speeds[:, best].max()) or not math.isfinite(scatter[best]):
        raise few
    step = float(np.median(np.diff(trace.time)))
    error = float(scatter[best]) / math.sqrt(max(len(onsets) - 2, 1)) / apart
    return ForceDelay(float(late[best]), math.hypot(error, step))


def first_beyond(time: Floats, values: Floats, limit: float) -> float:
    """When (n,) values first pass a limit either way; raises MissedError."""
    beyond = np.flatnonzero(np.abs(values) > limit)
    if not len(beyond):
        reached = float(np.abs(values).max(initial=0.0))
        raise MissedError(f"the force reached {reached:.2f} N of {limit:.2f} N")
    return float(time[beyond[0]])
