"""The form of a simulated skin: a plane, a cylinder, a sphere or a torus, turned about the origin of the work frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from palpate import Floats

MAX_STEPS = 30  # of Newton's method (a choice): a place that needs more is off the edge of a body
HEIGHT_ERROR = 1e-12  # [m] up to which a height is solved (a choice: far below any roughness)
ROUND_RATIO = 1e-6  # of the curvatures, below which the ellipse is a circle and K - E of rounding alone
# Brackets of the squared eccentricity e^2, between a circle and a line, within which K - E and 1 - e^2 keep digits.
MIN_SQUARED_ECCENTRICITY = 1e-8
MAX_SQUARED_ECCENTRICITY = 1.0 - 1e-9


@dataclass(frozen=True)
class SkinForm:
    """Slopes of the skin at the origin, and its curvatures [1/m] there, towards x and y; positive where it bulges."""

    slopes: tuple[float, float]
    curvatures: tuple[float, float]

    @property
    def _axes(self) -> Floats:
        """Unit vectors of the skin at the origin as rows (3, 3): along its rise towards x, across that, its normal."""
        slope_x, slope_y = self.slopes
        normal = np.array([-slope_x, -slope_y, 1.0]) / np.sqrt(1.0 + slope_x**2 + slope_y**2)
        along = np.array([1.0, 0.0, slope_x])
        along -= normal * (normal @ along)
        along /= np.linalg.norm(along)
        return np.array([along, np.cross(normal, along), normal])

    def near(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the distance (n,) [m] of points (n, 3) [m] from the skin, positive outside, and its normals (n, 3).

        The distance is that from a torus whose circles have the radii 1/k_x and 1/k_y: from the circle towards x, and
        with that in place of the height from the circle towards y. Without curvature it is that from a plane.
        """
        axes, (curvature_x, curvature_y) = self._axes, self.curvatures
        along_x, along_y, height = axes @ points.T
        if not (curvature_x or curvature_y):
            return height, np.broadcast_to(axes[2], points.shape)
        height_over_circle, cosine_x, sine_x = _distance_from_circle(height, along_x, curvature_x)
        distance, cosine_y, sine_y = _distance_from_circle(height_over_circle, along_y, curvature_y)
        return distance, np.column_stack([cosine_y * sine_x, sine_y, cosine_y * cosine_x]) @ axes

    def height(self, x: Floats, y: Floats) -> Floats:
        """Return the height (n,) [m] of the skin over x, y (n,) [m] by Newton's method; -inf off the edge of a body."""
        z = self.slopes[0] * x + self.slopes[1] * y
        for _ in range(MAX_STEPS):
            distance, normal = self.near(np.column_stack([x, y, z]))
            if np.abs(distance).max(initial=0.0) < HEIGHT_ERROR:
                return z
            z = z - distance / normal[:, 2]
        residual, _ = self.near(np.column_stack([x, y, z]))
        return np.where(np.abs(residual) < HEIGHT_ERROR, z, -np.inf)


def _distance_from_circle(height: Floats, along: Floats, curvature: float) -> tuple[Floats, Floats, Floats]:
    """Return the distance (n,) [m] of points from a circle of curvature k [1/m], and the normal's cosine and sine (n,).

    The circle touches its tangent at the origin; points are at heights h (n,) [m] over the tangent and lengths s (n,)
    [m] along it. With r = sqrt((1 + k h)^2 + (k s)^2) the distance (r - 1)/k is (k (h^2 + s^2) + 2 h)/(1 + r), which
    holds for k = 0, too.
    """
    radial, tangential = 1.0 + curvature * height, curvature * along
    r = np.hypot(radial, tangential)
    distance = (curvature * (height**2 + along**2) + 2.0 * height) / (1.0 + r)
    return distance, radial / r, tangential / r


@cache
def elliptic_share(radius: float, curvatures: tuple[float, float]) -> float:
    """Return the force of a sphere on a curved skin over that on a flat one at the same depth: Hertz's ellipse.

    The sphere has a radius R [m], the skin two curvatures [1/m]. With semi-axes a > b, m = e^2 = 1 - b^2/a^2, K and E
    the complete elliptic integrals of m, A < B half of the sums of the curvatures in both planes:
    B/A = ((a/b)^2 E - K)/(K - E), and F = 2/3 pi/K E* d^1.5 sqrt((K - E)/(A m K)). On a flat skin
    F = 4/3 E* d^1.5 sqrt(R). Source: Johnson 1985, section 4.2.
    """
    from scipy.optimize import brentq
    from scipy.special import ellipe, ellipk

    A, B = sorted(0.5 * (1.0 / radius + curvature) for curvature in curvatures)
    if B / A - 1.0 < ROUND_RATIO:
        return float((2.0 * radius * A) ** -0.5)

    def curvature_ratio(m: float) -> float:
        """Return B/A; (a/b)^2 is 1/(1 - m)."""
        K, E = ellipk(m), ellipe(m)
        return float((E / (1.0 - m) - K) / (K - E))

    solve: Any = brentq  # its annotations want numpy's floats
    m = float(solve(lambda m: curvature_ratio(m) - B / A, MIN_SQUARED_ECCENTRICITY, MAX_SQUARED_ECCENTRICITY))
    K, E = float(ellipk(m)), float(ellipe(m))
    force = 2.0 / 3.0 * np.pi / K * np.sqrt((K - E) / (A * m * K))
    flat_force = 4.0 / 3.0 * np.sqrt(radius)
    return float(force / flat_force)
