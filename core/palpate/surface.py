"""Surfaces: place, normal and curvature of the skin, with their uncertainties."""

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
    """Points of a surface in the work frame, with normal and curvature; NaN where nothing is known."""

    position: Floats  # (n, 3) [m]
    normal: Floats  # (n, 3) unit vectors out of the material
    height: Floats  # (n,) [m] of the place that was asked about, above the surface along the normal; negative inside it
    curvature: Floats  # (n, 2) [1/m] principal curvatures, the larger first; positive where the surface bulges
    position_std: Floats  # (n,) [m] standard uncertainty along the normal
    normal_std: Floats  # (n,) [rad] of the normal, in the direction in which it is known least
    curvature_std: Floats  # (n, 2) [1/m]
    unknown: Mapping[int, str] = field(default_factory=dict)  # row -> the reason why nothing is known there

    def __len__(self) -> int:
        return len(self.position)

    def without(self, unknown: Mapping[int, str]) -> SurfacePoints:
        """Return the same but for rows where nothing is known after all, each with the reason."""
        columns = {key: getattr(self, key).copy() for key in _COLUMNS}
        for column in columns.values():
            column[list(unknown)] = np.nan
        return SurfacePoints(**columns, unknown={**self.unknown, **unknown})


_MM = 1e3  # per metre
_COLUMNS = {"position": 3, "normal": 3, "height": 0, "curvature": 2}
_COLUMNS |= {"position_std": 0, "normal_std": 0, "curvature_std": 2}


class Surface(Part, ABC):
    """The skin of a specimen in the work frame, its origin on the skin and z outwards.

    Unknown places, such as in a hole or beyond the last touch, are in `SurfacePoints.unknown`, not extrapolated.
    """

    kind: ClassVar[str] = "surface"

    @abstractmethod
    def nearest(self, places: Floats) -> SurfacePoints:
        """Return the points of the surface nearest to places (n, 3) [m]."""

    @abstractmethod
    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Return points of the surface at x and y (n, 2) [m]; of several above one another that of the largest z."""


def surface_points(surface: Surface, places: Floats) -> SurfacePoints:
    """Return the points of a surface nearest to places (n, 3) [m], or uppermost at x and y (n, 2) [m].

    Raises ConfigurationError with the first place at which the surface is not known, PluginError naming the surface
    where it raises, or where what it returns is not a finite number for each place.
    """
    places = read_only_view(np.asarray(places, float))
    method = surface.uppermost if places.shape[1] == 2 else surface.nearest
    points = answer_of(surface, lambda: method(places))
    if not isinstance(points, SurfacePoints):
        raise PluginError(f"{_name(surface)}: it returns {type(points).__name__}, not SurfacePoints")
    if points.unknown:
        row = min(points.unknown)
        axes = ", ".join(f"{axis} {_MM * value:.1f}" for axis, value in zip("xyz", places[row]))
        raise ConfigurationError(f"place {row + 1} of {len(places)} ({axes} mm): {points.unknown[row]}")
    _check_columns(surface, points, len(places))
    return points


def _check_columns(surface: Surface, points: SurfacePoints, count: int) -> None:
    """Raise PluginError where a surface's answer is not a finite number for each of so many places."""
    for key, columns in _COLUMNS.items():
        values, shape = getattr(points, key), (count, columns) if columns else (count,)
        if not isinstance(values, np.ndarray) or values.shape != shape:
            raise PluginError(f"{_name(surface)}: {key} for {count} places must be an array of numbers {shape}")
        invalid = np.argwhere(~np.isfinite(values))
        if len(invalid):
            raise PluginError(f"{_name(surface)}: {key} is not a finite number at place {invalid[0][0] + 1}")


def _name(surface: Surface) -> str:
    return f"surface {type(surface).__name__}"
