"""Signals of a tool that turns: its force, height and velocity along the normal at the instants of the samples."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_report import SidewaysShare, TurnedTool
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.lateral_force import LateralForce
from palpate_engine.alignment.ports import Port
from palpate_engine.alignment.signal_series import Series
from palpate_engine.alignment.surface_lookup import LocalPlanes, SurfaceLookup
from palpate_engine.alignment.tool_frame import ToolFrame, Vector
from palpate_engine.alignment.turned_tool import ToolWatch


class OrientedSignals:
    """Reads the series of a wrench, a pose and a twist; keeps account of the weight that turns."""

    def __init__(self, settings: AlignmentSettings, force: Port, roles: Mapping[str, Series]) -> None:
        self._frame = ToolFrame(settings, force)
        self._lookup = None if settings.surface is None else SurfaceLookup(settings.surface)
        self._planes: LocalPlanes | None = None  # of the samples that are being made
        self.is_projecting = settings.is_projecting  # whether force and motion are those along a stated normal
        self._roles = roles
        self._axes = [
            roles.get(f"force {axis}", roles["force"]) for axis, _ in zip("xyz", force.components, strict=True)
        ]
        self._signs = [settings.force.sign if series is roles["force"] else 1 for series in self._axes]
        self._lateral = LateralForce((0, 1, 2))
        self._watch = ToolWatch()

    @property
    def share(self) -> SidewaysShare | None:
        """Share of the force that is across the normal, or the tool."""
        return self._lateral.share

    @property
    def turned(self) -> TurnedTool | None:
        """What the tool and its weight did; None where there are no samples yet."""
        return self._watch.turned

    def forces(self, stamps: NDArray[np.int64]) -> Floats:
        """Forces (n,) [N] along the normal, without a weight that turns; NaN where a reading is missing."""
        readings = [sign * series.at(stamps) for sign, series in zip(self._signs, self._axes, strict=True)]
        x, y, z, w = (self._roles[f"orientation {axis}"].at(stamps) for axis in "xyzw")
        normal = self._normals(len(stamps))
        load = self._frame.load((readings[0], readings[1], readings[2]), (x, y, z, w), normal)
        self._lateral.add(np.column_stack([load.along, *load.across]))
        nothing = np.zeros(len(stamps))
        place, height, known = (nothing, nothing, nothing), nothing, np.ones(len(stamps))
        curvature, curvature_std = nothing, nothing
        if self.is_projecting:
            place = self._vector("position", stamps)
            height = self._frame.along(place, normal)
        if self._planes is not None:
            planes = self._planes[: len(stamps)]
            height, known = planes.height, planes.known
            curvature, curvature_std = planes.curvature.mean(axis=1) * known, planes.curvature_std
        self._watch.add(load, place, height, curvature, curvature_std)
        return np.asarray(load.along * known)

    def heights(self, stamps: NDArray[np.int64], count: int) -> Floats:
        """Heights (n,) [m] of the tip along the normal: over the surface, or over the plane through the origin.

        The first `count` of them become samples.
        """
        place = self._vector("position", stamps)
        if self._lookup is None:
            return self._frame.along(place)
        self._planes = self._lookup.planes(np.column_stack(place), count)
        return self._planes.height

    def velocities(self, stamps: NDArray[np.int64]) -> Floats:
        """Velocities (n,) [m/s] of that height."""
        return self._frame.along(self._vector("velocity", stamps), self._normals(len(stamps)))

    def curvatures(self, count: int) -> Floats:
        """Principal curvatures (n, 2) [1/m] below the first samples that are being made; NaN where they are unknown."""
        if self._planes is None:
            return np.full((count, 2), np.nan)
        planes = self._planes[:count]
        return planes.curvature * planes.known[:, None]

    def _normals(self, count: int) -> Vector | None:
        """Columns (n,) of the normals below the first samples that are being made; None where one is for all."""
        if self._planes is None:
            return None
        x, y, z = self._planes.normal[:count].T
        return x, y, z

    def released(self, samples: Samples) -> None:
        """Take note of which of the samples whose forces were asked for, in order, are in contact."""
        self._watch.release(samples.contact)

    def _vector(self, role: str, stamps: NDArray[np.int64]) -> Vector:
        x, y, z = (self._roles[f"{role} {axis}"].at(stamps) for axis in "xyz")
        return x, y, z
