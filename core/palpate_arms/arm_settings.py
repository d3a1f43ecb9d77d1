"""The settings of an arm: the keys that every arm has, and its streams."""

from __future__ import annotations

import json
import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from palpate import (
    RETREAT,
    Acceleration,
    Angle,
    AngularSpeed,
    Channel,
    Device,
    Length,
    OwnMotion,
    Speed,
    StopModes,
    Stream,
    Time,
)
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.work_frame import WorkFrame
from pydantic import Field

if TYPE_CHECKING:
    from palpate_arms.arm_driver import ArmDriver
    from palpate_arms.arm_rows import ArmRows
    from palpate_arms.servo_law import ServoLaw


class ArmSettings(Device):
    """The settings of an arm (an ArmDevice is one that can be connected).

    Setpoints in the work frame are followed at 500 Hz in a process of its own, by the paper's Cartesian PD law on top
    of the controller's position control or by that alone. Every command keeps the limits of [safety] and those given
    here, in the process that sends it, which also reads the sensor's force and stops by itself. Streams: tip (pose and
    twist in the work frame, as measured), joints, setpoint, the robot's own wrench (estimated), and status.
    """

    maker: ClassVar[str] = "arm"  # what messages call it: "ur at 192.168.1.7"
    has_own_rate: ClassVar[bool] = False  # whether its states come at a rate that only their time-stamps know
    joint_names: ClassVar[tuple[str, ...]]
    # Channels of the status, each with the value that it has while the arm may move.
    status_channels: ClassVar[Mapping[str, float]] = {}
    # Joints [rad] of an ordinary posture with the tool downwards, from which a twin finds that of the work.
    posture: ClassVar[tuple[float, ...]] = ()
    weighs_flange: ClassVar[bool] = False  # whether a sensor in its flange can weigh what hangs there
    own_stop: ClassVar[str] = ""  # key of the force at which the controller stops the arm by itself
    sudden_end: ClassVar[str] = ""  # what it means where the arm's process ends without a word

    host: str = Field(min_length=1, description="address of the controller")
    work: WorkFrame = Field(description="where the specimen is")
    tcp: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.12), min_length=3, max_length=3, description="tip on the flange"
    )
    tcp_rotation: tuple[Angle, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="rotation vector of the tool on the flange; left out: none, or the controller's setting",
    )
    kinematics: Literal["controller", "dh"] = Field(
        default="controller", description="tip pose and velocity from the controller, or from the joints by the model"
    )
    control: Literal["pd", "servo"] = Field(
        default="pd", description="the paper's PD law, or the controller's position control alone"
    )
    gain: float = Field(default=20.0, gt=0, lt=100, description="proportional gain of the PD law, in 1/s")
    damping: float = Field(default=0.5, ge=0, lt=1, description="derivative gain of the PD law")
    controller_timeout: Time = Field(default=0.1, gt=0, description="a state older than this is a lost link")
    host_timeout: Time = Field(
        default=0.25, gt=0, description="the arm retracts when the main job is silent for longer"
    )
    start: Time = Field(default=20.0, gt=0, description="longest time for the client library to connect")
    start_tolerance: Length = Field(default=0.03, gt=0, description="largest distance of the tip from a motion's start")
    approach_speed: Speed = Field(default=0.02, gt=0, le=0.25, description="highest speed on the way to the start")
    retract_speed: Speed | None = Field(
        default=None,
        gt=0,
        le=0.25,
        description="of a retraction at most; left out: 50 mm/s, or what [safety] retract_speed allows",
    )
    acceleration: Acceleration = Field(default=1.0, gt=0, le=5, description="highest, in braking and retraction")
    joint_speed: AngularSpeed = Field(
        default=math.pi / 2, gt=0, le=math.pi, description="highest joint speed that a command may require"
    )
    tracking: Length = Field(default=0.01, gt=0, le=0.05, description="largest distance of the arm from its command")
    deadband: Length = Field(
        default=0.0, ge=0, lt=RETREAT, description="of a command, so much at most the arm may leave undone"
    )
    links_low: tuple[Length, ...] = Field(
        default=(-2.0, -2.0, 0.0),
        min_length=3,
        max_length=3,
        description="corner of the box, in the base, of elbow, wrist and flange",
    )
    links_high: tuple[Length, ...] = Field(
        default=(2.0, 2.0, 2.0), min_length=3, max_length=3, description="the opposite corner"
    )

    @classmethod
    @abstractmethod
    def driver(cls) -> type[ArmDriver]:
        """Return the class of its driver; import it here, so that a replay loads no client library."""

    @property
    @abstractmethod
    def arm_model(self) -> ArmModel | None:
        """The kinematic model; None where the driver finds it. Raises ConfigurationError, such as for a URDF file."""

    @property
    @abstractmethod
    def command_lag(self) -> float:
        """Lag [s] of the arm behind its commands, by a setting; the lag that a motion shows is compared with it."""

    @property
    def controller_stiffness(self) -> float | None:
        """Stiffness [N/m] by which the controller gives way to a force; None of an arm that does not.

        It is on record as a known compliance. What counts as depth is the measured pose, so that it is not part of the
        specimen's stiffness.
        """
        return None

    def identity(self, observe: bool) -> Mapping[str, str]:
        """Return the controller's facts before anything is connected; raises DeviceError where it is not ready.

        Asked by `host().controller_facts`, so that a rehearsal asks the twin.
        """
        return {}

    def driver_settings(self, identity: Mapping[str, str], observe: bool) -> dict[str, Any]:
        """Return the settings of the driver, as plain data."""
        return self.model_dump(mode="json")

    @property
    def title(self) -> str:
        """As messages call it."""
        return f"{self.maker} at {self.host}"

    @property
    def rows(self) -> ArmRows:
        """Layouts of its states."""
        from palpate_arms.arm_rows import ArmRows

        return ArmRows(len(self.joint_names), len(self.status_channels))

    @property
    def live(self) -> bool:
        """It sends in real time."""
        return True

    @property
    def streams(self) -> tuple[Stream, ...]:
        """Tip, twist, joints, setpoint, the robot's own wrench, status."""
        from palpate_arms.setpoint_buffer import PERIOD

        rate, names = None if self.has_own_rate else 1.0 / PERIOD, self.joint_names
        pose = [Channel(axis, "m") for axis in "xyz"] + [Channel(f"q{axis}", "1") for axis in "xyzw"]
        twist = [Channel(axis, "m/s") for axis in "xyz"] + [Channel(f"w{axis}", "rad/s") for axis in "xyz"]
        joints = [Channel(name, "rad") for name in names] + [Channel(f"{name}_speed", "rad/s") for name in names]
        setpoint = [Channel(axis, "m") for axis in "xyz"] + [Channel(f"v{axis}", "m/s") for axis in "xyz"]
        wrench = [Channel(axis, "N") for axis in "xyz"] + [Channel(f"t{axis}", "N*m") for axis in "xyz"]
        status = [Channel("time", "s"), *(Channel(name, "1") for name in self.status_channels)]
        # Name, channels, rate [Hz], layout, clock, frame, and True for what is not measured.
        return (
            Stream("tip", tuple(pose), rate, "pose", "host", "work"),
            Stream("twist", tuple(twist), rate, "twist", "host", "work"),
            Stream("joints", tuple(joints), rate, "joints", "host", "base"),
            Stream("setpoint", (*setpoint, Channel("measuring", "1")), rate, "setpoint", "host", "work", True),
            Stream("robot_wrench", tuple(wrench), rate, "wrench", "host", "base", True),
            Stream("status", tuple(status), rate, clock="host"),
        )

    @property
    def shared_streams(self) -> tuple[str, ...]:
        """The robot's own wrench, where the arm's process can watch it as a sensor's."""
        return ("robot_wrench",)

    @property
    def stop_modes(self) -> StopModes | None:
        """Reports of its own stops in its status, and by a second connection; None if it reports none."""
        return None

    @property
    def own_motion(self) -> OwnMotion:
        """It goes to the start, brakes, and continues for a while where the job does not.

        An arm on a spring continues for its lag, and what no setting shows of it, after its commands have stopped.
        """
        from palpate_arms.arm_lag import DELAY

        blind = self.host_timeout + (0.0 if self.controller_stiffness is None else self.command_lag + DELAY)
        approach = self.approach_speed, self.start_tolerance, self.acceleration, blind
        stop = (self.own_stop, getattr(self, self.own_stop)) if self.own_stop else None
        followed_speed = self.tracking / max(self.command_lag, 1e-9)
        leaves_slowly = self.retract_speed is not None and self.retract_speed <= followed_speed
        yield_force = math.inf if self.controller_stiffness is None else self.controller_stiffness * self.tracking
        return OwnMotion(*approach, stop, math.inf if leaves_slowly else followed_speed, yield_force)

    @property
    def gravity(self) -> tuple[float, ...]:
        """In the work frame, of an arm whose base stands upright."""
        return tuple((-self.work.matrix[2, :3] + 0.0).tolist())

    @property
    def twin_settings(self) -> Mapping[str, str]:
        """The arm of a twin, by its kinematic model, and where its work is."""
        model = self.arm_model
        if model is None:
            return {}
        plain = {key: json.dumps(value) for key, value in model.model_dump().items()}
        stiffness = self.controller_stiffness
        return {
            **{f"arm.model.{key}": value for key, value in plain.items()},
            "arm.lag": str(self.command_lag),
            "arm.posture": str(list(self.posture)),
            **({} if stiffness is None else {"arm.stiffness": str(stiffness)}),
            **self.work_settings,
        }

    @property
    def work_settings(self) -> Mapping[str, str]:
        """Work frame of a twin, and its tip and tool."""
        return {
            "work.origin": str(list(self.work.origin)),
            "work.rotation": str(list(self.work.rotation)),
            "work.turn": str(self.work.turn),
            "tcp": str(list(self.tcp)),
            **({} if self.tcp_rotation is None else {"tcp_rotation": str(list(self.tcp_rotation))}),
        }

    @property
    def law(self) -> ServoLaw:
        """Law by which setpoints become commands."""
        from palpate_arms.servo_law import ServoLaw

        keys = ("control", "gain", "damping", "approach_speed", "acceleration")
        lever, gives_way = math.dist(self.tcp, (0.0, 0.0, 0.0)), self.controller_stiffness is not None
        retract_speed = math.inf if self.retract_speed is None else self.retract_speed
        stated = {key: getattr(self, key) for key in keys}
        return ServoLaw(**stated, retract_speed=retract_speed, lever=lever, gives_way=gives_way)
