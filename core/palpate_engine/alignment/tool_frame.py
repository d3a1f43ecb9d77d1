"""The tool's frame: which way gravity and the skin's normal point in the axes of a sensor that turns with the tool."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from palpate.alignment_settings import AlignmentSettings
from palpate.rotation_vectors import rotation_rows
from palpate.vectors import Floats, dot_columns

from palpate_engine.alignment.ports import PLACE, TURNS, Port, Ports

GRAVITY = 9.80665  # [m/s^2], standard
_OUT = (0.0, 0.0, -1.0)  # of the skin, in the frame of a tool that looks at it
_UP = (0.0, 0.0, 1.0)
_MIN_AXIAL_COSINE = (
    0.5  # a choice: a force that is read farther off the tool's axis than 60 degrees is not the one along it
)
_MAX_COSINE_TO_Y = 0.9  # of a normal of which the cross product with y is well conditioned: a choice
_AXES = 3  # of a force
_HALF_TURN = (math.pi, 0.0, 0.0)

Vector = tuple[Floats, Floats, Floats]  # of columns (n,)
Rotations = tuple[Vector, Vector, Vector]  # by rows


def mounting_of(settings: AlignmentSettings, axis: int) -> tuple[float, ...] | None:
    """Return the rotation vector of the sensor on the tool: as stated, or by the sign of a force that is its z; else
    None."""
    if settings.mounting is not None:
        return settings.mounting
    if axis != 2:
        return None
    return _HALF_TURN if settings.force.sign == 1 else (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Load:
    """Forces (n,) on the tip without weight and bias, and where the weight points in the sensor's axes."""

    along: Floats  # [N] along the skin's normal, or along the axis that is read
    across: tuple[Floats, Floats]  # [N]
    reading: Vector  # [N] on the tip, in the sensor's axes, weight and bias included
    weight: Vector  # [N] in the sensor's axes
    weight_along: Floats  # [N] of it, in the direction of `along`


