"""The plane of a station, against which depth and angle of a tool are judged."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import Floats, turned_axes
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector, shortest_turn
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_arms.setpoint_rows import PLAN

# Choices.
_ROUNDING = 1e-9  # [m]
_UNIT_ERROR = 1e-6  # by which the length of a normal may be off 1


@dataclass(frozen=True)
class StationPlane:
    """Foot and normal in the work frame."""

    foot: Floats  # (3,) [m]
    normal: Floats  # (3,)

    @classmethod
    def of_row(cls, row: Floats) -> StationPlane:
        """Return the plane of a row (16,) of a plan."""
        return cls(row[PLAN["foot"]], row[PLAN["normal"]])

    @property
    def is_one(self) -> bool:
        """True if these are numbers, and the normal is of length 1."""
        return bool(np.isfinite(self.foot).all()) and abs(float(np.linalg.norm(self.normal)) - 1.0) <= _UNIT_ERROR

    @property
    def is_level(self) -> bool:
        """True if the normal is that of the work frame."""
        return bool(self.normal[2] >= 1.0)

    def height(self, place: Floats) -> float:
        """Return the height [m] of a place (3,) [m] above it."""
        return float((place - self.foot) @ self.normal)

    def off_tool(self, rotation: Floats, work: WorkFrame) -> float:
        """Return the angle [rad] between the normal and a tool (3, 3) in the base.

        By its tangent: the length of the cross product over the scalar product of both.
        """
        a, b, c = (-(work.matrix[:3, :3].T @ rotation[:, 2])).tolist()
        x, y, z = self.normal.tolist()
        # By plain floats: numpy's cross product is a twentieth of a period of the servo loop.
        across = math.hypot(b * z - c * y, c * x - a * z, a * y - b * x)
        return math.atan2(across, a * x + b * y + c * z)

    def off_turn(self, turn: Floats, work: WorkFrame) -> float:
        """Return the angle [rad] between a turn (3,) of the tool, in its frame, and the shortest one to the normal."""
        if self.is_level:
            return math.hypot(*turn.tolist())
        local = rotation_matrix((work.axes_in_tool @ shortest_turn(self.normal)).tolist())
        return math.hypot(*rotation_vector(local.T @ rotation_matrix(turn.tolist())).tolist())


LEVEL = StationPlane(np.zeros(3), np.array([0.0, 0.0, 1.0]))


def pressed_in_at_the_end(ends: Floats) -> str | None:
    """Return why the tip would stay in the material after a plan with first and last rows (2, 16); None if not."""
    first, last = (StationPlane.of_row(row).height(row[PLAN["position"]]) for row in ends)
    if last >= min(first, 0.0) - _ROUNDING:
        return None
    return f"the motion ends with the tip {-1e3 * last:.2f} mm below the skin, where it would stay"


@dataclass(frozen=True)
class StationExtremes:
    """The extremes of rows (n, 16) of a plan, against the planes of their stations."""

    are_planes: bool  # all normals are of length 1
    angle: float  # [rad] between tool and normal
    depth: float  # [m] below the plane

    @classmethod
    def of(cls, rows: Floats, work: WorkFrame) -> StationExtremes:
        """Return the extremes of all rows (n, 16)."""
        normal = rows[:, PLAN["normal"]]
        off = np.abs(np.linalg.norm(normal, axis=1) - 1.0).max(initial=0.0)
        cosine = (turned_axes(rows[:, PLAN["turn"]] @ work.axes_in_tool) * normal).sum(axis=1).min(initial=1.0)
        height = ((rows[:, PLAN["position"]] - rows[:, PLAN["foot"]]) * normal).sum(axis=1).min(initial=0.0)
        return cls(bool(off <= _UNIT_ERROR), math.acos(max(min(float(cosine), 1.0), -1.0)), -float(height))
