"""Signals of a tool that turns: its force, height and velocity along the normal at the instants of the samples."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from palpate.alignment.lateral_force import LateralForce, SidewaysShare
from palpate.alignment.ports import Port
from palpate.alignment.settings import AlignmentSettings
from palpate.alignment.signal_series import Series
from palpate.alignment.tool_frame import ToolFrame, Vector
from palpate.alignment.turned_tool import ToolWatch, TurnedTool
from palpate.estimation import Samples
from palpate.vectors import Floats


class OrientedSignals:
    """Reads the series of a wrench, a pose and a twist; keeps account of the weight that turns."""

    def __init__(self, settings: AlignmentSettings, force: Port, roles: Mapping[str, Series]) -> None:
        self._frame = ToolFrame(settings, force)
        self._roles = roles
        self._axes = [
            roles.get(f"force {axis}", roles["force"]) for axis, _ in zip("xyz", force.components, strict=True)
        ]
        self._signs = [settings.force.sign if series is roles["force"] else 1 for series in self._axes]
        self._lateral = LateralForce((0, 1, 2))
        self._watch = ToolWatch()

    @property
    def is_projecting(self) -> bool:
        """Whether force and motion are those along a stated normal."""
        return self._frame.is_projecting

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
        load = self._frame.load((readings[0], readings[1], readings[2]), (x, y, z, w))
        self._lateral.add(np.column_stack([load.along, *load.across]))
        if self.is_projecting:
            place = self._vector("position", stamps)
            self._watch.add(load, place, self._frame.height(place))
        else:
            nowhere = np.zeros(len(stamps))
            self._watch.add(load, (nowhere, nowhere, nowhere), nowhere)
        return load.along

    def heights(self, stamps: NDArray[np.int64]) -> Floats:
        """Heights (n,) [m] of the tip along the normal, over the plane through the origin."""
        return self._frame.height(self._vector("position", stamps))

    def velocities(self, stamps: NDArray[np.int64]) -> Floats:
        """Velocities (n,) [m/s] of that height."""
        return self._frame.height(self._vector("velocity", stamps))

    def released(self, samples: Samples) -> None:
        """Take note of which of the samples whose forces were asked for, in order, are in contact."""
        self._watch.release(samples.contact)

    def _vector(self, role: str, stamps: NDArray[np.int64]) -> Vector:
        x, y, z = (self._roles[f"{role} {axis}"].at(stamps) for axis in "xyz")
        return x, y, z
