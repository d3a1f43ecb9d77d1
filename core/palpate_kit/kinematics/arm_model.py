"""The kinematic model of an arm: its joints from the base to the flange, how far and how fast each can turn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
from palpate import Angle, AngularSpeed, Floats, Length, Settings
from pydantic import Field, model_validator

from palpate_kit.kinematics.rotations import rotation_vector

_MIN_JOINTS = 6  # that hold a tool at any place in any orientation
_FULL_TURN = 2.0 * math.pi
_MAX_STEP = 0.5  # [rad] of the fastest joint in one step of Newton's method (choice)
_MIN_STEP = 1e-12  # [rad] in a quotient, in place of 0
_NUMBERS = 12  # of a transform: a rotation, row by row, and a translation
_TWIST = 6  # numbers of a velocity and an angular velocity
_MAX_STEPS, _TOLERANCE = 30, 1e-10  # of Newton's method; [m] and [rad] (choice)
_ANGLE_DIGITS = 15  # of a cosine, to which a quarter turn is exact
Transform = tuple[float, ...]
"""A rotation (3, 3), row by row, and a translation (3,) [m]: twelve numbers."""


class Joint(Settings):
    """One turning joint: its name in the messages, and its Denavit-Hartenberg parameters."""

    name: str = Field(min_length=1, description='name in the messages, such as "elbow_joint"')
    a: Length = Field(default=0.0, description="length of the link along x")
    d: Length = Field(default=0.0, description="offset along z")
    alpha: Angle = Field(default=0.0, description="twist around x")
    offset: Angle = Field(default=0.0, description="angle at which the joint reads 0")


class DHJoint(Joint):
    """One turning joint by its Denavit-Hartenberg parameters, with its ends and its speed."""

    name: str = Field(min_length=1, description="of the joint")
    low: Angle = Field(default=-_FULL_TURN, description="least angle of the joint")
    high: Angle = Field(default=_FULL_TURN, description="greatest angle of the joint")
    speed: AngularSpeed = Field(default=math.pi, gt=0, description="highest speed of the joint")


class ArmModel(Settings):
    """Turning joints in a chain, T = base prod(Rz(q_i) link_i); no model equals another one.

    The places of an arm are those of its joints from the third on, and that of its flange.
    """

    name: str = Field(min_length=1, description="of the arm")
    base: Transform = Field(min_length=_NUMBERS, max_length=_NUMBERS, description="first joint in the base")
    links: tuple[Transform, ...] = Field(description="next joint, or the flange, in the frame that a joint turns")
    joints: tuple[str, ...] = Field(min_length=_MIN_JOINTS, description="names of the joints, from the base on")
    low: tuple[Angle, ...] = Field(description="least angle of each joint")
    high: tuple[Angle, ...] = Field(description="greatest angle of each joint")
    speed: tuple[AngularSpeed, ...] = Field(description="highest speed of each joint")
    places: tuple[str, ...] = Field(default=(), description="names of the places; left out: those of the joints")

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        """Raise ValueError unless each joint has its link, limits and speed."""
        count = len(self.joints)
        if any(len(numbers) != count for numbers in (self.links, self.low, self.high, self.speed)):
            raise ValueError("links, low, high and speed have one entry for each joint")
        if any(len(link) != _NUMBERS for link in self.links):
            raise ValueError("a link is a rotation, row by row, and a translation: twelve numbers")
        for name, low, high, speed in zip(self.joints, self.low, self.high, self.speed, strict=True):
            if not (low < high and 0.0 < speed < math.inf and math.isfinite(high - low)):
                raise ValueError(f"{name} has no range between two finite ends, or no speed")
        if self.places and len(self.places) != count - 1:
            raise ValueError("places are those of the joints from the third on, and of the flange")
        return self

    @classmethod
    def of_dh(
        cls,
        name: str,
        joints: Sequence[DHJoint],
        flange: float = 0.0,
        modified: bool = False,
        places: Sequence[str] = (),
    ) -> ArmModel:
        """Return the model of Denavit-Hartenberg parameters; the `flange` is so far [m] along the last joint's axis.

        Standard: T_i = Rz(q_i) Tz(d_i) Tx(a_i) Rx(alpha_i). Modified, after Craig: T_i = Rx(alpha_i) Tx(a_i) Rz(q_i)
        Tz(d_i). A link is all that is between the turns Rz of two joints, and the offset of an angle belongs to the
        link before it. `places` are names for messages, of the joints from the third on and of the flange.
        """
        transforms = _modified_transforms if modified else _standard_transforms
        base, *links = transforms(joints, flange)
        return cls(
            name=name,
            base=numbers_of(base),
            links=tuple(numbers_of(link) for link in links),
            joints=tuple(joint.name for joint in joints),
            low=tuple(joint.low for joint in joints),
            high=tuple(joint.high for joint in joints),
            speed=tuple(joint.speed for joint in joints),
            places=tuple(places),
        )

    @cached_property
    def place_names(self) -> tuple[str, ...]:
        """Names of the places."""
        return self.places or (*self.joints[2:], "flange")

    @cached_property
    def speed_limits(self) -> Floats:
        """Highest speeds (n,) [rad/s]."""
        return np.array(self.speed)

    def end_of(self, q: Sequence[float]) -> str | None:
        """Return a sentence on the first joint that is beyond its ends; None where none is."""
        for name, angle, low, high in zip(self.joints, q, self.low, self.high, strict=True):
            if not low <= angle <= high:
                ends = f"{math.degrees(low):.0f} to {math.degrees(high):.0f} deg"
                return f"{name} would be at {math.degrees(angle):.0f} deg, beyond its end ({ends})"
        return None

    def flange(self, q: Sequence[float]) -> tuple[Floats, Floats]:
        """Return the pose of the flange (4, 4) in the base, and origin and direction of each joint's axis (n, 2, 3)."""
        return _flange(tuple(q), self)

    def tip(self, q: Sequence[float], tcp: Floats) -> tuple[Floats, Floats]:
        """Return the pose (4, 4) of the tool centre point in the base, and its Jacobian (6, n): (v, w) = J q'.

        `tcp` is the pose (4, 4) of the tool centre point on the flange.
        """
        return tip_of(*self.flange(q), tcp)

    def tip_and_places(self, q: Sequence[float], tcp: Floats) -> tuple[Floats, Floats, Floats]:
        """Return pose and Jacobian as `tip` does, and the places (n - 1, 3) [m] in the base."""
        end, axes = self.flange(q)
        return *tip_of(end, axes, tcp), np.concatenate([axes[2:, 0], end[None, :3, 3]])

    def joints_at(
        self, pose: Floats, tcp: Floats, near: Floats, steps: int = _MAX_STEPS, tolerance: float = _TOLERANCE
    ) -> Floats | None:
        """Return the joint angles (n,) that put the tool centre point at a pose (4, 4); None where it cannot.

        By Newton's method from the angles `near` (n,), up to a `tolerance` [m], [rad]; an arm of more than six joints
        takes the smallest steps. None as well at a singularity, and where the `steps` do not suffice.
        """
        q = np.array(near, float)
        for _ in range(steps):
            current, jacobian = self.tip(q.tolist(), tcp)
            # The error of the pose as a twist: J dq = error.
            translation = pose[:3, 3] - current[:3, 3]
            rotation = rotation_vector(pose[:3, :3] @ current[:3, :3].T)
            error = np.concatenate([translation, rotation])
            if np.abs(error).max() < tolerance:
                # A joint that has gone round on the way is turned back to -pi .. pi.
                wrapped = (q + np.pi) % _FULL_TURN - np.pi if np.abs(q).max() > _FULL_TURN else q
                return np.asarray(wrapped, np.float64)
            try:
                step = solve(jacobian, error)
            except np.linalg.LinAlgError:
                return None
            largest = float(np.abs(step).max())
            if not math.isfinite(largest):
                return None
            q = q + step * min(1.0, _MAX_STEP / max(largest, _MIN_STEP))
        return None


