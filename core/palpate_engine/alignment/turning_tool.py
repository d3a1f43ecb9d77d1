"""Signals of a tool that turns: its force, height and velocity along the normal at the instants of the samples."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_settings import AlignmentSettings
from palpate.device import Batch
from palpate.vectors import Floats

from palpate_engine.alignment.lateral_force import LateralForce
from palpate_engine.alignment.ports import Port
from palpate_engine.alignment.signal_reader import SignalReader, ToolReport, ToolSignals
from palpate_engine.alignment.signal_series import Series
from palpate_engine.alignment.surface_lookup import SurfaceLookup
from palpate_engine.alignment.tool_frame import Load, ToolFrame, Vector
from palpate_engine.alignment.tool_watch import ToolWatch


class TurningToolReader(SignalReader):
    """Reads the series of a wrench, a pose and a twist; keeps account of the weight that turns."""

    def __init__(self, settings: AlignmentSettings, force: Port, series: Mapping[str, Series]) -> None:
        self._frame = ToolFrame(settings, force)
        self._lookup = None if settings.surface is None else SurfaceLookup(settings.surface)
        self._is_projecting = settings.is_projecting
        self._series = series
        self._axes = [
            series.get(f"force {axis}", series["force"]) for axis, _ in zip("xyz", force.components, strict=True)
        ]
        self._signs = [settings.force.sign if one is series["force"] else 1 for one in self._axes]
        self._lateral = LateralForce((0, 1, 2))
        self._watch = ToolWatch()

    def feed(self, device: str, batch: Batch) -> None:
        """Its account is of samples, which `read` makes."""

    def read(self, stamps: NDArray[np.int64], count: int) -> ToolSignals:
        """Force, without a weight that turns, height and velocity along the normal, or along the axis that is read.

        The height is that over the surface, or over the plane through the origin of the poses.
        """
        now, planes, nothing = stamps[:count], None, np.zeros(count)
        height, motion = self._series["position"].values[: len(stamps)], ((nothing, nothing, nothing), nothing)
        if self._is_projecting:
            place = self._vector("position", stamps)
            if self._lookup is None:
                height = self._frame.along(place)
            else:
                ahead = self._lookup.planes(np.column_stack(place), count)
                height, planes = ahead.height, ahead[:count]
            motion = (place[0][:count], place[1][:count], place[2][:count]), height[:count]
        normal = None if planes is None else _columns(planes.normal)
        load, velocity = self._load(now, normal), self._velocity(now, normal)
        self._lateral.add(np.column_stack([load.along, *load.across]))
        if planes is None:
            self._watch.add(load, *motion, nothing, nothing)
            return ToolSignals(height, load.along, velocity, np.full((count, 2), np.nan))
        curvature = planes.curvature.mean(axis=1) * planes.known
        self._watch.add(load, *motion, curvature, planes.curvature_std)
        return ToolSignals(height, load.along * planes.known, velocity, planes.curvature * planes.known[:, None])

    def _load(self, stamps: NDArray[np.int64], normal: Vector | None) -> Load:
        """Forces on the tip, without a weight that turns."""
        fx, fy, fz = (sign * one.at(stamps) for sign, one in zip(self._signs, self._axes, strict=True))
        x, y, z, w = (self._series[f"orientation {axis}"].at(stamps) for axis in "xyzw")
        return self._frame.load((fx, fy, fz), (x, y, z, w), normal)

    def _velocity(self, stamps: NDArray[np.int64], normal: Vector | None) -> Floats | None:
        if "velocity" not in self._series:
            return None
        if not self._is_projecting:
            return self._series["velocity"].at(stamps)
        return self._frame.along(self._vector("velocity", stamps), normal)

    def _vector(self, role: str, stamps: NDArray[np.int64]) -> Vector:
        x, y, z = (self._series[f"{role} {axis}"].at(stamps) for axis in "xyz")
        return x, y, z

    def release(self, contact: NDArray[np.bool_]) -> None:
        """Part the account into air and contact."""
        self._watch.release(contact)

    @property
    def report(self) -> ToolReport:
        """Share of the force across the normal, or the tool, and what the tool and its weight did."""
        return ToolReport(self._lateral.share, self._watch.turned)


def _columns(vectors: Floats) -> Vector:
    """Columns (n,) of vectors (n, 3)."""
    x, y, z = vectors.T
    return x, y, z
