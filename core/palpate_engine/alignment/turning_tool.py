"""Signals of a tool that turns: its force, height and velocity along the normal at the instants of the samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

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
from palpate_engine.alignment.tool_frame import Load, Rotations, ToolFrame, Vector, axis_out, quaternions, rotations
from palpate_engine.alignment.tool_watch import ToolWatch


class TurningToolReader(SignalReader):
    """Reads the series of a wrench, a pose and a twist; keeps account of the weight that turns.

    A tip that is a sphere of a `radius` [m] touches along the normal through its centre, however the tool stands: place
    and velocity are those of the centre, and the height is less by the radius. Of any other tip they are its end's.
    """

    def __init__(self, settings: AlignmentSettings, force: Port, series: Mapping[str, Series], radius: float) -> None:
        """Take the settings, the port of the force, the signals by their roles, and the radius [m] of the tip."""
        self._frame, self._radius = ToolFrame(settings, force), radius
        self._lookup = None if settings.surface is None else SurfaceLookup(settings.surface, radius)
        self._is_projecting = settings.is_projecting
        self._series, self._euler = series, settings.euler
        self._turns = [role.removeprefix("orientation ") for role in series if role.startswith("orientation ")]
        self._axes = [
            series.get(f"force {axis}", series["force"]) for axis, _ in zip("xyz", force.components, strict=True)
        ]
        self._signs = [settings.force.sign if axis_series is series["force"] else 1 for axis_series in self._axes]
        self._lateral = LateralForce((0, 1, 2))
        self._watch = ToolWatch()

    def feed(self, device: str, batch: Batch) -> None:
        """Its account is of samples, which `read` makes."""

    def read(self, stamps: NDArray[np.int64], count: int) -> ToolSignals:
        """Return force, height and velocity of the first `count` instants: along the normal, or along the axis read.

        `stamps` [ns] may have one instant more, for the last difference of the height. The force is without a weight
        that turns; the height is that over the surface, or over the plane through the origin of the poses.
        """
        sample_stamps, planes, zeros = stamps[:count], None, np.zeros(count)
        # Orientation of the tool at every instant, that after the block included.
        turns = {name: self._series[f"orientation {name}"].at(stamps) for name in self._turns}
        rotation_rows = rotations(quaternions(turns, self._euler))
        out = axis_out(rotation_rows)
        height = self._series["position"].values[: len(stamps)]
        place_and_height = (zeros, zeros, zeros), zeros  # of the tip, as its watch takes them
        if self._is_projecting:
            place = self._from_end(self._columns("position", stamps), out)
            if self._lookup is None:
                height = self._frame.along(place) - self._radius
            else:
                next_planes = self._lookup.planes(np.column_stack(place), count)
                height, planes = next_planes.height, next_planes[:count]
            place_and_height = (place[0][:count], place[1][:count], place[2][:count]), height[:count]
        # Force and velocity are those of the samples of the block alone, along the normal below each.
        normal = None if planes is None else _vector(planes.normal.T)
        rotation_rows, out = _first(rotation_rows, count), _vector(column[:count] for column in out)
        load = self._load(sample_stamps, rotation_rows, normal)
        velocity = self._velocity(sample_stamps, out, normal)
        self._lateral.add(np.column_stack([load.along, *load.across]))
        tilt = self._frame.tilt(out, normal) if self._is_projecting else zeros
        if planes is None:
            self._watch.add(load, *place_and_height, tilt, zeros, zeros)
            return ToolSignals(height, load.along, velocity, np.full((count, 2), np.nan))
        # Where the surface is not known, NaN takes the force out.
        curvature = planes.curvature.mean(axis=1) * planes.known
        self._watch.add(load, *place_and_height, tilt, curvature, planes.curvature_std)
        return ToolSignals(height, load.along * planes.known, velocity, planes.curvature * planes.known[:, None])

    def _from_end(self, end: Vector, out: Vector) -> Vector:
        """Return the centre of the tip, from its end, in the frame of the poses."""
        if not self._radius:
            return end
        return _vector(place + self._radius * axis for place, axis in zip(end, out, strict=True))

    def _load(self, stamps: NDArray[np.int64], rows: Rotations, normal: Vector | None) -> Load:
        """Return the forces on the tip, without a weight that turns."""
        fx, fy, fz = (sign * axis_series.at(stamps) for sign, axis_series in zip(self._signs, self._axes, strict=True))
        return self._frame.load((fx, fy, fz), rows, normal)

    def _velocity(self, stamps: NDArray[np.int64], out: Vector, normal: Vector | None) -> Floats | None:
        """Return the velocity (n,) [m/s] along the normal, of a sphere that of its centre: v + w x r n; None without a
        signal."""
        if "velocity" not in self._series:
            return None
        if not self._is_projecting:
            return self._series["velocity"].at(stamps)
        velocity = self._columns("velocity", stamps)
        if self._radius and "turn x" in self._series:
            (x, y, z), (u, v, w) = self._columns("turn", stamps), out
            velocity = self._from_end(velocity, (y * w - z * v, z * u - x * w, x * v - y * u))
        return self._frame.along(velocity, normal)

    def _columns(self, role: str, stamps: NDArray[np.int64]) -> Vector:
        return _vector(self._series[f"{role} {axis}"].at(stamps) for axis in "xyz")

    def release(self, contact: NDArray[np.bool_]) -> None:
        """Part the account into air and contact."""
        self._watch.release(contact)

    @property
    def report(self) -> ToolReport:
        """Share of the force across the normal, or the tool, and what the tool and its weight did."""
        return ToolReport(self._lateral.share, self._watch.turned)


def _vector(columns: Iterable[Floats]) -> Vector:
    x, y, z = columns
    return x, y, z


def _first(rows: Rotations, count: int) -> Rotations:
    first, second, third = (_vector(column[:count] for column in row) for row in rows)
    return first, second, third