class ToolFrame:
    """Turns readings of a sensor at a tool's orientation into the force along the normal; without a state.

    A force F on the tip is read as p F in the sensor's axes, p = 1 or -1 by the sensor's convention, which sign and
    mounting say together: a force that pushes the tip out counts as positive. With R the tool's orientation in the
    frame of the poses and M the mounting of the sensor on the tool, a direction d of that frame is M^T R^T d in the
    sensor's axes: the force along n is (M^T R^T n) (p f - p b - m g M^T R^T e), e the direction of gravity, b the bias.
    """

    def __init__(self, settings: AlignmentSettings, force: Port) -> None:
        """Take the settings and the port of the force, whose components are the axes of the sensor."""
        axes = force.components
        self._axis = axes.index(force.column)
        mounting = mounting_of(settings, self._axis)
        assert mounting is not None  # the wiring was checked
        self._columns = tuple(zip(*rotation_rows(mounting), strict=True))  # of M: its axes in the tool's frame
        self._polarity = settings.force.sign * (1 if self.axial(mounting, self._axis) > 0 else -1)
        self._out = settings.force.sign * self._polarity  # of the axis that is read
        self._weight = (settings.tip_mass or 0.0) * GRAVITY if settings.weight == "turning" else 0.0  # [N]
        self._down = unit_vector(settings.gravity or (0.0, 0.0, -1.0))
        self._normal = None if settings.normal is None else unit_vector(settings.normal)
        self._bias = settings.bias or (0.0, 0.0, 0.0)

    @staticmethod
    def axial(mounting: tuple[float, ...], axis: int) -> float:
        """Return the cosine between one of the sensor's axes and the direction out of the skin, seen from the tool."""
        return sum(out * row[axis] for out, row in zip(_OUT, rotation_rows(mounting), strict=True))

    @staticmethod
    def is_axial(mounting: tuple[float, ...], axis: int) -> bool:
        """Return True if one of the sensor's axes is along the tool."""
        return abs(ToolFrame.axial(mounting, axis)) >= _MIN_AXIAL_COSINE

    def load(self, readings: Vector, rows: Rotations, normal: Vector | None = None) -> Load:
        """Return the force on the tip from readings (n,) [N] of the three axes and the tool's orientation.

        `rows` are those of the tool's rotation matrices R. The force is that along the `normal` at each place, where
        that is given.
        """
        # On the tip acts what is read, p (f - b) with the sensor's sign p and zero b, less the weight m g M^T R^T e,
        # where M turns the sensor's axes into the tool's, and e points down.
        down = self._in_sensor(rows, self._down)
        weight = _scaled(down, self._weight)
        reading = tuple(self._polarity * (f - b) for f, b in zip(readings, self._bias, strict=True))
        x, y, z = (f - w for f, w in zip(reading, weight, strict=True))
        along = normal or self._normal
        # Without a normal the force is along the axis of the sensor that is read.
        if along is None:
            force_axes = (x, y, z)
            lateral_axes = [force_axes[i] for i in range(3) if i != self._axis]
            axes = np.full(len(x), float(self._out))
            return Load(
                along=self._out * force_axes[self._axis],
                across=(lateral_axes[0], lateral_axes[1]),
                reading=_vector(reading),
                weight=weight,
                weight_along=axes * weight[self._axis],
            )
        # Along the normal and two axes across it, in the sensor's frame.
        out = self._in_sensor(rows, along)
        first, second = (self._in_sensor(rows, side) for side in _sides(along))
        force = (x, y, z)
        return Load(
            along=dot_columns(out, force),
            across=(dot_columns(first, force), dot_columns(second, force)),
            reading=_vector(reading),
            weight=weight,
            weight_along=dot_columns(out, weight),
        )

    def tilt(self, out: Vector, normal: Vector | None = None) -> Floats:
        """Return the angle (n,) [rad] between the tool's axis and the normal, that which is given or stated."""
        return np.arccos(np.clip(self.along(out, normal), -1.0, 1.0))

    def along(self, place: Vector, normal: Vector | None = None) -> Floats:
        """Return the component (n,) of vectors (n,) of the frame of the poses along the normal, which is given or
        stated."""
        x, y, z = normal or self._normal or _UP
        return place[0] * x + place[1] * y + place[2] * z

    def _in_sensor(self, rows: Rotations, direction: tuple[float, ...] | Vector) -> Vector:
        """Return a direction of the frame of the poses in the sensor's axes: M^T R^T d."""
        d = direction
        tool = [d[0] * rows[0][i] + d[1] * rows[1][i] + d[2] * rows[2][i] for i in range(3)]
        a, b, c = (tool[0] * m[0] + tool[1] * m[1] + tool[2] * m[2] for m in self._columns)
        return a, b, c


def problems_of(settings: AlignmentSettings, ports: Ports) -> list[tuple[str, str]]:
    """Return key and problem of everything without which orientations cannot be used."""
    force = ports["force"]
    projecting = "normal" if settings.normal is not None else "surface"
    key = projecting if settings.is_projecting else "weight"
    problems = _orientation_problems(settings, ports["position"], key)
    # A direction in the sensor's axes needs all three of them, and where they are on the tool.
    if len(force.components) != _AXES:
        problems.append(
            (key, f"needs all three axes of the force, and {force.signal.channel} has {len(force.components)}")
        )
        return problems
    problems += _mounting_problems(settings, force)
    speed = dict.fromkeys("xyz", "m/s")
    if settings.is_projecting and "velocity" in ports.roles and not ports["velocity"].has(speed):
        problems.append((key, f"needs a velocity of three axes, and {ports['velocity'].signal.channel} is of no twist"))
    return problems


def _orientation_problems(settings: AlignmentSettings, position: Port, key: str) -> list[tuple[str, str]]:
    """Return the problem of a position without an orientation, or of turns without an order, by the key that
    needs it."""
    problems: list[tuple[str, str]] = []
    turn = next((names for names in TURNS if position.has(names)), None)
    if turn is None or not position.has(PLACE):
        text = f"needs the tool's orientation, and {position.signal.channel} is of no pose: of a stream with x, y, z"
        problems.append((key, f"{text} and qx, qy, qz, qw, or rx, ry, rz, or roll, pitch, yaw"))
    elif "yaw" in turn and settings.euler is None:
        problems.append(("euler", 'is needed for roll, pitch and yaw: the order of the turns, such as "ZYX"'))
    return problems


