"""The skin of a simulated specimen that is a surface: distance, normals, and Hertz's ellipse at each place."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from palpate import ConfigurationError, Floats, Surface, SurfacePoints

from palpate_simulation.skin_form import elliptic_share

# Ratios B/A of the curvatures in both planes at which the ellipse is tabulated (a choice).
CURVATURE_RATIOS = np.geomspace(1.0, 100.0, 600)


@dataclass
class SkinOnSurface:
    """A surface as a skin; where the surface is not known, as off its edge, it has no skin.

    Distance, curvatures and inclusions are needed at the same points one after the other: the latest answer is kept.
    """

    surface: Surface
    _latest: tuple[Floats, SurfacePoints] | None = field(default=None, repr=False, compare=False)

    def _nearest(self, points: Floats) -> SurfacePoints:
        """Return the surface's points (n) nearest to points (n, 3) [m]."""
        if self._latest is None or not np.array_equal(self._latest[0], points):
            self._latest = points, self.surface.nearest(points)
        return self._latest[1]

    def near(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the distance (n,) [m] of points (n, 3) [m] from the skin, positive outside, and its normals (n, 3).

        Where the skin is not known the distance is infinite, and the normal points upwards.
        """
        nearest = self._nearest(points)
        distance, normal = nearest.height.copy(), nearest.normal.copy()
        for row in nearest.unknown:
            distance[row], normal[row] = np.inf, (0.0, 0.0, 1.0)
        return distance, normal

    def feet(self, points: Floats) -> Floats:
        """Return the places (n, 3) [m] of the skin nearest to points (n, 3); where it is unknown, the points."""
        nearest = self._nearest(points)
        return np.where(np.isfinite(nearest.position), nearest.position, points)

    def over(self, place: tuple[float, float]) -> Floats:
        """Return the place (3,) [m] of the skin at x and y [m]; raises ConfigurationError off the skin."""
        uppermost = self.surface.uppermost(np.array([place]))
        if uppermost.unknown:
            x, y = (1e3 * coordinate for coordinate in place)  # [mm]
            raise ConfigurationError(f"specimen: no skin at x {x:.1f}, y {y:.1f} mm: {uppermost.unknown[0]}")
        return np.asarray(uppermost.position[0])

    def share(self, points: Floats, radius: float) -> Floats:
        """Return the force (n,) of a sphere of radius R [m] at points (n, 3) over that on a flat skin as deep.

        It depends on A < B, half of the sums of the curvatures in both planes, as `elliptic_share` does: a function of
        B/A, over sqrt(2 R A). Raises ConfigurationError where A is not positive.
        """
        half_sums = 0.5 * (1.0 / radius + np.nan_to_num(self._nearest(points).curvature))
        if half_sums.min(initial=np.inf) <= 0.0:
            raise ConfigurationError("specimen: a hollow of its surface is narrower than the tip")
        A, B = half_sums.min(axis=1), half_sums.max(axis=1)
        return np.asarray(np.interp(B / A, CURVATURE_RATIOS, _tabulated_shares()) / np.sqrt(2.0 * radius * A))

    def refuse(self, position: Floats) -> None:
        """Raise ConfigurationError where a motion at positions (n, 3) [m] goes where the skin is not known."""
        if unknown := self.surface.nearest(position).unknown:
            row = min(unknown)
            x, y, z = (1e3 * position[row]).tolist()  # [mm]
            coordinates = f"x {x:.1f}, y {y:.1f}, z {z:.1f} mm"
            raise ConfigurationError(
                f"the trajectory goes where the specimen has no skin ({coordinates}): {unknown[row]}"
            )


@cache
def _tabulated_shares() -> Floats:
    """Return the shares (600,) at `CURVATURE_RATIOS`: those of a tip of 1 m on a cylinder, for which 2 R A is 1."""
    return np.array([elliptic_share(1.0, (0.0, ratio - 1.0)) for ratio in CURVATURE_RATIOS.tolist()])
