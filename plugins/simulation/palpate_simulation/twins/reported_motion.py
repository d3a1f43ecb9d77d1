"""Motion of a controller's arm as RTDE reports it: with the noise of its encoders, and the faults of its state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.rotations import pose_of, rotation_matrix

from palpate_simulation.twins.arm import SimulatedArm


class ReportedMotion:
    """Joints and poses that a controller reports; true but for noise, as long as no fault is set."""

    def __init__(self, arm: SimulatedArm, position_std: float, velocity_std: float, seed: int) -> None:
        self._arm = arm
        self._rng = np.random.default_rng(seed)
        self._position_std, self._velocity_std = position_std, velocity_std  # [m], [m/s] of the height
        self.restore()

    def restore(self) -> None:
        """End all faults."""
        self.stuck_pose: list[float] | None = None  # that is reported for ever
        self.is_nan = False  # the pose is not a number
        self.pose_offset = np.zeros(3)  # [m] of the pose, in the base
        self.frame_offset = np.zeros(3)  # [m] of the pose and its target, in the base
        self.stamp_leap = 0.0  # [s] of the time-stamps
        self.speed_factor = 1.0  # of the tip's speed

    def stick(self) -> None:
        """Keep reporting the present pose; everything else goes on."""
        self.stuck_pose = self._arm.pose

    def outputs(self, now: float) -> dict[str, Any]:
        """Return the outputs of RTDE that follow from the arm's joints, at a time of the controller [s]."""
        arm = self._arm
        pose, jacobian = arm.tip(arm.tcp)
        # Noise belongs to the joints, so that pose and joints agree; it is scaled to the noise of the height.
        lever = math.hypot(*jacobian[2].tolist()) or 1.0  # [m/rad]
        position_noise, velocity_noise = self._rng.standard_normal((2, len(arm.q)))
        joint_error = position_noise * (self._position_std / lever)
        joint_speed = arm.qd + velocity_noise * (self._velocity_std / lever)
        pose_error = jacobian @ joint_error
        measured = pose.copy()
        measured[:3, 3] += pose_error[:3] + self.pose_offset + self.frame_offset
        measured[:3, :3] = rotation_matrix(pose_error[3:].tolist()) @ pose[:3, :3]
        return {
            "timestamp": now + self.stamp_leap,
            "actual_q": (arm.q + joint_error).tolist(),
            "actual_qd": joint_speed.tolist(),
            "target_q": arm.q.tolist(),
            "target_qd": arm.qd.tolist(),
            "actual_TCP_pose": self._faulty_pose(pose_of(measured)),
            "actual_TCP_speed": (self.speed_factor * (jacobian @ joint_speed)).tolist(),
            "target_TCP_pose": _shifted_pose(pose_of(pose), self.frame_offset),
        }

    def _faulty_pose(self, pose: list[float]) -> list[float]:
        """Return a measured pose (6,), or what a fault reports in its place."""
        if self.is_nan:
            return [float("nan")] * 6
        return pose if self.stuck_pose is None else self.stuck_pose


def _shifted_pose(pose: list[float], offset: Floats) -> list[float]:
    """Return a pose (6,) moved by an offset (3,) [m]."""
    return [*(np.array(pose[:3]) + offset).tolist(), *pose[3:]]
