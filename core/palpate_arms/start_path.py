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


@dataclass(frozen=True)
class FirstStation:
    """Where a motion begins, and the plane of the skin below."""

    place: Floats  # (3,) [m]
    turn: Floats | None  # (3,) of the tool, in its frame; None where it keeps the work frame's orientation
    plane: StationPlane

    @classmethod
    def of(cls, trajectory: Trajectory, work: WorkFrame) -> FirstStation:
        """That of a motion; raises ConfigurationError where a surface is not known below it."""
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
    """Times (n,) [s] and setpoints of the way from a position (3,) [m] of a tool (3, 3) in the base."""
    by = station.turn_from(work, rotation)
    angle = float(np.linalg.norm(by))
    path = straight_path(position, station.place, law, angle)
    now, inverse = tool_turn(work, rotation), work.axes_in_tool.T
    axis = inverse @ rotation_matrix(now.tolist()) @ (by / max(angle, 1e-12))
    turned = None
    if station.turn is not None:
        turned = np.array([inverse @ turn_after(now, by * (1.0 - left)) for left in path.left.tolist()])
    idle = np.zeros(len(path.times), bool)
    turning = path.turning[:, None] * axis
    return path.times, Setpoint(path.position, path.velocity, idle, turned, turning, law.lever)