def _standard_transforms(joints: Sequence[DHJoint], flange: float) -> list[Floats]:
    """Return base and links (4, 4) of standard parameters: base = Rz(o_1), L_i = Tz(d_i) Tx(a_i) Rx(alpha_i) Rz(o_i+1).

    o_i is the offset of an angle; behind the last joint is the flange, Tz(flange).
    """
    offsets = [_turn("z", joint.offset) for joint in joints]
    transforms = [offsets[0]]
    for joint, behind in zip(joints, [*offsets[1:], _shift(0.0, flange)], strict=True):
        screw = _shift(joint.a, 0.0) @ _turn("x", joint.alpha)
        transforms.append(_shift(0.0, joint.d) @ screw @ behind)
    return transforms


def _modified_transforms(joints: Sequence[DHJoint], flange: float) -> list[Floats]:
    """Return base and links (4, 4) of Craig's parameters: base = S_1, L_i = Tz(d_i) S_i+1, S = Tx(a) Rx(alpha) Rz(o).

    o is the offset of an angle; behind the last joint is the flange, Tz(flange).
    """
    fronts = [_shift(joint.a, 0.0) @ _turn("x", joint.alpha) @ _turn("z", joint.offset) for joint in joints]
    transforms = [fronts[0]]
    for joint, behind in zip(joints, [*fronts[1:], _shift(0.0, flange)], strict=True):
        transforms.append(_shift(0.0, joint.d) @ behind)
    return transforms


