"""A tip under force control: creep at a constant force."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from palpate import Acceleration, Depth, Force, ForceLaw, Length, Speed, Stiffness, Time
from pydantic import Field, model_validator

from palpate_trajectories.motion_parts import PlannedMotion, through
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.planned_trajectory import PlannedTrajectory
from palpate_trajectories.smooth_profile import Knot, rest_profile

# Duration of a turn over that at constant acceleration, a choice above 1.5: by the basis of `smooth_profile` the
# acceleration of a smooth one peaks at 1.5 times its mean.
_TURN_TIME = 2.0


class ForceHold(PlannedTrajectory):
    """Down to a force and held there, by a closed loop in the arm's own process: the tip creeps at a constant force.

    The tip's speed along the normal is gain (force - measured force), at most `speed`, with gain = 1/(response
    stiffness): in a material of that stiffness the lacking force falls to 1/e in the time `response`, in a softer one
    more slowly. What is declared here is the envelope: never deeper than `depth`, never faster than `speed`, and no
    longer than `duration` from the approach on; the tip is stopped and leaves where it would have to go deeper. As
    setpoints, `at` gives that envelope: the deepest way that the tip could go.
    """

    force: Force = Field(gt=0, description="force that is held")
    depth: Depth = Field(gt=0, description="envelope: greatest depth of the tip, below the nominal surface")
    duration: Time = Field(
        default=30.0, gt=0, le=3600, description="envelope: duration of force control, with approach"
    )
    speed: Speed = Field(default=0.005, gt=0, le=0.02, description="envelope: highest speed, in and out")
    acceleration: Acceleration = Field(default=0.1, gt=0, le=0.5, description="highest acceleration, in and out")
    stiffness: Stiffness = Field(gt=0, description="stiffest material expected, force per depth")
    response: Time = Field(default=0.3, ge=0.2, description="time constant of the loop in that material")
    clearance: Depth = Field(default=0.002, gt=0, description="height above the nominal surface at both ends")
    standstill: Time = Field(default=1.0, ge=0, description="standstill in free air before and after it")
    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="where [x, y]")
    surface: NominalHeight = Field(default=NominalHeight(), description="nominal surface")

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        """Raise ValueError where the speed is not reached, or the duration is shorter than the ways."""
        way = self.depth + self.clearance
        if way <= self.speed * self._turn:
            raise ValueError(f"speed {self.speed:g} m/s is never reached over a distance of {way:g} m: lower it")
        if self.duration <= 2 * self._way_time:
            raise ValueError(
                f"duration {self.duration:g} s is too short: the way down and up at {self.speed:g} m/s takes up to "
                f"{2 * self._way_time:.3g} s"
            )
        return self

    @property
    def _turn(self) -> float:
        """The duration of a turn from rest to the speed [s]."""
        return _TURN_TIME * self.speed / self.acceleration

    @property
    def _way_time(self) -> float:
        """The duration of the whole way at that speed [s]."""
        return (self.depth + self.clearance) / self.speed + self._turn

    @property
    def force_law(self) -> ForceLaw:
        """The law of the force control."""
        gain = 1.0 / (self.response * self.stiffness)
        begin = self.standstill
        return ForceLaw(
            force=self.force,
            begin=begin,
            end=begin + self.duration,
            speed=self.speed,
            acceleration=self.acceleration,
            gain=gain,
        )

    @cached_property
    def _motion(self) -> PlannedMotion:
        """The envelope: down at constant speed to the greatest depth, there until force control ends, and up."""
        law, turn = self.force_law, self._turn
        # Times [s] at which the tip begins to go down and up, and its depth [m] at the top, where it is in the air.
        down, up = law.begin, law.end
        top = -self.clearance
        turn_way = self.speed * turn / 2  # that of a turn from rest to the speed
        knots = [
            Knot(down, top),
            Knot(down + turn, top + turn_way, self.speed),
            Knot(down + self._way_time - turn, self.depth - turn_way, self.speed),
            Knot(down + self._way_time, self.depth),
            Knot(up, self.depth),
            Knot(up + turn, self.depth - turn_way, -self.speed),
            Knot(up + self._way_time - turn, top + turn_way, -self.speed),
            Knot(up + self._way_time, top),
        ]
        x, y = (rest_profile(value) for value in self.place)
        end = knots[-1].time + self.standstill
        return PlannedMotion(
            duration=end, x=x, y=y, depth=through(knots), measuring=((law.begin, law.end),), surface=self.surface
        )
