"""The robot as `ur_rtde` shows it: states in, commands out, in the work frame."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate_devices.ur3e.frame import WorkFrame
from palpate_devices.ur3e.kinematics import pose_of
from palpate_devices.ur3e.servo import PERIOD

Floats = NDArray[np.float64]

PLAYING = 2  # runtime state
_VARIABLES = [
    *("timestamp", "actual_q", "actual_qd", "actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force"),
    *("robot_mode", "safety_mode", "runtime_state", "robot_status_bits", "safety_status_bits"),
]


class Robot:
    """The client library's two objects, and the state that they last gave.

    Its constructor raises RuntimeError in the library's words, takes seconds where the controller does not begin
    to send, and hangs for ever, interpreter's lock held, where it accepts and is silent: only a process that may be
    killed makes one.
    """

    def __init__(self, settings: dict[str, Any]) -> None:
        import rtde_control
        import rtde_receive

        self.receive = rtde_receive.RTDEReceiveInterface(settings["host"], 500.0, _VARIABLES)
        if not self.receive.isConnected():  # it says so by this alone, and only after 2.5 s
            raise RuntimeError("the controller refuses to start sending its state, or sends nothing")
        self.control = rtde_control.RTDEControlInterface(settings["host"], 500.0)
        self.control.setWatchdog(settings["watchdog"])
        self.control.setTcp([*settings["tcp"], 0.0, 0.0, 0.0])
        self._work = WorkFrame.model_construct(**settings["work"])
        self._out, self._origin = self._work.matrix[:3, :3], self._work.matrix[:3, 3]
        self._turn = pose_of(self._work.tool_pose(self._origin))[3:]
        self._servo = PERIOD, settings["lookahead"], settings["servo_gain"]
        self.stamp, self.seen = -1.0, time.monotonic_ns()
        self.state: list[float] = []
        self.modes = (7, 1, PLAYING)

    def poll(self) -> bool:
        """Take over a new state; False where there is none."""
        receive = self.receive
        stamp = receive.getTimestamp()
        if stamp == self.stamp:
            return False
        now = time.monotonic_ns()
        values, modes = self._read()
        for _ in range(2):
            again = receive.getTimestamp()
            if again == stamp:
                break
            stamp, now = again, time.monotonic_ns()  # a packet came in between: its values may be mixed
            values, modes = self._read()
        if len(values) != 30:
            return False
        self.stamp, self.seen, self.state, self.modes = stamp, now, values, modes
        return True

    def _read(self) -> tuple[list[float], tuple[int, int, int]]:
        receive = self.receive
        values = [
            *receive.getActualQ(),
            *receive.getActualQd(),
            *receive.getActualTCPPose(),
            *receive.getActualTCPSpeed(),
            *receive.getActualTCPForce(),
        ]
        return values, (receive.getRobotMode(), receive.getSafetyMode(), receive.getRuntimeState())

    def place(self) -> tuple[Floats, Floats]:
        """Position and velocity (3,) of the tip in the work frame."""
        inwards = self._out.T
        return inwards @ (np.array(self.state[12:15]) - self._origin), inwards @ np.array(self.state[18:21])

    def servo(self, position: Floats) -> bool:
        """Send the arm to a position in the work frame; True means sent, not done."""
        target = (self._origin + self._out @ position).tolist()
        if not all(map(math.isfinite, target)):
            raise ValueError("a command that is no number")
        return bool(self.control.servoL([*target, *self._turn], 0.5, 0.5, *self._servo))
