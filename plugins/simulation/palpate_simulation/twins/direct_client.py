"""The client of a software controller that calls it directly, with the methods of `ur_rtde` that a robot uses.

Neither sockets nor time-outs of the wall clock lie between: this is how a robot is driven in simulated time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import accumulate
from typing import Any, ClassVar

from palpate import clock

from palpate_simulation.twins.arm import TICK
from palpate_simulation.twins.direct_ports import DirectPorts
from palpate_simulation.twins.rtde import OUTPUTS, layout
from palpate_simulation.twins.ur_commands import DONE, READY, ScriptCommand

_READ_BACK_BYTES = 17  # of a data packet: its recipe in one byte, then two doubles
_PROGRAM = "def rtde_control():\n# int register offset 0\nend\n"
_START_TIMEOUT = 5.0  # [s] for the program to start, as in the library
_ANSWER_TIMEOUT = 300.0  # [s]; the library waits so long for a command that is never carried out
_STOP_DECELERATION = 10.0  # [m/s^2] that servoStop passes by default, as in the library
_PROGRAM_RUNS = 2  # bit of the robot's status
_COMMAND_REGISTER, _PARAMETER_REGISTER = "input_int_register_0", "input_double_register_"
# Ranges that the library accepts in servoL after the pose: speed, acceleration, time [s], lookahead [s], gain.
SERVO_RANGES = ((0.0, 3.14), (0.0, 40.0), (-math.inf, math.inf), (0.03, 0.2), (100.0, 2000.0))


class DirectReadBack:
    """Register of a controller that commands write, read back as by `ur3e.echo.ReadBack`."""

    def __init__(self, ports: DirectPorts) -> None:
        self._ports, self._connection = ports, ports.connections
        self._last_stamp = -1.0  # [s]
        self.wrong_size: tuple[int, int] | None = None  # bytes of a packet, and those that were expected

    def latest(self) -> tuple[float, float] | None:
        """Return the controller's time [s] and the register of the newest state; None without a new one."""
        state = self._ports.latest
        if self._ports.missing:
            self.wrong_size = max(_READ_BACK_BYTES - self._ports.missing, 1), _READ_BACK_BYTES
            return None
        if state is None or self._ports.connections != self._connection or state["timestamp"] == self._last_stamp:
            return None
        self._last_stamp = float(state["timestamp"])
        return self._last_stamp, float(state["input_double_register_7"])


class DirectStates:
    """States of a controller, by the methods of `rtde_receive.RTDEReceiveInterface`.

    `variables` are the outputs of a packet in their order; a packet that lacks bytes lacks the last of them.
    """

    _OUTPUTS: ClassVar = {
        "getTimestamp": "timestamp",
        "getActualQ": "actual_q",
        "getActualQd": "actual_qd",
        "getTargetQ": "target_q",
        "getActualTCPPose": "actual_TCP_pose",
        "getTargetTCPPose": "target_TCP_pose",
        "getActualTCPSpeed": "actual_TCP_speed",
        "getActualTCPForce": "actual_TCP_force",
        "getFtRawWrench": "ft_raw_wrench",
        "getRobotMode": "robot_mode",
        "getSafetyMode": "safety_mode",
        "getRuntimeState": "runtime_state",
        "getSpeedScaling": "speed_scaling",
        "getTargetSpeedFraction": "target_speed_fraction",
        "getPayload": "payload",
        "getPayloadCog": "payload_cog",
    }

    def __init__(self, ports: DirectPorts, variables: Sequence[str] = ()) -> None:
        self._ports, self._connection = ports, ports.connections
        sizes = [layout([name], OUTPUTS).size for name in variables]
        self._ends = dict(zip(variables, accumulate(sizes), strict=True))  # byte after each output in a packet
        self._last: dict[str, Any] = dict(ports.controller.state()) if ports.latest is None else ports.latest
        self._starts = not ports.controller.refuses_start

    def isConnected(self) -> bool:  # noqa: N802, a name of the library
        """Return True if the connection stands."""
        return self._starts and self._ports.connections == self._connection

    def __getattr__(self, name: str) -> Any:
        """Return the method of the library that gives an output; raises AttributeError for any other name."""
        if name not in self._OUTPUTS:
            raise AttributeError(name)
        getter = partial(self._output, self._OUTPUTS[name])
        setattr(self, name, getter)  # found at once from now on: it is called 500 times a second
        return getter

    def _output(self, name: str) -> Any:
        """Return an output of the latest state, a number or (k,); after the connection's end, of the last one."""
        if self.isConnected() and self._ports.latest is not None:
            self._last = self._ports.latest
        output = self._last[name]
        # The library reads zeros beyond the end of a packet that is too short.
        if self._ports.missing and self._ends[name] > max(self._ends.values()) - self._ports.missing:
            return [0.0] * len(output) if isinstance(output, Sequence) else 0
        return output


