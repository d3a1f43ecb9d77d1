"""The way of the tip onto the skin and off it, for every motion that palpates by a sine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from palpate import Depth, Frequency, Settings, Speed, Time
from pydantic import Field, model_validator

from palpate_trajectories.motion_parts import TOP_SPEED, PlannedMotion, through
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.oscillation import together
from palpate_trajectories.smooth_profile import Knot, KnotProfile, profile
from palpate_trajectories.surface_motion import Footway, SurfaceMotion

_MIN_PERIODS = 4.0  # of the sine, a choice: in a line that lasts fewer an estimate has too little to follow


class PressShape(Settings):
    """A sine around a depth, and the way to it and back."""

    bias: Depth = Field(gt=0, description="depth around which the sine goes, below the nominal surface")
    amplitude: Depth = Field(default=0.001, gt=0, description="amplitude of the sine")
    frequency: Frequency = Field(default=2.0, gt=0, description="frequency of the sine")
    clearance: Depth = Field(default=0.005, gt=0, description="height above the nominal surface in free air")
    standstill: Time = Field(
        default=1.0, ge=0, description="standstill in free air before the first approach, for the tare"
    )
    speed: Speed = Field(default=0.01, gt=0, description="mean speed of approach and retraction")

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        if self.amplitude >= self.bias:
            raise ValueError(f"amplitude {self.amplitude:g} m must be smaller than bias {self.bias:g} m")
        speed = 2 * math.pi * self.frequency * self.amplitude
        if speed > TOP_SPEED:
            raise ValueError(f"the sine moves at {speed:.3g} m/s, allowed {TOP_SPEED:g}: lower amplitude or frequency")
        return self

    @property
    def transfer(self) -> float:
        """The duration of an approach, and of a retraction [s]."""
        return (self.clearance + self.bias) / self.speed


@dataclass(frozen=True)
class Touch:
    """One stay on the skin."""

    begin: float  # [s], when the sine is at full swing and crosses the bias inwards
    end: float  # [s], when the retraction begins


def press_motion(
    press: PressShape,
    touches: Sequence[Touch],
    x: list[Knot],
    y: list[Knot],
    measuring: Sequence[tuple[float, float]],
    surface: NominalHeight,
) -> PlannedMotion:
    """Return the motion that touches the skin at given times while it moves along a path.

    `x` and `y` are the knots of the path, `measuring` the intervals [s] whose samples are estimated from. Between two
    touches the tip is `press.clearance` above the surface; during one it presses by `press.bias`, with the sine on top,
    whose amplitude `swell` takes from 0 to 1 and back.
    """
    return PlannedMotion(
        duration=touches[-1].end + press.transfer,
        x=through(x),
        y=through(y),
        depth=_touch_profile(touches, press.transfer, -press.clearance, press.bias),
        measuring=tuple(measuring),
        surface=surface,
        swell=_touch_profile(touches, press.transfer, 0.0, 1.0),
        wave=together([press.amplitude], [press.frequency]),
        wave_start=touches[0].begin,
    )


def surface_press(
    press: PressShape, touches: Sequence[Touch], footway: Footway, measuring: Sequence[tuple[float, float]]
) -> SurfaceMotion:
    """Return the motion that touches a surface at given times while its foot moves along a path."""
    return SurfaceMotion(
        duration=touches[-1].end + press.transfer,
        footway=footway,
        depth=_touch_profile(touches, press.transfer, -press.clearance, press.bias),
        measuring=tuple(measuring),
        swell=_touch_profile(touches, press.transfer, 0.0, 1.0),
        wave=together([press.amplitude], [press.frequency]),
        wave_start=touches[0].begin,
    )


def _touch_profile(touches: Sequence[Touch], transfer: float, away: float, touching: float) -> KnotProfile:
    """Return the profile that changes from `away` to `touching` before every touch, and back after it."""
    knots = []
    for touch in touches:
        knots += [Knot(touch.begin - transfer, away), Knot(touch.begin, touching)]
        knots += [Knot(touch.end, touching), Knot(touch.end + transfer, away)]
    return profile(knots)


def refuse_hasty(press: PressShape, way: float, speed: float) -> None:
    """Raise ValueError where a line is over before the sine has measured it."""
    if way * press.frequency < _MIN_PERIODS * speed:
        raise ValueError(
            f"speed: at {speed:g} m/s a line of {way:g} m lasts {way * press.frequency / speed:.2g} periods of the "
            f"sine, which cannot follow; at least {_MIN_PERIODS:g} are needed: go slower, or raise the frequency"
        )
