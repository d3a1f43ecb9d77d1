"""Roles that something states: a message's type, or the name of a number in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from palpate import Floats
from palpate_records.messages.definitions import short_name
from palpate_records.tables.csv_names import role_by_words, stated_role

UNITS = {"force": "N", "position": "m", "velocity": "m/s"}
_ROLES_BY_TYPE = {  # with the field that has the role
    "geometry_msgs/WrenchStamped": ("force", "wrench.force.z"),
    "geometry_msgs/Wrench": ("force", "force.z"),
    "geometry_msgs/PoseStamped": ("position", "pose.position.z"),
    "geometry_msgs/Pose": ("position", "position.z"),
    "geometry_msgs/PointStamped": ("position", "point.z"),
    "geometry_msgs/TransformStamped": ("position", "transform.translation.z"),
    "geometry_msgs/TwistStamped": ("velocity", "twist.linear.z"),
    "geometry_msgs/Twist": ("velocity", "linear.z"),
}
_NAME_ENDS = {
    "force": ("force.z", "force_z", "fz"),
    "position": ("position.z", "translation.z", "position_z"),
    "velocity": ("linear.z", "velocity.z", "velocity_z", "vz"),
}
_MAX_CLOCK_DIFFERENCE = 0.02  # between the rates of two clocks that count the same time: a choice
_MIN_CLOCK_STEPS = 10  # from which on a column can be compared with a clock: a choice
_OTHER_NAMES = (
    "stamp",
    "header",
    "orientation",
    "rotation",
    "covariance",
    "layout",
    "torque",
    "angular",
    "acceleration",
)


def role_of_type(topic: str, type_name: str) -> tuple[str, str] | None:
    """Return the role of a topic of a known type, and the field that has it; None for any other type."""
    return _ROLES_BY_TYPE.get(short_name(type_name))


def role_of_name(name: str) -> tuple[str | None, str, str | None]:
    """Return the role of a number by its name, the reason, and its unit, which a name never states.

    "other" is the role of what is certainly none of force, position and velocity; None that of an unknown name.
    """
    lower_name = name.lower()
    if any(text in lower_name for text in _OTHER_NAMES) or role_by_words(_last_field(name)) == "other":
        return "other", "", None
    for role, ends in _NAME_ENDS.items():
        if any(lower_name == end or lower_name.endswith((f".{end}", f"_{end}")) for end in ends):
            return role, "by its name", None
    return None, "", None


def is_unknown_name(name: str) -> bool:
    """Return True for a field whose name states no known quantity and is not merely that of an array or a number."""
    return not name.endswith("]") and name != "data" and stated_role(_last_field(name)) is None


def _last_field(name: str) -> str:
    """Return the last field of a path such as ``wrench.force.z``."""
    return name.rpartition(".")[2]


def beside(role: str, name: str, columns: Sequence[str]) -> Iterator[tuple[str, str, str | None]]:
    """Yield signal, column and unit of the columns that belong to the column `name` of a role, if all of them exist.

    They are the other axes of a force, or the pose of a height, by names that end in x, y and z, or in 0 to 5 as a UR
    numbers force and pose. The unit None is that of the role.
    """
    # A UR numbers its force and pose 0 to 5: 2 is z, 3 to 5 are the rotation vector.
    if name.endswith("_2"):
        x, y, z, *rotation_columns = (f"{name[:-1]}{axis}" for axis in range(6))
        rotations = [_axis_signals("r", rotation_columns, "rad")] if "pose" in name else []
    else:
        stem = name.removesuffix("z")
        x, y, z = (f"{stem}{axis}" for axis in "xyz")
        rotations = list(_named_rotations(stem))
    if role == "force":
        signals: list[tuple[str, str, str | None]] = [("force_x", x, None), ("force_y", y, None)]
    elif role == "position":
        rotation = next((signals for signals in rotations if _exist(signals, columns)), None)
        if rotation is None:
            return
        signals = [("x", x, None), ("y", y, None), ("z", z, None), *rotation]
    else:
        return
    if name == z and _exist(signals, columns):
        yield from signals


_Signals = Sequence[tuple[str, str, str | None]]  # signal, column, unit


def _axis_signals(prefix: str, columns: Sequence[str], unit: str) -> list[tuple[str, str, str | None]]:
    """Return signals such as rx, ry, rz of columns in the order x, y, z, w."""
    return [(f"{prefix}{axis}", column, unit) for axis, column in zip("xyzw"[: len(columns)], columns, strict=True)]


def _exist(signals: _Signals, columns: Sequence[str]) -> bool:
    """Return True if every column of the signals is among the `columns`."""
    return all(column in columns for _, column, _ in signals)


def _named_rotations(stem: str) -> Iterator[list[tuple[str, str, str | None]]]:
    """Yield the quaternions, then the rotation vector, that may belong to a position whose names have a stem."""
    for quaternion_stem in _quaternion_stems(stem):
        yield _axis_signals("q", [f"{quaternion_stem}{axis}" for axis in "xyzw"], "1")
    yield _axis_signals("r", [f"{stem}r{axis}" for axis in "xyz"], "rad")


def _quaternion_stems(stem: str) -> Iterator[str]:
    """Yield the stems that the names of a quaternion may have, by that of a position."""
    for position_word, rotation_word in (
        ("position", "orientation"),
        ("translation", "rotation"),
        ("pos", "quat"),
        ("pos", "orientation"),
    ):
        if position_word in stem:
            yield stem.replace(position_word, rotation_word)
    yield f"{stem}q"


def runs_with(values: Floats, logged: Floats) -> bool:
    """Return True if a column is the time in seconds: it always grows, and at the rate of the log time [s]."""
    steps = np.diff(values)
    span = logged[-1] - logged[0]
    if len(steps) <= _MIN_CLOCK_STEPS or not span > 0 or not (steps > 0).all():
        return False
    return bool(abs((values[-1] - values[0]) / span - 1.0) < _MAX_CLOCK_DIFFERENCE)
