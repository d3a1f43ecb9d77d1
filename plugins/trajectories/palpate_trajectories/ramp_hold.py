"""Ramps down to one depth or several, each held: relaxation at a constant depth."""

from __future__ import annotations

import itertools
from functools import cached_property
from typing import Any

from palpate import Depth, Length, Speed, Time
from pydantic import Field, model_validator

from palpate_trajectories.load_unload import refuse_speeds
from palpate_trajectories.motion_parts import PlannedMotion, through
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.planned_trajectory import PlannedTrajectory
from palpate_trajectories.smooth_profile import Knot, rest_profile


class RampHold(PlannedTrajectory):
    """Down to a depth at constant speed and held there: the force relaxes at a constant depth (stress relaxation).

    Several depths are held one after the other, from the shallowest: two depths reveal a material whose relaxation
    depends on the contact radius, such as a poroelastic one. Speed is constant but for the turns, which take `turn`
    each. Ramps and holds are measured, the way back is not: there the contact shrinks, which few models know of.
    """

    depths: tuple[Depth, ...] = Field(min_length=1, description="depths that are held, below the nominal surface")
    hold: Time = Field(default=30.0, gt=0, le=3600, description="duration of each hold")
    speed: Speed = Field(default=0.01, gt=0, description="speed of the ramps, and of the retraction")
    turn: Time = Field(default=0.1, gt=0, description="duration of each turn, and of starting and stopping")
    clearance: Depth = Field(default=0.001, gt=0, description="height above the nominal surface at both ends")
    standstill: Time = Field(
        default=1.0, ge=0, description="standstill in free air before and after it, for tare and drift"
    )
    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="where [x, y]")
    surface: NominalHeight = Field(default=NominalHeight(), description="nominal surface")

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        distances = [b - a for a, b in itertools.pairwise((-self.clearance, *self.depths))]
        if min(distances) <= 0:
            raise ValueError(f"depths {', '.join(f'{d:g} m' for d in self.depths)} must be above 0 and increase")
        for distance in distances:
            refuse_speeds((self.speed,), distance, self.turn)
        return self

    @cached_property
    def _motion(self) -> PlannedMotion:
        """Return the motion to each depth in turn, held there, and up again."""
        # Down to each depth, and held there.
        time, level = self.standstill, -self.clearance
        knots = [Knot(time, level)]
        for depth in self.depths:
            knots += _ramp_knots(time, level, depth, self.speed, self.turn)
            time, level = knots[-1].time + self.hold, depth
            knots.append(Knot(time, level))
        # Up again, not measured.
        measuring = (self.standstill, time)
        knots += _ramp_knots(time, level, -self.clearance, -self.speed, self.turn)
        x, y = (rest_profile(value) for value in self.place)
        end = knots[-1].time + self.standstill
        return PlannedMotion(duration=end, x=x, y=y, depth=through(knots), measuring=(measuring,), surface=self.surface)


def _ramp_knots(start: float, begin: float, end: float, speed: float, turn: float) -> list[Knot]:
    """Return the knots after the first of a way from rest to rest, at constant speed between two turns."""
    turn_way = speed * turn / 2  # that of a turn from rest to the speed
    arrive = start + turn + (end - begin - 2 * turn_way) / speed
    return [
        Knot(start + turn, begin + turn_way, speed),
        Knot(arrive, end - turn_way, speed),
        Knot(arrive + turn, end),
    ]
