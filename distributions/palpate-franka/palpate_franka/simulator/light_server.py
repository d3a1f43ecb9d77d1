"""franky-sim's robot at 1 kHz on one of two cores: its own numbers and bytes, by fewer steps of the interpreter."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from franky_sim import FrankaRobotServer
from franky_sim.base_simulator import InnerRobotState
from franky_sim.franka_robot_state import FrankaRobotState
from franky_sim.franka_server import FrankaServer

_STATE = struct.Struct("<320f 85B f")


def packed(s: Any) -> bytes:
    """Return a state as bytes, as `FrankaRobotState.pack_state` does, in one call.

    Little-endian, without gaps: 320 floats of 4 bytes, 85 bytes (two modes of the controller, twice 41 errors, of the
    present and of the last reflex, and the mode of the robot), and the success rate as a float.
    """
    return _STATE.pack(
        *s.O_T_EE, *s.O_T_EE_d, *s.F_T_EE, *s.EE_T_K, *s.F_T_NE, *s.NE_T_EE,
        s.m_ee, *s.I_ee, *s.F_x_Cee[:3], s.m_load, *s.I_load, *s.F_x_Cload[:3], *s.elbow, *s.elbow_d,
        *s.tau_J, *s.tau_J_d, *s.dtau_J, *s.q, *s.q_d, *s.dq, *s.dq_d, *s.ddq_d,
        *s.joint_contact, *s.cartesian_contact, *s.joint_collision, *s.cartesian_collision,
        *s.tau_ext_hat_filtered, *s.O_F_ext_hat_K, *s.K_F_ext_hat_K, *s.O_dP_EE_d, *s.O_ddP_O[:3],
        *s.elbow_c, *s.delbow_c, *s.ddelbow_c, *s.O_T_EE_c, *s.O_dP_EE_c, *s.O_ddP_EE_c,
        *s.theta, *s.dtheta, *s.accelerometer_top, *s.accelerometer_bottom,
        s.motion_generator_mode.value, s.controller_mode.value,
        *map(bool, s.errors), *map(bool, s.reflex_reason), s.robot_mode.value, s.control_command_success_rate,
    )  # fmt: skip


def replaced(state: Any, **changes: Any) -> Any:
    """Return a state with changes, as `FrankaRobotState.replace` does, without a look at each of its fields."""
    new = object.__new__(type(state))
    new.__dict__.update(state.__dict__, **changes)
    return new


class Joints:
    """State of the joints as by `FrankaMujocoRobot._get_state`, computed once an instant, with encoder noise [rad].

    The server calls it four times an instant. A real encoder never reads the same in every digit: palpate recognises
    repeated states by that.
    """

    def __init__(self, robot: Any, std: float, seed: int) -> None:
        self._robot, self._std, self._random = robot, std, np.random.default_rng(seed)
        self._time: float | None = None
        self._state: Any = None

    def __call__(self) -> Any:
        """Return the state of the joints."""
        data = self._robot.data
        if data.time != self._time:
            angles = data.qpos[:7] + self._std * self._random.standard_normal(7)
            rows = angles, data.qvel[:7], self._robot._applied_torques
            self._time, self._state = data.time, InnerRobotState(*(tuple(row.tolist()) for row in rows))
        return self._state


def lighten(robot: Any, std: float, seed: int) -> None:
    """Make the server of a robot lighter: its gripper is not asked for, and its fingers hang loose."""
    FrankaRobotState.pack_state, FrankaRobotState.replace = packed, replaced
    robot._get_state, robot._pre_step = Joints(robot, std, seed), lambda: None
    # Pinocchio's pose is overwritten by the next one: without a copy the measured pose at rest is the desired one.
    pose_at = robot.kinematics
    robot.kinematics = lambda joints: pose_at(joints).copy()
    FrankaRobotServer.process_commands = FrankaServer.process_commands
    FrankaRobotServer.send_state = FrankaServer.send_state
