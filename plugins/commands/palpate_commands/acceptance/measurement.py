"""Reaction, deceleration and way of an arm that braked, from its states around a stop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import Floats

# Choices, unless a decision is named.
_SPEED_SPAN = 0.03  # [s] over which a speed is averaged
_MIN_STATES = 3  # in that time, from which on a speed is known
_MIN_SPEED_SHARE = 0.7  # of the speed of the strokes: slower ones show nothing
_TURN_SHARE = 0.15  # of the speed of the strokes: a change of it within three spans, or a rest below it, is a turn
_BRAKING_BEGIN, _BRAKING_END = 0.8, 0.2  # of the speed, between which braking is measured (decision 0245)
_SMOOTHED_STATES = 3  # of a running mean of the speed
_REVERSAL_TIME = 0.1  # [s] after braking in which an arm that retracts still goes its deepest
_TOP_DISTANCE = 1e-3  # [m] below the top of the strokes, before which the force is that of free air
_MIN_AIR_READINGS = 20  # that determine the noise of the force
_ONSET_NOISES, _ONSET_SHARE = 6.0, 0.02  # times the noise, or of the largest force, from which on the force shows
_MIN_PAUSE = 0.3  # [s] without force between two ways down
_FIRST_DELAY, _LAST_DELAY, _DELAY_STEP = -0.05, 1.0, 5e-4  # [s] of the delays that are tried
_MEAN_SPAN = 0.02  # [s] over which force and speed are averaged
_MIN_SPEED_SCATTER = 0.15  # of the fastest: strokes at one speed show no delay


class MissedError(Exception):
    """A stop that shows nothing, with the reason."""


@dataclass(frozen=True)
class BrakingTrace:
    """The motion of an arm: times (n,) [s], and along the normal, outwards, heights (n,) [m] and speeds (n,) [m/s]."""

    time: Floats
    height: Floats
    velocity: Floats


@dataclass(frozen=True)
class Braking:
    """A stop as it was measured."""

    speed: float  # [m/s] the largest until it brakes: an arm that was held up goes on faster
    reaction: float  # [s] from the event to the beginning of braking
    deceleration: float  # [m/s^2]
    deceleration_most: float  # [m/s^2] that the spacing of the states leaves possible
    way: float  # [m] from the event to where the tip reversed or stood
    resolution: float  # [s] between two states


def measure_braking(trace: BrakingTrace, event: float, planned: float, inwards: bool) -> Braking:
    """Return the braking after an event at a time [s], in strokes at a planned speed [m/s]; raises MissedError.

    `inwards`: only a stop on the way in shows something, for an arm that retracts does not brake on the way out.

    Braking is taken as even: it begins where the line through the times at 0.8 and 0.2 of the speed meets the speed.
    """
    if trace.time[-1] < event + _SPEED_SPAN:
        raise _missing_states(trace, event)
    velocity = _velocity_before(trace, event, planned)
    if inwards and velocity > 0:
        raise MissedError("the arm was on its way up just then")
    spacing = float(np.median(np.diff(trace.time)))
    speed = abs(velocity)

    # The last state above 0.8 of the speed, and the first below 0.2 of it.
    direction = float(np.sign(velocity))
    smooth_speed = np.convolve(direction * trace.velocity, np.full(_SMOOTHED_STATES, 1 / _SMOOTHED_STATES), "same")
    is_after = trace.time > event
    time_after, speed_after = trace.time[is_after], smooth_speed[is_after]
    slow_rows = np.flatnonzero(speed_after <= _BRAKING_END * speed)
    if not len(slow_rows):
        raise MissedError("the arm did not stop")
    end_row = int(slow_rows[0])
    fast_rows = np.flatnonzero(speed_after[:end_row] >= _BRAKING_BEGIN * speed)
    last_fast_time = float(time_after[fast_rows[-1]]) if len(fast_rows) else event

    # Each edge is known to one spacing of the states, and smoothing adds one.
    braking_time = max(float(time_after[end_row]) - last_fast_time - spacing, spacing / 2)
    speed_share = _BRAKING_BEGIN - _BRAKING_END
    begin = last_fast_time + spacing / 2 - braking_time * (1.0 - _BRAKING_BEGIN) / speed_share

    # The farthest place until shortly after the stop.
    event_height = float(np.interp(event, trace.time, trace.height))
    ways = direction * (trace.height[is_after] - event_height)
    way = float(ways[: end_row + round(_REVERSAL_TIME / spacing)].max())
    return Braking(
        speed=max(speed, _fastest_until(trace, event, max(last_fast_time, event), direction, spacing)),
        reaction=max(begin - event, 0.0),
        deceleration=speed_share * speed / braking_time,
        deceleration_most=speed_share * speed / max(braking_time - spacing, spacing / 2),
        way=max(way, 0.0),
        resolution=spacing,
    )


def _fastest_until(trace: BrakingTrace, event: float, end: float, direction: float, spacing: float) -> float:
    """Return the largest mean speed [m/s] over a span between shortly before an event [s] and an end [s]."""
    speeds = direction * trace.velocity[(trace.time > event - _SPEED_SPAN) & (trace.time <= end)]
    count = min(max(round(_SPEED_SPAN / spacing), 1), len(speeds))
    return float(np.convolve(speeds, np.full(count, 1 / count), "valid").max())


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

    `planned` is the speed of the strokes [m/s], `movement` [m] by how much the tip still moved when it was found. From
    the last state to the event the tip goes on at its speed. States after the event count as well: the way is the
    farthest that any of them shows.
    """
    velocity = _velocity_before(trace, event, planned)
    # The place of the tip at the event, by the last state before it.
    last = int(np.flatnonzero(trace.time <= event)[-1])
    gap = event - float(trace.time[last])
    event_height = float(trace.height[last]) + velocity * gap
    # Beyond that place counts the farthest state; where the tip stands counts to either side.
    ways = np.sign(velocity) * (np.append(trace.height[last + 1 :], height) - event_height)
    way = max(float(ways.max()), abs(float(ways[-1])))
    spacing = float(np.median(np.diff(trace.time)))
    return StandstillAfterEvent(speed=abs(velocity), way=way, resolution=gap + spacing, movement=movement)


