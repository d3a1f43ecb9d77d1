"""Points palpated one after the other: those of a grid, or places that are given."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Angle, AngularSpeed, Floats, Length, Speed, Surface, Time, Trajectory
from pydantic import Field, model_validator

from palpate_trajectories.approach import PressShape, Touch, press_motion, surface_press
from palpate_trajectories.motion_parts import TOP_SPEED, PlannedMotion, line_knots, line_time, through
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.planned_trajectory import PlannedTrajectory
from palpate_trajectories.smooth_profile import Knot
from palpate_trajectories.stations import Stations
from palpate_trajectories.surface_motion import StationFootway, SurfaceLine, SurfaceMotion

_MAX_POINTS = 2000  # a choice: some 3 hours of visits by default; a finer pitch is a mistake
_RAMP = 0.25  # [s], a choice: acceleration and deceleration of a way, as the default of a line
_ROUNDING = 1e-9  # pitches and periods, a choice: rounding of a whole number of them
_MIN_SPEED = 1e-9  # [m/s], a choice: of a coordinate that does not move
_MAX_EXCHANGED = 400  # points, a choice: 2-opt costs their square, and more of them keep the first tour
_MIN_GAIN = 1e-12  # [m], a choice: a smaller gain is rounding

Place = tuple[float, float]


class GridPoints(PlannedTrajectory):
    """Points on a grid, or `places`, palpated one after the other in the order of a short way.

    Each visit is approach, settle, sine, retract, as in a point palpation; travel is in free air. The order is a
    nearest-neighbour tour improved by exchanging edges (2-opt) until nothing is gained.
    """

    size: tuple[Length, Length] | None = Field(default=None, description="extent of the grid [along, across]")
    pitch: Length | None = Field(default=None, gt=0, description="distance between the grid's points")
    places: tuple[tuple[Length, Length], ...] = Field(default=(), description="the points themselves [x, y]")
    centre: tuple[Length, Length] = Field(default=(0.0, 0.0), description="middle of the grid [x, y]")
    angle: Angle = Field(default=0.0, description="direction of the grid, from the x axis towards y")
    order: tuple[int, ...] | None = Field(default=None, description="order of the visits; left out: a short path")
    duration: Time = Field(default=3.0, gt=0, description="measured part of each visit")
    settle: Time = Field(default=0.5, ge=0, description="sine before the measured part of each visit")
    travel_speed: Speed = Field(default=0.05, gt=0, le=TOP_SPEED, description="speed from point to point, in free air")
    first_point: int = Field(default=0, ge=0, description="first visit, counted from 0; to continue a run")
    press: PressShape = Field(description="depth, sine, approach")
    turn_speed: AngularSpeed = Field(
        default=math.radians(8.0), gt=0, le=1.0, description="fastest turn of the tool on the way over a surface"
    )
    surface: NominalHeight | Surface = Field(
        default=NominalHeight(),
        description="nominal height that it follows, or a surface to whose normals the tool turns",
    )

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        """Raise ValueError for a grid that is incomplete, too large, or in an order of other points."""
        has_grid = self.size is not None and self.pitch is not None
        if has_grid == bool(self.places):
            raise ValueError("give either size and pitch of a grid, or places")
        if self.size is not None and min(self.size) < 0:
            raise ValueError("size: no length may be below 0")
        count = self._count
        if count > _MAX_POINTS:
            raise ValueError(f"these are {count} points; {_MAX_POINTS} are allowed")
        if self.order is not None and sorted(self.order) != list(range(count)):
            raise ValueError(f"order must name each of the points 0 to {count - 1} once")
        if self.first_point >= count:
            raise ValueError(f"first_point {self.first_point}: there are {count} points")
        return self

    @property
    def _count(self) -> int:
        """The number of points."""
        if self.places or self.size is None or self.pitch is None:
            return len(self.places)
        along, across = (math.floor(extent / self.pitch + _ROUNDING) + 1 for extent in self.size)
        return along * across

    @cached_property
    def visits(self) -> tuple[Place, ...]:
        """The places in the order of their visits."""
        places = self.places or self._grid
        order = self.order if self.order is not None else short_order(places)
        return tuple(places[i] for i in order)

    @property
    def _grid(self) -> tuple[Place, ...]:
        """The points of the grid, row by row."""
        assert self.size is not None
        assert self.pitch is not None
        along, across = (
            np.arange(math.floor(extent / self.pitch + _ROUNDING) + 1) * self.pitch for extent in self.size
        )
        # About the middle, turned by the angle and moved to the centre.
        from_middle, aside = np.meshgrid(along - along[-1] / 2, across - across[-1] / 2)
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        x = self.centre[0] + cos * from_middle - sin * aside
        y = self.centre[1] + sin * from_middle + cos * aside
        return tuple(zip(x.ravel().tolist(), y.ravel().tolist(), strict=True))

    @cached_property
    def _touches(self) -> list[Touch]:
        """The touch of each visit; every one begins at a whole number of periods after the first."""
        press, stay = self.press, self.settle + self.duration
        period = 1.0 / press.frequency
        begin = press.standstill + press.transfer
        touches = [Touch(begin, begin + stay)]
        for travel in self._travels:
            soonest = touches[-1].end + 2 * press.transfer + travel
            begin = touches[0].begin + math.ceil((soonest - touches[0].begin) / period - _ROUNDING) * period
            touches.append(Touch(begin, begin + stay))
        return touches

    @cached_property
    def _stations(self) -> tuple[Stations, list[SurfaceLine]] | None:
        """The stations of the visits and the lines between them; None where the motion follows a nominal height."""
        if isinstance(self.surface, NominalHeight):
            return None
        visits = self.visits[self.first_point :]
        stations = Stations.on(self.surface, np.array(visits))  # first: an impossible place is named
        return stations, [SurfaceLine.on(self.surface, begin, end) for begin, end in itertools.pairwise(visits)]

    @property
    def _travels(self) -> list[float]:
        """The duration of each way to the next visit [s]."""
        if self._stations is not None:
            speeds = self.press.clearance, self.travel_speed, self.turn_speed
            return [line.duration(*speeds) for line in self._stations[1]]
        visits = self.visits[self.first_point :]
        return [line_time(math.dist(a, b), self.travel_speed, _RAMP) for a, b in itertools.pairwise(visits)]

    @property
    def followed(self) -> Surface | None:
        """See `palpate.SupportsSurface`."""
        return None if isinstance(self.surface, NominalHeight) else self.surface

    @cached_property
    def _motion(self) -> PlannedMotion | SurfaceMotion:
        """Return the motion from point to point, on the level or from station to station of a surface."""
        measuring = [(touch.begin + self.settle, touch.end) for touch in self._touches]
        if self._stations is None:
            return self._level_motion(measuring)
        stations, lines = self._stations
        knots = [Knot(0.0, 0.0)]
        for number, (touch, travel) in enumerate(zip(self._touches, self._travels, strict=False)):
            leave = touch.end + self.press.transfer
            knots += [Knot(leave, number), Knot(leave + travel, number + 1)]
        return surface_press(self.press, self._touches, StationFootway(stations, lines, through(knots)), measuring)

    def _level_motion(self, measuring: Sequence[tuple[float, float]]) -> PlannedMotion:
        """Return the motion over a nominal height, in x and y."""
        assert isinstance(self.surface, NominalHeight)
        touches, visits = self._touches, self.visits[self.first_point :]
        x, y = [Knot(0.0, visits[0][0])], [Knot(0.0, visits[0][1])]
        for touch, (start, destination) in zip(touches, itertools.pairwise(visits), strict=False):
            leave, distance = touch.end + self.press.transfer, math.dist(start, destination)
            # Each coordinate has its share of the speed, so that both arrive at once.
            for knots, begin, end in zip((x, y), start, destination, strict=True):
                speed = self.travel_speed
                if distance > 0:
                    speed = self.travel_speed * abs(end - begin) / distance
                knots += [Knot(leave, begin), *line_knots(leave, begin, end, max(speed, _MIN_SPEED), _RAMP)]
        return press_motion(self.press, touches, x, y, measuring, self.surface)

    def after(self, elapsed: float) -> Trajectory | None:
        """Return the visits that were not finished after a time [s]; None when all were."""
        next_point = self.first_point + sum(touch.end <= elapsed for touch in self._touches)
        if next_point >= len(self.visits):
            return None
        return self.model_copy(update={"first_point": next_point})


def short_order(places: Sequence[Place]) -> list[int]:
    """Return an order with a short path through all places: nearest neighbour from the first, then 2-opt."""
    points = np.array(places)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    # Nearest neighbour; of equally near ones the first.
    tour, unvisited = [0], list(range(1, len(points)))
    while unvisited:
        nearest = min(unvisited, key=lambda i: (distance[tour[-1], i], i))
        tour.append(nearest)
        unvisited.remove(nearest)
    # 2-opt (Croes 1958).
    if len(tour) > _MAX_EXCHANGED:
        return tour
    is_shorter = True
    while is_shorter:
        is_shorter = _exchange(tour, distance)
    return tour


def _exchange(tour: list[int], distance: Floats) -> bool:
    """Reverse stretches of an open tour in place where that makes it shorter; return True if it did."""
    is_shorter = False
    for i in range(len(tour) - 2):
        for j in range(i + 2, len(tour)):
            # The edges at both ends of the stretch, as they are and exchanged; an open tour ends without one.
            length = distance[tour[i], tour[i + 1]]
            exchanged = distance[tour[i], tour[j]]
            if j + 1 < len(tour):
                length = length + distance[tour[j], tour[j + 1]]
                exchanged = exchanged + distance[tour[i + 1], tour[j + 1]]
            if exchanged < length - _MIN_GAIN:
                tour[i + 1 : j + 1] = tour[i + 1 : j + 1][::-1]
                is_shorter = True
    return is_shorter
