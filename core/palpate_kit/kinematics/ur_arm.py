"""Kinematics of Universal Robots' e-Series, and rotation vectors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from palpate import Floats, rotation_rows

ALPHA = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)  # [rad]
_TWIST = tuple((round(math.cos(alpha), 15), round(math.sin(alpha), 15)) for alpha in ALPHA)
JOINTS = (
    *("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"),
    *("wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
)  # from the base to the flange, by the names that the ROS driver gives them


@dataclass(frozen=True)
class Model:
    """Standard Denavit-Hartenberg parameters, nominal, and joint speeds [rad/s] at most.

    Universal Robots, "DH parameters for calculations of kinematics and dynamics"; every arm has small deltas of its own
    in its calibration file.
    """

    name: str
    a: tuple[float, ...]  # [m]
    d: tuple[float, ...]  # [m]
    speed: tuple[float, ...] = (math.pi,) * 6


def _model(name: str, upper: float, fore: float, d: tuple[float, ...], degrees: tuple[int, ...]) -> Model:
    shoulder, wrist_1, wrist_2, wrist_3 = d
    speed = tuple(math.radians(number) for number in degrees)
    return Model(name, (0.0, -upper, -fore, 0.0, 0.0, 0.0), (shoulder, 0.0, 0.0, wrist_1, wrist_2, wrist_3), speed)


_SLOW, _LARGE = (180,) * 6, (0.1807, 0.17415, 0.11985, 0.11655)
UR3E = _model("ur3e", 0.24355, 0.2132, (0.15185, 0.13105, 0.08535, 0.0921), (180, 180, 180, 360, 360, 360))
UR5E = _model("ur5e", 0.425, 0.3922, (0.1625, 0.1333, 0.0997, 0.0996), _SLOW)
UR10E = _model("ur10e", 0.6127, 0.57155, _LARGE, (120, 120, 180, 180, 180, 180))
UR16E = _model("ur16e", 0.4784, 0.36, _LARGE, (120, 120, 180, 180, 180, 180))
MODELS = {model.name: model for model in (UR3E, UR5E, UR10E, UR16E)}
A, D = UR3E.a, UR3E.d
SPEED_LIMITS = np.array(UR3E.speed)  # [rad/s]


def flange(q: Sequence[float], model: Model = UR3E) -> tuple[Floats, Floats]:
    """Pose of the flange (4, 4) in the base, and the axes: origin and direction of each joint (6, 2, 3).

    T = prod Rz(q_i) Tz(d_i) Tx(a_i) Rx(alpha_i).
    """
    return _flange(tuple(q), model)


@lru_cache(maxsize=16)  # Newton's method begins where it last ended
def _flange(q: tuple[float, ...], model: Model) -> tuple[Floats, Floats]:
    # Plain floats: six 4 x 4 products in numpy take three times as long.
    xu, xv, xw, yu, yv, yw, zu, zv, zw = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    x = y = z = 0.0
    axes = []
    for angle, a, d, (ca, sa) in zip(q, model.a, model.d, _TWIST, strict=True):
        axes.append(((x, y, z), (xw, yw, zw)))
        c, s = math.cos(angle), math.sin(angle)
        along, across = xu * c + xv * s, xv * c - xu * s
        x += along * a + xw * d
        xu, xv, xw = along, across * ca + xw * sa, xw * ca - across * sa
        along, across = yu * c + yv * s, yv * c - yu * s
        y += along * a + yw * d
        yu, yv, yw = along, across * ca + yw * sa, yw * ca - across * sa
        along, across = zu * c + zv * s, zv * c - zu * s
        z += along * a + zw * d
        zu, zv, zw = along, across * ca + zw * sa, zw * ca - across * sa
    pose = np.array(((xu, xv, xw, x), (yu, yv, yw, y), (zu, zv, zw, z), (0.0, 0.0, 0.0, 1.0)))
    return pose, np.array(axes)


def tip(q: Sequence[float], tcp: Floats, model: Model = UR3E) -> tuple[Floats, Floats]:
    """Pose (4, 4) of the tool centre point in the base, and its Jacobian (6, 6): (v, w) = J q'.

    `tcp` is the pose (4, 4) of the tool centre point on the flange.
    """
    pose, jacobian, _ = tip_and_links(q, tcp, model)
    return pose, jacobian


def tip_and_links(q: Sequence[float], tcp: Floats, model: Model = UR3E) -> tuple[Floats, Floats, Floats]:
    """Like `tip`, and the places (5, 3) of elbow, wrists 1 to 3 and flange in the base."""
    end, axes = flange(q, model)
    return *tip_of(end, axes, tcp), np.concatenate([axes[2:, 0], end[None, :3, 3]])


def tip_of(end: Floats, axes: Floats, tcp: Floats) -> tuple[Floats, Floats]:
    """Like `tip`, from what `flange` gives."""
    pose = end @ tcp
    arm, axis = pose[:3, 3] - axes[:, 0], axes[:, 1]
    jacobian = np.empty((6, 6))
    jacobian[0] = axis[:, 1] * arm[:, 2] - axis[:, 2] * arm[:, 1]
    jacobian[1] = axis[:, 2] * arm[:, 0] - axis[:, 0] * arm[:, 2]
    jacobian[2] = axis[:, 0] * arm[:, 1] - axis[:, 1] * arm[:, 0]
    jacobian[3:] = axis.T
    return pose, jacobian


def distinguishable(q: Sequence[float], tcp: Floats, position: Floats) -> tuple[Model, float]:
    """The model whose forward kinematics come nearest to a measured position (3,) [m] of the tip, and how near [m]."""
    apart = {name: float(np.linalg.norm(tip(q, tcp, m)[0][:3, 3] - position)) for name, m in MODELS.items()}
    nearest = min(apart, key=lambda name: apart[name])
    return MODELS[nearest], apart[nearest]


def joints_at(
    pose: Floats, tcp: Floats, near: Floats, steps: int = 30, tolerance: float = 1e-10, model: Model = UR3E
) -> Floats | None:
    """Joint angles (6,) that put the tool centre point at a pose (4, 4), by Newton's method; None where it fails."""
    q = np.array(near, float)
    for _ in range(steps):
        found, jacobian = tip(q.tolist(), tcp, model)
        error = np.concatenate([pose[:3, 3] - found[:3, 3], rotation_vector(pose[:3, :3] @ found[:3, :3].T)])
        if np.abs(error).max() < tolerance:
            turned = (q + np.pi) % (2 * np.pi) - np.pi if np.abs(q).max() > 2 * np.pi else q
            return np.asarray(turned, np.float64)
        try:
            step = np.linalg.solve(jacobian, error)
        except np.linalg.LinAlgError:
            return None
        largest = float(np.abs(step).max())
        if not math.isfinite(largest):
            return None
        q = q + step * min(1.0, 0.5 / max(largest, 1e-12))
    return None


