"""From the joints of a log to the tip: position, orientation and velocity by the robot's kinematics, in whole arrays.

Standard Denavit-Hartenberg: T = prod Rz(q_i) Tz(d_i) Tx(a_i) Rx(alpha_i). The velocity of the tip is J(q) q', where the
column of a turning joint is (axis x (tip - origin), axis).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Literal, Self

import numpy as np
from palpate import Angle, Channel, Floats, Length, LogError, Settings, Stream
from palpate_records.messages.channel_mapping import Clock
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.feeds import TopicFeed, check_fields, name_the_log
from palpate_records.messages.readings import FieldReading
from palpate_records.messages.topics import Container
from pydantic import Field, model_validator

from palpate_kit.kinematics.arm_model import Joint
from palpate_kit.kinematics.rotations import matrix_of
from palpate_kit.kinematics.ur_arm import ALPHA, JOINTS, A, D
from palpate_kit.kinematics.work_frame import WorkFrame

_POSE = (*((axis, "m") for axis in "xyz"), *((f"q{axis}", "1") for axis in "xyzw"))
_TWIST = (*((axis, "m/s") for axis in "xyz"), *((f"w{axis}", "rad/s") for axis in "xyz"))
# q and -q are one orientation: the one on the side of this is given, whose edge is far from usual poses.
_SIDE = np.array([0.70, 0.17, 0.11, 0.68])


class Kinematics(Settings):
    """The robot whose joint states give the position and velocity of the tip, in its base or in a work frame."""

    topic: str = Field(min_length=1, description='topic of JointState messages, such as "/joint_states"')
    robot: Literal["ur3e"] | None = Field(
        default=None, description="a robot whose nominal parameters are known: streams tip and twist; or give joints"
    )
    joints: tuple[Joint, ...] = Field(default=(), description="joints of another robot, from the base to the tip")
    prefix: str = Field(default="", description='prefix of the joint names of a known robot, such as "left_"')
    tcp: tuple[Length, ...] = Field(min_length=3, max_length=3, description="tip on the flange")
    tcp_rotation: tuple[Angle, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="rotation vector of the tool on the flange"
    )
    work: WorkFrame | None = Field(
        default=None, description="frame of the numbers, such as one whose z is the surface normal; else the base"
    )

    @model_validator(mode="after")
    def _one_robot(self) -> Self:
        if (self.robot is None) == (not self.joints):
            raise ValueError('give either robot = "ur3e" or joints')
        if self.joints and self.prefix:
            raise ValueError("prefix is for known robots: give the whole names in joints")
        if len({joint.name for joint in self.joints}) < len(self.joints):
            raise ValueError("two joints have one name")
        return self

    @cached_property
    def chain(self) -> tuple[Joint, ...]:
        """The joints from the base to the tip."""
        if self.joints:
            return self.joints
        rows = zip(JOINTS, A, D, ALPHA, strict=True)
        return tuple(Joint.model_construct(name=self.prefix + n, a=a, d=d, alpha=w, offset=0.0) for n, a, d, w in rows)

    @property
    def streams(self) -> tuple[Stream, Stream]:
        """Of the tip and of its velocity."""
        frame = "base" if self.work is None else "work"
        pose, twist = (tuple(Channel(*channel) for channel in channels) for channels in (_POSE, _TWIST))
        return Stream("tip", pose, None, "pose", "log", frame), Stream("twist", twist, None, "twist", "log", frame)

    def pose(self, angles: Floats) -> Floats:
        """Position [m] and quaternion x, y, z, w of the tip (n, 7) at joint angles (n, k) [rad]."""
        pose, _ = self._tips(angles)
        return np.concatenate([pose[:, :3, 3], quaternions(pose[:, :3, :3])], axis=1)

    def quaternions(self, angles: Floats) -> Floats:
        """Orientation of the tip (n, 4) at joint angles (n, k) [rad]."""
        return self.pose(angles)[:, 3:]

    def twist(self, numbers: Floats) -> Floats:
        """Velocity [m/s] and angular velocity [rad/s] of the tip (n, 6); numbers are angles, then speeds (n, 2 k)."""
        count = len(self.chain)
        _, jacobian = self._tips(numbers[:, :count])
        return np.asarray((jacobian @ numbers[:, count:, None])[:, :, 0])

    def _tips(self, angles: Floats) -> tuple[Floats, Floats]:
        return tips(angles, self.chain, *self._ends)

    @cached_property
    def _ends(self) -> tuple[Floats, Floats]:
        """The base in the frame of the numbers, and the tip on the flange (4, 4)."""
        base: Floats = np.eye(4)
        if self.work is not None:
            base = np.asarray(np.linalg.inv(self.work.matrix), np.float64)
        return base, matrix_of([*self.tcp, *self.tcp_rotation])


def tips(angles: Floats, chain: Sequence[Joint], base: Floats, tool: Floats) -> tuple[Floats, Floats]:
    """Poses (n, 4, 4) of a tool on a chain of joints at angles (n, k) [rad], and Jacobians (n, 6, k).

    `base` (4, 4) is the pose of the robot's base in the frame of the answer, `tool` (4, 4) that of the tip on the
    flange.
    """
    pose: Floats = np.tile(base, (len(angles), 1, 1))
    origins, axes = [], []
    for angle, joint in zip(angles.T, chain, strict=True):
        origins.append(pose[:, :3, 3])
        axes.append(pose[:, :3, 2])
        pose = pose @ _link(angle + joint.offset, joint)
    pose = pose @ tool
    jacobian = np.empty((len(angles), 6, len(chain)))
    for k, (origin, axis) in enumerate(zip(origins, axes, strict=True)):
        (ax, ay, az), (x, y, z) = axis.T, (pose[:, :3, 3] - origin).T
        for row, value in enumerate((ay * z - az * y, az * x - ax * z, ax * y - ay * x)):
            jacobian[:, row, k] = value
        jacobian[:, 3:, k] = axis
    return pose, jacobian


def _link(angle: Floats, joint: Joint) -> Floats:
    """Rz(q) Tz(d) Tx(a) Rx(alpha), (n, 4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    # A quarter turn is meant exactly: 6e-17 for its cosine would tilt nothing, but round zeros into noise.
    ca, sa = round(float(np.cos(joint.alpha)), 15), round(float(np.sin(joint.alpha)), 15)
    link = np.zeros((len(angle), 4, 4))
    for column, (first, second) in enumerate(
        ((c, s), (-s * ca, c * ca), (s * sa, -c * sa), (joint.a * c, joint.a * s))
    ):
        link[:, 0, column], link[:, 1, column] = first, second
    link[:, 2, 1:], link[:, 3, 3] = (sa, ca, joint.d), 1.0
    return link


def quaternions(rotations: Floats) -> Floats:
    """Unit quaternions x, y, z, w (n, 4) of rotations (n, 3, 3), all on one side, so that they do not jump in sign.

    Each of the four ways to compute one loses digits where its own component is small: the largest is taken.
    """
    r = rotations.transpose(1, 2, 0)
    x, y, z = r[0, 0], r[1, 1], r[2, 2]
    squares = np.stack([1 + x - y - z, 1 - x + y - z, 1 - x - y + z, 1 + x + y + z])  # 4 q_i^2
    a, b, c = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]  # 4 w q_i
    d, e, f = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]  # 4 q_i q_j
    ways = np.stack(
        [
            np.stack([squares[0], d, e, a]),
            np.stack([d, squares[1], f, b]),
            np.stack([e, f, squares[2], c]),
            np.stack([a, b, c, squares[3]]),
        ]
    )
    found = np.take_along_axis(ways, squares.argmax(axis=0)[None, None], axis=0)[0].T
    found = found / np.linalg.norm(found, axis=1, keepdims=True)
    return np.asarray(found * np.where(found @ _SIDE < 0, -1.0, 1.0)[:, None])


