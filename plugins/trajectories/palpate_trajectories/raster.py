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

_MOST_LINES = 2000


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
    def _possible(self) -> Any:
        if min(self.size) <= 0:
            raise ValueError("size: both lengths must be above 0")
        if self.pitch > self.size[1] + 1e-9:
            raise ValueError(f"pitch {self.pitch:g} m is more than the height of the area, {self.size[1]:g} m")
        if self.lines > _MOST_LINES:
            raise ValueError(f"pitch {self.pitch:g} m makes {self.lines} lines; {_MOST_LINES} are allowed")
        if self.first_line >= self.lines:
            raise ValueError(f"first_line {self.first_line}: the raster has {self.lines} lines, 0 to {self.lines - 1}")
        refuse_hasty(self.press, self.size[0], self.speed)
        return self

    @property
    def lines(self) -> int:
        """How many lines the whole raster has."""
        return math.floor(self.size[1] / self.pitch + 1e-9) + 1

    @cached_property
    def _way(self) -> _LinePath:
        """The way over the area, in coordinates along and across the lines."""
        way = _LinePath(self.press.standstill + self.press.transfer + self.settle)
        if (surface := self.followed) is not None:
            way.line = lambda begin, end: SurfaceLine.on(surface, self._place(*begin), self._place(*end))
        half, lowest = self.size[0] / 2, -self.pitch * (self.lines - 1) / 2
        for line in range(self.first_line, self.lines):
            forwards = line % 2 == 0 or not self.boustrophedon
            begin, end = (-half, half) if forwards else (half, -half)
            if line > self.first_line:
                pace = self.speed if self.boustrophedon else self.return_speed
                way.go(begin, lowest + line * self.pitch, pace, self.ramp, not self.boustrophedon)
                way.now += self.dwell
            else:
                way.place(begin, lowest + line * self.pitch)
            way.go(end, lowest + line * self.pitch, self.speed, self.ramp, False)
            way.finished.append(way.now)
            way.now += self.dwell
        return way

    def _place(self, along: float, across: float) -> tuple[float, float]:
        """x and y of a place along and across the lines."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return self.centre[0] + cos * along - sin * across, self.centre[1] + sin * along + cos * across

    @property
    def followed(self) -> Surface | None:
        """See `palpate.SupportsSurface`."""
        return None if isinstance(self.surface, NominalHeight) else self.surface

    @cached_property
    def _motion(self) -> PlannedMotion | SurfaceMotion:
        way, begin = self._way, self.press.standstill + self.press.transfer
        edges = [begin, *(edge for pause in way.pauses for edge in pause), way.now]
        measuring = list(zip(edges[::2], edges[1::2], strict=True))
        if isinstance(self.surface, NominalHeight):
            return self._level_motion(measuring)
        footway = footway_along(way.surface_lines, through([Knot(0.0, 0.0), *way.progress]))
        return surface_press(self.press, [Touch(begin, way.now)], footway, measuring)

    def _level_motion(self, measuring: list[tuple[float, float]]) -> PlannedMotion:
        assert isinstance(self.surface, NominalHeight)
        way, begin = self._way, self.press.standstill + self.press.transfer
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        x = [
            Knot(k.time, self.centre[0] + cos * k.along - sin * k.across, cos * k.pace - sin * k.drift)
            for k in way.knots
        ]
        y = [
            Knot(k.time, self.centre[1] + sin * k.along + cos * k.across, sin * k.pace + cos * k.drift)
            for k in way.knots
        ]
        return press_motion(self.press, [Touch(begin, way.now)], x, y, measuring, self.surface)

    def after(self, elapsed: float) -> Trajectory | None:
        """The raster that continues with the first line not finished after a time [s]."""
        done = sum(end <= elapsed for end in self._way.finished)
        if self.first_line + done >= self.lines:
            return None
        return self.model_copy(update={"first_line": self.first_line + done})


@dataclass(frozen=True)
class _Place:
    time: float
    along: float
    across: float
    pace: float = 0.0  # [m/s] along the line
    drift: float = 0.0  # [m/s] across it


@dataclass
class _LinePath:
    """A way that grows by straight lines."""

    now: float
    knots: list[_Place] = field(default_factory=list)
    finished: list[float] = field(default_factory=list)  # [s] when each line was done
    pauses: list[tuple[float, float]] = field(default_factory=list)  # [s] in contact, but not measuring
    along: float = 0.0
    across: float = 0.0
    line: Callable[[tuple[float, float], tuple[float, float]], SurfaceLine] | None = None  # of a line on a surface
    surface_lines: list[SurfaceLine] = field(default_factory=list)
    progress: list[Knot] = field(default_factory=list)  # lines that are done

    def place(self, along: float, across: float) -> None:
        """Where it begins."""
        self.along, self.across = along, across
        self.knots.append(_Place(self.now, along, across))

    def go(self, along: float, across: float, speed: float, ramp: float, pausing: bool) -> None:
        """Straight to a place, from rest to rest."""
        way = math.hypot(along - self.along, across - self.across)
        if self.line is not None:
            self.surface_lines.append(self.line((self.along, self.across), (along, across)))
            length, done = self.surface_lines[-1].length, len(self.surface_lines)
            self.progress += line_knots(self.now, done - 1.0, done, speed / length, ramp)
            before, self.now = self.now, self.now + line_time(length, speed, ramp)
            self.pauses += [(before, self.now)] if pausing else []
            self.along, self.across = along, across
            return
        unit = ((along - self.along) / way, (across - self.across) / way)
        self.knots.append(_Place(self.now, self.along, self.across))
        for knot in line_knots(self.now, 0.0, way, speed, ramp):
            place = (self.along + unit[0] * knot.value, self.across + unit[1] * knot.value)
            self.knots.append(_Place(knot.time, *place, unit[0] * knot.rate, unit[1] * knot.rate))
        before, self.now = self.now, self.now + line_time(way, speed, ramp)
        if pausing:
            self.pauses.append((before, self.now))
        self.along, self.across = along, across
