"""The UR3e as a device."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from palpate import (
    Acceleration,
    Batch,
    Channel,
    Device,
    DeviceError,
    Frequency,
    Length,
    Link,
    OwnMotion,
    Setpoint,
    Speed,
    Stream,
    Time,
    Trajectory,
)
from pydantic import Field

from palpate_devices.process.child import Child
from palpate_devices.process.clock import ClockMap, epoch_offset
from palpate_devices.process.lateness import lateness_table
from palpate_devices.process.ring import integers, shared_memory
from palpate_devices.ur3e import layout
from palpate_devices.ur3e.frame import WorkFrame
from palpate_devices.ur3e.kinematics import JOINTS, matrix_of, quaternion, tip
from palpate_devices.ur3e.probe import probe
from palpate_devices.ur3e.servo import PERIOD, way

Floats = NDArray[np.float64]

_POLL = 0.006  # [s]
_BEAT_SLACK = 0.02  # [s]
_HINT = ": the client library does that where it loses the link to the controller"


class UR3e(Device):
    """A Universal Robots UR3e as an arm, by `ur_rtde` in a process of its own.

    Setpoints in the work frame are followed at 500 Hz, by the paper's Cartesian PD law on top of `servoL` or by
    `servoL` alone; the tool keeps looking along the normal. The controller's watchdog is set before anything moves, so
    that the arm stops by itself where commands stay away. Controller time is mapped to the host's clock by the lower
    envelope of the arrival times. Streams: tip (pose and twist in the work frame), joints, setpoint, the robot's own
    wrench (estimated, in the base's orientation: not that of a sensor at the flange), and status.
    """

    host: str = Field(min_length=1, description="address of the controller")
    work: WorkFrame = Field(description="where the specimen is")
    tcp: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.12), min_length=3, max_length=3, description="tip on the flange"
    )
    kinematics: Literal["controller", "dh"] = Field(
        default="controller", description="tip pose and velocity from the controller, or from the joints by nominal DH"
    )
    control: Literal["pd", "servo"] = Field(default="pd", description="the paper's PD law, or servoL alone")
    gain: float = Field(default=20.0, gt=0, lt=100, description="proportional gain of the PD law, in 1/s")
    damping: float = Field(default=0.5, ge=0, lt=1, description="derivative gain of the PD law")
    lookahead: Time = Field(default=0.03, ge=0.03, le=0.2, description="servoL's lookahead time")
    servo_gain: float = Field(default=1000.0, ge=100, le=2000, description="servoL's gain")
    watchdog: Frequency = Field(default=10.0, ge=1, le=50, description="the arm stops where commands come more rarely")
    stale: Time = Field(default=0.1, gt=0, description="an older state of the controller is a lost link")
    host_limit: Time = Field(default=0.25, gt=0, description="the arm retracts where the main job is silent for longer")
    start: Time = Field(default=20.0, gt=0, description="how long the client library may take to connect")
    start_tolerance: Length = Field(default=0.03, gt=0, description="how far from its start a motion may begin")
    approach_speed: Speed = Field(default=0.02, gt=0, le=0.25, description="fastest on the way to the start")
    retract_speed: Speed = Field(default=0.05, gt=0, le=0.25, description="of a retraction")
    acceleration: Acceleration = Field(default=1.0, gt=0, le=5, description="of braking and retraction, at most")

    @property
    def live(self) -> bool:
        """It sends as time goes by."""
        return True

    @property
    def streams(self) -> tuple[Stream, ...]:
        """Tip, twist, joints, setpoint, the robot's own wrench, status."""
        rate = 1.0 / PERIOD
        pose = [Channel(axis, "m") for axis in "xyz"] + [Channel(f"q{axis}", "1") for axis in "xyzw"]
        twist = [Channel(axis, "m/s") for axis in "xyz"] + [Channel(f"w{axis}", "rad/s") for axis in "xyz"]
        joints = [Channel(name, "rad") for name in JOINTS] + [Channel(f"{name}_speed", "rad/s") for name in JOINTS]
        setpoint = [Channel(axis, "m") for axis in "xyz"] + [Channel(f"v{axis}", "m/s") for axis in "xyz"]
        wrench = [Channel(axis, "N") for axis in "xyz"] + [Channel(f"t{axis}", "N*m") for axis in "xyz"]
        status = [Channel("time", "s"), *(Channel(name, "1") for name in ("robot_mode", "safety_mode", "runtime"))]
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
        """It goes to the start, and brakes."""
        return OwnMotion(self.approach_speed, self.start_tolerance, self.acceleration)

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """The arm at rest; `follow` sets it in motion."""
        return self._connected()

    @contextmanager
    def _connected(self) -> Iterator[Link]:
        name = f"ur3e at {self.host}"
        try:
            identity = probe(self.host)
        except DeviceError as error:
            raise DeviceError(f"ur3e at {error}") from error
        child = Child(name, layout.MODULE, self._worker_settings(), layout.COLUMNS, _HINT)
        try:
            link = UR3eLink(self, child, {**identity, **child.wait_for("ready", self.start)})
            yield link
        finally:
            child.ring.head[layout.STOP] = 1
            child.close()

    def _worker_settings(self) -> dict[str, Any]:
        keys = ("host", "tcp", "lookahead", "servo_gain", "watchdog", "stale", "host_limit")
        motion = ("control", "gain", "damping", "approach_speed", "retract_speed", "acceleration")
        law = {key: getattr(self, key) for key in motion}
        return {key: getattr(self, key) for key in keys} | {"law": law, "work": self.work.model_dump()}


class UR3eLink:
    """A connected UR3e (an Arm, Retractable and Watched)."""

    def __init__(self, settings: UR3e, child: Child, identity: Mapping[str, Any]) -> None:
        self._settings, self._child, self._identity = settings, child, identity
        self._clock = ClockMap()
        self._tool = matrix_of([*settings.tcp, 0.0, 0.0, 0.0])
        self._position: Floats | None = None
        self._turned = np.array([1.0, 1e-3, 1e-6, 1e-9])  # the first quaternion's largest part is positive
        self._states = 0
        self._first = self._last = 0
        self._mismatch = 0.0

    def way(self, trajectory: Trajectory) -> tuple[Floats, Setpoint]:
        """The way to the first setpoint; see `palpate.Approaching`."""
        name, settings = self._child.name, self._settings
        if self._position is None:
            raise DeviceError(f"{name}: nothing is known of where the arm is")
        start = trajectory.at(np.zeros(1)).position[0]
        away = float(np.linalg.norm(start - self._position))
        if away > settings.start_tolerance:
            here = ", ".join(f"{1e3 * x:.1f}" for x in self._position)
            raise DeviceError(
                f"{name}: the tip is at ({here}) mm in the work frame, {1e3 * away:.1f} mm from where the "
                f"motion starts; bring it within {1e3 * settings.start_tolerance:g} mm by hand"
            )
        times, position, velocity = way(self._position, start, settings.approach_speed, settings.acceleration)
        return times, Setpoint(position, velocity, np.zeros(len(times), bool))

    def follow(self, trajectory: Trajectory) -> None:
        """Go to the first setpoint, then follow them all."""
        count = int(np.floor(trajectory.total_duration / PERIOD + 1e-9)) + 1
        times = np.asarray(np.arange(count) * PERIOD, np.float64)
        setpoint = trajectory.at(times)
        table = np.column_stack([setpoint.position, setpoint.velocity, setpoint.measuring.astype(float)])
        self.way(trajectory)  # refused where it is too far
        memory = shared_memory(table.nbytes)
        try:
            os.pwrite(memory, np.ascontiguousarray(table).tobytes(), 0)
            self._child.hand_over("follow", memory, rows=len(table))
        finally:
            os.close(memory)

    def stop(self) -> None:
        """Stop where it is."""
        self._child.ring.head[layout.STOP] = 1

    def retract(self) -> None:
        """Brake, and go back along the normal to where the motion began."""
        self._child.ring.head[layout.RETRACT] = 1

    def batches(self) -> Iterator[Batch]:
        """The states as they come, until the motion is over; raises DeviceError as soon as the robot fails."""
        done = False
        early = self._child.ring.early()  # what came while other devices were connected
        self._clock.to_host(integers(early, 0), integers(early, 1) + epoch_offset())
        while not done:
            done = any(message["say"] == "done" for message in self._child.messages())
            rows = self._child.ring.read()
            yield from self._batches(rows)
            if not len(rows):
                self._child.check(self._settings.stale + _BEAT_SLACK)
            time.sleep(_POLL)

    def _batches(self, rows: Floats) -> Iterator[Batch]:
        received = integers(rows, 1) + epoch_offset()
        controller = integers(rows, 0)
        stamps = self._clock.to_host(controller, received)
        pose, twist = self._kinematics(rows)
        if len(rows):
            self._position = pose[-1, :3]
            self._first, self._last = self._first or int(controller[0]), int(controller[-1])
        self._states += len(rows)
        status = np.column_stack([controller / 1e9, rows[:, 32:35]])
        columns = (pose, twist, rows[:, 2:14], rows[:, 35:42], rows[:, 26:32], status)
        for stream, values in zip(self._settings.streams, columns, strict=True):
            yield Batch(stream.name, stamps, received, np.ascontiguousarray(values))

    def _kinematics(self, rows: Floats) -> tuple[Floats, Floats]:
        """Pose (n, 7) and twist (n, 6) of the tip in the work frame."""
        work = self._settings.work.matrix
        turn = work[:3, :3].T
        pose, twist = np.empty((len(rows), 7)), np.empty((len(rows), 6))
        for i, row in enumerate(rows):
            matrix, speed = matrix_of(row[14:20].tolist()), row[20:26]
            if self._settings.kinematics == "dh" or i == 0:
                own, jacobian = tip(row[2:8].tolist(), self._tool)
                self._mismatch = max(self._mismatch, float(np.abs(own[:3, 3] - matrix[:3, 3]).max()))
                if self._settings.kinematics == "dh":
                    matrix, speed = own, jacobian @ row[8:14]
            turned = quaternion(turn @ matrix[:3, :3])
            # A tool that looks down is turned by about pi, where the sign of a quaternion is up to chance.
            turned = -turned if float(turned @ self._turned) < 0 else turned
            pose[i, :3], pose[i, 3:], self._turned = turn @ (matrix[:3, 3] - work[:3, 3]), turned, turned
            twist[i, :3], twist[i, 3:] = turn @ speed[:3], turn @ speed[3:]
        return pose, twist

    @property
    def health(self) -> Mapping[str, Any]:
        """What was seen of the robot and of the loop."""
        expected = round((self._last - self._first) / 1e9 / PERIOD) + 1
        return {
            **self._identity,
            "states": self._states,
            "states_unseen": max(expected - self._states, 0),
            "commands": lateness_table(self._child.ring.head),
            "clock_wander": self._clock.wander,
            "kinematics_mismatch": self._mismatch,
        }
