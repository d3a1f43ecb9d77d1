"""Roles that something states: a message's type, or the name of a number in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from palpate import Floats
from palpate_records.messages.definitions import short_name
from palpate_records.tables.csv_names import role_by_words, stated_role

UNITS = {"force": "N", "position": "m", "velocity": "m/s"}
_TYPED = {
    "geometry_msgs/WrenchStamped": ("force", "wrench.force.z"),
    "geometry_msgs/Wrench": ("force", "force.z"),
    "geometry_msgs/PoseStamped": ("position", "pose.position.z"),
    "geometry_msgs/Pose": ("position", "position.z"),
    "geometry_msgs/PointStamped": ("position", "point.z"),
    "geometry_msgs/TransformStamped": ("position", "transform.translation.z"),
    "geometry_msgs/TwistStamped": ("velocity", "twist.linear.z"),
    "geometry_msgs/Twist": ("velocity", "linear.z"),
}
_ENDS = {
    "force": ("force.z", "force_z", "fz"),
    "position": ("position.z", "translation.z", "position_z"),
    "velocity": ("linear.z", "velocity.z", "velocity_z", "vz"),
}
_NONE = ("stamp", "header", "orientation", "rotation", "covariance", "layout", "torque", "angular", "acceleration")


def role_of_type(topic: str, type_name: str) -> tuple[str, str] | None:
    """Return the role of a topic of a known type, and its number; None where the type gives none."""
    return _TYPED.get(short_name(type_name))


def role_of_name(name: str) -> tuple[str | None, str, str | None]:
    """Return the role that a number's name states, by what, and its unit, which names do not state; "other" is not a
    role."""
    words = name.lower()
    if any(word in words for word in _NONE) or role_by_words(_field_of(name)) == "other":
        return "other", "", None
    for role, ends in _ENDS.items():
        if any(words == end or words.endswith((f".{end}", f"_{end}")) for end in ends):
            return role, "by its name", None
    return None, "", None


def is_unknown_name(name: str) -> bool:
    """Return True for a field whose name is neither a quantity that is known, nor the data of an array or a number."""
    return not name.endswith("]") and name != "data" and stated_role(_field_of(name)) is None


def _field_of(name: str) -> str:
    """Return the last field of a path, without what holds it."""
    return name.rpartition(".")[2]


def beside(role: str, name: str, columns: Sequence[str]) -> Iterator[tuple[str, str, str | None]]:
    """Signal, column and unit of what belongs to the column of a role: a force's other axes, the pose of a height.

    By names that end in x, y and z, or in 0 to 5 as a UR numbers force and pose. No unit: it is that of the role.
    """
    if name.endswith("_2"):
        x, y, z, *turn = (f"{name[:-1]}{axis}" for axis in range(6))
        turns = [[(f"r{axis}", column, "rad") for axis, column in zip("xyz", turn, strict=True)]] * ("pose" in name)
    else:
        stem = name.removesuffix("z")
        x, y, z = (f"{stem}{axis}" for axis in "xyz")
        turns = [[(f"q{axis}", f"{start}{axis}", "1") for axis in "xyzw"] for start in _quaternion_stems(stem)]
        turns += [[(f"r{axis}", f"{stem}r{axis}", "rad") for axis in "xyz"]]
    if role == "force":
        found: list[tuple[str, str, str | None]] = [("force_x", x, None), ("force_y", y, None)]
    elif role == "position" and (turned := next((t for t in turns if all(c in columns for _, c, _ in t)), None)):
        found = [("x", x, None), ("y", y, None), ("z", z, None), *turned]
    else:
        return
    if name == z and all(column in columns for _, column, _ in found):
        yield from found


def _quaternion_stems(stem: str) -> Iterator[str]:
    """How the names of a quaternion may begin, next to those of a place."""
    for place, turn in (
        ("position", "orientation"),
        ("translation", "rotation"),
        ("pos", "quat"),
        ("pos", "orientation"),
    ):
        if place in stem:
            yield stem.replace(place, turn)
    yield f"{stem}q"


def runs_with(values: Floats, logged: Floats) -> bool:
    """Return True if a column is the time in seconds: it always grows, as fast as the log time."""
    steps = np.diff(values)
    span = logged[-1] - logged[0]
    return bool(
        len(steps) > 10 and span > 0 and (steps > 0).all() and abs((values[-1] - values[0]) / span - 1.0) < 0.02
    )
