"""The work frame from four touched points: a plane through three, and a fourth that has to lie on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector
from palpate_kit.kinematics.work_frame import WorkFrame

# Choices.
_MIN_DISTANCE = 5e-3  # [m] between a point and the line of two others, and between the fourth and the others
_MIN_HEIGHT_SHARE = 0.1  # of its longest side, that a triangle is high
_MAX_TILT = math.radians(30.0)  # between the tool and the normal
_SMALLEST_SINE = 1e-9  # between two axes, below which they are parallel
_SMALLEST_LENGTH = 1e-12  # [m] in a quotient, in place of 0
_MM = 1e3  # per metre
_UP = np.array([0.0, 0.0, 1.0])  # the z of the base


@dataclass(frozen=True)
class SurfacePlane:
    """A plane in the base, with its normal out of the material."""

    place: Floats  # (3,) [m] of one of its points
    normal: Floats  # (3,)

    @classmethod
    def through(cls, points: Floats, outwards: Floats) -> SurfacePlane:
        """Return the plane of three points (3, 3) [m]; `outwards` (3,) is where the tool comes from.

        Raises ConfigurationError where they lie on one line, or where the tool does not look at their plane.
        """
        # The cross product of two sides is twice the area: over the longest side, the least height of the triangle.
        sides = [np.linalg.norm(points[i] - points[i - 1]) for i in range(3)]
        cross_product = np.cross(points[1] - points[0], points[2] - points[0])
        longest = float(max(sides))
        height = float(np.linalg.norm(cross_product)) / max(longest, _SMALLEST_LENGTH)
        min_height = max(_MIN_DISTANCE, _MIN_HEIGHT_SHARE * longest)
        if height < min_height:
            raise ConfigurationError(
                f"the three points lie on one line, or nearly so: one of them is {_MM * height:.1f} mm from the line "
                f"of the others, and at least {_MM * min_height:.1f} mm are needed: touch a triangle"
            )
        # The normal on the side of the tool.
        normal = cross_product / np.linalg.norm(cross_product)
        normal = normal if float(normal @ outwards) >= 0 else -normal
        tilt = math.acos(min(float(normal @ outwards), 1.0))
        if tilt > _MAX_TILT:
            raise ConfigurationError(
                f"the plane of the three points is tilted by {math.degrees(tilt):.0f} deg from the tool, over "
                f"{math.degrees(_MAX_TILT):g} deg: did one of them not touch the surface?"
            )
        return cls(points[0], normal)

    def height_of(self, point: Floats) -> float:
        """Return how far [m] a point (3,) lies out of the material."""
        return float((point - self.place) @ self.normal)


def check_fourth(plane: SurfacePlane, points: Floats, fourth: Floats, tolerance: float) -> float:
    """Return the height [m] of a fourth point (3,) over the plane of three (3, 3).

    Raises ConfigurationError where it is over the tolerance [m], or the point next to one of the three.
    """
    nearest = float(np.linalg.norm(points - fourth, axis=1).min())
    if nearest < _MIN_DISTANCE:
        raise ConfigurationError(
            f"the fourth point is {_MM * nearest:.1f} mm from one of the first three and shows nothing: at least "
            f"{_MM * _MIN_DISTANCE:g} mm are needed"
        )
    height = plane.height_of(fourth)
    if abs(height) > tolerance:
        raise ConfigurationError(
            f"the fourth point contradicts the first three: it lies {_MM * abs(height):.2f} mm "
            f"{'above' if height > 0 else 'below'} their plane, over --tolerance {_MM * tolerance:g} mm: touch all "
            "four again, or the surface is not a plane"
        )
    return height


def work_frame(plane: SurfacePlane, origin: Floats, tool: Floats) -> tuple[WorkFrame, float]:
    """Return the frame at a point (3,) of a plane for a tool (3, 3) in the base, and the angle [rad] between both.

    The frame is turned from the base's orientation by as little as possible, around up x normal. Its tool is turned
    around the normal to be as near as possible to the real one; the angle is what remains.
    """
    # The shortest turn of the base's z onto the normal, as a rotation vector.
    axis = np.cross(_UP, plane.normal)
    sine = float(np.linalg.norm(axis))
    angle = math.atan2(sine, float(_UP @ plane.normal))
    # Along the z axis the turn is about any horizontal axis: x.
    rotation = axis * (angle / sine) if sine > _SMALLEST_SINE else np.array([angle, 0.0, 0.0])
    # The frame at the foot of the origin, and its tool turned about the normal as the real one is.
    foot = origin - plane.height_of(origin) * plane.normal
    unturned = WorkFrame(origin=_coordinates(foot), rotation=_coordinates(rotation))
    from_unturned = unturned.tool.T @ tool
    # The angle about z of the rotation nearest to it, by its upper 2 x 2 block.
    turn = math.atan2(from_unturned[1, 0] - from_unturned[0, 1], from_unturned[0, 0] + from_unturned[1, 1])
    frame = unturned.model_copy(update={"turn": turn})
    # What no turn about the normal explains.
    remainder = rotation_matrix((0.0, 0.0, -turn)) @ from_unturned
    return WorkFrame.model_validate(frame.model_dump()), float(np.linalg.norm(rotation_vector(remainder)))


def _coordinates(vector: Floats) -> tuple[float, float, float]:
    """Return the three numbers of a vector (3,)."""
    x, y, z = vector.tolist()
    return x, y, z