def rotation_matrix(vector: Sequence[float]) -> Floats:
    """Rotation (3, 3) of a rotation vector [rad] (Rodrigues)."""
    return np.array(rotation_rows(vector))


def rotation_vector(matrix: Floats) -> Floats:
    """Rotation vector (3,) [rad] of a rotation (3, 3), up to and including half turns."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    sine, cosine = 0.5 * math.hypot(h - f, c - g, d - b), 0.5 * (a + e + i - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        scale = angle / (2.0 * sine)
        return np.array(((h - f) * scale, (c - g) * scale, (d - b) * scale))
    axis = np.array((h - f, c - g, d - b))
    if cosine > 0:
        return 0.5 * axis
    # Near a half turn the antisymmetric part vanishes: take the largest column of R + 1.
    columns = matrix + np.eye(3)
    column = columns[:, int(np.argmax(np.diag(columns)))]
    direction = column / np.linalg.norm(column)
    return np.asarray(direction * (angle if float(direction @ axis) >= 0 else -angle))


def shortest_turn(axis: Floats) -> Floats:
    """Rotation vector (3,) [rad] of the shortest turn from z to a direction (3,) of length 1."""
    x, y, z = axis.tolist()
    across = math.hypot(x, y)
    angle = math.atan2(across, z)
    scale = angle / across if across > 1e-12 else 1.0
    return np.array((-scale * y, scale * x, 0.0))


def matrix_of(pose: Sequence[float]) -> Floats:
    """Pose (4, 4) of UR's six numbers: position [m] and rotation vector [rad]."""
    rows = [(*row, place) for row, place in zip(rotation_rows(pose[3:]), pose[:3], strict=True)]
    return np.array([*rows, (0.0, 0.0, 0.0, 1.0)])


def pose_of(matrix: Floats) -> list[float]:
    """UR's six numbers of a pose (4, 4)."""
    return [*matrix[:3, 3].tolist(), *rotation_vector(matrix[:3, :3]).tolist()]


def quaternion(matrix: Floats) -> Floats:
    """Quaternion (x, y, z, w) of a rotation (3, 3), w not negative."""
    vector = rotation_vector(matrix)
    angle = float(np.linalg.norm(vector))
    half = 0.5 * math.sin(0.5 * angle) / (0.5 * angle) if angle > 1e-12 else 0.5
    return np.array([*(vector * half), math.cos(0.5 * angle)])
