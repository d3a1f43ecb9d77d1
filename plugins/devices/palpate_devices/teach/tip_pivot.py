"""Where the tip is on the flange, by turning the tool about it: the tip stays, the flange goes round."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_kit.kinematics.rotations import rotation_vector
from palpate_kit.numerics.normal_equations import linear_regression

_LEAST = math.radians(5.0)  # of each turn
_SLID = 0.5e-3  # [m]
_OFF = 1e-3  # [m]


@dataclass(frozen=True)
class Pivot:
    """The point about which a tool turned."""

    place: Floats  # (3,) [m] on the flange
    std: float  # [m] largest standard uncertainty of it
    residual: float  # [m] root mean square of what the point moved


def pivot_of(flanges: Sequence[Floats]) -> Pivot:
    """Return the point that stood still while the flange (4, 4) took some postures; raises ConfigurationError.

    R t + p = c for each posture with rotation R and place p: least squares for t on the flange and c in the base.
    """
    first = flanges[0][:3, :3]
    turns = np.array([rotation_vector(first.T @ flange[:3, :3]) for flange in flanges[1:]])
    angles = np.linalg.norm(turns, axis=1)
    if (small := float(angles.min())) < _LEAST:
        raise ConfigurationError(
            f"a turn of {math.degrees(small):.1f} deg shows too little: at least {math.degrees(_LEAST):g} deg "
            "are needed"
        )
    if np.linalg.svd(turns, compute_uv=False)[1] < 0.3 * float(angles.max()):
        raise ConfigurationError("all turns were about one axis: turn the tool sideways as well as forwards")
    matrix = np.vstack([np.hstack([flange[:3, :3], -np.eye(3)]) for flange in flanges])
    regression = linear_regression(matrix, -np.concatenate([flange[:3, 3] for flange in flanges]))
    # Three coordinates of a place are one distance.
    return Pivot(regression.weights[:3], float(regression.errors()[:3].max()), math.sqrt(3.0) * regression.rms)


def check_tip(pivot: Pivot, tool: Floats, radius: float) -> float:
    """Distance [m] of a pivot from where a tool (4, 4) has it; raises ConfigurationError where that is too far.

    A ball in a hole turns about its centre, `radius` [m] behind the tip; a pointed tip has none.
    """
    if pivot.residual > _SLID:
        raise ConfigurationError(
            f"the tip slid by {1e3 * pivot.residual:.1f} mm while the tool was turned, over {1e3 * _SLID:g} mm: hold "
            "it in a small hole, and turn again"
        )
    if pivot.std > _OFF / 2:
        raise ConfigurationError(
            f"the turns show the tip to {1e3 * pivot.std:.1f} mm only: turn farther, and hold the tip better"
        )
    centre = tool[:3, 3] - radius * tool[:3, 2]
    apart = float(np.linalg.norm(pivot.place - centre))
    if apart > _OFF:
        tip = pivot.place + radius * tool[:3, 2]
        fits = ", ".join(f'"{1e3 * x + 0.0:.1f} mm"' for x in tip)
        raise ConfigurationError(
            f"the tool turned about a point {1e3 * apart:.1f} mm from where tcp has the tip, over {1e3 * _OFF:g} mm: "
            f"tcp = [{fits}] would agree; set it in the pipeline and on the pendant"
        )
    return apart
