"""The mounting of the sensor on the tool, by the weight in orientations of the tool that the arm knows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats, LogError
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_calibration.calibrated_value import MeasuredValue, RepeatValue

# Choices.
_MIN_SPREAD = 0.05  # of directions; with less across a line, also of the largest, a turn about it is not determined
_SIGNIFICANT = 5.0  # standard uncertainties between two conventions of a sensor
_MAX_MISFIT = 5.0  # times the forces that noise and directions explain
_STATED_CONVENTION_NOISE = 1e6  # [N], with which the convention is always the stated one
_TURN_STEP = 1e-4  # [rad] for derivatives by a direction
_MIN_ANGLE = 1e-9  # [rad] of a turn that has an axis
_UNKNOWNS = 7  # of a fit: weight, three of the mounting, three of the bias
_ON_A_LINE = "the directions of gravity lie on a line: turn the tool by some 30 degrees or more, about two axes"


@dataclass(frozen=True)
class MountingFit:
    """The orientation of a sensor on the tool, by one repeat."""

    rotation: Floats  # (3, 3) of the sensor on the tool
    covariance: Floats  # (3, 3) of a small turn of it [rad^2], in the tool's axes
    convention: int  # q: 1 or -1
    tells_reaction: bool  # True: the readings show whether they are the force on the tip or its reaction


def mounting_fit(
    forces: Floats, tools: Floats, down: Floats, std: float, sign: int, angle: float = math.inf
) -> MountingFit:
    """Return the mounting M from mean forces (n, 3) [N] in n >= 3 orientations (n, 3, 3) of the tool.

    f = q m g M^T d + f0 with d = R^T e, the direction `down` of gravity in the tool's frame, and q = 1 or -1 by the
    sensor's convention. q M^T is orthogonal: scale, matrix and bias that leave the least squares have a closed form by
    singular values (Umeyama 1991), once for each q. A turn about one direction of gravity changes nothing, and with an
    unknown bias only differences of directions count: three ends of d that are not on a line determine M, and four that
    are not in a plane exclude its mirror image, and so give q. Where they are in one, `sign`, that of the force that
    pushes the tip out, stands for q. `std` [N] is that of a mean force. Raises LogError where the readings say less, or
    do not follow the orientations as well as those that are off by `angle` [rad].
    """
    # Differences of forces and of directions, which have no bias.
    downs = np.einsum("nij,i->nj", tools, down)
    f, d = forces - forces.mean(axis=0), downs - downs.mean(axis=0)
    spread = np.linalg.svd(d, compute_uv=False)
    if len(forces) < 3 or spread[0] < _MIN_SPREAD or spread[1] < _MIN_SPREAD * spread[0]:
        raise LogError(f"calibration: {_ON_A_LINE}")

    # The convention by the smaller sum of squares, where it is significantly smaller.
    fits = _convention_fits(f, d)
    is_significant = abs(fits[1].squares - fits[-1].squares) > (_SIGNIFICANT * std) ** 2
    q = sign
    if is_significant:
        q = 1 if fits[1].squares < fits[-1].squares else -1
    weight = fits[q].weight

    # It must leave no more than the noise of the forces, and the weight across the error of the directions.
    rms = math.sqrt(fits[q].squares / max(3 * len(forces) - _UNKNOWNS, 1))
    explained = math.hypot(std, abs(weight) * angle)
    if weight <= 0 or rms > _MAX_MISFIT * explained:
        raise LogError(
            f"calibration: the readings do not follow the arm's poses: a weight of {weight:.3g} N leaves {rms:.2g} N, "
            f"and noise and directions explain {explained:.2g} N: is the sensor on this arm, and does it hang free?"
        )
    # A turn t changes the forces by weight t x d: its information is weight^2 sum(d^2 - d d^T).
    information = weight**2 * ((d**2).sum() * np.eye(3) - d.T @ d)
    return MountingFit(
        rotation=q * fits[q].matrix.T,
        covariance=scaled_inverse(information) * std**2,
        convention=q,
        tells_reaction=is_significant,
    )


@dataclass(frozen=True)
class _ConventionFit:
    """The best weight and orthogonal matrix by one convention of the sensor: f = weight matrix d."""

    squares: float  # [N^2] that remain
    matrix: Floats  # (3, 3)
    weight: float  # [N]


def _convention_fits(f: Floats, d: Floats) -> dict[int, _ConventionFit]:
    """Return for each q, 1 and -1, the fit of forces f (n, 3) [N] to directions d (n, 3), both about their means.

    With f^T d = U S V^T the matrix is U D V^T, D = diag(1, 1, +-1) such that its determinant is q, and the weight is
    tr(S D)/sum d^2 (Umeyama 1991).
    """
    U, singular_values, Vt = np.linalg.svd(f.T @ d)
    handedness = float(np.sign(np.linalg.det(U @ Vt)))
    fits = {}
    for q in (1, -1):
        signs = np.array([1.0, 1.0, handedness * q])
        weight = float((singular_values * signs).sum() / (d**2).sum())
        matrix = U @ np.diag(signs) @ Vt
        squares = float(((f - weight * d @ matrix.T) ** 2).sum())
        fits[q] = _ConventionFit(squares, matrix, weight)
    return fits


@dataclass(frozen=True)
class Mounting:
    """The mounting by all repeats."""

    values: dict[str, MeasuredValue]  # its rotation vector
    down: Floats  # (repeats, n, 3) directions in which the weight is read, in the sensor's axes
    note: str | None


def find_mounting(
    repeats: Sequence[tuple[Floats, Floats, float]], down: Floats, angle: float, sign: int, near: Sequence[float]
) -> Mounting:
    """Return the mounting from repeats of mean forces (n, 3) [N], orientations (n, 3, 3) of the tool and noise [N].

    `down` is the direction of gravity in the base's frame, `sign` that of a force that pushes the tip out.
    Type B is what a base that is not level by `angle` [rad] would do. Of a half turn's two vectors the one `near`
    another is taken.
    """
    mountings: list[_RepeatMounting] = []
    for forces, tools, noise in repeats:
        fit = mounting_fit(forces, tools, down, noise, sign, angle)
        # The vectors of later repeats are those near the first repeat's.
        nominal = mountings[0].vector if mountings else np.array(near)
        vector = _vector(fit.rotation, nominal)
        std = _vector_std(fit, vector, nominal)
        level_term = _level_term(forces, tools, down, angle, fit.convention, vector)
        weight_direction = fit.convention * np.einsum("nij,i->nj", tools @ fit.rotation, down)
        mountings.append(_RepeatMounting(vector, std, level_term, weight_direction, fit.tells_reaction))

    # The base is the same in every repeat: its term does not average out.
    type_b = np.sqrt(np.mean(np.square([mounting.level_term for mounting in mountings]), axis=0))
    freedom = 3.0 * len(repeats[0][0]) - _UNKNOWNS
    values = {}
    for i, axis in enumerate("xyz"):
        components = [RepeatValue(float(item.vector[i]), float(item.std[i]), freedom) for item in mountings]
        values[f"mounting_{axis}"] = MeasuredValue.of(components, "rad", float(type_b[i]))
    note = None
    if not all(mounting.tells_reaction for mounting in mountings):
        note = "mounting: these orientations do not distinguish a force on the tip from its reaction"
    return Mounting(values, np.array([mounting.weight_direction for mounting in mountings]), note)


@dataclass(frozen=True)
class _RepeatMounting:
    """The mounting by one repeat."""

    vector: Floats  # (3,) [rad] rotation vector
    std: Floats  # (3,) [rad]
    level_term: Floats  # (3,) [rad] by a base that is not level
    weight_direction: Floats  # (n, 3) in which the weight is read, in the sensor's axes
    tells_reaction: bool  # see `MountingFit`


def _vector_std(fit: MountingFit, vector: Floats, near: Floats) -> Floats:
    """Return the standard deviation (3,) [rad] of a fit's rotation vector, the one that is `near` another.

    The covariance of a small turn becomes that of the vector, by derivatives along three axes.
    """
    turns = [rotation_matrix((_TURN_STEP * axis).tolist()) for axis in np.eye(3)]
    turned_vectors = np.array([_vector(turn @ fit.rotation, near) for turn in turns])
    slopes = (turned_vectors - vector).T / _TURN_STEP
    return np.sqrt(np.diag(slopes @ fit.covariance @ slopes.T))


def _level_term(forces: Floats, tools: Floats, down: Floats, angle: float, convention: int, near: Floats) -> Floats:
    """Return the standard uncertainty (3,) [rad] by that of the direction of gravity, turned about two axes."""
    helper = np.cross(down, np.eye(3)[int(np.argmin(np.abs(down)))])
    first = helper / np.linalg.norm(helper)
    variance = np.zeros(3)
    for axis in (first, np.cross(down, first)):
        turned_down = rotation_matrix((_TURN_STEP * axis).tolist()) @ down
        fit = mounting_fit(forces, tools, turned_down, _STATED_CONVENTION_NOISE, convention)
        variance += ((_vector(fit.rotation, near) - near) / _TURN_STEP * angle) ** 2
    return np.sqrt(variance)


def _vector(rotation: Floats, near: Floats) -> Floats:
    """Return the rotation vector (3,) [rad] of a rotation, of the two the one that is nearer to another."""
    vector = rotation_vector(rotation)
    length = float(np.linalg.norm(vector))
    if length < _MIN_ANGLE:
        return vector
    opposite = vector * (1.0 - 2.0 * math.pi / length)
    return min((vector, opposite), key=lambda candidate: float(np.linalg.norm(candidate - near)))
