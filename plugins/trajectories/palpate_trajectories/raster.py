"""A raster: parallel lines over an area, swept one after the other without leaving the skin."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from palpate import Angle, Length, Speed, Surface, Time, Trajectory
from pydantic import Field, model_validator

from palpate_trajectories.approach import PressShape, Touch, press_motion, refuse_hasty, surface_press
from palpate_trajectories.motion_parts import PlannedMotion, line_knots, line_time, through
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.planned_trajectory import PlannedTrajectory
from palpate_trajectories.smooth_profile import Knot
from palpate_trajectories.surface_motion import SurfaceLine, SurfaceMotion, footway_along

_MAX_LINES = 2000  # a choice: a finer pitch is a mistake
_ROUNDING = 1e-9  # lines and [m], a choice: rounding of a whole number of pitches


class Raster(PlannedTrajectory):
    """A raster of parallel lines over a rectangle, there and back (boustrophedon) or always in one direction.

    The tip stays on the skin: at a line's end it dwells, steps aside by the pitch, and continues; the sine never stops.
    In one direction it goes back to the next line's beginning, in contact but not measuring.
    """

    size: tuple[Length, Length] = Field(description="length of the lines, and height of the area [along, across]")
    pitch: Length = Field(gt=0, description="distance between lines")
    centre: tuple[Length, Length] = Field(default=(0.0, 0.0), description="middle of the area [x, y]")
    angle: Angle = Field(default=0.0, description="direction of the lines, from the x axis towards y")
    speed: Speed = Field(default=0.004, gt=0, description="speed along the lines, and from one to the next")
    return_speed: Speed = Field(default=0.02, gt=0, description="speed back to a line's beginning, in one direction")
    boustrophedon: bool = Field(default=True, description="every second line backwards")
    dwell: Time = Field(default=0.0, ge=0, description="palpation at rest at each end of a line")
    settle: Time = Field(default=2.0, ge=0, description="palpation at the beginning of the first line")
    ramp: Time = Field(default=0.25, gt=0, description="time of acceleration, and of deceleration")
    first_line: int = Field(default=0, ge=0, description="first line, counted from 0; to continue a raster")
    press: PressShape = Field(description="depth, sine, approach")
    surface: NominalHeight | Surface = Field(
        default=NominalHeight(),
        description="nominal height that it follows, or a surface with whose normal the tool turns",
    )

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        """Raise ValueError for lines that are too many, too few or too fast for the press."""
        if min(self.size) <= 0:
            raise ValueError("size: both lengths must be above 0")
        if self.pitch > self.size[1] + _ROUNDING:
            raise ValueError(f"pitch {self.pitch:g} m is more than the height of the area, {self.size[1]:g} m")
        if self.lines > _MAX_LINES:
            raise ValueError(f"pitch {self.pitch:g} m makes {self.lines} lines; {_MAX_LINES} are allowed")
        if self.first_line >= self.lines:
            raise ValueError(f"first_line {self.first_line}: the raster has {self.lines} lines, 0 to {self.lines - 1}")
        refuse_hasty(self.press, self.size[0], self.speed)
        return self

    @property
    def lines(self) -> int:
        """The number of lines of the whole raster."""
        return math.floor(self.size[1] / self.pitch + _ROUNDING) + 1

    @cached_property
    def _path(self) -> _LinePath:
        """The path over the area, in coordinates along and across the lines."""
        path = _LinePath(self.press.standstill + self.press.transfer + self.settle)
        surface = self.followed
        if surface is not None:
            path.line = lambda begin, end: SurfaceLine.on(surface, self._place(*begin), self._place(*end))
        half = self.size[0] / 2
        lowest = -self.pitch * (self.lines - 1) / 2
        for line in range(self.first_line, self.lines):
            across = lowest + line * self.pitch
            forwards = line % 2 == 0 or not self.boustrophedon
            begin, end = (-half, half) if forwards else (half, -half)
            # To the beginning of the line: aside by the pitch, or back without measuring.
            if line > self.first_line:
                speed = self.speed if self.boustrophedon else self.return_speed
                path.go(begin, across, speed, self.ramp, pausing=not self.boustrophedon)
                path.now += self.dwell
            else:
                path.place(begin, across)
            # Along the line.
            path.go(end, across, self.speed, self.ramp, pausing=False)
            path.finished.append(path.now)
            path.now += self.dwell
        return path

    def _place(self, along: float, across: float) -> tuple[float, float]:
        """Return x and y of a place along and across the lines."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return self.centre[0] + cos * along - sin * across, self.centre[1] + sin * along + cos * across

    @property
    def followed(self) -> Surface | None:
        """See `palpate.SupportsSurface`."""
        return None if isinstance(self.surface, NominalHeight) else self.surface

    @cached_property
    def _motion(self) -> PlannedMotion | SurfaceMotion:
        """Return the motion along the lines, over the level or along the stations of a surface."""
        # Measured but for the pauses.
        path, begin = self._path, self.press.standstill + self.press.transfer
        edges = [begin, *(edge for pause in path.pauses for edge in pause), path.now]
        measuring = list(zip(edges[::2], edges[1::2], strict=True))
        if isinstance(self.surface, NominalHeight):
            return self._level_motion(measuring)
        footway = footway_along(path.surface_lines, through([Knot(0.0, 0.0), *path.progress]))
        return surface_press(self.press, [Touch(begin, path.now)], footway, measuring)

    def _level_motion(self, measuring: list[tuple[float, float]]) -> PlannedMotion:
        """Return the motion over a nominal height, in x and y."""
        assert isinstance(self.surface, NominalHeight)
        path, begin = self._path, self.press.standstill + self.press.transfer
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        x, y = [], []
        for knot in path.knots:
            place_x, place_y = self._place(knot.along, knot.across)
            x.append(Knot(knot.time, place_x, cos * knot.speed_along - sin * knot.speed_across))
            y.append(Knot(knot.time, place_y, sin * knot.speed_along + cos * knot.speed_across))
        return press_motion(
            self.press, touches=[Touch(begin, path.now)], x=x, y=y, measuring=measuring, surface=self.surface
        )

    def after(self, elapsed: float) -> Trajectory | None:
        """Return the raster that continues with the first line not finished after a time [s]; None when all are."""
        next_line = self.first_line + sum(end <= elapsed for end in self._path.finished)
        if next_line >= self.lines:
            return None
        return self.model_copy(update={"first_line": next_line})


