"""Registration: the pose of a mesh by touches and its pose before, and the directions that touches leave open."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from palpate import ConfigurationError, Floats, SurfacePoints
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector
from palpate_kit.numerics.least_squares import least_squares
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_surfaces.mesh import Mesh, mesh_points
from palpate_surfaces.pose import UncertainPose
from palpate_surfaces.touches import Touches

# Choices (0265).
MIN_TOUCHES = 6
MAX_DEVIATION = 3.0  # standard deviations of a touch from the surface
_REJECTION_LEVEL = 0.01  # probability of residuals so large, below which the covariance grows with them (Birge 1932)
_OPEN_SHARE = 0.9  # of the prior's standard deviation: a direction that keeps more is open
_MIN_VARIANCE_SHARE = 1e-6  # of its variance, in the residual of a touch that determines a direction alone
_SHIFT_SHARE = 0.1  # of a shift: a turn that moves the body's ends by less is named a shift
_SMALL_ANGLE = 1e-6  # [rad] below which the series of the left Jacobian is exact to a double
_MAX_ITERATIONS = 100  # of least squares
_COST_GAIN = 1e-8  # relative, below which least squares have converged


@dataclass(frozen=True)
class RegisteredPose:
    """A pose after touches, and the touches' agreement with it."""

    pose: UncertainPose
    distance: Floats  # (n,) [m] of the touches above the surface
    deviation: Floats  # (n,) the same over its standard deviation
    probability: float  # of distances as large together, where the touches' uncertainties are right
    scale: float  # factor of the covariance for residuals that are too large; 1 where they agree
    open: tuple[str, ...]  # directions in which the touches leave the pose as it was before
    beyond: tuple[int, ...]  # rows of touches beyond the mesh's rim

    @property
    def residual(self) -> float:
        """Root mean square of the distances [m]."""
        return float(np.sqrt(np.mean(self.distance**2)))


def distances(mesh: Mesh, touches: Touches) -> tuple[Floats, Floats]:
    """Return the distances (n,) [m] of touches from a mesh at its prior pose, and their standard deviations (n,)."""
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
    residual, jacobian = search.scaled_distances(unknowns)
    covariance = scaled_inverse(jacobian.T @ jacobian + np.eye(6))  # in standard deviations of the prior

    # Residuals that are too large together widen the covariance.
    chi_square = float(residual @ residual + unknowns @ unknowns)
    probability = _chi_square_tail(chi_square, len(touches))
    scale = chi_square / len(touches) if probability < _REJECTION_LEVEL else 1.0

    # The covariance is of turns of the body at its new pose; the unknowns change the rotation vector.
    displacement = search.prior_factor @ unknowns
    body_turns = np.eye(6)
    body_turns[3:, 3:] = _left_jacobian(displacement[3:])
    factor = body_turns @ search.prior_factor
    pose = replace(moved(mesh.pose, displacement), covariance=scale * factor @ covariance @ factor.T)

    # Share of a touch's own variance that its residual still has after the fit.
    variance_share = 1.0 - np.einsum("ni,ij,nj->n", jacobian, covariance, jacobian)
    is_beyond_rim = mesh.body.on_the_rim(*mesh.body.nearest(pose.inwards(touches.centre)))
    return RegisteredPose(
        pose=pose,
        distance=residual * search.std,
        deviation=residual / np.sqrt(np.maximum(variance_share, _MIN_VARIANCE_SHARE)),
        probability=probability,
        scale=scale,
        open=_open_directions(mesh, covariance, search.prior_factor),
        beyond=tuple(np.flatnonzero(is_beyond_rim).tolist()),
    )


@dataclass(frozen=True)
class _PoseSearch:
    """Least squares over displacement and turn (6,), in standard deviations of the pose before the touches."""

    mesh: Mesh
    touches: Touches
    prior_factor: Floats  # (6, 6) Cholesky's factor of the pose's covariance
    std: Floats  # (n,) [m] of a touch, with the body's shape

    @classmethod
    def of(cls, mesh: Mesh, touches: Touches) -> _PoseSearch:
        """Return the search from the pose of a mesh."""
        prior_factor = np.asarray(np.linalg.cholesky(mesh.pose.covariance), np.float64)
        return cls(mesh, touches, prior_factor, np.hypot(touches.std, mesh.shape_uncertainty))

    def scaled_distances(self, unknowns: Floats) -> tuple[Floats, Floats]:
        """Return distances (n,) in standard deviations at unknowns (6,), and minus their derivatives (n, 6)."""
        displacement = self.prior_factor @ unknowns
        pose = moved(self.mesh.pose, displacement)
        points = _points_at(self.mesh, pose, self.touches.centre)
        jacobian = pose.height_jacobian(points.position, points.normal)
        # The turn of a rotation vector w that grows by dw is J(w) dw, J the left Jacobian of rotations.
        jacobian[:, 3:] = jacobian[:, 3:] @ _left_jacobian(displacement[3:])
        distance = (points.height - self.touches.radius) / self.std
        return distance, -jacobian @ self.prior_factor / self.std[:, None]

    def minimum(self) -> Floats:
        """Return the unknowns (6,) of the least sum; raises ConfigurationError without convergence."""

        def normal_equations(unknowns: Floats) -> Floats:
            """Return [r J]^T [r J] (7, 7) over touches and prior; the prior's residual is the unknowns."""
            distance, jacobian = self.scaled_distances(unknowns)
            touch_rows = np.column_stack([distance, jacobian])
            prior_rows = np.column_stack([unknowns, np.eye(6)])
            rows = np.vstack([touch_rows, prior_rows])
            return np.asarray(rows.T @ rows)

        unbounded = np.full(6, np.inf)
        solution = least_squares(
            normal_equations, np.zeros(6), -unbounded, unbounded, most=_MAX_ITERATIONS, gain=_COST_GAIN
        )
        if not solution.converged:
            raise ConfigurationError(f"{self.mesh.file}: no pose fits the touches, from where it is stated to stand")
        return solution.x


