"""Registration: the pose of a mesh from touches, on top of what was known of it, and the directions they leave open."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from palpate import ConfigurationError, Floats, SurfacePoints
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector
from palpate_kit.numerics.least_squares import least_squares
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_surfaces.mesh import Mesh, points_of
from palpate_surfaces.pose import UncertainPose
from palpate_surfaces.touches import Touches

FEWEST = 6  # touches
FARTHEST = 3.0  # standard deviations
_UNLIKELY = 0.01  # probability of residuals so large, below which the covariance grows with them
_OPEN = 0.9  # of the prior's standard deviation, above which touches have determined next to nothing
_LEAST_LEFT = 1e-6  # of its variance, in the residual of a touch that determines a direction alone
_TURN = 0.1  # [rad] of a turn, as large as a shift of that share of the body's size


@dataclass(frozen=True)
class RegisteredPose:
    """A pose after touches, and how they agree with it."""

    pose: UncertainPose
    distance: Floats  # (n,) [m] of the touches above the surface
    deviation: Floats  # (n,) the same over its standard deviation
    probability: float  # of distances as large together, where the touches' uncertainties are right
    scale: float  # by which the covariance was multiplied, 1 where they agree
    open: tuple[str, ...]  # directions in which the pose is what it was before
    beyond: tuple[int, ...]  # touches that are beyond the mesh's rim

    @property
    def residual(self) -> float:
        """Root mean square of the distances [m]."""
        return float(np.sqrt(np.mean(self.distance**2)))


def distances(mesh: Mesh, touches: Touches) -> tuple[Floats, Floats]:
    """Distances (n,) [m] of touches from a mesh as it is known, and their standard deviations (n,)."""
    points = _points_at(mesh, mesh.pose, touches.centre)
    return points.height - touches.radius, np.hypot(points.position_std, touches.std)


def register(mesh: Mesh, touches: Touches) -> RegisteredPose:
    """Return the pose of a mesh by least squares over touches' distances from it and over the pose as it was known.

    Minimises sum (h_i - r_i)^2/s_i^2 + q^T C^-1 q over displacements and turns q, h the height of a sphere's centre and
    r its radius. What the touches leave open stays where it was, with the uncertainty that it had. Raises
    ConfigurationError where no pose is found.
    """
    search = _PoseSearch.of(mesh, touches)
    unknowns = search.minimum()
    residual, slopes = search.scaled(unknowns)
    inner = scaled_inverse(slopes.T @ slopes + np.eye(6))
    chi_square = float(residual @ residual + unknowns @ unknowns)
    probability = _chi_square_tail(chi_square, len(touches))
    scale = chi_square / len(touches) if probability < _UNLIKELY else 1.0
    by = search.root @ unknowns
    turns = np.eye(6)  # of the body as it is now, in place of growth of the rotation vector
    turns[3:, 3:] = _left_jacobian(by[3:])
    spread = turns @ search.root
    pose = replace(moved(mesh.pose, by), covariance=scale * spread @ inner @ spread.T)
    left = 1.0 - np.einsum("ni,ij,nj->n", slopes, inner, slopes)  # of a touch's own variance, in its residual
    beyond = mesh.body.on_the_rim(*mesh.body.nearest(pose.inwards(touches.centre)))
    return RegisteredPose(
        pose=pose,
        distance=residual * search.std,
        deviation=residual / np.sqrt(np.maximum(left, _LEAST_LEFT)),
        probability=probability,
        scale=scale,
        open=_open_directions(mesh, inner, search.root),
        beyond=tuple(np.flatnonzero(beyond).tolist()),
    )


@dataclass(frozen=True)
class _PoseSearch:
    """Least squares over displacement and turn, in standard deviations of what was known before."""

    mesh: Mesh
    touches: Touches
    root: Floats  # (6, 6) Cholesky's factor of the pose's covariance
    std: Floats  # (n,) [m] of a touch, with the body's shape

    @classmethod
    def of(cls, mesh: Mesh, touches: Touches) -> _PoseSearch:
        root = np.asarray(np.linalg.cholesky(mesh.pose.covariance), np.float64)
        return cls(mesh, touches, root, np.hypot(touches.std, mesh.shape_uncertainty))

    def scaled(self, unknowns: Floats) -> tuple[Floats, Floats]:
        """Distances (n,) in standard deviations, and their slopes (n, 6)."""
        pose = moved(self.mesh.pose, self.root @ unknowns)
        points = _points_at(self.mesh, pose, self.touches.centre)
        jacobian = pose.height_jacobian(points.position, points.normal)
        # The turn of a rotation vector w that grows by dw is J(w) dw, J the left Jacobian of rotations.
        jacobian[:, 3:] = jacobian[:, 3:] @ _left_jacobian((self.root @ unknowns)[3:])
        return (points.height - self.touches.radius) / self.std, -jacobian @ self.root / self.std[:, None]

    def minimum(self) -> Floats:
        """(6,) raises ConfigurationError if it fails."""

        def normal(unknowns: Floats) -> Floats:
            residual, slopes = self.scaled(unknowns)
            rows = np.vstack([np.column_stack([residual, slopes]), np.column_stack([unknowns, np.eye(6)])])
            return np.asarray(rows.T @ rows)

        high = np.full(6, np.inf)
        found = least_squares(normal, np.zeros(6), -high, high, most=100, gain=1e-8)
        if not found.converged:
            raise ConfigurationError(f"{self.mesh.file}: no pose fits the touches, from where it is stated to stand")
        return found.x


def moved(pose: UncertainPose, by: Floats) -> UncertainPose:
    """Return a pose after a displacement and a turn (6,) of the body about its pivot, which goes along."""
    turn = rotation_matrix(by[3:].tolist())
    pivot = pose.pivot + by[:3]
    translation = pivot + turn @ (pose.translation - pose.pivot)
    return replace(pose, rotation=rotation_vector(turn @ pose.matrix), translation=translation, pivot=pivot)


def _points_at(mesh: Mesh, pose: UncertainPose, places: Floats) -> SurfacePoints:
    """Points of the mesh at another pose; beyond its rim, too, where the nearest point of the rim counts."""
    feet, faces = mesh.body.nearest(pose.inwards(places))
    return points_of(pose, mesh, places, feet, faces, {})


def _left_jacobian(vector: Floats) -> Floats:
    """J (3, 3) of a rotation vector (3,) [rad]. Source: Chirikjian 2011, section 10.6."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-6:
        return np.eye(3) + cross / 2
    one, two = (1 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + one * cross + two * cross @ cross)


