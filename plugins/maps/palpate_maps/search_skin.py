"""The surface that a search goes over: points of the skin, the normals there, and how far straight distances hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats, Setpoint, Surface, SurfacePoints
from palpate_kit.kinematics.turns_to_normals import rotation_to

from palpate_maps.hidden_patches import REACH
from palpate_maps.surface_map import ARC

_MIN_NORMAL_Z = 0.5  # a skin steeper than 60 degrees is not visited: x and y hardly distinguish its places (0295)
_MIN_AREA_Z = 0.05  # z of a normal, by which the skin's area is at most 20 times that in x and y: a choice
_MIN_SHARPNESS = 1e-12  # [1/m] of a plane, whose reach is then a length too


@dataclass(frozen=True)
class SearchSkin:
    """A surface at the nodes of a search."""

    surface: Surface
    normal: Floats  # (m, 3)
    sharpness: Floats  # (m,) [1/m] larger of the principal curvatures, without its sign

    @classmethod
    def at(cls, surface: Surface, points: SurfacePoints, rows: NDArray[np.bool_]) -> SearchSkin:
        """Return the skin at some of the points of a grid."""
        return cls(surface, points.normal[rows], np.abs(points.curvature[rows]).max(axis=1))

    @property
    def stretch(self) -> Floats:
        """(m,) area of the skin over that in x and y."""
        return np.asarray(1.0 / self.normal[:, 2])

    @property
    def reach(self) -> float:
        """[m] to which straight distances are within 1 % of those along the skin, wherever it may be palpated."""
        return float(ARC / max(self.sharpness.max(), _MIN_SHARPNESS))

    def demand_gentle(self, radius: float, nodes: Floats) -> None:
        """Raise ConfigurationError where a patch of a radius [m] is felt farther than straight distances hold."""
        if self.reach >= REACH * radius:
            return
        k = int(np.argmax(self.sharpness))
        x, y = (1e3 * nodes[k, :2]).tolist()
        raise ConfigurationError(
            f"--radius: {1e3 * radius:g} mm: at x {x:.1f}, y {y:.1f} mm the surface has a radius of curvature of "
            f"{1e3 / self.sharpness[k]:.3g} mm, on which a search is for patches of up to "
            f"{1e3 * self.reach / REACH:.2g} mm; choose a smaller one, or an --area without that place"
        )


def tips_on(points: SurfacePoints, depth: float) -> tuple[Setpoint, NDArray[np.bool_]]:
    """Return a tool at each point, along its normal and as deep below [m], and where (n,) the skin cannot be
    visited."""
    normal = points.normal
    refused = ~(normal[:, 2] >= _MIN_NORMAL_Z)  # where nothing is known, too
    still = np.zeros((len(points), 3))
    inside = np.ones(len(points), bool)
    return Setpoint(
        position=points.position - depth * normal,
        velocity=still,
        measuring=inside,
        rotation=rotation_to(normal),
        angular_velocity=still,
    ), refused


def skin_share(points: SurfacePoints, allowed: NDArray[np.bool_], beside: float) -> float:
    """Return the share of the skin below a grid's points that is allowed; a point without skin is as its neighbour."""
    area = np.where(np.isfinite(points.normal[:, 2]), 1.0 / np.maximum(points.normal[:, 2], _MIN_AREA_Z), beside)
    return float(area[allowed].sum() / area.sum())
