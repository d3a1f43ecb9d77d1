"""The tip from the joints of a log: position, orientation and velocity by the robot's kinematics, in whole arrays.

Standard Denavit-Hartenberg: T = prod Rz(q_i) Tz(d_i) Tx(a_i) Rx(alpha_i). The velocity of the tip is J(q) q', where the
column of a turning joint is (axis x (tip - origin), axis).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
# q and -q are one orientation: the one whose product with this is positive is returned. A choice: no usual pose is at
# right angles to it, where the sign would jump.
_SIDE = np.array([0.70, 0.17, 0.11, 0.68])
_ANGLE_DIGITS = 15  # of a cosine, to which a quarter turn is exact


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
        """Raise ValueError unless there is one robot, a known one or one of joints with different names."""
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
        return tuple(
            Joint.model_construct(name=self.prefix + name, a=a, d=d, alpha=alpha, offset=0.0)
            for name, a, d, alpha in rows
        )

    @property
    def streams(self) -> tuple[Stream, Stream]:
        """The streams of the tip and of its velocity."""
        frame = "base" if self.work is None else "work"
        pose, twist = (tuple(Channel(*channel) for channel in channels) for channels in (_POSE, _TWIST))
        return (
            Stream("tip", pose, None, layout="pose", clock="log", frame=frame),
            Stream("twist", twist, None, layout="twist", clock="log", frame=frame),
        )

    def pose(self, angles: Floats) -> Floats:
        """Return position [m] and quaternion x, y, z, w of the tip (n, 7) at joint angles (n, k) [rad]."""
        pose, _ = self._tips(angles)
        return np.concatenate([pose[:, :3, 3], quaternions(pose[:, :3, :3])], axis=1)

    def quaternions(self, angles: Floats) -> Floats:
        """Return the quaternions of the tip (n, 4) at joint angles (n, k) [rad]."""
        return self.pose(angles)[:, 3:]

    def twist(self, numbers: Floats) -> Floats:
        """Return velocity [m/s] and angular velocity [rad/s] of the tip (n, 6) at angles, then speeds (n, 2 k)."""
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
    """Return poses (n, 4, 4) of a tool on a chain of joints at angles (n, k) [rad], and Jacobians (n, 6, k).

    `base` (4, 4) is the pose of the robot's base in the frame of both, `tool` (4, 4) that of the tip on the flange. The
    rows of a Jacobian are the tip's velocity x, y, z, then its angular velocity.
    """
    pose: Floats = np.tile(base, (len(angles), 1, 1))
    origins, axes = [], []
    for angle, joint in zip(angles.T, chain, strict=True):
        origins.append(pose[:, :3, 3])
        axes.append(pose[:, :3, 2])
        pose = pose @ _link(angle + joint.offset, joint)
    pose = pose @ tool
    # A turning joint moves the tip by axis x (tip - origin), and turns it around the axis.
    jacobian = np.empty((len(angles), 6, len(chain)))
    for k, (origin, axis) in enumerate(zip(origins, axes, strict=True)):
        ax, ay, az = axis.T
        x, y, z = (pose[:, :3, 3] - origin).T
        jacobian[:, 0, k] = ay * z - az * y
        jacobian[:, 1, k] = az * x - ax * z
        jacobian[:, 2, k] = ax * y - ay * x
        jacobian[:, 3:, k] = axis
    return pose, jacobian


def _link(angle: Floats, joint: Joint) -> Floats:
    """Return the transforms (n, 4, 4) Rz(q) Tz(d) Tx(a) Rx(alpha) of a joint at angles q (n,) [rad].

    [[c, -s ca, s sa, a c], [s, c ca, -c sa, a s], [0, sa, ca, d], [0, 0, 0, 1]] with c = cos q, ca = cos alpha. A
    quarter turn of alpha is exact: a cosine of 6e-17 would tilt nothing, but round zeros into noise.
    """
    c, s = np.cos(angle), np.sin(angle)
    ca = round(float(np.cos(joint.alpha)), _ANGLE_DIGITS)
    sa = round(float(np.sin(joint.alpha)), _ANGLE_DIGITS)
    link = np.zeros((len(angle), 4, 4))
    link[:, 0, 0], link[:, 0, 1], link[:, 0, 2], link[:, 0, 3] = c, -s * ca, s * sa, joint.a * c
    link[:, 1, 0], link[:, 1, 1], link[:, 1, 2], link[:, 1, 3] = s, c * ca, -c * sa, joint.a * s
    link[:, 2, 1:] = sa, ca, joint.d
    link[:, 3, 3] = 1.0
    return link


def quaternions(rotations: Floats) -> Floats:
    """Return unit quaternions x, y, z, w (n, 4) of rotations (n, 3, 3), all on one side: their sign does not jump.

    The products 4 q_i q_j are sums of entries of a rotation. A row of them is the quaternion but for a factor, and
    loses digits where its own component q_i is small: the row of the largest component is taken (Shepperd 1978).
    """
    r = rotations.transpose(1, 2, 0)
    rx, ry, rz = r[0, 0], r[1, 1], r[2, 2]
    squares = np.stack([1 + rx - ry - rz, 1 - rx + ry - rz, 1 - rx - ry + rz, 1 + rx + ry + rz])  # 4 q_i^2
    wx, wy, wz = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]  # 4 w q_i
    xy, xz, yz = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]  # 4 q_i q_j
    products = np.stack(
        [
            np.stack([squares[0], xy, xz, wx]),
            np.stack([xy, squares[1], yz, wy]),
            np.stack([xz, yz, squares[2], wz]),
            np.stack([wx, wy, wz, squares[3]]),
        ]
    )
    largest = squares.argmax(axis=0)
    quaternion = np.take_along_axis(products, largest[None, None], axis=0)[0].T
    quaternion = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.asarray(quaternion * np.where(quaternion @ _SIDE < 0, -1.0, 1.0)[:, None])


def joint_feeds(
    container: Container, kinematics: Kinematics, clock: Clock, log: str
) -> tuple[list[TopicFeed], TopicFeed]:
    """Return the feeds of the tip, and of its velocity if the joints' is recorded; then that of the orientation.

    `container` is the log, `kinematics` the robot with the topic of its joints; a feed is a stream with the numbers of
    the messages that it is made of. Raises LogError if the log does not have the topic of the joints, or its messages
    do not name them.
    """
    if kinematics.topic not in container.topics:
        topics = ", ".join(container.topics) or "none"
        raise LogError(f"{log}: topic {kinematics.topic!r} of the kinematics is not in the log (there are: {topics})")
    with name_the_log(log):
        decoder = decoder_of(container.topics[kinematics.topic])
    # What is read of each joint, by its name in the message.
    names = [joint.name for joint in kinematics.chain]
    angles = tuple(FieldReading("position", None, name) for name in names)
    speeds = tuple(FieldReading("velocity", None, name) for name in names)
    tip_stream, twist_stream = kinematics.streams

    def feed(stream: Stream, readings: tuple[FieldReading, ...], function: Callable[[Floats], Floats]) -> TopicFeed:
        """Return the feed of a stream that is a function of readings of the joints."""
        return TopicFeed(
            stream,
            topic=kinematics.topic,
            readings=readings,
            factors=np.ones(len(_POSE)),
            clock=clock,
            decoder=decoder,
            function=function,
        )

    tip = feed(tip_stream, angles, kinematics.pose)
    twist = feed(twist_stream, angles + speeds, kinematics.twist)
    orientation = feed(Stream("", (), None), angles, kinematics.quaternions)
    check_fields(container, [tip], log)
    # The velocity of the tip needs speeds, which are optional in such messages.
    with name_the_log(log):
        return ([tip, twist] if _has_speeds(container, twist) else [tip]), orientation


def _has_speeds(container: Container, twist: TopicFeed) -> bool:
    """Return True if the first message that names the joints has their speeds."""
    for _, messages in container.blocks({twist.topic}):
        table = twist.decoder.read(messages, twist.readings)
        if len(table.values):
            return bool(np.isfinite(table.values[0]).all())
    return False
