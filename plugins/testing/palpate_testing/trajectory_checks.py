"""Checks of trajectories."""

from __future__ import annotations

import numpy as np
from palpate import Floats, Setpoint, Settings, Surface, Trajectory, angular_velocities

from palpate_testing.failure_messages import demand

TOP_SPEED = 0.25  # [m/s] (a choice): no motion of a palpation is faster
STEP = 1e-4  # [s] of the grid (a choice: shorter than any controller's period)
MARGIN = 0.1  # [s] of the grid before and after the motion (a choice)
TOUCHING = 1e-6  # [m] below the skin, where a motion that starts on it may be (a choice)
DEPTH_ERROR = 20e-6  # [m] of the depth that a motion reaches between the instants of the grid (a choice)
REST_SPEED, REST_RANGE = 1e-9, 1e-9  # [m/s], [m] of rounding at rest
MAX_ACCELERATION = 100.0  # [m/s^2] (a choice): a larger one is a jump of the velocity
# Positions may differ by this many steps at the largest speed, and by rounding.
JUMP_FACTOR, JUMP_ROUNDING = 1.01, 1e-12
# Error of differences over the grid, of the largest velocity (a choice), and rounding of linear and angular ones.
DIFFERENCE_ERROR, SPEED_ROUNDING, TURN_ROUNDING = 1e-3, 1e-9, 1e-6  # [1], [m/s], [rad/s]


def check_trajectory(trajectory: Trajectory, top_speed: float = TOP_SPEED, depth: float | None = None) -> None:
    """Check that a trajectory starts and ends at rest outside of the skin, has no jumps, and states its true velocity.

    Checked on a fine grid: shapes, finiteness, rest at both ends and beyond them, the duration, position and velocity
    without jumps, velocity equal to the derivative of position, no speed above `top_speed` [m/s], and a part for
    measuring within the motion; ends above the skin, on one that is flat or that its surface describes; where `depth`
    [m] is given, that its deepest setpoint is so far below; of a tool that turns, an angular velocity that is that of
    its rotation. Raises AssertionError with the reason.
    """
    name, duration = type(trajectory).__name__, trajectory.total_duration
    demand(np.isfinite(duration) and duration > 0, f"{name}.total_duration is {duration}")
    time = np.arange(-MARGIN, duration + MARGIN, STEP)
    setpoint = trajectory.at(time)
    _check_arrays(name, setpoint, len(time))
    _check_rest(name, trajectory, setpoint, time)
    height = _height_above_skin(trajectory, setpoint)
    for row, verb in ((0, "starts"), (-1, "ends")):
        depth_there = -1e3 * float(height[row])  # [mm]
        demand(depth_there < 1e3 * TOUCHING, f"{name} {verb} {depth_there:.3g} mm inside of the skin")
    if depth is not None:
        deepest = -1e3 * float(height.min())  # [mm]
        is_right = abs(deepest - 1e3 * depth) <= 1e3 * DEPTH_ERROR
        demand(is_right, f"{name} goes {deepest:.4g} mm below the skin, not {1e3 * depth:.4g} mm: is z outwards?")
    _check_speed(name, setpoint, top_speed)
    _check_turns(name, setpoint)
    _check_velocity(name, setpoint)


def _check_arrays(name: str, setpoint: Setpoint, count: int) -> None:
    """Check shapes and finiteness of setpoints at `count` times, and that a part of them is for measuring."""
    for field in ("position", "velocity"):
        vectors = getattr(setpoint, field)
        demand(vectors.shape == (count, 3), f"{name}: {field} has shape {vectors.shape} for {count} times")
        demand(np.isfinite(vectors).all(), f"{name}: {field} is not finite everywhere")
    demand(setpoint.measuring.shape == (count,), f"{name}: measuring has the wrong shape")
    demand(setpoint.measuring.any(), f"{name} has no part for measuring")


def _check_rest(name: str, trajectory: Trajectory, setpoint: Setpoint, time: Floats) -> None:
    """Check that the setpoints rest, without measuring, at times (n,) [s] before and after the motion."""
    duration = trajectory.total_duration
    outside = (time < 0) | (time > duration)
    is_at_rest = np.allclose(setpoint.velocity[outside], 0, atol=REST_SPEED)
    demand(is_at_rest, f"{name} does not start and end at rest")
    demand(not setpoint.measuring[outside].any(), f"{name} measures before it starts or after its total_duration")
    start, end = trajectory.at(np.array([0.0, duration])).position
    for rows, position in ((time < 0, start), (time > duration, end)):
        moved = np.abs(setpoint.position[rows] - position).max()
        demand(moved <= REST_RANGE, f"{name} does not last for its total_duration: {moved:.3g} m are left")


def _check_speed(name: str, setpoint: Setpoint, top_speed: float) -> None:
    """Check that the speed is at most `top_speed` [m/s], and neither position nor velocity jumps."""
    speed = np.linalg.norm(setpoint.velocity, axis=1)
    demand(speed.max() <= top_speed, f"{name} moves at {speed.max():.3g} m/s, allowed {top_speed:g}")
    jump = np.abs(np.diff(setpoint.position, axis=0)).max()
    is_smooth = jump <= JUMP_FACTOR * speed.max() * STEP + JUMP_ROUNDING
    demand(is_smooth, f"{name}: the position jumps by {jump:.3g} m")
    acceleration = np.abs(np.diff(setpoint.velocity, axis=0)).max() / STEP
    demand(acceleration < MAX_ACCELERATION, f"{name}: the velocity jumps ({acceleration:.3g} m/s^2)")


def _check_velocity(name: str, setpoint: Setpoint) -> None:
    """Check that the velocity is the derivative of the position, by central differences."""
    speed = np.linalg.norm(setpoint.velocity, axis=1)
    slope = (setpoint.position[2:] - setpoint.position[:-2]) / (2 * STEP)
    error = np.abs(slope - setpoint.velocity[1:-1]).max()
    is_right = error <= DIFFERENCE_ERROR * speed.max() + SPEED_ROUNDING
    demand(is_right, f"{name}: the velocity is not that of the position ({error:.3g} m/s off)")


def _height_above_skin(trajectory: Trajectory, setpoint: Setpoint) -> Floats:
    """Return the height (n,) [m] of setpoints above the trajectory's surface; above the plane z = 0 without one."""
    surface = getattr(trajectory, "surface", None)
    if isinstance(surface, Surface):
        return surface.nearest(setpoint.position).height
    height: Floats = setpoint.position[:, 2]
    if isinstance(surface, Settings):
        height = height - surface.at(setpoint.position[:, 0], setpoint.position[:, 1])[0]  # type: ignore[attr-defined]
    return height


def _check_turns(name: str, setpoint: Setpoint) -> None:
    """Check that the angular velocity of a tool that turns is that of its rotation vector."""
    rotation, angular_velocity = setpoint.rotation, setpoint.angular_velocity
    demand((rotation is None) == (angular_velocity is None), f"{name}: rotation and angular_velocity come together")
    if rotation is None or angular_velocity is None:
        return
    rate = (rotation[2:] - rotation[:-2]) / (2 * STEP)
    error = np.abs(angular_velocities(rotation[1:-1], rate) - angular_velocity[1:-1]).max()
    is_right = error <= DIFFERENCE_ERROR * np.abs(angular_velocity).max() + TURN_ROUNDING
    demand(is_right, f"{name}: the angular velocity is not that of the rotation ({error:.3g} rad/s off)")
