"""Roles: which numbers of an unknown log are force, position, velocity and time.

Types that say what they hold (a wrench, a pose, a twist) are taken at their word: component z, in SI. Arrays of numbers
without names are looked into: a velocity is the derivative of a position, time runs with the clock of the recorder, and
what is left over and moves is the force. Where two candidates remain nothing is chosen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_devices.logs.definitions import short_name

Floats = NDArray[np.float64]

ROLES = ("force", "position", "velocity")
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
_REACH = 25  # samples to either side over which a derivative is taken: noise averages out, and the mean is exact
_ALIKE = 0.5  # residual of a velocity against a derivative, relative to the velocity, below which they belong together
_CLEARLY = 1.5  # how much better the best position must fit than the next
_SAME = 0.999999  # correlation of two columns that say the same


@dataclass(frozen=True)
class Candidate:
    """A number that may play a role."""

    role: str
    topic: str
    field: str
    reason: str
    select: str | None = None

    def __str__(self) -> str:
        return f"{self.topic}:{self.field}"


def typed(topic: str, type_name: str) -> list[Candidate]:
    """What a topic of a known type can serve as."""
    found = _TYPED.get(short_name(type_name))
    return [Candidate(found[0], topic, found[1], f"a {type_name}")] if found else []


def untyped(topic: str, names: Sequence[str], logged: Floats, values: Floats) -> list[Candidate]:
    """What the columns (n, k) of a topic can serve as, by how they move with log time (n,) [s]."""
    moving = [k for k in range(len(names)) if np.isfinite(values[:, k]).all() and np.ptp(values[:, k]) > 0]
    clocks = [k for k in moving if _runs_with(values[:, k], logged)]
    time = values[:, clocks[0]] if clocks else logged
    found = [Candidate("time", topic, names[k], "runs with the clock of the recorder") for k in clocks[:1]]
    rest = [k for k in moving if k not in clocks and ".stamp." not in f".{names[k]}"]
    pair = _position_and_velocity(time, values, rest)
    if pair is None:
        return found
    positions, speed = pair
    why = f"{names[speed]} is its derivative"
    found += [Candidate("position", topic, names[k], why) for k in positions]
    found.append(Candidate("velocity", topic, names[speed], f"it is the derivative of {names[positions[0]]}"))
    taken = {*positions, speed, *(k for k in rest if _follows(values[:, k], values[:, positions[0]]))}
    found += [Candidate("force", topic, names[k], "it moves, and is no motion") for k in rest if k not in taken]
    return found


def _runs_with(values: Floats, logged: Floats) -> bool:
    """Whether a column is the time in seconds: it always grows, as fast as the log time."""
    steps = np.diff(values)
    span = logged[-1] - logged[0]
    return bool(len(steps) > 10 and (steps > 0).all() and abs((values[-1] - values[0]) / span - 1.0) < 0.02)


def _position_and_velocity(time: Floats, values: Floats, columns: Sequence[int]) -> tuple[list[int], int] | None:
    """The positions that fit best, and the velocity that is their derivative."""
    fits = []
    for speed in columns:
        smooth = _mean(values[:, speed])
        scale = float(np.sqrt(np.mean(smooth**2)))
        for place in columns:
            if place != speed and scale > 0:
                slope = _slope(time, values[:, place])
                residual = min(float(np.sqrt(np.mean((slope - s * smooth) ** 2))) for s in (1.0, -1.0))
                fits.append((residual / scale, place, speed))
    fits.sort()
    if not fits or fits[0][0] > _ALIKE:
        return None
    best, place, speed = fits[0]
    rivals = [k for fit, k, v in fits if v == speed and fit < _CLEARLY * best]
    return [k for k in rivals if k == place or not _same(values[:, k], values[:, place])], speed


def _slope(time: Floats, values: Floats) -> Floats:
    n = 2 * _REACH
    return np.asarray((values[n:] - values[:-n]) / np.maximum(time[n:] - time[:-n], 1e-9))


def _mean(values: Floats) -> Floats:
    n = 2 * _REACH
    sums = np.cumsum(np.concatenate([[0.0], values]))
    return np.asarray((sums[n + 1 :] - sums[: -n - 1]) / (n + 1))


def _same(one: Floats, other: Floats) -> bool:
    return bool(abs(np.corrcoef(one, other)[0, 1]) > _SAME)


def _follows(values: Floats, position: Floats) -> bool:
    """Whether a column is a position, too, such as the setpoint: the same range, or the same numbers shifted."""
    span = np.ptp(position)
    alike = abs(values.min() - position.min()) < 0.25 * span and abs(values.max() - position.max()) < 0.25 * span
    return bool(alike or abs(np.ptp(values) / span - 1.0) < 0.25 or _same(values, position))


@dataclass(frozen=True)
class Signs:
    """Which way channels count."""

    force: int
    position: int
    velocity: int


def signs(time: Mapping[str, Floats], values: Mapping[str, Floats]) -> Signs:
    """Signs by which force is positive in contact, the position falls as force grows, and the velocity is its rate.

    `time` and `values` are by role. The force rests in the first twentieth of the record.
    """
    force, position = values["force"], values["position"]
    rest = float(np.median(force[: max(len(force) // 20, 1)]))
    force_sign = 1 if force.max() - rest >= rest - force.min() else -1
    there = np.interp(time["position"], time["force"], force_sign * force)
    with np.errstate(invalid="ignore", divide="ignore"):
        together = np.corrcoef(there, position)[0, 1]
    position_sign = -1 if together > 0 else 1
    velocity_sign = position_sign
    if "velocity" in values and len(position) > 4 * _REACH:
        speed = np.interp(time["position"], time["velocity"], values["velocity"])
        agree = np.sum(_slope(time["position"], position) * speed[_REACH:-_REACH])
        velocity_sign = position_sign if agree >= 0 else -position_sign
    return Signs(force_sign, position_sign, velocity_sign)


def at_rest(time: Floats, force: Floats, duration: float) -> bool:
    """Whether the force does not move in the first seconds, so that they give a tare."""
    window = force[time - time[0] <= duration]
    if len(window) < 10:
        return False
    noise = float(np.sqrt(np.mean(np.diff(window, 2) ** 2) / 6.0))
    spread = float(window.std(ddof=1))
    return spread <= 3.0 * noise or spread <= 1e-3
