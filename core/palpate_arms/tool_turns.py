"""Turns of the tool: rotation vectors from its orientation by the work frame, in the frame of a tool so oriented."""

from __future__ import annotations

import numpy as np
from palpate import Floats, angular_velocities
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_arms.setpoint_buffer import PERIOD


def tool_turn(work: WorkFrame, rotation: Floats) -> Floats:
    """Return the turn (3,) of a tool (3, 3) in the base."""
    return rotation_vector(work.tool.T @ rotation)


def turn_after(turn: Floats, more: Floats) -> Floats:
    """Return a turn (3,) and then another one, in the frame that is turned already."""
    return rotation_vector(rotation_matrix(turn.tolist()) @ rotation_matrix(more.tolist()))


def turn_from_to(turn: Floats, other: Floats) -> Floats:
    """Return the turn (3,) that leads from one to another, in the frame that is turned by the first."""
    if not other.any():
        return np.asarray(-turn)
    return rotation_vector(rotation_matrix(turn.tolist()).T @ rotation_matrix(other.tolist()))


def turning(turn: Floats, previous: Floats) -> Floats:
    """Return the angular velocity (3,) [rad/s] from a turn of the tool to the next, in the frame of a tool not turned.

    That of the rotation vector halfway, which changes by the difference in a period.
    """
    change = (turn - previous) / PERIOD
    if not change.any():
        return np.asarray(change)
    return np.asarray(angular_velocities(0.5 * (turn + previous)[None], change[None])[0])


def fastest_turn(turns: Floats) -> float:
    """Return the largest angular speed [rad/s] of turns (n, 3), one in each period."""
    change = np.diff(turns, axis=0) / PERIOD
    if not change.any():
        return 0.0
    return float(np.linalg.norm(angular_velocities(0.5 * (turns[1:] + turns[:-1]), change), axis=1).max())