def _velocity_before(trace: BrakingTrace, event: float, planned: float) -> float:
    """Return the mean velocity [m/s] until an event [s]; raises MissedError where the arm was slower than a stroke."""
    is_before = (trace.time > event - _SPEED_SPAN) & (trace.time <= event)
    if np.count_nonzero(is_before) < _MIN_STATES:
        raise _missing_states(trace, event)
    velocity = float(trace.velocity[is_before].mean())
    if abs(velocity) < _MIN_SPEED_SHARE * planned:
        raise _slow_stroke(trace, event, velocity, planned)
    return velocity


def _missing_states(trace: BrakingTrace, event: float) -> MissedError:
    return MissedError(
        f"the arm's states around the stop at {event:.2f} s are missing; they go to {trace.time[-1]:.2f} s"
    )


def _slow_stroke(trace: BrakingTrace, event: float, velocity: float, planned: float) -> MissedError:
    """Return why an arm at a velocity [m/s] was slower than planned when it was stopped: at a turn, or all the way."""
    is_earlier = (trace.time > event - 3 * _SPEED_SPAN) & (trace.time <= event - 2 * _SPEED_SPAN)
    change = abs(float(trace.velocity[is_earlier].mean()) - velocity) if is_earlier.any() else planned
    speeds = f"{1e3 * abs(velocity):.1f} of {1e3 * planned:.1f} mm/s"
    if change > _TURN_SHARE * planned or abs(velocity) < _TURN_SHARE * planned:
        return MissedError(f"the arm turned just then, at {speeds}")
    return MissedError(f"this computer is too busy to move the arm as planned: it went at {speeds}")


@dataclass(frozen=True)
class ForceDelay:
    """The delay of the force against the pose, by their stamps."""

    value: float  # [s]
    std: float  # [s] its standard uncertainty


def measure_force_delay(trace: BrakingTrace, time: Floats, force: Floats) -> ForceDelay:
    """Return the delay by strokes into a material at different speeds, times and tared forces (n,) [N].

    The force shows a delay after the tip has passed one and the same height on its way down, however fast it goes: the
    delay is that for which these heights scatter least. Where a force only begins to rise the material's own delay is
    small, and makes the result too short; foam that has not yet come back makes it too long. Raises MissedError.
    """
    onsets = _onset_times(trace, time, force)
    too_few = MissedError(f"the force rose on {len(onsets)} ways down: strokes at two speeds into foam show a delay")
    if len(onsets) < 2:
        raise too_few

    # Heights and speeds of the tip at each onset less each delay, (strokes, delays).
    delays = np.asarray(np.arange(_FIRST_DELAY, _LAST_DELAY, _DELAY_STEP), np.float64)
    touch_times = onsets[:, None] - delays
    heights = np.interp(touch_times, trace.time, trace.height)
    speeds = (np.interp(touch_times - _MEAN_SPAN, trace.time, trace.height) - heights) / _MEAN_SPAN
    scatter = np.where((speeds > 0.0).all(axis=0), heights.std(axis=0), math.inf)
    best = int(np.argmin(scatter))
    speed_scatter = float(np.std(speeds[:, best]))
    if speed_scatter < _MIN_SPEED_SCATTER * float(speeds[:, best].max()) or not math.isfinite(scatter[best]):
        raise too_few

    # The delay is the slope of height over speed: its standard error, with two unknowns, and the spacing of the states.
    spacing = float(np.median(np.diff(trace.time)))
    slope_error = float(scatter[best]) / math.sqrt(max(len(onsets) - 2, 1)) / speed_scatter
    return ForceDelay(float(delays[best]), math.hypot(slope_error, spacing))


def _onset_times(trace: BrakingTrace, time: Floats, force: Floats) -> Floats:
    """Return the times (m,) [s] at which the force begins to rise; raises MissedError without readings in free air."""
    is_below_top = trace.height < trace.height.max() - _TOP_DISTANCE
    in_air = time < float(trace.time[int(np.argmax(is_below_top))])
    if np.count_nonzero(in_air) < _MIN_AIR_READINGS:
        raise MissedError("the sensor sent too few readings before the strokes")
    count = max(round(_MEAN_SPAN / float(np.median(np.diff(time)))), 1)
    mean_force = np.convolve(force, np.full(count, 1 / count), "same")
    threshold = max(_ONSET_NOISES * float(mean_force[in_air].std()), _ONSET_SHARE * float(np.abs(mean_force).max()))
    loaded_times = time[np.abs(mean_force) > threshold]
    return np.asarray(loaded_times[np.diff(loaded_times, prepend=-math.inf) > _MIN_PAUSE])


def first_beyond(time: Floats, values: Floats, limit: float) -> float:
    """Return the time at which (n,) values first pass a limit either way; raises MissedError."""
    rows = np.flatnonzero(np.abs(values) > limit)
    if not len(rows):
        reached = float(np.abs(values).max(initial=0.0))
        raise MissedError(f"the force reached {reached:.2f} N of {limit:.2f} N")
    return float(time[rows[0]])
