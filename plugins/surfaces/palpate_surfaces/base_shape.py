"""The best plane or sphere of points, and heights over it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_surfaces.surface_patch import tangent_frame

_BETTER = 0.5  # of the plane's squares, that a sphere must come below
_LARGEST = 3.0  # of the points' extent: a sphere of a larger radius is as good as a plane
_STEPS = 20  # of Gauss and Newton


@dataclass(frozen=True)
class BaseShape:
    """A plane, or a sphere, whose side is the one that looks upwards; coordinates on it are q, heights over it h.

    On a plane q are two coordinates [m], on a sphere the three of a point of it, from its centre.
    """

    origin: Floats  # (3,) [m] a point of the plane, or the sphere's centre
    axis: Floats  # (3,) outwards from the plane, or towards the middle of the points
    radius: float | None = None  # [m]; None: a plane
    side: float = 1.0  # -1 of a hollow sphere, whose material is outside

    @classmethod
    def of(cls, points: Floats) -> BaseShape:
        """Return the sphere through points (n, 3) where it is much nearer to them than the plane, else the plane."""
        middle = points.mean(axis=0)
        _, _, axes = np.linalg.svd(points - middle)
        normal = axes[2] if axes[2, 2] >= 0 else -axes[2]
        plane = cls(middle, normal)
        centre, radius = _sphere(points)
        sphere = cls(centre, _unit(middle - centre), radius, 1.0 if middle[2] > centre[2] else -1.0)
        extent = float(np.linalg.norm(np.ptp(points, axis=0)))
        squares = [float(np.sum(shape.coordinates(points)[1] ** 2)) for shape in (plane, sphere)]
        return sphere if radius < _LARGEST * extent and squares[1] < _BETTER * squares[0] else plane

    @property
    def name(self) -> str:
        """In words."""
        return "plane" if self.radius is None else f"sphere of {1e3 * self.radius:.0f} mm"

    def coordinates(self, points: Floats) -> tuple[Floats, Floats]:
        """q (n, 2 or 3) and h (n,) of points (n, 3) [m]."""
        off = points - self.origin
        if self.radius is None:
            local = off @ tangent_frame(self.axis).T
            return local[:, :2], local[:, 2]
        distance = np.linalg.norm(off, axis=1)
        return self.radius * off / distance[:, None], self.side * (distance - self.radius)

    def points(self, q: Floats, height: Floats) -> Floats:
        """Points (n, 3) [m] of q and heights (n,)."""
        if self.radius is None:
            return np.asarray(self.origin + np.column_stack([q, height]) @ tangent_frame(self.axis))
        return np.asarray(self.origin + q * (1.0 + self.side * height[:, None] / self.radius))

    def outwards(self, q: Floats) -> Floats:
        """Unit vectors (n, 3) in which heights are counted."""
        return np.tile(self.axis, (len(q), 1)) if self.radius is None else self.side * q / self.radius

    def around(self, q: Floats, steps: Floats) -> Floats:
        """Coordinates at steps (m, 2) [m] from one of them (k,)."""
        if self.radius is None:
            return np.asarray(q + steps)
        beside = q + steps @ tangent_frame(q / self.radius)[:2]
        return np.asarray(self.radius * beside / np.linalg.norm(beside, axis=1, keepdims=True))

    def unrolled(self, q: Floats) -> Floats:
        """(n, 2) [m] coordinates in a plane, at their distance and direction from the middle of the points."""
        if self.radius is None:
            return q
        local = q @ tangent_frame(self.axis).T
        away = np.linalg.norm(local[:, :2], axis=1)
        arc = self.radius * np.arctan2(away, local[:, 2])
        return np.asarray(local[:, :2] * (arc / np.maximum(away, 1e-12))[:, None])

    def turned(self, q: Floats) -> Floats:
        """(n,) angles [rad] from the middle of the points, seen from the sphere's centre; 0 on a plane."""
        return np.zeros(len(q)) if self.radius is None else np.arccos(np.clip(q @ self.axis / self.radius, -1.0, 1.0))

    def above(self, lateral: Floats) -> Floats:
        """(n, 3) [m] points of the shape at x and y (n, 2), or of its rim where it does not reach there."""
        off = lateral - self.origin[:2]
        if self.radius is None:
            return np.column_stack([lateral, self.origin[2] - off @ self.axis[:2] / self.axis[2]])
        rise = np.sqrt(np.maximum(self.radius**2 - (off**2).sum(axis=1), 0.0))
        return np.column_stack([lateral, self.origin[2] + self.side * rise])


def _sphere(points: Floats) -> tuple[Floats, float]:
    """Centre (3,) and radius [m] of the sphere nearest to points (n, 3): the algebraic fit, then Gauss and Newton."""
    middle = points.mean(axis=0)
    off = points - middle
    design = np.column_stack([2 * off, np.ones(len(off))])
    solution, *_ = np.linalg.lstsq(design, (off**2).sum(axis=1), rcond=None)
    centre = solution[:3]
    radius = math.sqrt(max(float(solution[3] + centre @ centre), 1e-12))
    for _ in range(_STEPS):
        distance = np.linalg.norm(off - centre, axis=1)
        slopes = np.column_stack([-(off - centre) / distance[:, None], -np.ones(len(off))])
        step, *_ = np.linalg.lstsq(slopes, -(distance - radius), rcond=None)
        centre, radius = centre + step[:3], radius + float(step[3])
    return middle + centre, abs(radius)


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))
