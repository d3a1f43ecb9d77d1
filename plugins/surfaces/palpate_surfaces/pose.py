"""A pose with its covariance, and the uncertainty of a surface's place and normal by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.rotations import rotation_matrix


@dataclass(frozen=True)
class UncertainPose:
    """A frame in the work frame: x = R x' + t, known to small displacements d and turns w about a pivot c.

    The body may be moved by d + w x (x - c), with the covariance of (d, w).
    """

    rotation: Floats  # (3,) [rad] rotation vector
    translation: Floats  # (3,) [m]
    pivot: Floats  # (3,) [m] in the work frame
    covariance: Floats  # (6, 6) of displacement [m] and turn [rad]

    @property
    def matrix(self) -> Floats:
        """R (3, 3)."""
        return rotation_matrix(self.rotation.tolist())

    def outwards(self, points: Floats) -> Floats:
        """Return points (n, 3) [m] of the body in the work frame."""
        return np.asarray(points @ self.matrix.T + self.translation)

    def inwards(self, points: Floats) -> Floats:
        """Return points (n, 3) [m] of the work frame in that of the body."""
        return np.asarray((points - self.translation) @ self.matrix)

    def height_jacobian(self, position: Floats, normal: Floats) -> Floats:
        """Return the derivatives (n, 6) of heights along normals n (n, 3) at positions x (n, 3) by (d, w).

        The surface rises by n . (d + w x (x - c)).
        """
        return np.hstack([normal, np.cross(position - self.pivot, normal)])

    def position_variance(self, position: Floats, normal: Floats) -> Floats:
        """Return the variances (n,) [m^2] of the surface along normals (n, 3) at positions (n, 3)."""
        jacobian = self.height_jacobian(position, normal)
        return np.asarray(np.einsum("ni,ij,nj->n", jacobian, self.covariance, jacobian))

    def normal_covariance(self, position: Floats, normal: Floats, shape: Floats) -> Floats:
        """Return the covariances (n, 3, 3) of normals at fixed positions, with the shape operators S (n, 3, 3) [1/m].

        A small displacement and turn change a normal by w x n - S (d + w x (x - c)).

        A body that is moved aside by s shows at the same place the normal of a point next to it, turned by s/R.
        """
        count = len(normal)
        # Each part is linear in (d, w): (n, 3, 6), with v x w = [v] w and so w x v = -[v] w.
        displacement = [np.broadcast_to(np.eye(3), (count, 3, 3)), -_cross_matrices(position - self.pivot)]
        turn = [np.zeros((count, 3, 3)), -_cross_matrices(normal)]
        jacobian = np.concatenate(turn, axis=2) - shape @ np.concatenate(displacement, axis=2)
        return np.asarray(jacobian @ self.covariance @ jacobian.transpose(0, 2, 1))


def _cross_matrices(vectors: Floats) -> Floats:
    """Return the matrices [v] (n, 3, 3) of vectors v (n, 3), with [v] u = v x u."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
