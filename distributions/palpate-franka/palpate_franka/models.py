"""Kinematics of Franka's arms: Craig's Denavit-Hartenberg parameters, ends and speeds, by the maker's manual."""

from __future__ import annotations

import math

from palpate_kit.kinematics.arm_model import ArmModel, DHJoint

# Craig's parameters of the seven joints, and the flange beyond the last.
_A = (0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088)  # [m]
_D = (0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0)  # [m]
_QUARTER_TURNS = (0.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0)  # of alpha
_FLANGE = 0.107  # [m]
JOINTS = tuple(f"joint{i}" for i in range(1, 8))
POSTURE = (0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.785)  # [rad] with the tool downwards, a choice


def _model(name: str, low: tuple[float, ...], high: tuple[float, ...], speed: tuple[float, ...]) -> ArmModel:
    """Return an arm whose joints have these ends [rad] and largest speeds [rad/s]."""
    joints = [
        DHJoint(
            name=joint,
            a=_A[i],
            d=_D[i],
            alpha=_QUARTER_TURNS[i] * math.pi / 2,
            low=low[i],
            high=high[i],
            speed=speed[i],
        )
        for i, joint in enumerate(JOINTS)
    ]
    return ArmModel.of_dh(name, joints, flange=_FLANGE, modified=True)


MODELS = {
    "fr3": _model(
        "fr3",
        (-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159),
        (2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159),
        (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
    ),
    "panda": _model(
        "panda",
        (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
        (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
        (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    ),
}
