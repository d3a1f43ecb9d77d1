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
from palpate_simulation.twins.controller import Controller
from palpate_simulation.twins.delay_line import DelayLine
from palpate_simulation.twins.rtde import OUTPUTS, layout

_READ_BACK_BYTES = 17
_PROGRAM = "def rtde_control():\n# int register offset 0\nend\n"
_START = 5.0  # [s] for the program to start, as in the library
_ANSWER = 300.0  # [s]; the library waits so long for a command that is never carried out
_READY, _DONE = 1, 2
_COMMAND, _FIRST = "input_int_register_0", "input_double_register_"
# What the library takes of servoL besides the pose: speed, acceleration, time [s], lookahead [s], gain.
SERVO_RANGES = ((0.0, 3.14), (0.0, 40.0), (-math.inf, math.inf), (0.03, 0.2), (100.0, 2000.0))
_SERVO, _STOP_SERVO, _SET_TCP, _GET_TCP, _SET_PAYLOAD, _WATCHDOG, _KICK, _END = 24, 16, 29, 40, 17, 35, 0, 255


class DirectPorts:
    """What `ListeningPorts` are to the network (a RobotPorts): the latest state, and what can go wrong with it."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.sockets: list[Any] = []
        self.began = clock().now()
        self.frozen = self.mute = self.halved = self.greets_not = self.control_mute = False
        self.late: DelayLine[dict[str, Any]] = DelayLine()
        self.missing = 0
        self.shut_ports: set[int] = set()
        self.is_open = True
        self.connections = 0  # number of the present ones: every end of them counts one up
        self._held_until = 0.0  # monotonic time [s]
        self._held: list[dict[str, Any]] = []
        self.latest: dict[str, Any] | None = None  # as listeners have it
        self.latest_control: dict[str, Any] | None = None  # as the connection that commands has it

    def serve(self, ready: list[Any]) -> None:
        """Nothing waits: commands are calls."""

    def broadcast(self) -> None:
        """Take this tick's state."""
        if self._held and clock().now() >= self._held_until:
            for values in self._held:
                self._land(values)
            self.drop_unsent()
        if self.frozen or self.halved or self.mute:
            return
        self.late.put(dict(self.controller.state()), clock().now())
        for state in self.late.take(clock().now()):
            self.latest = state
        if not self.control_mute and clock().now() >= self._held_until:
            self.latest_control = self.latest

    def say(self, text: str) -> None:
        """The library passes over texts."""

    def shut(self, port: int) -> None:
        """Stop listening on one port."""
        self.shut_ports.add(port)

    def disconnect(self, reset: bool = False) -> None:
        """End every connection."""
        self.connections += 1

    def hold_back(self, duration: float) -> None:
        """Hold back what commands send, for a time [s]; then all of it lands at once."""
        self._held_until = clock().now() + duration

    def drop_unsent(self) -> None:
        """What is held back never lands: the connection was reset."""
        self._held = []

    def close(self, reset: bool = False) -> None:
        """Stop listening, and end every connection."""
        self.is_open = False
        self.disconnect()

    def restore(self) -> None:
        """Listen and answer again."""
        self.frozen = self.mute = self.halved = self.greets_not = self.control_mute = False
        self.missing = 0
        self.late.clear()
        self.is_open, self._held_until = True, 0.0
        self.drop_unsent()
        self.shut_ports.clear()

    def write(self, values: dict[str, Any]) -> None:
        """Inputs for the next tick, unless the connection is mute."""
        if self.control_mute or self.mute:
            return
        if clock().now() < self._held_until:
            self._held.append(values)
        else:
            self._land(values)

    def _land(self, values: dict[str, Any]) -> None:
        self.controller.write(values)
        self.controller.date(clock().now() - self.began)


class DirectReadBack:
    """What a controller has taken of its commands, as `ur3e.echo.ReadBack` gives it."""

    def __init__(self, ports: DirectPorts) -> None:
        self._ports, self._connection, self._seen = ports, ports.connections, -1.0
        self.wrong_size: tuple[int, int] | None = None

    def latest(self) -> tuple[float, float] | None:
        """Controller's time [s] and register of the newest state; None without a new one."""
        state = self._ports.latest
        if self._ports.missing:
            self.wrong_size = max(_READ_BACK_BYTES - self._ports.missing, 1), _READ_BACK_BYTES
            return None
        if state is None or self._ports.connections != self._connection or state["timestamp"] == self._seen:
            return None
        self._seen = float(state["timestamp"])
        return self._seen, float(state["input_double_register_7"])


