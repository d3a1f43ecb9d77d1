"""The program that `ur_rtde` uploads, as the controller runs it: a command register, read at every tick."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.rotations import matrix_of, pose_of

from palpate_simulation.twins.arm import TICK, SimulatedArm
from palpate_simulation.twins.ur_commands import DONE, READY, REALTIME_COMMANDS, ScriptCommand

PARAMETERS = 14  # double registers of a command
# Indexes of parameters after the six numbers of a pose, of joints or of a speed.
SPEED, ACCELERATION, LOOKAHEAD, GAIN = 6, 7, 9, 10


class Program:
    """A running control program: commands come in `input_int_register_0`, parameters in the double registers.

    Carried out: servoJ/L, speedJ/L, moveJ/L and their stops, watchdog, TCP, kinematics, steadiness, protective stop,
    and what needs no motion (payload, zero of the force sensor). Any other command ends the program, and says so.
    The registers are counted from the offset that the script `text` states.
    """

    def __init__(self, text: str, arm: SimulatedArm, protect: Callable[[], None]) -> None:
        self._arm = arm
        self._protect = protect
        match = re.search(r"# int register offset\s*(\d+)", text)
        self._offset = int(match[1]) if match else 0
        self._is_busy: Callable[[], bool] | None = None  # of the command that is being carried out, as long as it is
        self._executing = False
        self._watchdog_time: float | None = None  # [s] between commands at most, once the watchdog is set
        self._fed_at = 0.0  # [s] of the last command
        self.zeroed = False
        self.outputs: dict[str, Any] = {}
        self.complaint = ""
        self._report_status(0)

    def feed(self, now: float) -> None:
        """Feed the watchdog at a time [s] at which the command register was written."""
        self._fed_at = now

    def step(self, inputs: dict[str, Any], now: float) -> bool:
        """Advance by a tick at a time [s], with the registers by name; return False where the program ends."""
        if self._watchdog_time is not None and now - self._fed_at > self._watchdog_time:
            self.complaint = "the watchdog found no command in time"
            return False
        # A move or a stop goes on until the arm is at rest.
        if self._is_busy is not None:
            if self._is_busy():
                return True
            self._is_busy = None
            self._report_status(DONE)
        command = int(inputs.get(f"input_int_register_{self._offset}", 0))
        if command in REALTIME_COMMANDS:
            self._report_status(READY)
            return self._carry_out(command, inputs)
        if command == ScriptCommand.NONE:
            self._executing = False
            self._report_status(READY)
            return True
        return self._executing or self._start(command, inputs)

    def _start(self, command: int, inputs: dict[str, Any]) -> bool:
        """Carry out a command once, until the register is 0 again; return False where the program ends."""
        self._executing = True
        if command == ScriptCommand.STOP_SCRIPT or not self._carry_out(command, inputs):
            return False
        if self._is_busy is None:
            self._report_status(DONE)
        return True

    def _report_status(self, status: int) -> None:
        """Write a status to the output register."""
        self.outputs[f"output_int_register_{self._offset}"] = status

    def _carry_out(self, command: int, inputs: dict[str, Any]) -> bool:
        """Carry out a command with the parameters in the registers; return False, with a complaint, if it cannot be."""
        p = [float(inputs.get(f"input_double_register_{self._offset + i}", 0.0)) for i in range(PARAMETERS)]
        arm, is_reached = self._arm, True
        match command:
            case ScriptCommand.SERVOJ:
                arm.servo(np.array(p[:6]), p[LOOKAHEAD], p[GAIN])
            case ScriptCommand.SERVOL:
                is_reached = arm.servo_to_pose(p[:6], p[LOOKAHEAD], p[GAIN])
            case ScriptCommand.SPEEDJ:
                arm.run_at(np.array(p[:6]))
            case ScriptCommand.SPEEDL:
                is_reached = arm.run_tip_at(p[:6])
            case ScriptCommand.MOVEJ | ScriptCommand.MOVEJ_IK | ScriptCommand.MOVEL | ScriptCommand.MOVEL_FK:
                is_asynchronous = int(inputs.get(f"input_int_register_{self._offset + 1}", 0))
                is_reached = self._move(command, p, bool(is_asynchronous))
            case ScriptCommand.SPEED_STOP | ScriptCommand.SERVO_STOP | ScriptCommand.STOPL | ScriptCommand.STOPJ:
                arm.stop()
                self._is_busy = self._is_moving
            case ScriptCommand.SET_WATCHDOG:
                self._watchdog_time = 1.0 / p[0] if p[0] > 0 else None
            case ScriptCommand.SET_TCP:
                arm.tcp = matrix_of(p[:6])
            case ScriptCommand.PROTECTIVE_STOP:
                self._protect()
            case ScriptCommand.ZERO_FORCE_SENSOR:
                self.zeroed = True
            case ScriptCommand.SET_PAYLOAD:
                self.outputs |= {"payload": p[0], "payload_cog": tuple(p[1:4])}
            case ScriptCommand.FORCE_MODE_STOP | ScriptCommand.SET_GRAVITY:
                pass
            case _:
                return self._answer(command, p)
        if not is_reached:
            self.complaint = f"command {command}: out of reach"
        return is_reached

    def _is_moving(self) -> bool:
        """Return True until the arm is at rest."""
        return self._arm.moving

    def _move(self, command: int, p: list[float], is_asynchronous: bool) -> bool:
        """Move to joints or to a pose, p[:6]; return False for one out of reach, or a speed or acceleration of 0."""
        arm, speed, acceleration = self._arm, p[SPEED], p[ACCELERATION]
        is_goal_in_joints = command in (ScriptCommand.MOVEJ, ScriptCommand.MOVEL_FK)
        goal: Floats | None = np.array(p[:6]) if is_goal_in_joints else arm.inverse(p[:6])
        if goal is None or speed <= 0 or acceleration <= 0:
            return False
        if command in (ScriptCommand.MOVEJ, ScriptCommand.MOVEJ_IK):
            arm.move(goal, speed, acceleration)
        elif not arm.move_linear(pose_of(arm.model.tip(goal.tolist(), arm.tcp)[0]), speed, acceleration):
            return False
        if not is_asynchronous:
            self._is_busy = self._is_moving
        return True

    def _answer(self, command: int, p: list[float]) -> bool:
        """Answer a query in the output registers; return False, with a complaint, for a command that is unknown.

        The numbers of the answer are in the double registers, 1 for success or yes in the second integer register.
        """
        arm = self._arm
        numbers: list[float] = []
        is_positive = True
        match command:
            case ScriptCommand.GET_STEPTIME:
                numbers = [TICK]
            case ScriptCommand.GET_TCP_OFFSET:
                numbers = pose_of(arm.tcp)
            case ScriptCommand.GET_FORWARD_KINEMATICS_ARGS:
                tool = matrix_of(p[6:12]) if any(p[6:12]) else arm.tcp
                numbers = pose_of(arm.model.tip(p[:6], tool)[0])
            case ScriptCommand.GET_INVERSE_KINEMATICS_ARGS | ScriptCommand.GET_INVERSE_KINEMATICS_DEFAULT:
                joints = arm.inverse(p[:6])
                numbers = [] if joints is None else joints.tolist()
                is_positive = joints is not None or not arm.moving
            case ScriptCommand.IS_STEADY:
                is_positive = not arm.moving
            case ScriptCommand.IS_POSE_WITHIN_SAFETY_LIMITS | ScriptCommand.IS_JOINTS_WITHIN_SAFETY_LIMITS:
                pass
            case _:
                self.complaint = f"command {command} is not carried out in software"
                return False
        self.outputs[f"output_int_register_{self._offset + 1}"] = int(is_positive)
        for i, number in enumerate(numbers):
            self.outputs[f"output_double_register_{self._offset + i}"] = number
        return True