@dataclass(frozen=True)
class _Place:
    """A place on the path, and its speed there."""

    time: float  # [s]
    along: float  # [m]
    across: float  # [m]
    speed_along: float = 0.0  # [m/s]
    speed_across: float = 0.0  # [m/s]


@dataclass
class _LinePath:
    """A path that grows by straight lines."""

    now: float  # [s] at its end so far
    knots: list[_Place] = field(default_factory=list)
    finished: list[float] = field(default_factory=list)  # [s] when each line was done
    pauses: list[tuple[float, float]] = field(default_factory=list)  # [s] in contact, but not measuring
    along: float = 0.0
    across: float = 0.0
    line: Callable[[tuple[float, float], tuple[float, float]], SurfaceLine] | None = None  # of a line on a surface
    surface_lines: list[SurfaceLine] = field(default_factory=list)
    progress: list[Knot] = field(default_factory=list)  # number of finished lines

    def place(self, along: float, across: float) -> None:
        """Begin at a place."""
        self.along, self.across = along, across
        self.knots.append(_Place(self.now, along, across))

    def go(self, along: float, across: float, speed: float, ramp: float, pausing: bool) -> None:
        """Go straight to a place, from rest to rest; a pausing way is not measured."""
        if self.line is not None:
            length = self._add_surface_line(self.line((self.along, self.across), (along, across)), speed, ramp)
        else:
            length = self._add_line(along, across, speed, ramp)
        start = self.now
        self.now = start + line_time(length, speed, ramp)
        if pausing:
            self.pauses.append((start, self.now))
        self.along, self.across = along, across

    def _add_surface_line(self, line: SurfaceLine, speed: float, ramp: float) -> float:
        """Add a line on the surface, in parts of its length; return the length [m]."""
        self.surface_lines.append(line)
        count = len(self.surface_lines)
        self.progress += line_knots(self.now, count - 1.0, count, speed / line.length, ramp)
        return line.length

    def _add_line(self, along: float, across: float, speed: float, ramp: float) -> float:
        """Add the knots of a line in the plane; return its length [m]."""
        length = math.hypot(along - self.along, across - self.across)
        # The knots of the way along the line become places, and its rate a velocity, by the line's direction.
        unit_along = (along - self.along) / length
        unit_across = (across - self.across) / length
        self.knots.append(_Place(self.now, self.along, self.across))
        for knot in line_knots(self.now, 0.0, length, speed, ramp):
            place = self.along + unit_along * knot.value, self.across + unit_across * knot.value
            self.knots.append(_Place(knot.time, *place, unit_along * knot.rate, unit_across * knot.rate))
        return length
