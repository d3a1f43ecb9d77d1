"""The way to the first setpoint of a motion: a straight one, on which the tool turns to the first normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats, Setpoint, Trajectory, setpoints_at, surface_of, surface_points
from palpate_kit.kinematics.rotations import rotation_matrix
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_arms.servo_law import ServoLaw, straight_path
from palpate_arms.station_plane import LEVEL, StationPlane
from palpate_arms.tool_turns import tool_turn, turn_after, turn_from_to

_NO_TURN = 1e-12  # [rad], in place of 0 in a quotient


@dataclass(frozen=True)
class FirstStation:
    """The place at which a motion begins, and the plane of the skin below."""

    place: Floats  # (3,) [m]
    turn: Floats | None  # (3,) of the tool, in its frame; None where it keeps the work frame's orientation
    plane: StationPlane

    @classmethod
    def of(cls, trajectory: Trajectory, work: WorkFrame) -> FirstStation:
        """Return the first station of a motion; raises ConfigurationError where a surface is not known below it."""
        first, surface = setpoints_at(trajectory, np.zeros(1)), surface_of(trajectory)
        place, turn = first.position[0], None if first.rotation is None else work.axes_in_tool @ first.rotation[0]
        if surface is None:
            return cls(place, turn, LEVEL)
        points = surface_points(surface, place[None])
        return cls(place, turn, StationPlane(points.position[0], points.normal[0]))

    def turn_from(self, work: WorkFrame, rotation: Floats) -> Floats:
        """Return the turn (3,) that a tool (3, 3) in the base has still to make, in its own frame."""
        return turn_from_to(tool_turn(work, rotation), np.zeros(3) if self.turn is None else self.turn)


def start_path(
    station: FirstStation, position: Floats, rotation: Floats, law: ServoLaw, work: WorkFrame
) -> tuple[Floats, Setpoint]:
    """Return times (n,) [s] and setpoints of the way from a position (3,) [m] of a tool (3, 3) in the base."""
    # A straight way that lasts long enough for the turn as well.
    remaining_turn = station.turn_from(work, rotation)
    angle = float(np.linalg.norm(remaining_turn))
    path = straight_path(position, station.place, law, angle)
    # Axis and turns in the work frame; the turn begins with that of the tool now.
    begin, to_work = tool_turn(work, rotation), work.axes_in_tool.T
    axis = to_work @ rotation_matrix(begin.tolist()) @ (remaining_turn / max(angle, _NO_TURN))
    turns = None
    if station.turn is not None:
        shares = (1.0 - path.left).tolist()
        turns = np.array([to_work @ turn_after(begin, remaining_turn * share) for share in shares])
    measuring = np.zeros(len(path.times), bool)
    turning = path.turning[:, None] * axis
    return path.times, Setpoint(path.position, path.velocity, measuring, turns, turning, law.lever)