def moved(pose: UncertainPose, displacement: Floats) -> UncertainPose:
    """Return a pose after a displacement [m] and a turn [rad] (6,) of the body about its pivot, which moves too."""
    turn = rotation_matrix(displacement[3:].tolist())
    pivot = pose.pivot + displacement[:3]
    translation = pivot + turn @ (pose.translation - pose.pivot)
    return replace(pose, rotation=rotation_vector(turn @ pose.matrix), translation=translation, pivot=pivot)


def _points_at(mesh: Mesh, pose: UncertainPose, places: Floats) -> SurfacePoints:
    """Return the points of a mesh at another pose nearest to places (n, 3) [m]; beyond its rim those of the rim."""
    feet, faces = mesh.body.nearest(pose.inwards(places))
    return mesh_points(pose, mesh, places, feet, faces, {})


def _left_jacobian(vector: Floats) -> Floats:
    """Return the left Jacobian J (3, 3) of a rotation vector w (3,) [rad], t its angle.

    J = 1 + (1 - cos t)/t^2 [w] + (t - sin t)/t^3 [w]^2, [w] u = w x u. Source: Chirikjian 2011, section 10.6.
    """
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < _SMALL_ANGLE:
        return np.eye(3) + cross / 2
    first_order = (1 - math.cos(angle)) / angle**2
    second_order = (angle - math.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first_order * cross + second_order * cross @ cross)


def _chi_square_tail(chi_square: float, degrees: int) -> float:
    """Return the probability of a larger chi^2 with so many degrees of freedom."""
    from scipy.special import gammaincc

    return float(gammaincc(degrees / 2, chi_square / 2))


def _open_directions(mesh: Mesh, covariance: Floats, prior_factor: Floats) -> tuple[str, ...]:
    """Return the directions that touches leave nearly as uncertain as before, in words.

    `covariance` (6, 6) is in standard deviations of the prior, whose Cholesky factor (6, 6) is `prior_factor`: its
    eigenvalues are the shares of the prior's variance that are left.
    """
    variance_shares, eigenvectors = np.linalg.eigh(covariance)
    deviations = prior_factor @ eigenvectors * np.sqrt(variance_shares)  # columns of one standard deviation
    open_deviations = deviations[:, variance_shares > _OPEN_SHARE**2]
    if not open_deviations.size:
        return ()
    # Of directions that are all open any mixture is one: shifts are separated from turns.
    _, _, mixture = np.linalg.svd(open_deviations[3:], full_matrices=True)
    return tuple(_direction_text(mesh.pose, direction, mesh.body.size) for direction in (open_deviations @ mixture.T).T)


def _direction_text(pose: UncertainPose, deviation: Floats, size: float) -> str:
    """Return a displacement and turn (6,) of one standard deviation: a turn about an axis, or a shift.

    `size` [m] is the body's: a turn that moves its ends by far less than the shift does is a shift.
    """
    shift, turn = deviation[:3], deviation[3:]
    angle, distance = float(np.linalg.norm(turn)), float(np.linalg.norm(shift))
    if angle * size / 2 < _SHIFT_SHARE * distance:
        return f"a shift along ({_vector_text(shift / distance)}), held to ± {1e3 * distance:.1f} mm"
    # The axis of a screw: the points that it moves along itself alone.
    point = pose.pivot + np.cross(turn, shift) / angle**2
    point_text = ", ".join(f"{1e3 * coordinate:.1f}" for coordinate in point)
    return (
        f"a turn about the axis ({_vector_text(turn / angle)}) through ({point_text}) mm, "
        f"held to ± {math.degrees(angle):.1f} deg"
    )


def _vector_text(vector: Floats) -> str:
    """Return a vector with two decimals, without minus zeros."""
    return ", ".join(f"{component + 0.0:.2f}" for component in np.round(vector, 2))
