"""The form of a simulated skin: a plane, a cylinder, a sphere or a torus, turned about the origin of the work frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from palpate import Floats

_STEPS = 30  # of Newton's, for a height
_CLOSE = 1e-12  # [m]


@dataclass(frozen=True)
class SkinForm:
    """Slopes of the skin at the origin, and its curvatures [1/m] there, towards x and y; positive where it bulges."""

    slopes: tuple[float, float]
    curvatures: tuple[float, float]

    @property
    def _axes(self) -> Floats:
        """Rows (3, 3): the skin's own axes at the origin in the work frame, the last of them its normal."""
        tilt_x, tilt_y = self.slopes
        normal = np.array([-tilt_x, -tilt_y, 1.0]) / np.sqrt(1.0 + tilt_x**2 + tilt_y**2)
        along = np.array([1.0, 0.0, tilt_x])
        along -= normal * (normal @ along)
        along /= np.linalg.norm(along)
        return np.array([along, np.cross(normal, along), normal])

    def near(self, points: Floats) -> tuple[Floats, Floats]:
        """Distance (n,) [m] of points (n, 3) from the skin, positive outside, and the normals (n, 3) to them.

        The distance from a torus whose circles have the radii 1/k_x and 1/k_y, where none is curved from a plane.
        """
        axes, (by_x, by_y) = self._axes, self.curvatures
        along, beside, height = axes @ points.T
        if not (by_x or by_y):
            return height, np.broadcast_to(axes[2], points.shape)
        height, up, aside = _from_circle(height, along, by_x)
        distance, rise, across = _from_circle(height, beside, by_y)
        return distance, np.column_stack([rise * aside, across, rise * up]) @ axes

    def height(self, x: Floats, y: Floats) -> Floats:
        """Height (n,) [m] of the skin over x, y (n,) by Newton's method; -inf off the edge of a body."""
        z = self.slopes[0] * x + self.slopes[1] * y
        for _ in range(_STEPS):
            distance, normal = self.near(np.column_stack([x, y, z]))
            if np.abs(distance).max(initial=0.0) < _CLOSE:
                return z
            z = z - distance / normal[:, 2]
        left, _ = self.near(np.column_stack([x, y, z]))
        return np.where(np.abs(left) < _CLOSE, z, -np.inf)


def _from_circle(height: Floats, along: Floats, curvature: float) -> tuple[Floats, Floats, Floats]:
    """Distance (n,) [m] of points from a circle through the origin, at heights over its tangent; its two slopes."""
    up, aside = 1.0 + curvature * height, curvature * along
    root = np.hypot(up, aside)
    distance = (curvature * (height**2 + along**2) + 2.0 * height) / (1.0 + root)
    return distance, up / root, aside / root


@cache
def elliptic_share(radius: float, curvatures: tuple[float, float]) -> float:
    """Force of a sphere on a skin of two curvatures [1/m], over that on a flat one at the same depth: Hertz's ellipse.

    With semi-axes a > b, e^2 = 1 - b^2/a^2, K and E the complete elliptic integrals of e, A < B half of the sums of the
    curvatures in both planes: B/A = ((a/b)^2 E - K)/(K - E), and F = 2/3 pi/K E* d^1.5 sqrt((K - E)/(A e^2 K)).
    Source: Johnson 1985, section 4.2.
    """
    from scipy.optimize import brentq
    from scipy.special import ellipe, ellipk

    less, more = sorted(0.5 * (1.0 / radius + one) for one in curvatures)
    if more / less - 1.0 < 1e-6:
        return float((2.0 * radius * less) ** -0.5)

    def ratio(square: float) -> float:
        k, e = ellipk(square), ellipe(square)
        return float((e / (1.0 - square) - k) / (k - e))

    solve: Any = brentq  # its annotations want numpy's floats
    square = float(solve(lambda s: ratio(s) - more / less, 1e-8, 1.0 - 1e-9))
    k, e = float(ellipk(square)), float(ellipe(square))
    force = 2.0 / 3.0 * np.pi / k * np.sqrt((k - e) / (less * square * k))
    return float(force / (4.0 / 3.0 * np.sqrt(radius)))
