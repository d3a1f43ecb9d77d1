"""The place of the tip on the flange, by turning the tool about the tip: the tip stays, the flange goes round."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_kit.kinematics.rotations import rotation_vector
from palpate_kit.numerics.normal_equations import linear_regression

# Choices.
_MIN_TURN = math.radians(5.0)  # of each posture against the first
_MIN_SIDEWAYS_TURN = 0.3  # of the largest turn, around a second axis
_MAX_SLIDE = 0.5e-3  # [m] root mean square of what the tip moved
_MAX_DISTANCE = 1e-3  # [m] of the pivot from the declared tip
_MM = 1e3  # per metre
_MAX_STD = _MAX_DISTANCE / 2  # [m] of the pivot


@dataclass(frozen=True)
class Pivot:
    """The point about which a tool was turned."""

    place: Floats  # (3,) [m] on the flange
    std: float  # [m] largest standard uncertainty of it
    residual: float  # [m] root mean square of what the point moved


def pivot_of(flanges: Sequence[Floats]) -> Pivot:
    """Return the point that stood still while the flange (4, 4) took some postures.

    R t + p = c for each posture with rotation R and place p: least squares for t on the flange and c in the base.
    Raises ConfigurationError where a turn is too small, or all are around one axis.
    """
    # Rotation vectors of all postures against the first.
    first = flanges[0][:3, :3]
    turns = np.array([rotation_vector(first.T @ flange[:3, :3]) for flange in flanges[1:]])
    angles = np.linalg.norm(turns, axis=1)
    smallest = float(angles.min())
    if smallest < _MIN_TURN:
        raise ConfigurationError(
            f"a turn of {math.degrees(smallest):.1f} deg shows too little: at least {math.degrees(_MIN_TURN):g} deg "
            "are needed"
        )
    # The second singular value of the rotation vectors is their part across the main axis.
    if np.linalg.svd(turns, compute_uv=False)[1] < _MIN_SIDEWAYS_TURN * float(angles.max()):
        raise ConfigurationError("all turns were about one axis: turn the tool sideways as well as forwards")
    # R t - c = -p, three rows for each posture.
    matrix = np.vstack([np.hstack([flange[:3, :3], -np.eye(3)]) for flange in flanges])
    regression = linear_regression(matrix, -np.concatenate([flange[:3, 3] for flange in flanges]))
    # The first three unknowns are t. Three coordinates of a place are one distance: sqrt(3) times the rms of one.
    return Pivot(regression.weights[:3], float(regression.errors()[:3].max()), math.sqrt(3.0) * regression.rms)


def check_tip(pivot: Pivot, tool: Floats, radius: float) -> float:
    """Return the distance [m] of a pivot from the place that a tool (4, 4) declares.

    A ball in a hole turns about its centre, `radius` [m] behind the tip along the tool's z axis; that of a pointed tip
    is 0. Raises ConfigurationError where the distance is over 1 mm, where the tip slid, or where the turns do not
    determine it.
    """
    if pivot.residual > _MAX_SLIDE:
        raise ConfigurationError(
            f"the tip slid by {_MM * pivot.residual:.1f} mm while the tool was turned, over {_MM * _MAX_SLIDE:g} mm: "
            "hold it in a small hole, and turn again"
        )
    if pivot.std > _MAX_STD:
        raise ConfigurationError(
            f"the turns show the tip to {_MM * pivot.std:.1f} mm only: turn farther, and hold the tip better"
        )
    centre = tool[:3, 3] - radius * tool[:3, 2]
    distance = float(np.linalg.norm(pivot.place - centre))
    if distance > _MAX_DISTANCE:
        tip = pivot.place + radius * tool[:3, 2]
        tcp = ", ".join(f'"{_MM * x:z.1f} mm"' for x in tip)
        raise ConfigurationError(
            f"the tool turned about a point {_MM * distance:.1f} mm from where tcp has the tip, over "
            f"{_MM * _MAX_DISTANCE:g} mm: tcp = [{tcp}] would agree; set it in the pipeline and on the pendant"
        )
    return distance
