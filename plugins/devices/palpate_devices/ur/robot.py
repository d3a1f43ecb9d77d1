"""The robot as `ur_rtde` shows it: states in, commands out, in the work frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import numpy as np
from palpate import Floats, clock
from palpate_arms.fence import ArmState
from palpate_arms.setpoint_buffer import PERIOD
from palpate_arms.tool_turns import tool_turn
from palpate_kit.acquisition.computer import host
from palpate_kit.kinematics.ur_arm import (
    MODELS,
    Model,
    distinguishable,
    flange,
    matrix_of,
    pose_of,
    rotation_matrix,
    rotation_vector,
    tip,
)
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_devices.ur.client_sockets import drop_unsent, send_at_once
from palpate_devices.ur.command_echo import RTDE_PORT, Echo, ReadBack
from palpate_devices.ur.controller_states import PLAYING
from palpate_devices.ur.layout import MOTION, POSE, STATE, TWIST

_VARIABLES = [
    *("timestamp", "actual_q", "actual_qd", "actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force"),
    *("robot_mode", "safety_mode", "runtime_state", "robot_status_bits", "safety_status_bits"),
    *("target_speed_fraction", "speed_scaling"),
]
_LOAD = ["payload", "payload_cog"]
_NEAR = 5e-3  # [m] between the controller's pose and that of the nominal kinematics
_SWING, _FASTEST = 5e-3, 3.0  # [m], [m/s] of a tip: the largest arm of the series reaches 2 m/s
_ENOUGH, _SELDOM = 10, 0.01  # states that tell their rate; [s] between states at the most
_TAKES = 0.2  # [s] until the controller's states show a new TCP or payload


class RobotFaultError(Exception):
    """Why the servo process ends at once, in words for the person at the robot."""


class Robot:
    """The client library's objects, and the state that they last gave; without `control` it only listens.

    Its constructor raises RuntimeError in the library's words, takes seconds where the controller does not begin
    to send, and hangs indefinitely, interpreter's lock held, where it accepts and is silent: only a process that may be
    killed makes one.
    """

    def __init__(self, settings: dict[str, Any]) -> None:
        self._load_known = settings["load_known"]
        variables = [*_VARIABLES, *(_LOAD if self._load_known else [])]
        self.receive = host().robot_states(settings["host"], variables)
        if not self.receive.isConnected():  # it says so by this alone, and only after 2.5 s
            raise RuntimeError("the controller refuses to start sending its state, or sends nothing")
        self.control: Any = None
        self._work = WorkFrame.model_construct(**settings["work"])
        self._out, self._origin = self._work.matrix[:3, :3], self._work.matrix[:3, 3]
        self._turned: tuple[Floats, list[float]] | None = None
        self._servo = PERIOD, settings["lookahead"], settings["servo_gain"]
        self.state_period = PERIOD  # [s] from one state to the next
        self.stamp, self.seen, self.fresh = -1.0, clock().now_ns(), False
        self.state: list[float] = []
        self.modes = (7, 1, PLAYING)
        self.paces = (1.0, 1.0)  # speed slider, the controller's own scaling
        self._echo = Echo()
        self._read_back: Any = None  # a ReadBack
        self.wrong_size: tuple[int, int] | None = None  # bytes of a state, and how many were agreed on
        self.leap: float | None = None  # [m] between the last two states, where no arm moves so far
        self.facts: dict[str, Any] = {}
        self.tool = np.eye(4)
        self.model = MODELS["ur3e"]
        if settings["observe"]:
            self._look(settings)
        else:
            self._take_over(settings)

    def _take_over(self, settings: dict[str, Any]) -> None:
        """The control program, watchdog, tool and payload; finds the model from the tool's pose."""
        self.control = host().robot_commands(settings["host"])
        send_at_once(RTDE_PORT)
        drop_unsent(RTDE_PORT)
        self._read_back = host().read_back(settings["host"], ReadBack)
        pendant = self.control.getTCPOffset()
        # The tool's own turn is the pendant's business, unless the pipeline states it.
        rotation = settings["tcp_rotation"]
        rotation = (pendant[3:] if len(pendant) == 6 else [0.0] * 3) if rotation is None else rotation
        tcp = [*settings["tcp"], *rotation]
        self.control.setTcp(tcp)
        if settings["payload"] is not None:
            self.control.setPayload(settings["payload"], list(settings["payload_centre"]))
        self.tool = matrix_of(tcp)
        self.facts |= {"tcp": tcp, "tcp_on_pendant": list(pendant)}
        self._wait_for_state(_TAKES)
        self._tell_model(settings)
        self._read_load()
        self.control.setWatchdog(settings["watchdog"])  # last: it wants to be fed

    def _look(self, settings: dict[str, Any]) -> None:
        """Where the tool is by the joints: the controller's pose is that of whatever tool the pendant has."""
        rotation = settings["tcp_rotation"] or [0.0] * 3
        self.tool = matrix_of([*settings["tcp"], *rotation])
        self._wait_for_state(0.0)
        q, pose = self.state[STATE["joints"]], matrix_of(self.state[POSE])
        nearest, apart = distinguishable(q, self.tool, pose[:3, 3])
        self.model = nearest if apart < _NEAR else MODELS.get(settings["model"], MODELS["ur3e"])
        on_flange = np.linalg.inv(flange(q, self.model)[0]) @ pose
        if settings["tcp_rotation"] is None:
            self.tool[:3, :3] = on_flange[:3, :3]
        self.facts |= {"tcp": pose_of(self.tool), "tcp_on_pendant": pose_of(on_flange), "model": self.model.name}
        self._read_load()

    def _wait_for_state(self, settle: float) -> None:
        deadline, began, stamps = clock().now() + 2.0, clock().now(), list[float]()
        while not (fresh := self.poll()) or clock().now() - began < settle:
            if fresh:
                stamps.append(self.stamp)
            if clock().now() > deadline:
                raise RuntimeError("the controller sends no states")
            clock().sleep(PERIOD)
        if not math.isfinite(self.stamp):
            raise RuntimeError("the controller's time-stamp is no number")
        self._note_rate(stamps)
        since = datetime.fromtimestamp(clock().epoch_ns() / 1e9 - self.stamp, UTC)
        self.facts["powered_since"] = since.isoformat(timespec="seconds")

    def _note_rate(self, stamps: list[float]) -> None:
        """How often states come, by their time-stamps; raises RuntimeError where an arm cannot be led by so few."""
        if len(stamps) < _ENOUGH:
            return
        period = float(np.median(np.diff(stamps)))
        self.facts["state_rate"] = 1.0 / period
        if period > 1.01 * _SELDOM:
            raise RuntimeError(
                f"the controller sends its state at {1.0 / period:.0f} Hz; at least {1.0 / _SELDOM:.0f} Hz are needed"
            )
        self.state_period = max(period, PERIOD)

    def _tell_model(self, settings: dict[str, Any]) -> None:
        q, place = self.state[STATE["joints"]], np.array(self.state[STATE["position"]])
        if settings["model"] in MODELS:
            model = MODELS[settings["model"]]
            apart = float(np.linalg.norm(tip(q, self.tool, model)[0][:3, 3] - place))
        else:
            model, apart = distinguishable(q, self.tool, place)
        if apart > _NEAR:
            raise RuntimeError(
                f"the controller reports the tip {1e3 * apart:.1f} mm from where the joints of a {model.name} put it: "
                f"is this another arm? ([device.*] model is one of {', '.join(MODELS)})"
            )
        self.model = model
        self.facts |= {"model": model.name, "nominal_kinematics_off": apart}

    def _read_load(self) -> None:
        if self._load_known:
            centre = self.receive.getPayloadCog()
            self.facts |= {"payload": self.receive.getPayload(), "payload_centre": list(centre)}

    def poll(self) -> bool:
        """Take over a new state; False where there is none."""
        receive = self.receive
        stamp = receive.getTimestamp()
        if stamp == self.stamp:
            return False
        now = clock().now_ns()
        values, modes, paces = self._read()
        for _ in range(2):
            again = receive.getTimestamp()
            if again == stamp:
                break
            stamp, now = again, clock().now_ns()  # a packet came in between: its values may be mixed
            values, modes, paces = self._read()
        if len(values) != STATE.size:
            return False
        self.leap = self._leap(stamp, values)
        self.stamp, self.seen, self.state, self.fresh = stamp, now, values, True
        self.modes, self.paces = modes, paces
        self.read_back()
        return True

    def read_back(self) -> None:
        """Take over what the controller has taken of the commands."""
        if self._read_back is None:
            return
        if (news := self._read_back.latest()) is not None:
            self._echo.hear(*news)
        self.wrong_size = self._read_back.wrong_size

    def _leap(self, stamp: float, values: list[float]) -> float | None:
        """How far [m] the tip is from where the state before had it, if that is farther than any arm moves."""
        if not self.state:
            return None
        way = math.dist(values[STATE["position"]], self.state[STATE["position"]])
        return way if way > _SWING + _FASTEST * abs(stamp - self.stamp) else None

    @property
    def unheard(self) -> float:
        """For how long [s] of its own time the controller has taken none of the commands on their way."""
        return self._echo.silence(self.stamp)

    @property
    def ahead(self) -> float:
        """How far [m] the latest command is from what the controller has taken before it."""
        return self._echo.ahead(self.stamp)

    def _read(self) -> tuple[list[float], tuple[int, int, int], tuple[float, float]]:
        receive = self.receive
        values = [
            *receive.getActualQ(),
            *receive.getActualQd(),
            *receive.getActualTCPPose(),
            *receive.getActualTCPSpeed(),
            *receive.getActualTCPForce(),
        ]
        modes = receive.getRobotMode(), receive.getSafetyMode(), receive.getRuntimeState()
        return values, modes, (receive.getTargetSpeedFraction(), receive.getSpeedScaling())

    @property
    def is_number(self) -> bool:
        """Whether joints, pose and speed are finite numbers."""
        return all(map(math.isfinite, self.state[MOTION]))

    def look(self) -> ArmState:
        """Where the tip is, how fast and how turned; whether it is news since the last look."""
        inwards, fresh = self._out.T, self.fresh
        self.fresh = False
        rotation = rotation_matrix(self.state[STATE["rotation"]])
        return ArmState(
            self.position,
            inwards @ np.array(self.state[STATE["velocity"]]),
            rotation,
            self.state[STATE["joints"]],
            fresh,
        )

    @property
    def position(self) -> Floats:
        """Of the tip in the work frame (3,) [m]."""
        return np.asarray(self._out.T @ (np.array(self.state[STATE["position"]]) - self._origin))

    def turn(self) -> Floats:
        """Rotation vector (3,) of the tool from where the work frame wants it."""
        return tool_turn(self._work, rotation_matrix(self.state[STATE["rotation"]]))

    def feed_watchdog(self) -> None:
        """No command, in time; raises RobotFaultError where the link is lost."""
        if self.control is not None:
            _sent(self.control.kickWatchdog)

    def servo(self, position: Floats, turn: Floats) -> bool:
        """Send the arm to a position in the work frame and a turn of the tool; True means sent, not done.

        Raises RobotFaultError where the link is lost.
        """
        target = (self._origin + self._out @ position).tolist()
        if self._turned is None or not np.array_equal(self._turned[0], turn):
            rotation = rotation_vector(self._work.tool @ rotation_matrix(turn.tolist()))
            self._turned = turn.copy(), rotation.tolist()
        number = self._echo.number(self.stamp, position)
        return _sent(self.control.servoL, [*target, *self._turned[1]], 0.5, number, *self._servo)


def _sent(command: Callable[..., bool], *arguments: Any) -> bool:
    """Whether a command was sent; of a link that was reset the library says it in words of its sockets."""
    try:
        return bool(command(*arguments))
    except RuntimeError as error:
        raise RobotFaultError(
            "the control link is lost: the client library can neither send nor connect again "
            f"({' '.join(str(error).split())}), and the controller's watchdog stops the arm. Check cable and switch"
        ) from error


def by_joints(state: list[float], tool: Floats, model: Model) -> list[float]:
    """A state whose pose and speed of the tip are those of its joints."""
    pose, jacobian = tip(state[STATE["joints"]], tool, model)
    twist = (jacobian @ np.array(state[STATE["joint_speeds"]])).tolist()
    found = list(state)
    found[POSE], found[TWIST] = pose_of(pose), twist
    return found
