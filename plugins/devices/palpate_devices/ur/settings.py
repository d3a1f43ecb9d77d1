"""The keys of Universal Robots' e-Series, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

from palpate import (
    Acceleration,
    Angle,
    AngularSpeed,
    Channel,
    Device,
    Frequency,
    Length,
    Mass,
    OwnMotion,
    Speed,
    Stream,
    Time,
)
from palpate_kit.kinematics.ur_arm import JOINTS
from palpate_kit.kinematics.work_frame import WorkFrame
from pydantic import Field

if TYPE_CHECKING:
    from palpate_arms.servo import ServoLaw


class URSettings(Device):
    """Keys, streams and own motion of an arm."""

    host: str = Field(min_length=1, description="address of the controller")
    work: WorkFrame = Field(description="where the specimen is")
    tcp: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.12), min_length=3, max_length=3, description="tip on the flange"
    )
    tcp_rotation: tuple[Angle, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="rotation vector of the tool on the flange; left out: the pendant's setting",
    )
    model: Literal["auto", "ur3e", "ur5e", "ur10e", "ur16e"] = Field(
        default="auto", description='which arm; "auto": found from joints and tip pose'
    )
    payload: Mass | None = Field(
        default=None, gt=0, le=20, description="everything mounted on the flange; left out: the pendant's setting"
    )
    payload_centre: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="centre of mass of that payload on the flange"
    )
    safety_checksum: str | None = Field(
        default=None,
        pattern=r"^[0-9A-Za-z]{4}([0-9A-Za-z]{4})?$",
        description="of the safety configuration, as the pendant shows it; for the record: no interface tells it",
    )
    kinematics: Literal["controller", "dh"] = Field(
        default="controller", description="tip pose and velocity from the controller, or from the joints by nominal DH"
    )
    control: Literal["pd", "servo"] = Field(default="pd", description="the paper's PD law, or servoL alone")
    gain: float = Field(default=20.0, gt=0, lt=100, description="proportional gain of the PD law, in 1/s")
    damping: float = Field(default=0.5, ge=0, lt=1, description="derivative gain of the PD law")
    lookahead: Time = Field(default=0.03, ge=0.03, le=0.2, description="servoL's lookahead time")
    servo_gain: float = Field(default=1000.0, ge=100, le=2000, description="servoL's gain")
    watchdog: Frequency = Field(default=10.0, ge=1, le=50, description="the arm stops when commands arrive less often")
    controller_timeout: Time = Field(default=0.1, gt=0, description="a state older than this is a lost link")
    host_timeout: Time = Field(
        default=0.25, gt=0, description="the arm retracts when the main job is silent for longer"
    )
    start: Time = Field(default=20.0, gt=0, description="longest time for the client library to connect")
    start_tolerance: Length = Field(default=0.03, gt=0, description="largest distance of the tip from a motion's start")
    approach_speed: Speed = Field(default=0.02, gt=0, le=0.25, description="highest speed on the way to the start")
    retract_speed: Speed = Field(default=0.05, gt=0, le=0.25, description="of a retraction")
    acceleration: Acceleration = Field(default=1.0, gt=0, le=5, description="highest, in braking and retraction")
    joint_speed: AngularSpeed = Field(
        default=math.pi / 2, gt=0, le=math.pi, description="highest joint speed that a command may require"
    )
    tracking: Length = Field(default=0.01, gt=0, le=0.05, description="largest distance of the arm from its command")
    links_low: tuple[Length, ...] = Field(
        default=(-2.0, -2.0, 0.0),
        min_length=3,
        max_length=3,
        description="corner of the box, in the base, of elbow, wrist and flange",
    )
    links_high: tuple[Length, ...] = Field(
        default=(2.0, 2.0, 2.0), min_length=3, max_length=3, description="the opposite corner"
    )

    @property
    def live(self) -> bool:
        """It sends as time goes by."""
        return True

    @property
    def streams(self) -> tuple[Stream, ...]:
        """Tip, twist, joints, setpoint, the robot's own wrench, status."""
        from palpate_arms.setpoint_buffer import PERIOD

        rate = 1.0 / PERIOD
        pose = [Channel(axis, "m") for axis in "xyz"] + [Channel(f"q{axis}", "1") for axis in "xyzw"]
        twist = [Channel(axis, "m/s") for axis in "xyz"] + [Channel(f"w{axis}", "rad/s") for axis in "xyz"]
        joints = [Channel(name, "rad") for name in JOINTS] + [Channel(f"{name}_speed", "rad/s") for name in JOINTS]
        setpoint = [Channel(axis, "m") for axis in "xyz"] + [Channel(f"v{axis}", "m/s") for axis in "xyz"]
        wrench = [Channel(axis, "N") for axis in "xyz"] + [Channel(f"t{axis}", "N*m") for axis in "xyz"]
        modes = ("robot_mode", "safety_mode", "runtime", "speed_slider", "speed_scaling")
        status = [Channel("time", "s"), *(Channel(name, "1") for name in modes)]
        return (
            Stream("tip", tuple(pose), rate, "pose", "host", "work"),
            Stream("twist", tuple(twist), rate, "twist", "host", "work"),
            Stream("joints", tuple(joints), rate, "joints", "host", "base"),
            Stream("setpoint", (*setpoint, Channel("measuring", "1")), rate, "setpoint", "host", "work", True),
            Stream("robot_wrench", tuple(wrench), rate, "wrench", "host", "base", True),
            Stream("status", tuple(status), rate, clock="host"),
        )

    @property
    def own_motion(self) -> OwnMotion:
        """It goes to the start, brakes, and continues for a while where the job does."""
        return OwnMotion(self.approach_speed, self.start_tolerance, self.acceleration, self.host_timeout)

    @property
    def gravity(self) -> tuple[float, ...]:
        """In the work frame, of an arm whose base stands upright."""
        return tuple((-self.work.matrix[2, :3] + 0.0).tolist())

    @property
    def twin_settings(self) -> Mapping[str, str]:
        """The robot of a twin, and where its work is."""
        return {
            "robot": f'"{"ur3e" if self.model == "auto" else self.model}"',
            "work.origin": str(list(self.work.origin)),
            "work.rotation": str(list(self.work.rotation)),
            "work.turn": str(self.work.turn),
            "tcp": str(list(self.tcp)),
        }

    @property
    def law(self) -> ServoLaw:
        """How setpoints become commands."""
        from palpate_arms.servo import ServoLaw

        keys = ("control", "gain", "damping", "approach_speed", "retract_speed", "acceleration")
        return ServoLaw(**{key: getattr(self, key) for key in keys}, lever=math.dist(self.tcp, (0.0, 0.0, 0.0)))