class DirectCommands:
    """A control program and its commands, as `rtde_control.RTDEControlInterface` sends them.

    Raises RuntimeError in the library's words where the program does not start.
    """

    def __init__(self, ports: DirectPorts) -> None:
        self._ports, self._connection = ports, ports.connections
        # As the library: the register still has the command that ended the last program.
        self._ports.write({_COMMAND_REGISTER: ScriptCommand.NONE.value})
        ports.controller.upload(_PROGRAM)
        deadline = clock().now() + _START_TIMEOUT
        while not self.isProgramRunning():
            if clock().now() > deadline:
                raise RuntimeError("Failed to start control script, before timeout of 5 seconds")
            clock().sleep(TICK)

    def isConnected(self) -> bool:  # noqa: N802, a name of the library
        """Return True if the connection stands."""
        return self._ports.connections == self._connection

    def isProgramRunning(self) -> bool:  # noqa: N802
        """Return True if the program runs, by the latest state of this connection."""
        state = self._ports.latest_control
        return state is not None and bool(state["robot_status_bits"] & _PROGRAM_RUNS)

    def getTCPOffset(self) -> list[float]:  # noqa: N802
        """Return the pose (6,) of the tip on the flange."""
        self._carry_out(ScriptCommand.GET_TCP_OFFSET)
        state = self._ports.latest_control or {}
        return [float(state[f"output_double_register_{i}"]) for i in range(6)]

    def setTcp(self, tcp: Sequence[float]) -> bool:  # noqa: N802
        """Set the pose (6,) of the tip on the flange."""
        return self._carry_out(ScriptCommand.SET_TCP, *tcp)

    def setPayload(self, mass: float, centre: Sequence[float]) -> bool:  # noqa: N802
        """Set mass [kg] and centre of mass (3,) [m] on the flange."""
        return self._carry_out(ScriptCommand.SET_PAYLOAD, mass, *centre)

    def setWatchdog(self, frequency: float) -> bool:  # noqa: N802
        """Let the program end where commands come less often than at a frequency [Hz]."""
        return self._carry_out(ScriptCommand.SET_WATCHDOG, frequency)

    def kickWatchdog(self) -> bool:  # noqa: N802
        """Feed the watchdog by sending no command."""
        return self._send(ScriptCommand.NONE)

    def servoL(self, pose: Sequence[float], speed: float, acceleration: float, *servo: float) -> bool:  # noqa: N802
        """Go on to a pose (6,); `servo`: time [s], lookahead [s], gain. Raises ValueError where the library does."""
        for number, (low, high) in zip((speed, acceleration, *servo), SERVO_RANGES, strict=True):
            if not low <= number <= high:
                raise ValueError(f"The value is not within [{low:g};{high:g}]")
        return self._send(ScriptCommand.SERVOL, *pose, speed, acceleration, *servo)

    def servoStop(self) -> bool:  # noqa: N802
        """Come to rest."""
        return self._carry_out(ScriptCommand.SERVO_STOP, _STOP_DECELERATION)

    def stopScript(self) -> None:  # noqa: N802
        """End the program."""
        self._send(ScriptCommand.STOP_SCRIPT)

    def _send(self, command: ScriptCommand, *parameters: float) -> bool:
        """Write a command and its parameters to the registers; return False without a program."""
        if not (self.isConnected() and self.isProgramRunning()):
            return False
        registers = {f"{_PARAMETER_REGISTER}{i}": number for i, number in enumerate(parameters)}
        self._ports.write({_COMMAND_REGISTER: command.value, **registers})
        return True

    def _carry_out(self, command: ScriptCommand, *parameters: float) -> bool:
        """Carry out a command that is answered; return False without an answer."""
        is_done = self._wait_for(READY) and self._send(command, *parameters) and self._wait_for(DONE)
        return is_done and self._send(ScriptCommand.NONE)

    def _wait_for(self, status: int) -> bool:
        """Wait until the program reports a status; return False where it ends, or after 300 s."""
        deadline = clock().now() + _ANSWER_TIMEOUT
        while clock().now() < deadline and self.isConnected() and self.isProgramRunning():
            if (self._ports.latest_control or {}).get("output_int_register_0") == status:
                return True
            clock().sleep(TICK)
        return False
