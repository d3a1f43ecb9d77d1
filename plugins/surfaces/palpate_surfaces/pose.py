"""A pose that is known up to a covariance, and what that leaves of a surface's place and normal."""

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
        """Points (n, 3) of the body in the work frame."""
        return np.asarray(points @ self.matrix.T + self.translation)

    def inwards(self, points: Floats) -> Floats:
        """Points (n, 3) of the work frame in that of the body."""
        return np.asarray((points - self.translation) @ self.matrix)

    def height_jacobian(self, position: Floats, normal: Floats) -> Floats:
        """(n, 6) by how much the surface rises along normals (n, 3) at positions (n, 3): n . (d + w x (x - c))."""
        return np.hstack([normal, np.cross(position - self.pivot, normal)])

    def position_variance(self, position: Floats, normal: Floats) -> Floats:
        """(n,) [m^2] along the normals."""
        jacobian = self.height_jacobian(position, normal)
        return np.asarray(np.einsum("ni,ij,nj->n", jacobian, self.covariance, jacobian))

    def normal_covariance(self, position: Floats, normal: Floats, shape: Floats) -> Floats:
        """(n, 3, 3) of normals at fixed places, S (n, 3, 3) the shape operators: w x n - S (d + w x (x - c)).

        A body that is moved aside by s shows at the same place the normal of a point next to it, turned by s/R.
        """
        turn = -_cross_matrices(normal)  # w x n = -[n] w
        shift = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(normal), 3, 3)), -_cross_matrices(position - self.pivot)], axis=2
        )
        jacobian = np.concatenate([np.zeros((len(normal), 3, 3)), turn], axis=2) - shape @ shift
        return np.asarray(jacobian @ self.covariance @ jacobian.transpose(0, 2, 1))


def _cross_matrices(vectors: Floats) -> Floats:
    """(n, 3, 3), [v] with [v] x = v x x, of vectors (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