class DirectStates:
    """The states of a controller, as `rtde_receive.RTDEReceiveInterface` gives them."""

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
        self._ends = dict(zip(variables, accumulate(sizes), strict=True))  # bytes of a packet
        self._last: dict[str, Any] = dict(ports.controller.state()) if ports.latest is None else ports.latest
        self._starts = not ports.controller.refuses_start

    def isConnected(self) -> bool:  # noqa: N802, a name of the library
        """Return True if the connection stands."""
        return self._starts and self._ports.connections == self._connection

    def __getattr__(self, name: str) -> Any:
        if name not in self._OUTPUTS:
            raise AttributeError(name)
        getter = partial(self._output, self._OUTPUTS[name])
        setattr(self, name, getter)  # it is asked for 500 times a second
        return getter

    def _output(self, name: str) -> Any:
        if self.isConnected() and self._ports.latest is not None:
            self._last = self._ports.latest
        value = self._last[name]
        if self._ports.missing and self._ends[name] > max(self._ends.values()) - self._ports.missing:
            return [0.0] * len(value) if isinstance(value, Sequence) else 0  # the library reads on behind the packet
        return value


class DirectCommands:
    """A control program and its commands, as `rtde_control.RTDEControlInterface` sends them.

    Raises RuntimeError in the library's words where the program does not start.
    """

    def __init__(self, ports: DirectPorts) -> None:
        self._ports, self._connection = ports, ports.connections
        self._ports.write({_COMMAND: 0})  # as the library: the register still has what ended the last program
        ports.controller.upload(_PROGRAM)
        deadline = clock().now() + _START
        while not self.isProgramRunning():
            if clock().now() > deadline:
                raise RuntimeError("Failed to start control script, before timeout of 5 seconds")
            clock().sleep(TICK)

    def isConnected(self) -> bool:  # noqa: N802, a name of the library
        """Return True if the connection stands."""
        return self._ports.connections == self._connection

    def isProgramRunning(self) -> bool:  # noqa: N802
        """By the latest state of this connection."""
        state = self._ports.latest_control
        return state is not None and bool(state["robot_status_bits"] & 2)

    def getTCPOffset(self) -> list[float]:  # noqa: N802
        """Where the tip is on the flange."""
        self._carry_out(_GET_TCP)
        state = self._ports.latest_control or {}
        return [float(state[f"output_double_register_{i}"]) for i in range(6)]

    def setTcp(self, tcp: Sequence[float]) -> bool:  # noqa: N802
        """Set it."""
        return self._carry_out(_SET_TCP, *tcp)

    def setPayload(self, mass: float, centre: Sequence[float]) -> bool:  # noqa: N802
        """Set mass and centre of mass."""
        return self._carry_out(_SET_PAYLOAD, mass, *centre)

    def setWatchdog(self, frequency: float) -> bool:  # noqa: N802
        """Let the program end where commands come less often."""
        return self._carry_out(_WATCHDOG, frequency)

    def kickWatchdog(self) -> bool:  # noqa: N802
        """No command, in time."""
        return self._send(_KICK)

    def servoL(self, pose: Sequence[float], speed: float, acceleration: float, *servo: float) -> bool:  # noqa: N802
        """Go on to a pose; `servo`: time, lookahead, gain. Raises ValueError where the library does."""
        for value, (least, most) in zip((speed, acceleration, *servo), SERVO_RANGES, strict=True):
            if not least <= value <= most:
                raise ValueError(f"The value is not within [{least:g};{most:g}]")
        return self._send(_SERVO, *pose, speed, acceleration, *servo)

    def servoStop(self) -> bool:  # noqa: N802
        """Come to rest."""
        return self._carry_out(_STOP_SERVO, 10.0)

    def stopScript(self) -> None:  # noqa: N802
        """End the program."""
        self._send(_END)

    def _send(self, command: int, *numbers: float) -> bool:
        if not (self.isConnected() and self.isProgramRunning()):
            return False
        self._ports.write({_COMMAND: command, **{f"{_FIRST}{i}": x for i, x in enumerate(numbers)}})
        return True

    def _carry_out(self, command: int, *numbers: float) -> bool:
        """Carry out a command that is answered; return False where it is not."""
        return self._wait_for(_READY) and self._send(command, *numbers) and self._wait_for(_DONE) and self._send(0)

    def _wait_for(self, status: int) -> bool:
        deadline = clock().now() + _ANSWER
        while clock().now() < deadline and self.isConnected() and self.isProgramRunning():
            if (self._ports.latest_control or {}).get("output_int_register_0") == status:
                return True
            clock().sleep(TICK)
        return False
