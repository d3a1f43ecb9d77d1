"""The skin of a simulated specimen that is a surface: distance, normals, and Hertz's ellipse at each place."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from palpate import ConfigurationError, Floats, Surface, SurfacePoints

from palpate_simulation.skin_form import elliptic_share

_RATIOS = np.geomspace(1.0, 100.0, 600)  # of the curvatures in both planes


@dataclass
class SkinOnSurface:
    """A surface as a skin; where the surface is not known, as off its edge, it has no skin.

    Depth, normal, curvatures and inclusions are asked for at the same places, one after the other: the latest are kept.
    """

    surface: Surface
    _latest: tuple[Floats, SurfacePoints] | None = field(default=None, repr=False, compare=False)

    def _nearest(self, points: Floats) -> SurfacePoints:
        if self._latest is None or not np.array_equal(self._latest[0], points):
            self._latest = points, self.surface.nearest(points)
        return self._latest[1]

    def near(self, points: Floats) -> tuple[Floats, Floats]:
        """Distance (n,) [m] of points (n, 3) from the skin, positive outside, and the normals (n, 3) to them."""
        found = self._nearest(points)
        distance, normal = found.height.copy(), found.normal.copy()
        for row in found.unknown:
            distance[row], normal[row] = np.inf, (0.0, 0.0, 1.0)
        return distance, normal

    def feet(self, points: Floats) -> Floats:
        """Places (n, 3) [m] of the skin nearest to points (n, 3); the points themselves where it is unknown."""
        found = self._nearest(points)
        return np.where(np.isfinite(found.position), found.position, points)

    def over(self, place: tuple[float, float]) -> Floats:
        """Return the place (3,) [m] of the skin at x and y; raises ConfigurationError where it has none."""
        found = self.surface.uppermost(np.array([place]))
        if found.unknown:
            x, y = (1e3 * at for at in place)
            raise ConfigurationError(f"specimen: no skin at x {x:.1f}, y {y:.1f} mm: {found.unknown[0]}")
        return np.asarray(found.position[0])

    def share(self, points: Floats, radius: float) -> Floats:
        """Force (n,) of a sphere of a radius [m] at points (n, 3) over that on a flat skin at the same depth."""
        sums = 0.5 * (1.0 / radius + np.nan_to_num(self._nearest(points).curvature))
        if sums.min(initial=np.inf) <= 0.0:
            raise ConfigurationError("specimen: a hollow of its surface is narrower than the tip")
        less, more = sums.min(axis=1), sums.max(axis=1)
        return np.asarray(np.interp(more / less, _RATIOS, _shares()) / np.sqrt(2.0 * radius * less))

    def refuse(self, position: Floats) -> None:
        """Raise ConfigurationError where a motion at positions (n, 3) [m] goes where the skin is not known."""
        if unknown := self.surface.nearest(position).unknown:
            row = min(unknown)
            axes = ", ".join(f"{axis} {1e3 * value:.1f}" for axis, value in zip("xyz", position[row], strict=True))
            raise ConfigurationError(f"the trajectory goes where the specimen has no skin ({axes} mm): {unknown[row]}")


@cache
def _shares() -> Floats:
    """Shares of a tip of 1 m on a cylinder, one for each ratio."""
    return np.array([elliptic_share(1.0, (0.0, ratio - 1.0)) for ratio in _RATIOS.tolist()])
