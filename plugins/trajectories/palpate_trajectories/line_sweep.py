"""A sweep along a line: some time at its beginning, then at constant speed to its end while the sine continues."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

from palpate import Length, Speed, Surface, Time
from pydantic import Field, model_validator

from palpate_trajectories.approach import PressShape, Touch, press_motion, refuse_hasty, surface_press
from palpate_trajectories.motion_parts import PlannedMotion, line_knots, line_time, through
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.planned_trajectory import PlannedTrajectory
from palpate_trajectories.smooth_profile import Knot
from palpate_trajectories.surface_motion import SurfaceLine, SurfaceMotion, footway_along

_MIN_LENGTH = 1e-6  # [m], a choice: a shorter line does not count


class LineSweep(PlannedTrajectory):
    """A sweep along a line: standstill, approach, palpation at the beginning, line at constant speed, retract.

    While measuring, depth(t) = bias + amplitude sin(2 pi f t) below the nominal surface; the coordinates along it have
    continuous velocity and acceleration (paper, section Online Dynamic Estimation).
    """

    start: tuple[Length, Length] = Field(default=(0.0, 0.0), description="start [x, y]")
    end: tuple[Length, Length] = Field(description="end [x, y]")
    speed: Speed = Field(default=0.004, gt=0, description="speed along the line")
    settle: Time = Field(default=10.0, ge=0, description="palpation at the beginning, before it moves")
    ramp: Time = Field(default=0.25, gt=0, description="time of acceleration, and of deceleration")
    press: PressShape = Field(description="depth, sine, approach")
    surface: NominalHeight | Surface = Field(
        default=NominalHeight(),
        description="nominal height that it follows, or a surface with whose normal the tool turns",
    )

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        if self._length < _MIN_LENGTH:
            raise ValueError("start and end are the same place: no line to sweep")
        refuse_hasty(self.press, self._length, self.speed)
        return self

    @property
    def _length(self) -> float:
        """The length of the line [m] in x and y."""
        return math.dist(self.start, self.end)

    @property
    def followed(self) -> Surface | None:
        """See `palpate.SupportsSurface`."""
        return None if isinstance(self.surface, NominalHeight) else self.surface

    @cached_property
    def _motion(self) -> PlannedMotion | SurfaceMotion:
        return self._level_motion if self.followed is None else self._surface_motion(self.followed)

    def _surface_motion(self, surface: Surface) -> SurfaceMotion:
        """Return the motion with its speed along the surface."""
        begin = self.press.standstill + self.press.transfer
        line = SurfaceLine.on(surface, self.start, self.end)
        leave = begin + self.settle
        arrive = leave + line_time(line.length, self.speed, self.ramp)
        knots = [Knot(0.0, 0.0), *line_knots(leave, 0.0, 1.0, self.speed / line.length, self.ramp)]
        return surface_press(
            self.press, [Touch(begin, arrive)], footway_along([line], through(knots)), [(begin, arrive)]
        )

    @property
    def _level_motion(self) -> PlannedMotion:
        """Return the motion along the line over a level surface."""
        assert isinstance(self.surface, NominalHeight)
        begin = self.press.standstill + self.press.transfer
        leave = begin + self.settle
        # Each coordinate has its share of the speed, so that both arrive at once.
        coordinates = []
        for start, end in zip(self.start, self.end, strict=True):
            share = abs(end - start) / self._length
            coordinates.append(line_knots(leave, start, end, self.speed * share, self.ramp))
        x, y = coordinates
        arrive = leave + line_time(self._length, self.speed, self.ramp)
        return press_motion(
            self.press, touches=[Touch(begin, arrive)], x=x, y=y, measuring=[(begin, arrive)], surface=self.surface
        )
