"""ROS 2 messages that are a header followed by numbers, packed in whole arrays.

CDR, little-endian: 4 bytes of encapsulation, then int32 sec, uint32 nanosec, the frame as a counted string with its
closing zero, padding to a multiple of 8 counted from byte 4, and float64 numbers. Every message of a stream has one
frame, so all have one size and a block of them is one numpy array. The names of joints are as constant as the frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_records.messages.topics import column

_SECOND = 1_000_000_000  # [ns]
# CDR (OMG DDS-RTPS): encapsulation, alignment counted from behind it, and sizes.
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_WORD, _DOUBLE = 4, 8  # bytes of an integer and of a float64, each aligned to its size
_SECONDS_AT, _NANOSECONDS_AT = 4, 8  # bytes: the stamp is a message's first field
_SEPARATOR = "\n" + "=" * 80 + "\n"  # of definitions, by rosbag2
_TIME = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
_HEADER = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
_VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"


@dataclass(frozen=True)
class MessageType:
    """A message type of the family: its name, its definition, and its numbers in their order."""

    name: str
    definition: str
    fields: tuple[str, ...]
    paths: tuple[str, ...] = ()  # of its numbers in a message; empty: the fields themselves


def _composed(*parts: str) -> str:
    """Return a definition with those of the types that it contains."""
    return _SEPARATOR.join([*parts, _HEADER, _TIME])


WRENCH = MessageType(
    "geometry_msgs/msg/WrenchStamped",
    _composed(
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
        "MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
        _VECTOR,
    ),
    ("x", "y", "z", "tx", "ty", "tz"),
    tuple(f"wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz"),
)
POSE = MessageType(
    "geometry_msgs/msg/PoseStamped",
    _composed(
        "std_msgs/Header header\ngeometry_msgs/Pose pose",
        "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
        "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    ),
    ("x", "y", "z", "qx", "qy", "qz", "qw"),
    (*(f"pose.position.{axis}" for axis in "xyz"), *(f"pose.orientation.{axis}" for axis in "xyzw")),
)
TWIST = MessageType(
    "geometry_msgs/msg/TwistStamped",
    _composed(
        "std_msgs/Header header\ngeometry_msgs/Twist twist",
        "MSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
        _VECTOR,
    ),
    ("x", "y", "z", "wx", "wy", "wz"),
    tuple(f"twist.{part}.{axis}" for part in ("linear", "angular") for axis in "xyz"),
)
JOINTS = MessageType(
    "sensor_msgs/msg/JointState",
    _composed("std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"),
    (),
)
LOG_SCHEMA = 1  # of what we record; a log without a number has this one
STANDARD = {"wrench": WRENCH, "pose": POSE, "twist": TWIST, "joints": JOINTS}
UNITS = {
    WRENCH.name: ("N", "N", "N", "N*m", "N*m", "N*m"),
    POSE.name: ("m", "m", "m", "1", "1", "1", "1"),
    TWIST.name: ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s"),
}


def numbers_type(name: str, fields: Sequence[str]) -> MessageType:
    """Return a type of our own, ``palpate_msgs/msg/NAME``: a header and one float64 for each field."""
    body = "\n".join(["std_msgs/Header header", *(f"float64 {field}" for field in fields)])
    return MessageType(f"palpate_msgs/msg/{name}", _composed(body), tuple(fields))


def joint_type(channels: Sequence[str]) -> MessageType:
    """Return JointState with these channels: the angle of each joint under its name, then as many speeds."""
    count = len(channels) // 2
    paths = [f"{part}[{i}]" for part in ("position", "velocity") for i in range(count)]
    return replace(JOINTS, fields=tuple(channels), paths=tuple(paths))


def message_type(schema_name: str, definition: str) -> MessageType | None:
    """Return the type of a recorded schema: a standard one, or a header and float64 numbers; None of any other."""
    parts = schema_name.split("/")
    name = f"{parts[0]}/msg/{parts[-1]}"  # schema names come with and without /msg/
    for standard in STANDARD.values():
        if standard.name == name:
            return standard
    # Fields as (type, name), without comments and the definitions of other types.
    own_definition = definition.split("\n===")[0]
    lines = [line.split("#")[0].split() for line in own_definition.splitlines()]
    fields = [line for line in lines if line]
    if not fields or fields[0][0] not in ("std_msgs/Header", "std_msgs/msg/Header"):
        return None
    numbers = fields[1:]
    if any(len(field) != 2 or field[0] != "float64" for field in numbers):
        return None
    return MessageType(name, definition, tuple(field[1] for field in numbers))


def pack(stamps: NDArray[np.int64], frame: str, numbers: Floats, joints: tuple[str, ...] = ()) -> list[bytes]:
    """Return a CDR message for each stamp [ns] and row of numbers (n, k); of joints (n, 2 j), angles, then speeds."""
    messages = pack_messages(stamps, frame, numbers, joints)
    raw, size = messages.tobytes(), messages.shape[1]
    return [raw[start : start + size] for start in range(0, len(raw), size)]


def pack_messages(
    stamps: NDArray[np.int64], frame: str, numbers: Floats, joints: tuple[str, ...] = ()
) -> NDArray[np.uint8]:
    """Return one message in CDR for each stamp (n,) [ns] and row of numbers (n, k), in one array (n, bytes).

    With `joints` they are JointStates with these names, else a header with its `frame` and the numbers.
    """
    # Copies of the template, with the stamp of each.
    template, runs = _template(frame, numbers.shape[1], joints)
    messages = np.tile(np.frombuffer(template, np.uint8), (len(stamps), 1))
    column(messages, _SECONDS_AT, "<i4")[:] = stamps // _SECOND
    column(messages, _NANOSECONDS_AT, "<u4")[:] = stamps % _SECOND
    # The numbers, run by run.
    begin = 0
    for offset, count in runs:
        run = np.ascontiguousarray(numbers[:, begin : begin + count], "<f8")
        messages[:, offset : offset + _DOUBLE * count] = run.view(np.uint8)
        begin += count
    return messages


@cache
def _template(frame: str, count: int, joints: tuple[str, ...]) -> tuple[bytes, tuple[tuple[int, int], ...]]:
    """Return a message in CDR whose stamp and numbers are 0, and the runs of its numbers: offset [bytes] and count.

    Without joints a header and `count` numbers. With joints a JointState: header, names, and the arrays of positions,
    velocities and efforts, each as its length and its numbers, as many as there are joints; of efforts none.
    """
    message = _MessageTemplate()
    message.add_text(frame)
    if not joints:
        message.add_numbers(count)
        return bytes(message.data), tuple(message.runs)
    message.add_integer(len(joints))
    for joint in joints:
        message.add_text(joint)
    for _ in ("position", "velocity"):
        message.add_integer(len(joints))
        message.add_numbers(len(joints))
    message.add_integer(0)  # the length of the efforts
    return bytes(message.data), tuple(message.runs)


class _MessageTemplate:
    """A message in CDR that grows field by field: encapsulation and a stamp of 0 to begin with."""

    def __init__(self) -> None:
        self.data = bytearray(_LITTLE_ENDIAN + bytes(2 * _WORD))
        self.runs: list[tuple[int, int]] = []  # of numbers: offset [bytes] and count

    def add_integer(self, number: int) -> None:
        """Append an unsigned integer, aligned."""
        self.data.extend(bytes(-len(self.data) % _WORD) + number.to_bytes(_WORD, "little"))

    def add_text(self, text: str) -> None:
        """Append a string: its size with the closing zero, and its bytes."""
        encoded = text.encode() + b"\0"
        self.add_integer(len(encoded))
        self.data.extend(encoded)

    def add_numbers(self, count: int) -> None:
        """Append a run of float64 that are 0, aligned."""
        self.data.extend(bytes(-(len(self.data) - len(_LITTLE_ENDIAN)) % _DOUBLE))
        self.runs.append((len(self.data), count))
        self.data.extend(bytes(_DOUBLE * count))
