"""Checks of trajectories."""

from __future__ import annotations

import numpy as np
from palpate import Floats, Setpoint, Settings, Surface, Trajectory, angular_velocities

from palpate_testing.failure_messages import demand

_STEP = 1e-4  # [s]
_TOUCHING = 1e-6  # [m] below the skin, where a motion that starts on it may be
_DEPTH_ERROR = 20e-6  # [m], of the depth that a motion reaches between the instants of the grid


def check_trajectory(trajectory: Trajectory, top_speed: float = 0.25, depth: float | None = None) -> None:
    """Check that a trajectory starts and ends at rest outside of the skin, has no jumps, and states its true velocity.

    Checked on a fine grid: shapes, finiteness, rest at both ends and beyond them, the duration, position and velocity
    without jumps, velocity equal to the derivative of position, no speed above `top_speed` [m/s], and a part for
    measuring within the motion; ends above the skin, on one that is flat or that its surface describes; where `depth`
    [m] is given, that its deepest setpoint is so far below; of a tool that turns, an angular velocity that is that of
    its rotation. Raises AssertionError with the reason.
    """
    name, end = type(trajectory).__name__, trajectory.total_duration
    demand(np.isfinite(end) and end > 0, f"{name}.total_duration is {end}")
    time = np.arange(-0.1, end + 0.1, _STEP)
    setpoint = trajectory.at(time)
    for field in ("position", "velocity"):
        values = getattr(setpoint, field)
        demand(values.shape == (len(time), 3), f"{name}: {field} has shape {values.shape} for {len(time)} times")
        demand(np.isfinite(values).all(), f"{name}: {field} is not finite everywhere")
    demand(setpoint.measuring.shape == (len(time),), f"{name}: measuring has the wrong shape")
    demand(setpoint.measuring.any(), f"{name} has no part for measuring")
    outside = (time < 0) | (time > end)
    demand(np.allclose(setpoint.velocity[outside], 0, atol=1e-9), f"{name} does not start and end at rest")
    demand(not setpoint.measuring[outside].any(), f"{name} measures before it starts or after its total_duration")
    ends = trajectory.at(np.array([0.0, end])).position
    for rows, place in ((time < 0, ends[0]), (time > end, ends[1])):
        moved = np.abs(setpoint.position[rows] - place).max()
        demand(moved <= 1e-9, f"{name} does not last for its total_duration: {moved:.3g} m are left")
    above = _height_above_skin(trajectory, setpoint)
    for row, end_name in ((0, "starts"), (-1, "ends")):
        inside = -1e3 * float(above[row])
        demand(inside < 1e3 * _TOUCHING, f"{name} {end_name} {inside:.3g} mm inside of the skin")
    if depth is not None:
        deepest = -1e3 * float(above.min())
        is_right = abs(deepest - 1e3 * depth) <= 1e3 * _DEPTH_ERROR
        demand(is_right, f"{name} goes {deepest:.4g} mm below the skin, not {1e3 * depth:.4g} mm: is z outwards?")
    speed = np.linalg.norm(setpoint.velocity, axis=1)
    demand(speed.max() <= top_speed, f"{name} moves at {speed.max():.3g} m/s, allowed {top_speed:g}")
    jump = np.abs(np.diff(setpoint.position, axis=0)).max()
    demand(jump <= 1.01 * speed.max() * _STEP + 1e-12, f"{name}: the position jumps by {jump:.3g} m")
    kick = np.abs(np.diff(setpoint.velocity, axis=0)).max() / _STEP
    demand(kick < 100.0, f"{name}: the velocity jumps ({kick:.3g} m/s^2)")
    _check_turns(name, setpoint)
    slope = (setpoint.position[2:] - setpoint.position[:-2]) / (2 * _STEP)
    wrong = np.abs(slope - setpoint.velocity[1:-1]).max()
    demand(
        wrong <= 1e-3 * speed.max() + 1e-9, f"{name}: the velocity is not that of the position ({wrong:.3g} m/s off)"
    )


def _height_above_skin(trajectory: Trajectory, setpoint: Setpoint) -> Floats:
    """Return the height (n,) [m] of setpoints above the trajectory's surface; above the plane z = 0 without one."""
    surface = getattr(trajectory, "surface", None)
    if isinstance(surface, Surface):
        return surface.nearest(setpoint.position).height
    above: Floats = setpoint.position[:, 2]
    if isinstance(surface, Settings):
        above = above - surface.at(setpoint.position[:, 0], setpoint.position[:, 1])[0]  # type: ignore[attr-defined]
    return above


def _check_turns(name: str, setpoint: Setpoint) -> None:
    rotation, stated = setpoint.rotation, setpoint.angular_velocity
    demand((rotation is None) == (stated is None), f"{name}: rotation and angular_velocity come together")
    if rotation is None or stated is None:
        return
    rate = (rotation[2:] - rotation[:-2]) / (2 * _STEP)
    wrong = np.abs(angular_velocities(rotation[1:-1], rate) - stated[1:-1]).max()
    most = np.abs(stated).max()
    demand(
        wrong <= 1e-3 * most + 1e-6, f"{name}: the angular velocity is not that of the rotation ({wrong:.3g} rad/s off)"
    )
