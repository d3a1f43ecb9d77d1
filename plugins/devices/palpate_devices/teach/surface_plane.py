"""The work frame from four touched points: a plane through three, and a fourth that has to lie on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector
from palpate_kit.kinematics.work_frame import WorkFrame

_APART = 5e-3  # [m] between a point and the line of two others, and between the fourth and the others
_SLIM = 0.1  # of its longest side that a triangle is high at least
_TILT = math.radians(30.0)  # between the tool and the normal
_UP = np.array([0.0, 0.0, 1.0])


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
        sides = [np.linalg.norm(points[i] - points[i - 1]) for i in range(3)]
        across = np.cross(points[1] - points[0], points[2] - points[0])
        longest = float(max(sides))
        height = float(np.linalg.norm(across)) / max(longest, 1e-12)
        if height < max(_APART, _SLIM * longest):
            raise ConfigurationError(
                f"the three points lie on one line, or nearly so: one of them is {1e3 * height:.1f} mm from the line "
                f"of the others, and at least {1e3 * max(_APART, _SLIM * longest):.1f} mm are needed: touch a triangle"
            )
        normal = across / np.linalg.norm(across)
        normal = normal if float(normal @ outwards) >= 0 else -normal
        tilt = math.acos(min(float(normal @ outwards), 1.0))
        if tilt > _TILT:
            raise ConfigurationError(
                f"the plane of the three points is tilted by {math.degrees(tilt):.0f} deg from the tool, over "
                f"{math.degrees(_TILT):g} deg: did one of them not touch the surface?"
            )
        return cls(points[0], normal)

    def height_of(self, point: Floats) -> float:
        """Return how far [m] a point (3,) lies out of the material."""
        return float((point - self.place) @ self.normal)


def check_fourth(plane: SurfacePlane, points: Floats, fourth: Floats, tolerance: float) -> float:
    """Height [m] of a fourth point (3,) over the plane of three (3, 3); raises ConfigurationError."""
    nearest = float(np.linalg.norm(points - fourth, axis=1).min())
    if nearest < _APART:
        raise ConfigurationError(
            f"the fourth point is {1e3 * nearest:.1f} mm from one of the first three and shows nothing: at least "
            f"{1e3 * _APART:g} mm are needed"
        )
    height = plane.height_of(fourth)
    if abs(height) > tolerance:
        raise ConfigurationError(
            f"the fourth point contradicts the first three: it lies {1e3 * abs(height):.2f} mm "
            f"{'above' if height > 0 else 'below'} their plane, over --tolerance {1e3 * tolerance:g} mm: touch all "
            "four again, or the surface is not a plane"
        )
    return height


def work_frame(plane: SurfacePlane, origin: Floats, tool: Floats) -> tuple[WorkFrame, float]:
    """The frame at a point (3,) of a plane for a tool (3, 3) in the base, and by what angle [rad] that is off it.

    Turned from the base's orientation by as little as possible; the tool's own turn is what remains about its axis.
    """
    axis = np.cross(_UP, plane.normal)
    sine = float(np.linalg.norm(axis))
    angle = math.atan2(sine, float(_UP @ plane.normal))
    vector = axis * (angle / sine) if sine > 1e-9 else np.array([angle, 0.0, 0.0])
    place = origin - plane.height_of(origin) * plane.normal
    bare = WorkFrame(origin=_three(place), rotation=_three(vector))
    left = bare.tool.T @ tool
    turn = math.atan2(left[1, 0] - left[0, 1], left[0, 0] + left[1, 1])
    frame = bare.model_copy(update={"turn": turn})
    rest = rotation_matrix((0.0, 0.0, -turn)) @ left
    return WorkFrame.model_validate(frame.model_dump()), float(np.linalg.norm(rotation_vector(rest)))


def _three(vector: Floats) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
