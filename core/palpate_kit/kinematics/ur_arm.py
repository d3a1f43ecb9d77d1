"""Kinematics of Universal Robots' e-Series.

Nominal: Universal Robots, "DH parameters for calculations of kinematics and dynamics"; every arm has small deltas of
its own in its calibration file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from palpate import Floats

from palpate_kit.kinematics.arm_model import ArmModel, DHJoint

ALPHA = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)  # [rad]
JOINTS = (
    *("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"),
    *("wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
)  # from the base to the flange, by the names that the ROS driver gives them
_PLACES = ("elbow", "wrist 1", "wrist 2", "wrist 3", "flange")


def _model(name: str, upper: float, fore: float, d: tuple[float, ...], degrees: tuple[int, ...]) -> ArmModel:
    """Return the model of an arm by the lengths [m] of upper arm and forearm, the offsets d [m] of shoulder and wrists,
    and the fastest turn [deg/s] of each joint."""
    shoulder, wrist_1, wrist_2, wrist_3 = d
    a, offsets = (0.0, -upper, -fore, 0.0, 0.0, 0.0), (shoulder, 0.0, 0.0, wrist_1, wrist_2, wrist_3)
    rows = zip(JOINTS, a, offsets, ALPHA, degrees, strict=True)
    joints = [
        DHJoint(name=joint_name, a=length, d=offset, alpha=alpha, speed=math.radians(degrees_per_second))
        for joint_name, length, offset, alpha, degrees_per_second in rows
    ]
    return ArmModel.of_dh(name, joints, places=_PLACES)


# Lengths [m] by the maker's table (see above), speeds [deg/s] by its data sheets.
_SLOW, _LARGE = (180,) * 6, (0.1807, 0.17415, 0.11985, 0.11655)
UR3E = _model("ur3e", 0.24355, 0.2132, (0.15185, 0.13105, 0.08535, 0.0921), (180, 180, 180, 360, 360, 360))
UR5E = _model("ur5e", 0.425, 0.3922, (0.1625, 0.1333, 0.0997, 0.0996), _SLOW)
UR10E = _model("ur10e", 0.6127, 0.57155, _LARGE, (120, 120, 180, 180, 180, 180))
UR16E = _model("ur16e", 0.4784, 0.36, _LARGE, (120, 120, 180, 180, 180, 180))
MODELS = {model.name: model for model in (UR3E, UR5E, UR10E, UR16E)}
_X, _Z = 9, 11  # of the twelve numbers of a link: its translation along x and z
A, D = ([link[column] for link in UR3E.links] for column in (_X, _Z))  # [m]


def distinguishable(q: Sequence[float], tcp: Floats, position: Floats) -> tuple[ArmModel, float]:
    """Return the model whose forward kinematics come nearest to a measured position (3,) [m] of the tip, and how
    near [m]."""
    distances = {name: float(np.linalg.norm(model.tip(q, tcp)[0][:3, 3] - position)) for name, model in MODELS.items()}
    nearest = min(distances, key=lambda name: distances[name])
    return MODELS[nearest], distances[nearest]
