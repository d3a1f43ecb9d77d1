"""The robot as `ur_rtde` shows it: states in, commands out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
from palpate import DeviceError, Floats, clock
from palpate_arms.arm_driver import (
    KINEMATICS_TOLERANCE,
    ArmDriver,
    ArmFaultError,
    ArmReading,
    DeadLinkError,
    GarbledStateError,
)
from palpate_arms.setpoint_buffer import PERIOD
from palpate_kit.acquisition.computer import host
from palpate_kit.acquisition.device_lock import network_device
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import matrix_of, pose_of
from palpate_kit.kinematics.ur_arm import MODELS, distinguishable
from palpate_kit.protocols.ur_dashboard import RTDE

from palpate_devices.ur.client_library import missing_library
from palpate_devices.ur.client_sockets import drop_unsent, send_at_once
from palpate_devices.ur.command_echo import Echo, ReadBack
from palpate_devices.ur.controller_states import NORMAL, RUNNING, STOPPED, complaint, slowdown

_VARIABLES = [
    *("timestamp", "actual_q", "actual_qd", "actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force"),
    "target_TCP_pose",
    *("robot_mode", "safety_mode", "runtime_state", "robot_status_bits", "safety_status_bits"),
    *("target_speed_fraction", "speed_scaling"),
]
_LOAD = ["payload", "payload_cog"]
_SIX = 6  # numbers of each part of a state
_MUTE = 25  # periods in which a stop has to reach the other connection, too
_SAFETY_MODES = range(1, 14)  # that a controller has
_State = tuple[list[list[float]], tuple[int, int, int], tuple[float, float]]


class URDriver(ArmDriver):
    """The client library's objects.

    `connect` raises RuntimeError in the library's words, takes seconds where the controller does not begin to send, and
    hangs indefinitely, interpreter's lock held, where it accepts and is silent: only a process that may be killed calls
    it.
    """

    has_watchdog = True
    answers_stop = True

    def __init__(self, settings: Mapping[str, Any], model: ArmModel | None, tool: Floats) -> None:
        super().__init__(settings, model, tool)
        self._observed = False
        self._servo = PERIOD, settings["lookahead"], settings["servo_gain"]
        self._stamp = -1.0
        self._control: Any = None
        self._echo = Echo()
        self._read_back: Any = None  # a ReadBack

    @property
    def reservation(self) -> str:
        """The port of the controller's states."""
        return network_device(self.settings["host"], RTDE)

    def connect(self, observe: bool) -> None:
        """States; unless the arm is only observed the control program, tool and payload."""
        self._observed = observe
        variables = [*_VARIABLES, *(_LOAD if self.settings["load_known"] else [])]
        try:
            self._receive = host().robot_states(self.settings["host"], variables)
            if not self._receive.isConnected():  # it says so by this alone, and only after 2.5 s
                raise RuntimeError("the controller refuses to start sending its state, or sends nothing")
            if not observe:
                self._take_over()
        except ImportError as error:
            raise DeviceError(f"{missing_library()} ({error})") from error

    def _take_over(self) -> None:
        settings = self.settings
        self._control = host().robot_commands(settings["host"])
        send_at_once(RTDE)
        drop_unsent(RTDE)
        self._read_back = host().read_back(settings["host"], ReadBack)
        pendant = self._control.getTCPOffset()
        # The tool's own turn is the pendant's business, unless the pipeline states it.
        rotation = settings["tcp_rotation"]
        rotation = (pendant[3:] if len(pendant) == _SIX else [0.0] * 3) if rotation is None else rotation
        tcp = [*settings["tcp"], *rotation]
        self._control.setTcp(tcp)
        if settings["payload"] is not None:
            self._control.setPayload(settings["payload"], list(settings["payload_centre"]))
        self.tool = matrix_of(tcp)
        self.facts |= {"tcp": tcp, "tcp_on_pendant": list(pendant)}

    def identify(self, reading: ArmReading) -> None:
        """The model from the tool's pose, payload, time of power-on; raises RuntimeError where it is another arm."""
        since = datetime.fromtimestamp(clock().epoch_ns() / 1e9 - reading.stamp, UTC)
        self.facts["powered_since"] = since.isoformat(timespec="seconds")
        assert reading.pose is not None
        q, pose = list(reading.joints), list(reading.pose)
        if self._observed:
            self._tell_tool(q, matrix_of(pose))
        else:
            self._tell_model(q, np.array(pose[:3]))
        if self.settings["load_known"]:
            centre = self._receive.getPayloadCog()
            self.facts |= {"payload": self._receive.getPayload(), "payload_centre": list(centre)}

    def _tell_tool(self, q: list[float], pose: Floats) -> None:
        """Where the tool is by the joints: the controller's pose is that of whatever tool the pendant has."""
        nearest, apart = distinguishable(q, self.tool, pose[:3, 3])
        self.model = nearest if apart < KINEMATICS_TOLERANCE else MODELS.get(self.settings["model"], MODELS["ur3e"])
        on_flange = np.linalg.inv(self.model.flange(q)[0]) @ pose
        if self.settings["tcp_rotation"] is None:
            self.tool[:3, :3] = on_flange[:3, :3]
        self.facts |= {"tcp": pose_of(self.tool), "tcp_on_pendant": pose_of(on_flange), "model": self.model.name}

    def _tell_model(self, q: list[float], place: Floats) -> None:
        if self.model is not None:
            apart = float(np.linalg.norm(self.model.tip(q, self.tool)[0][:3, 3] - place))
        else:
            self.model, apart = distinguishable(q, self.tool, place)
        if apart > KINEMATICS_TOLERANCE:
            raise RuntimeError(
                f"the controller reports the tip {1e3 * apart:.1f} mm from where the joints of a {self.model.name} put "
                f"it: is this another arm? ([device.*] model is one of {', '.join(MODELS)})"
            )
        self.facts |= {"model": self.model.name, "nominal_kinematics_off": apart}

    def target(self) -> Sequence[float] | None:
        """Of its position control."""
        pose = self._receive.getTargetTCPPose()
        if len(pose) != _SIX:
            raise ArmFaultError("the controller does not send its target pose")
        return [float(x) for x in pose]

    def enable(self) -> None:
        """The watchdog: it must be fed. Raises ArmFaultError where the state that answers comes later than it waits."""
        began, frequency = clock().now(), self.settings["watchdog"]
        self._control.setWatchdog(frequency)
        if (answer := clock().now() - began) * frequency > 1.0:
            raise ArmFaultError(
                f"the controller's states come late: the one that answers a command came {1e3 * answer:.0f} ms after "
                f"it, and its watchdog waits for {1e3 / frequency:.0f} ms{clock().late_computer()}"
            )

    def read(self) -> ArmReading | None:
        """Return the state, whole: a packet that comes in between mixes two."""
        receive = self._receive
        stamp = receive.getTimestamp()
        if stamp == self._stamp:
            return None
        now = clock().now_ns()
        values, modes, paces = self._values()
        for _ in range(2):
            again = receive.getTimestamp()
            if again == stamp:
                break
            stamp, now = again, clock().now_ns()  # a packet came in between: its values may be mixed
            values, modes, paces = self._values()
        if any(len(part) != _SIX for part in values):
            return None
        self._stamp = stamp
        self._take_echo()
        q, qd, pose, twist, wrench = values
        return ArmReading(stamp, q, qd, pose, twist, wrench, (*modes, *paces), now)

    def _values(self) -> _State:
        receive = self._receive
        values = [
            receive.getActualQ(),
            receive.getActualQd(),
            receive.getActualTCPPose(),
            receive.getActualTCPSpeed(),
            receive.getActualTCPForce(),
        ]
        modes = receive.getRobotMode(), receive.getSafetyMode(), receive.getRuntimeState()
        return values, modes, (receive.getTargetSpeedFraction(), receive.getSpeedScaling())

    def _take_echo(self) -> None:
        """Take over what the controller has taken of the commands."""
        if self._read_back is not None and (news := self._read_back.latest()) is not None:
            self._echo.hear(*news)

    def explain(self) -> str | None:
        """Return True if the controller's packets are of another size than was agreed on."""
        if self._read_back is None:
            return None
        self._take_echo()
        if (sizes := self._read_back.wrong_size) is None:
            return None
        return (
            f"the controller sends states of {sizes[0]} bytes in place of {sizes[1]}: what the client library "
            "makes of them is not where the arm is"
        )

    def keep_alive(self) -> None:
        """Feed the watchdog; raises DeadLinkError where the link is lost."""
        _sent(self._control.kickWatchdog)

    def send(self, pose: Sequence[float]) -> bool:
        """By `servoL`; raises DeadLinkError where the link is lost."""
        number = self._echo.number(self._stamp, self.place)
        return _sent(self._control.servoL, list(pose), 0.5, number, *self._servo)

    def stop(self) -> None:
        """Stop servoing, then the program; both wait for the controller."""
        self._control.servoStop()
        self._control.stopScript()

    def check(self, reading: ArmReading) -> None:
        """Check the modes of robot, safety and program; raises ArmFaultError, GarbledStateError for unknown modes."""
        modes = _modes(reading)
        if (text := complaint(modes)) is None:
            return
        if modes[1] not in _SAFETY_MODES:
            raise GarbledStateError(text)
        raise ArmFaultError(text + (self._mute_control() if modes == (RUNNING, NORMAL, STOPPED) else ""))

    def _mute_control(self) -> str:
        """Return a program that the control link still reports as running, although the other link reports that it
        is not."""
        for _ in range(_MUTE):
            if not self._control.isProgramRunning():
                return ""
            clock().sleep(PERIOD)
        return " The control link still reports it as running: that link is mute, and commands did not arrive."

    def slowdown(self, reading: ArmReading, first: ArmReading | None) -> str | None:
        """By the speed slider, the controller's own scaling and its reduced mode."""
        slider, scaling = reading.status[3:]
        before = None if first is None else _modes(first)[1]
        return slowdown((slider, scaling), _modes(reading)[1], before)

    @property
    def connected(self) -> bool:
        """By the connection of the states."""
        return bool(self._receive.isConnected())

    @property
    def unheard(self) -> float:
        """By the numbers of the commands that it reads back."""
        return self._echo.silence(self._stamp)

    @property
    def answer_time(self) -> float:
        """By the numbers of the commands that it reads back."""
        return self._echo.answer_time

    @property
    def ahead(self) -> float:
        """By the numbers of the commands that it reads back."""
        return self._echo.ahead(self._stamp)


def _modes(reading: ArmReading) -> tuple[int, int, int]:
    """Of robot, safety and program."""
    robot, safety, runtime = reading.status[:3]
    return int(robot), int(safety), int(runtime)


def _sent(command: Callable[..., bool], *arguments: Any) -> bool:
    """Return True if a command was sent; of a link that was reset the library says it in words of its sockets."""
    try:
        return bool(command(*arguments))
    except RuntimeError as error:
        raise DeadLinkError(
            "the control link is lost: the client library can neither send nor connect again "
            f"({' '.join(str(error).split())}), and the controller's watchdog stops the arm. Check cable and switch"
        ) from error