def joint_feeds(
    container: Container, kinematics: Kinematics, clock: Clock, log: str
) -> tuple[list[TopicFeed], TopicFeed]:
    """Return the streams of the tip, with its velocity where the joints' is recorded, and the orientation; raises
    LogError."""
    if kinematics.topic not in container.topics:
        there = ", ".join(container.topics) or "none"
        raise LogError(f"{log}: topic {kinematics.topic!r} of the kinematics is not in the log (there are: {there})")
    with name_the_log(log):
        decoder = decoder_of(container.topics[kinematics.topic])
    names = [joint.name for joint in kinematics.chain]
    angles = tuple(FieldReading("position", None, name) for name in names)
    speeds = tuple(FieldReading("velocity", None, name) for name in names)
    tips, twists = kinematics.streams
    ones = np.ones(len(_POSE))
    tip = TopicFeed(tips, kinematics.topic, angles, ones, clock, decoder, function=kinematics.pose)
    twist = TopicFeed(twists, kinematics.topic, angles + speeds, ones, clock, decoder, function=kinematics.twist)
    turn = TopicFeed(
        Stream("", (), None), kinematics.topic, angles, ones, clock, decoder, function=kinematics.quaternions
    )
    check_fields(container, [tip], log)
    with name_the_log(log):
        return ([tip, twist] if _has_speeds(container, twist) else [tip]), turn


def _has_speeds(container: Container, twist: TopicFeed) -> bool:
    """Return True if the first message that names the joints has their speeds."""
    for _, messages in container.blocks({twist.topic}):
        table = twist.decoder.read(messages, twist.readings)
        if len(table.values):
            return bool(np.isfinite(table.values[0]).all())
    return False
