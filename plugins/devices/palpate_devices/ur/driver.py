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
_SECOND = 1e9  # [ns]
_LOAD = ["payload", "payload_cog"]
_SIX = 6  # numbers of each part of a state
_STOP_PERIODS = 25  # a choice, 50 ms: periods in which a stop has to reach the other connection, too
_SAFETY_MODES = range(1, 14)  # that a controller has, by Universal Robots' table of RTDE outputs
_REREADS = 2  # a choice: of a state that is mixed; packets come 2 ms apart, and reading takes far less
_UNUSED_SPEED = 0.5  # [m/s] that `servoL` demands and `servoj` does not use
_MS = _MM = 1e3  # per second, per metre
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
        """Connect to the states, and unless the arm is only observed upload control program, tool and payload."""
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
        """Upload the control program, and set the sockets, the tool and the payload; raises RuntimeError."""
        settings = self.settings
        self._control = host().robot_commands(settings["host"])
        send_at_once(RTDE)
        drop_unsent(RTDE)
        self._read_back = host().read_back(settings["host"], ReadBack)
        pendant = self._control.getTCPOffset()
        # The tool's own turn is the pendant's business, unless the pipeline states it.
        rotation = settings["tcp_rotation"]
        if rotation is None:
            rotation = pendant[3:] if len(pendant) == _SIX else [0.0] * 3  # behind the three coordinates of its place
        tcp = [*settings["tcp"], *rotation]
        self._control.setTcp(tcp)
        if settings["payload"] is not None:
            self._control.setPayload(settings["payload"], list(settings["payload_centre"]))
        self.tool = matrix_of(tcp)
        self.facts |= {"tcp": tcp, "tcp_on_pendant": list(pendant)}

    def identify(self, reading: ArmReading) -> None:
        """Note model, payload and time of power-on; raises RuntimeError where the pose is that of another arm."""
        since = datetime.fromtimestamp(clock().epoch_ns() / _SECOND - reading.stamp, UTC)
        self.facts["powered_since"] = since.isoformat(timespec="seconds")
        assert reading.pose is not None
        q, pose = list(reading.joints), list(reading.pose)
        if self._observed:
            self._note_tool(q, matrix_of(pose))
        else:
            self._note_model(q, np.array(pose[:3]))
        if self.settings["load_known"]:
            centre = self._receive.getPayloadCog()
            self.facts |= {"payload": self._receive.getPayload(), "payload_centre": list(centre)}

    def _note_tool(self, q: list[float], pose: Floats) -> None:
        """Note tool and model by the joints (6,) [rad]: the pose (4, 4) is that of whatever tool the pendant has."""
        nearest, distance = distinguishable(q, self.tool, pose[:3, 3])
        self.model = nearest if distance < KINEMATICS_TOLERANCE else MODELS.get(self.settings["model"], MODELS["ur3e"])
        # The pendant's tool: the pose behind the flange.
        on_flange = np.linalg.inv(self.model.flange(q)[0]) @ pose
        if self.settings["tcp_rotation"] is None:
            self.tool[:3, :3] = on_flange[:3, :3]
        self.facts |= {"tcp": pose_of(self.tool), "tcp_on_pendant": pose_of(on_flange), "model": self.model.name}

    def _note_model(self, q: list[float], place: Floats) -> None:
        """Note the model whose tip is at a place (3,) [m] by the joints (6,) [rad]; raises RuntimeError without one."""
        if self.model is not None:
            distance = float(np.linalg.norm(self.model.tip(q, self.tool)[0][:3, 3] - place))
        else:
            self.model, distance = distinguishable(q, self.tool, place)
        if distance > KINEMATICS_TOLERANCE:
            raise RuntimeError(
                f"the controller reports the tip {_MM * distance:.1f} mm from where the joints of a {self.model.name} "
                f"put it: is this another arm? ([device.*] model is one of {', '.join(MODELS)})"
            )
        self.facts |= {"model": self.model.name, "nominal_kinematics_off": distance}

    def target(self) -> Sequence[float] | None:
        """Return the target pose of its position control; raises ArmFaultError without one."""
        pose = self._receive.getTargetTCPPose()
        if len(pose) != _SIX:
            raise ArmFaultError("the controller does not send its target pose")
        return [float(x) for x in pose]

    def enable(self) -> None:
        """Set the watchdog, which must be fed; raises ArmFaultError where the answer takes longer than it waits."""
        began, frequency = clock().now(), self.settings["watchdog"]
        self._control.setWatchdog(frequency)
        if (answer := clock().now() - began) * frequency > 1.0:
            raise ArmFaultError(
                f"the controller's states come late: the one that answers a command came {_MS * answer:.0f} ms after "
                f"it, and its watchdog waits for {_MS / frequency:.0f} ms{clock().late_computer()}"
            )

    def read(self) -> ArmReading | None:
        """Return the newest state; None without a new one, or where parts of it are missing.

        The client library gives one value at a time: a packet that arrives in between mixes two states, and all of it
        is read again.
        """
        receive = self._receive
        stamp = receive.getTimestamp()
        if stamp == self._stamp:
            return None
        now = clock().now_ns()
        # Joints, their speeds, pose, twist and wrench, of six numbers each; three modes; two shares of the full speed.
        values, modes, paces = self._values()
        for _ in range(_REREADS):
            newest_stamp = receive.getTimestamp()
            if newest_stamp == stamp:
                break
            stamp, now = newest_stamp, clock().now_ns()
            values, modes, paces = self._values()
        if any(len(part) != _SIX for part in values):
            return None
        self._stamp = stamp
        self._take_echo()
        q, qd, pose, twist, wrench = values
        return ArmReading(
            stamp=stamp,
            joints=q,
            joint_speeds=qd,
            pose=pose,
            twist=twist,
            wrench=wrench,
            status=(*modes, *paces),
            seen=now,
        )

    def _values(self) -> _State:
        """Return joints [rad], their speeds, pose, twist and wrench (6 each), the three modes, slider and scaling."""
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
        """Read the number of the latest command that the controller has taken."""
        if self._read_back is not None and (news := self._read_back.latest()) is not None:
            self._echo.hear(*news)

    def explain(self) -> str | None:
        """Return the cause of states that make no sense: packets of another size than was agreed on; else None."""
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
        """Send a pose by `servoL`, numbered; return True if sent; raises DeadLinkError where the link is lost."""
        number = self._echo.number(self._stamp, self.place)
        return _sent(self._control.servoL, list(pose), _UNUSED_SPEED, number, *self._servo)

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
        """Return the text of a control link that still reports a program as running, which the other link denies."""
        for _ in range(_STOP_PERIODS):
            if not self._control.isProgramRunning():
                return ""
            clock().sleep(PERIOD)
        return " The control link still reports it as running: that link is mute, and commands did not arrive."

    def slowdown(self, reading: ArmReading, first: ArmReading | None) -> str | None:
        """Return why the arm is slower than commanded (speed slider, own scaling, reduced mode); else None."""
        slider, scaling = reading.status[3:]
        first_safety = None if first is None else _modes(first)[1]
        return slowdown((slider, scaling), _modes(reading)[1], first_safety)

    @property
    def connected(self) -> bool:
        """True while the connection of the states stands."""
        return bool(self._receive.isConnected())

    @property
    def unheard(self) -> float:
        """The time [s] without news of commands on their way, by the numbers that it reads back."""
        return self._echo.silence(self._stamp)

    @property
    def answer_time(self) -> float:
        """The shortest time [s] of a command there and back, by the numbers that it reads back."""
        return self._echo.answer_time

    @property
    def ahead(self) -> float:
        """The distance [m] of the latest command from the one taken before, by the numbers that it reads back."""
        return self._echo.ahead(self._stamp)


def _modes(reading: ArmReading) -> tuple[int, int, int]:
    """Return the modes of robot, safety and program."""
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
