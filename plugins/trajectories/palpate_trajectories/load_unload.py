"""Loading and unloading at constant speed, by cycles."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from palpate import Depth, Length, Speed, Time
from pydantic import Field, model_validator

from palpate_trajectories.motion_parts import TOP_SPEED, PlannedMotion, through
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.planned_trajectory import PlannedTrajectory
from palpate_trajectories.smooth_profile import TURN, Knot, rest_profile


class LoadUnload(PlannedTrajectory):
    """Down to a depth and up again at constant speed, in cycles, at one speed after the other.

    Speed is constant but for the turns, which take `turn` each; the deepest point is exactly `depth`. All of the motion
    is measured.
    """

    depth: Depth = Field(gt=0, description="deepest point, below the nominal surface")
    speeds: tuple[Speed, ...] = Field(default=(0.006,), min_length=1, description="speeds, one after the other")
    cycles: int = Field(default=1, ge=1, le=1000, description="cycles at each speed")
    turn: Time = Field(default=0.1, gt=0, description="duration of each turn, and of starting and stopping")
    clearance: Depth = Field(default=0.005, gt=0, description="height above the nominal surface to which it returns")
    standstill: Time = Field(
        default=1.0, ge=0, description="standstill in free air before the first cycle, for the tare"
    )
    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="where [x, y]")
    surface: NominalHeight = Field(default=NominalHeight(), description="nominal surface")

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        refuse_speeds(self.speeds, self.depth + self.clearance, self.turn)
        return self

    @cached_property
    def _motion(self) -> PlannedMotion:
        return loading_cycles(self, [speed for speed in self.speeds for _ in range(self.cycles)], self.depth, 0.0)


class Compression(PlannedTrajectory):
    """Compression to a strain of a known thickness at constant speed, held, and released: a dynamometer's protocol.

    Defaults are the paper's: 50 mm/min to 10 % of 22 mm.
    """

    thickness: Depth = Field(default=0.022, gt=0, description="height of the specimen")
    strain: float = Field(default=0.1, gt=0, lt=1, allow_inf_nan=False, description="largest compression of it, 0 to 1")
    speed: Speed = Field(default=0.05 / 60, gt=0, description="speed down and up")
    hold: Time = Field(default=0.0, ge=0, description="rest at the deepest point, for relaxation")
    turn: Time = Field(default=0.1, gt=0, description="duration of each turn, and of starting and stopping")
    clearance: Depth = Field(default=0.001, gt=0, description="height above the nominal surface at both ends")
    standstill: Time = Field(default=1.0, ge=0, description="standstill in free air before it, for the tare")
    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="where [x, y]")
    surface: NominalHeight = Field(default=NominalHeight(), description="nominal surface")

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        refuse_speeds((self.speed,), self.thickness * self.strain + self.clearance, self.turn)
        return self

    @cached_property
    def _motion(self) -> PlannedMotion:
        return loading_cycles(self, [self.speed], self.thickness * self.strain, self.hold)


def refuse_speeds(speeds: tuple[float, ...], way: float, turn: float) -> None:
    """Raise ValueError where a speed is not positive or is never reached between two turns."""
    for speed in speeds:
        if speed <= 0 or speed > TOP_SPEED:
            raise ValueError(f"speed {speed:g} m/s must be above 0 and at most {TOP_SPEED:g} m/s")
        if way <= speed * turn:
            raise ValueError(f"speed {speed:g} m/s is never reached: its turns of {turn:g} s take all of {way:g} m")


def loading_cycles(settings: LoadUnload | Compression, speeds: list[float], depth: float, hold: float) -> PlannedMotion:
    """Return cycles down to a depth [m], with a hold [s] at the bottom, from and to rest at the clearance.

    There is a cycle for each of the speeds [m/s]. A turn from a speed to its opposite without a hold goes `TURN` times
    speed and duration beyond the place where it begins.
    """
    turn, top = settings.turn, -settings.clearance
    time = settings.standstill
    knots = [Knot(time, top)]
    for speed in speeds:
        # From rest to the speed.
        turn_way = speed * turn / 2  # at half of it on average
        knots.append(Knot(time + turn, top + turn_way, speed))
        time += turn
        # A turn reaches beyond the place where it begins; with a hold it stops, and takes two halves of a move.
        bottom = depth - (TURN * speed * turn if hold == 0 else turn_way)
        time += (bottom - top - turn_way) / speed
        knots.append(Knot(time, bottom, speed))
        if hold > 0:
            knots += [Knot(time + turn, depth), Knot(time + turn + hold, depth)]
            time += turn + hold
        # Up again, and to rest.
        knots.append(Knot(time + turn, bottom, -speed))
        time += turn + (bottom - top - turn_way) / speed
        knots.append(Knot(time, top + turn_way, -speed))
        time += turn
        knots.append(Knot(time, top))
    x, y = (rest_profile(value) for value in settings.place)
    return PlannedMotion(
        duration=time,
        x=x,
        y=y,
        depth=through(knots),
        measuring=((settings.standstill, time),),
        surface=settings.surface,
    )
