"""The best plane or sphere of points, and heights over it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_surfaces.surface_patch import tangent_frame

# Choices.
_SPHERE_MAX_SQUARES = 0.5  # of the plane's squared distances: a sphere has to leave less
_SPHERE_MAX_RADIUS = 3.0  # of the points' extent: a sphere of a larger radius is as good as a plane
_GAUSS_NEWTON_STEPS = 20
_MIN_LENGTH = 1e-12  # [m] keeps a division by a length finite


@dataclass(frozen=True)
class BaseShape:
    """A plane, or a sphere on its upper side, with coordinates q of its points and heights h over it.

    On a plane q are two coordinates [m], on a sphere the three of a point of it, from its centre.
    """

    origin: Floats  # (3,) [m] a point of the plane, or the sphere's centre
    axis: Floats  # (3,) outwards from the plane, or towards the middle of the points
    radius: float | None = None  # [m]; None: a plane
    side: float = 1.0  # -1 of a hollow sphere, whose material is outside

    @classmethod
    def of(cls, points: Floats) -> BaseShape:
        """Return the sphere through points (n, 3) where it is much nearer to them than the plane is, else the plane."""
        middle = points.mean(axis=0)
        _, _, principal_axes = np.linalg.svd(points - middle)
        normal = principal_axes[2] if principal_axes[2, 2] >= 0 else -principal_axes[2]
        plane = cls(middle, normal)
        centre, radius = _fit_sphere(points)
        side = 1.0 if middle[2] > centre[2] else -1.0
        sphere = cls(centre, _unit_vector(middle - centre), radius, side)
        extent = float(np.linalg.norm(np.ptp(points, axis=0)))
        plane_squares, sphere_squares = (float(np.sum(shape.coordinates(points)[1] ** 2)) for shape in (plane, sphere))
        is_curved = radius < _SPHERE_MAX_RADIUS * extent
        return sphere if is_curved and sphere_squares < _SPHERE_MAX_SQUARES * plane_squares else plane

    @property
    def name(self) -> str:
        """The shape in words."""
        return "plane" if self.radius is None else f"sphere of {1e3 * self.radius:.0f} mm"

    def coordinates(self, points: Floats) -> tuple[Floats, Floats]:
        """Return q (n, 2 or 3) [m] and h (n,) [m] of points (n, 3) [m]."""
        offset = points - self.origin
        if self.radius is None:
            local = offset @ tangent_frame(self.axis).T
            return local[:, :2], local[:, 2]
        distance = np.linalg.norm(offset, axis=1)
        return self.radius * offset / distance[:, None], self.side * (distance - self.radius)

    def points(self, q: Floats, height: Floats) -> Floats:
        """Return the points (n, 3) [m] of coordinates q (n, k) and heights (n,)."""
        if self.radius is None:
            return np.asarray(self.origin + np.column_stack([q, height]) @ tangent_frame(self.axis))
        return np.asarray(self.origin + q * (1.0 + self.side * height[:, None] / self.radius))

    def outwards(self, q: Floats) -> Floats:
        """Return the unit vectors (n, 3) at coordinates q (n, k) along which heights are counted."""
        return np.tile(self.axis, (len(q), 1)) if self.radius is None else self.side * q / self.radius

    def stencil(self, q: Floats, steps: Floats) -> Floats:
        """Return the coordinates (m, k) at steps (m, 2) [m] in the tangent plane from coordinates q (k,)."""
        if self.radius is None:
            return np.asarray(q + steps)
        on_tangent = q + steps @ tangent_frame(q / self.radius)[:2]
        return np.asarray(self.radius * on_tangent / np.linalg.norm(on_tangent, axis=1, keepdims=True))

    def unroll(self, q: Floats) -> Floats:
        """Return q (n, k) as coordinates in a plane (n, 2) [m], at their distance and direction from the middle.

        The distance is the arc from the middle of the points (azimuthal equidistant projection).
        """
        if self.radius is None:
            return q
        local = q @ tangent_frame(self.axis).T
        off_axis = np.linalg.norm(local[:, :2], axis=1)
        arc = self.radius * np.arctan2(off_axis, local[:, 2])
        return np.asarray(local[:, :2] * (arc / np.maximum(off_axis, _MIN_LENGTH))[:, None])

    def angles(self, q: Floats) -> Floats:
        """Return the angles (n,) [rad] from the middle of the points, seen from the sphere's centre; 0 on a plane."""
        return np.zeros(len(q)) if self.radius is None else np.arccos(np.clip(q @ self.axis / self.radius, -1.0, 1.0))

    def uppermost(self, lateral: Floats) -> Floats:
        """Return the points (n, 3) [m] of the shape at x and y (n, 2), or at the height of its rim off the sphere."""
        offset = lateral - self.origin[:2]
        if self.radius is None:
            return np.column_stack([lateral, self.origin[2] - offset @ self.axis[:2] / self.axis[2]])
        rise = np.sqrt(np.maximum(self.radius**2 - (offset**2).sum(axis=1), 0.0))
        return np.column_stack([lateral, self.origin[2] + self.side * rise])


def _fit_sphere(points: Floats) -> tuple[Floats, float]:
    """Return centre (3,) and radius [m] of the sphere nearest to points (n, 3): algebraic fit, then Gauss and Newton.

    |p - c|^2 = r^2 is linear in c and r^2 - |c|^2: 2 p.c + (r^2 - |c|^2) = |p|^2. Then the distances |p - c| - r are
    minimised, whose derivatives are -(p - c)/|p - c| by c and -1 by r.
    """
    middle = points.mean(axis=0)
    offset = points - middle
    design = np.column_stack([2 * offset, np.ones(len(offset))])
    solution, *_ = np.linalg.lstsq(design, (offset**2).sum(axis=1), rcond=None)
    centre = solution[:3]
    radius = math.sqrt(max(float(solution[3] + centre @ centre), 1e-12))  # [m] at least 1 um
    for _ in range(_GAUSS_NEWTON_STEPS):
        distance = np.linalg.norm(offset - centre, axis=1)
        jacobian = np.column_stack([-(offset - centre) / distance[:, None], -np.ones(len(offset))])
        step, *_ = np.linalg.lstsq(jacobian, -(distance - radius), rcond=None)
        centre, radius = centre + step[:3], radius + float(step[3])
    return middle + centre, abs(radius)


def _unit_vector(vector: Floats) -> Floats:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), _MIN_LENGTH))