def _chi_square_tail(value: float, degrees: int) -> float:
    from scipy.special import gammaincc

    return float(gammaincc(degrees / 2, value / 2))


def _open_directions(mesh: Mesh, inner: Floats, root: Floats) -> tuple[str, ...]:
    """What touches say next to nothing about, in words: the directions in which the covariance is that from before."""
    shares, directions = np.linalg.eigh(inner)
    by = (root @ directions * np.sqrt(shares))[:, shares > _OPEN**2]
    # Of directions that are all open any mixture is one: shifts are distinguished from turns.
    _, _, apart = np.linalg.svd(by[3:], full_matrices=True) if by.size else (None, None, np.zeros((0, 0)))
    return tuple(_words(mesh.pose, way, mesh.body.size) for way in (by @ apart.T).T)


def _words(pose: UncertainPose, by: Floats, size: float) -> str:
    """Return a displacement and turn (6,) of one standard deviation: a turn about an axis, or a shift."""
    shift, turn = by[:3], by[3:]
    angle, way = float(np.linalg.norm(turn)), float(np.linalg.norm(shift))
    if angle * size / 2 < _TURN * way:
        return f"a shift along ({_vector(shift / way)}), held to ± {1e3 * way:.1f} mm"
    # The axis of a screw: the points that it moves along itself alone.
    point = pose.pivot + np.cross(turn, shift) / angle**2
    return (
        f"a turn about the axis ({_vector(turn / angle)}) through ({', '.join(f'{1e3 * v:.1f}' for v in point)}) mm, "
        f"held to ± {math.degrees(angle):.1f} deg"
    )


def _vector(vector: Floats) -> str:
    return ", ".join(f"{value + 0.0:.2f}" for value in np.round(vector, 2))