def _mounting_problems(settings: AlignmentSettings, force: Port) -> list[tuple[str, str]]:
    """Return the problem of a mounting that is not known, or by which the force is not along the tool."""
    problems: list[tuple[str, str]] = []
    axis = force.components.index(force.column)
    mounting = mounting_of(settings, axis)
    if mounting is None:
        text = f"is needed where the force is the sensor's {'xyz'[axis]}: the rotation vector of the sensor on the tool"
        problems.append(("mounting", text))
    elif not ToolFrame.is_axial(mounting, axis):
        angle = math.degrees(math.acos(min(abs(ToolFrame.axial(mounting, axis)), 1.0)))
        problems.append(
            ("mounting", f"puts {force.signal.channel} {angle:.0f} deg off the tool's axis: name the axis along it")
        )
    return problems


def unit_vector(vector: tuple[float, ...]) -> tuple[float, ...]:
    """Return a vector (3,) in its direction, of length 1."""
    length = math.hypot(*vector)
    return tuple(part / length for part in vector)


def axis_out(rows: Rotations) -> Vector:
    """Return the tool's axis (n,), out of the skin at which its z looks."""
    return -rows[0][2], -rows[1][2], -rows[2][2]


def quaternions(turns: Mapping[str, Floats], order: str | None) -> tuple[Floats, Floats, Floats, Floats]:
    """Return quaternions x, y, z, w (n,) of what a pose has (n,): these, a rotation vector, or roll, pitch and yaw
    [rad].

    Turns are in an `order` of axes, in capitals about the tool's own axes, in small letters about the frame's.
    """
    if "qw" in turns:
        return turns["qx"], turns["qy"], turns["qz"], turns["qw"]
    if "rx" in turns:
        x, y, z = turns["rx"], turns["ry"], turns["rz"]
        angle = np.sqrt(x * x + y * y + z * z)
        share = 0.5 * np.sinc(0.5 * angle / math.pi)  # sin(a/2)/a
        return x * share, y * share, z * share, np.cos(0.5 * angle)
    assert order is not None  # the wiring was checked
    angles = {"x": turns["roll"], "y": turns["pitch"], "z": turns["yaw"]}
    zero = np.zeros_like(turns["roll"])
    quaternion = zero, zero, zero, zero + 1.0  # no turn
    for axis in order.lower() if order.isupper() else reversed(order):
        half = 0.5 * angles[axis]
        sine = [np.sin(half) if axis == other_axis else zero for other_axis in "xyz"]
        quaternion = _product(quaternion, (sine[0], sine[1], sine[2], np.cos(half)))
    return quaternion


def _product(second: tuple[Floats, ...], first: tuple[Floats, ...]) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the product of two quaternions x, y, z, w: the turn by the first, then by the second."""
    a, b, c, d = second
    x, y, z, w = first
    return (
        d * x + a * w + b * z - c * y,
        d * y - a * z + b * w + c * x,
        d * z + a * y - b * x + c * w,
        d * w - a * x - b * y - c * z,
    )


def rotations(orientation: tuple[Floats, Floats, Floats, Floats]) -> Rotations:
    """Return the rows of the rotations of quaternions x, y, z, w (n,) of any length, element by element."""
    x, y, z, w = orientation
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return (
        (1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)),
        (s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)),
        (s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)),
    )


def _sides(normal: tuple[float, ...] | Vector) -> tuple[Vector, Vector]:
    """Return two directions along the skin, at right angles to each other and to the normal."""
    x, y, z = (np.asarray(part, float) for part in normal)
    # The first is the cross product of the normal with y, or with x where the normal is nearly y.
    is_off_y = np.abs(y) < _MAX_COSINE_TO_Y
    length = np.where(is_off_y, np.sqrt(z * z + x * x), np.sqrt(z * z + y * y))
    a, b, c = (
        np.where(is_off_y, z, 0.0) / length,
        np.where(is_off_y, 0.0, -z) / length,
        np.where(is_off_y, -x, y) / length,
    )
    return (a, b, c), (y * c - z * b, z * a - x * c, x * b - y * a)


def _scaled(vector: Vector, factor: float) -> Vector:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def _vector(parts: tuple[Floats, ...]) -> Vector:
    x, y, z = parts
    return x, y, z