@lru_cache(maxsize=16)  # Newton's method begins where it last ended
def _flange(q: tuple[float, ...], model: ArmModel) -> tuple[Floats, Floats]:
    """Return the pose (4, 4) of the flange at joint angles q (n,) [rad], and the axes (n, 2, 3) of the joints.

    An axis is a point [m] and a direction. T = [[xu, xv, xw, x], [yu, yv, yw, y], [zu, zv, zw, z], [0, 0, 0, 1]]
    becomes T Rz(q_i) L_i joint by joint, with the link L_i = [[a, b, c, along], [d, e, f, across], [g, h, i, up], [0,
    0, 0, 1]]; (u, v, w) is a row of T Rz(q_i). In plain floats, as products of small matrices in numpy take three times
    as long.
    """
    xu, xv, xw, yu, yv, yw, zu, zv, zw, x, y, z = model.base
    axes = []
    for angle, (a, b, c, d, e, f, g, h, i, along, across, up) in zip(q, model.links, strict=True):
        axes.append(((x, y, z), (xw, yw, zw)))
        cosine, sine = math.cos(angle), math.sin(angle)
        # The first row of T.
        u, v, w = xu * cosine + xv * sine, xv * cosine - xu * sine, xw
        x += u * along + v * across + w * up
        xu, xv, xw = u * a + v * d + w * g, u * b + v * e + w * h, u * c + v * f + w * i
        # The second row.
        u, v, w = yu * cosine + yv * sine, yv * cosine - yu * sine, yw
        y += u * along + v * across + w * up
        yu, yv, yw = u * a + v * d + w * g, u * b + v * e + w * h, u * c + v * f + w * i
        # The third row.
        u, v, w = zu * cosine + zv * sine, zv * cosine - zu * sine, zw
        z += u * along + v * across + w * up
        zu, zv, zw = u * a + v * d + w * g, u * b + v * e + w * h, u * c + v * f + w * i
    pose = np.array(((xu, xv, xw, x), (yu, yv, yw, y), (zu, zv, zw, z), (0.0, 0.0, 0.0, 1.0)))
    return pose, np.array(axes)


def tip_of(end: Floats, axes: Floats, tcp: Floats) -> tuple[Floats, Floats]:
    """Return the pose (4, 4) of the tip, and its Jacobian (6, n), by the flange's pose `end` and the joints' `axes`.

    An axis is a point [m] and a direction, `tcp` (4, 4) is the tip on the flange. A joint with the axis e through a
    moves the tip p by v = e x (p - a), w = e.
    """
    pose = end @ tcp
    arm, axis = pose[:3, 3] - axes[:, 0], axes[:, 1]
    jacobian = np.empty((_TWIST, len(axes)))
    # The cross product.
    jacobian[0] = axis[:, 1] * arm[:, 2] - axis[:, 2] * arm[:, 1]
    jacobian[1] = axis[:, 2] * arm[:, 0] - axis[:, 0] * arm[:, 2]
    jacobian[2] = axis[:, 0] * arm[:, 1] - axis[:, 1] * arm[:, 0]
    jacobian[3:] = axis.T
    return pose, jacobian


def solve(jacobian: Floats, twist: Floats) -> Floats:
    """Return joint speeds (n,) for a twist (6,), the smallest where there are many; raises numpy's LinAlgError."""
    if jacobian.shape[1] == _TWIST:
        return np.asarray(np.linalg.solve(jacobian, twist), np.float64)
    return np.asarray(inverse_of(jacobian) @ twist, np.float64)


def inverse_of(jacobian: Floats) -> Floats:
    """Return the inverse (n, 6) of a Jacobian (6, n), that of the smallest speeds; raises numpy's LinAlgError."""
    if jacobian.shape[1] == _TWIST:
        return np.asarray(np.linalg.inv(jacobian), np.float64)
    return np.asarray(jacobian.T @ np.linalg.inv(jacobian @ jacobian.T), np.float64)


def _turn(axis: str, angle: float) -> Floats:
    """Return the rotation (4, 4) by an angle [rad] around x or z.

    A quarter turn is exact: a cosine of 6e-17 would tilt nothing, but round zeros into noise.
    """
    cosine, sine = round(math.cos(angle), _ANGLE_DIGITS), round(math.sin(angle), _ANGLE_DIGITS)
    turn = np.eye(4)
    first, second = (1, 2) if axis == "x" else (0, 1)
    turn[first, first] = turn[second, second] = cosine
    turn[first, second], turn[second, first] = -sine, sine
    return turn


def _shift(x: float, z: float) -> Floats:
    """Return the translation (4, 4) along x and z [m]."""
    shift = np.eye(4)
    shift[0, 3], shift[2, 3] = x, z
    return shift


def numbers_of(matrix: Floats) -> Transform:
    """Return a transform (4, 4) as its twelve numbers."""
    return (*(matrix[:3, :3] + 0.0).ravel().tolist(), *(matrix[:3, 3] + 0.0).tolist())
