"""How the sensor is mounted on the tool: by the weight, in orientations of the tool that the arm knows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats, LogError
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_calibration.calibrated_value import MeasuredValue, RepeatValue

_OPEN = 0.05  # of the largest spread of directions; with less across it, a turn about that axis is not seen
_SURE = 5.0  # standard uncertainties between two conventions of a sensor
_UNFIT = 5.0  # times what noise and directions explain
_ANY = 1e6  # [N] of noise, under which the convention is that which is said
_STEP = 1e-4  # [rad] for derivatives by a direction
_LINE = "the directions of gravity lie on a line: turn the tool by some 30 degrees or more, about two axes"


@dataclass(frozen=True)
class MountingFit:
    """Where a sensor's axes point on the tool."""

    rotation: Floats  # (3, 3) of the sensor on the tool
    std: Floats  # (3, 3) covariance of a small turn of it [rad^2], in the tool's axes
    convention: int  # q: 1 or -1
    tells_reaction: bool  # whether the readings say if they are the force on the tip or its reaction


def mounting_fit(
    forces: Floats, tools: Floats, down: Floats, std: float, sign: int, angle: float = math.inf
) -> MountingFit:
    """The mounting M from mean forces (n, 3) [N] in n >= 3 orientations (n, 3, 3) of the tool, gravity along `down`.

    f = q m g M^T d + f0 with d = R^T e, the direction of gravity in the tool's frame, and q = 1 or -1 by the sensor's
    convention. q M^T is orthogonal: scale, matrix and bias that leave the least squares have a closed form by singular
    values (Umeyama 1991), once for each q. A turn about one direction of gravity changes nothing, and with an unknown
    bias only differences of directions count: three ends of d that are not on a line determine M, and four that are not
    in a plane exclude its mirror image, and so give q. Where they are in one, `sign`, that of the force that pushes the
    tip out, stands for q. `std` [N] is that of a mean force. Raises LogError where the readings say less, or do not
    follow the orientations as well as those that are off by `angle` [rad].
    """
    downs = np.einsum("nij,i->nj", tools, down)
    f, d = forces - forces.mean(axis=0), downs - downs.mean(axis=0)
    spread = np.linalg.svd(d, compute_uv=False)
    if len(forces) < 3 or spread[0] < _OPEN or spread[1] < _OPEN * spread[0]:
        raise LogError(f"calibration: {_LINE}")
    own, values, other = np.linalg.svd(f.T @ d)
    mirrored = float(np.sign(np.linalg.det(own @ other)))
    fits: dict[int, tuple[float, Floats, float]] = {}
    for q in (1, -1):
        signs = np.array([1.0, 1.0, mirrored * q])
        weight = float((values * signs).sum() / (d**2).sum())
        matrix = own @ np.diag(signs) @ other
        fits[q] = float(((f - weight * d @ matrix.T) ** 2).sum()), matrix, weight
    apart = abs(fits[1][0] - fits[-1][0])
    sure = apart > (_SURE * std) ** 2
    q = (1 if fits[1][0] < fits[-1][0] else -1) if sure else sign
    left, matrix, weight = fits[q]
    rms = math.sqrt(left / max(3 * len(forces) - 7, 1))
    explained = math.hypot(std, abs(weight) * angle)
    if weight <= 0 or rms > _UNFIT * explained:
        raise LogError(
            f"calibration: the readings do not follow the arm's poses: a weight of {weight:.3g} N leaves {rms:.2g} N, "
            f"and noise and directions explain {explained:.2g} N: is the sensor on this arm, and does it hang free?"
        )
    information = weight**2 * ((d**2).sum() * np.eye(3) - d.T @ d)
    return MountingFit(q * matrix.T, scaled_inverse(information) * std**2, q, sure)


@dataclass(frozen=True)
class Mounting:
    """The mounting by all repeats."""

    values: dict[str, MeasuredValue]  # its rotation vector
    down: Floats  # (repeats, n, 3) directions in which the weight is read, in the sensor's axes
    note: str | None


def find_mounting(
    repeats: Sequence[tuple[Floats, Floats, float]], down: Floats, angle: float, sign: int, near: Sequence[float]
) -> Mounting:
    """Return the mounting from repeats of forces, orientations and noise [N].

    Type B is what a base that is not level by `angle` [rad] would do. Of a half turn's two vectors the one `near`
    another is taken.
    """
    sure, vectors = True, list[Floats]()
    stds, terms, downs = list[Floats](), list[Floats](), list[Floats]()
    for forces, tools, noise in repeats:
        fit = mounting_fit(forces, tools, down, noise, sign, angle)
        sure = sure and fit.tells_reaction
        downs.append(fit.convention * np.einsum("nij,i->nj", tools @ fit.rotation, down))
        close = vectors[0] if vectors else np.array(near)
        vectors.append(_vector(fit.rotation, close))
        turns = [_vector(rotation_matrix((_STEP * axis).tolist()) @ fit.rotation, close) for axis in np.eye(3)]
        slopes = (np.array(turns) - vectors[-1]).T / _STEP
        stds.append(np.sqrt(np.diag(slopes @ fit.std @ slopes.T)))
        terms.append(_by_level(forces, tools, down, angle, fit.convention, vectors[-1]))
    term = np.sqrt(np.mean(np.square(terms), axis=0))
    values = {
        f"mounting_{axis}": MeasuredValue.of(
            [
                RepeatValue(float(v[i]), float(s[i]), 3.0 * len(repeats[0][0]) - 7)
                for v, s in zip(vectors, stds, strict=True)
            ],
            "rad",
            float(term[i]),
        )
        for i, axis in enumerate("xyz")
    }
    note = None if sure else "mounting: these orientations do not distinguish a force on the tip from its reaction"
    return Mounting(values, np.array(downs), note)


def _by_level(forces: Floats, tools: Floats, down: Floats, angle: float, convention: int, near: Floats) -> Floats:
    """Standard uncertainty (3,) [rad] from that of the direction of gravity, turned about two axes."""
    helper = np.cross(down, np.eye(3)[int(np.argmin(np.abs(down)))])
    first = helper / np.linalg.norm(helper)
    total = np.zeros(3)
    for axis in (first, np.cross(down, first)):
        turned = rotation_matrix((_STEP * axis).tolist()) @ down
        moved = _vector(mounting_fit(forces, tools, turned, _ANY, convention).rotation, near)
        total += ((moved - near) / _STEP * angle) ** 2
    return np.sqrt(total)


def _vector(rotation: Floats, near: Floats) -> Floats:
    """Rotation vector (3,) [rad] of a rotation, of all that are the same the one nearest to another."""
    vector = rotation_vector(rotation)
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        return vector
    others = [vector, vector * (1.0 - 2.0 * math.pi / length)]
    return min(others, key=lambda one: float(np.linalg.norm(one - near)))
