"""Surfaces: where the skin is, which way is out, how it is curved, and how well that is known."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from palpate.errors import ConfigurationError, PluginError
from palpate.part_answer import answer_of
from palpate.parts import Part
from palpate.vectors import Floats, read_only_view


@dataclass(frozen=True)
class SurfacePoints:
    """Points of a surface in the work frame, and what is known of it there; NaN where nothing is."""

    position: Floats  # (n, 3) [m]
    normal: Floats  # (n, 3) unit vectors out of the material
    height: Floats  # (n,) [m] of the place that was asked about, above the surface along the normal; negative inside it
    curvature: Floats  # (n, 2) [1/m] principal curvatures, the larger first; positive where the surface bulges
    position_std: Floats  # (n,) [m] standard uncertainty along the normal
    normal_std: Floats  # (n,) [rad] of the normal, in the direction in which it is known least
    curvature_std: Floats  # (n, 2) [1/m]
    unknown: Mapping[int, str] = field(default_factory=dict)  # row -> why nothing is known there

    def __len__(self) -> int:
        return len(self.position)

    def without(self, unknown: Mapping[int, str]) -> SurfacePoints:
        """The same but for rows where nothing is known after all, with why."""
        columns = {key: getattr(self, key).copy() for key in _COLUMNS}
        for column in columns.values():
            column[list(unknown)] = np.nan
        return SurfacePoints(**columns, unknown={**self.unknown, **unknown})


_COLUMNS = {"position": 3, "normal": 3, "height": 0, "curvature": 2}
_COLUMNS |= {"position_std": 0, "normal_std": 0, "curvature_std": 2}


class Surface(Part, ABC):
    """The skin of a specimen in the work frame, its origin on the skin and z outwards.

    What is not known, such as in a hole or beyond the last touch, is in `SurfacePoints.unknown`, not extrapolated.
    """

    kind: ClassVar[str] = "surface"

    @abstractmethod
    def nearest(self, places: Floats) -> SurfacePoints:
        """Points of the surface nearest to places (n, 3) [m]."""

    @abstractmethod
    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Points of the surface at x and y (n, 2) [m]; of several above one another the one with the largest z."""


def surface_points(surface: Surface, places: Floats) -> SurfacePoints:
    """Points of a surface nearest to places (n, 3) [m], or uppermost at x and y (n, 2) [m].

    Raises ConfigurationError with the first place at which the surface is not known, PluginError naming the surface
    where it raises, or where what it returns is not a finite number for each place.
    """
    places = read_only_view(np.asarray(places, float))
    ask = surface.uppermost if places.shape[1] == 2 else surface.nearest
    points = answer_of(surface, lambda: ask(places))
    name, count = f"surface {type(surface).__name__}", len(places)
    if not isinstance(points, SurfacePoints):
        raise PluginError(f"{name}: it returns {type(points).__name__}, not SurfacePoints")
    if points.unknown:
        row = min(points.unknown)
        axes = ", ".join(f"{axis} {1e3 * value:.1f}" for axis, value in zip("xyz", places[row]))
        raise ConfigurationError(f"place {row + 1} of {count} ({axes} mm): {points.unknown[row]}")
    for key, columns in _COLUMNS.items():
        values, wanted = getattr(points, key), (count, columns) if columns else (count,)
        if not isinstance(values, np.ndarray) or values.shape != wanted:
            raise PluginError(f"{name}: {key} for {count} places must be an array of numbers {wanted}")
        if not np.isfinite(values).all():
            raise PluginError(
                f"{name}: {key} is not a finite number at place {np.argwhere(~np.isfinite(values))[0][0] + 1}"
            )
    return points
