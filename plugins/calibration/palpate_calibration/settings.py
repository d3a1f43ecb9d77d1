"""The ``[calibration]`` table: steps, limits and uncertainties of a calibration."""

from __future__ import annotations

import math
from typing import Literal, Self

from palpate import Acceleration, Angle, Device, Force, Frequency, Length, Mass, Settings, Speed, Time, Trajectory
from palpate_engine import MotionLimits
from pydantic import Field, model_validator


class TypeB(Settings):
    """Standard uncertainties that are known otherwise than by repeating (type B)."""

    mass: Mass = Field(default=0.0, ge=0, description="of the mass, such as that of the position's scale")
    delay: Time = Field(default=0.0, ge=0, description="of the delay, such as that of two clocks")
    offset: Force = Field(default=0.0, ge=0, description="of the reading at standstill")


class StepSettings(Settings):
    """One step of a guided calibration."""

    repeats: int | None = Field(
        default=None, ge=1, le=100, description="number of repeats; left out: that of [calibration]; a log has its own"
    )
    trajectory: Trajectory | None = Field(default=None, description="the motion, where a device moves for it")
    device: dict[str, Device] = Field(
        default={}, description="devices of this step, such as a recorded log; left out: those of the file"
    )


_TILT = math.radians(40.0)
_FOUR = (
    (0.0, 0.0, -1.0),
    (math.sin(_TILT), 0.0, -math.cos(_TILT)),
    (0.0, math.sin(_TILT), -math.cos(_TILT)),
    (-math.sin(_TILT), 0.0, -math.cos(_TILT)),
)


class Orientations(Settings):
    """The step in which the tool is turned: weight and centre of mass of the load behind the sensor."""

    repeats: int | None = Field(default=None, ge=1, le=100, description="number of repeats of all of them; a log: once")
    trajectory: Trajectory | None = Field(default=None, description="the motion, where a device moves for it")
    device: dict[str, Device] = Field(default={}, description="devices of this step; left out: those of the file")
    down: tuple[tuple[float, ...], ...] = Field(
        default=_FOUR,
        min_length=3,
        description="direction of gravity in the sensor's frame, in each orientation; left out: four, or by the poses "
        "of an arm that turned the tool",
    )
    angle_std: Angle = Field(
        default=math.radians(0.5), ge=0, description="standard uncertainty of each direction, about each of two axes"
    )
    duration: Time = Field(
        default=3.0, ge=1.0, description="standstill in each orientation, where the tool is turned by hand"
    )

    @model_validator(mode="after")
    def _directions(self) -> Self:
        for direction in self.down:
            if len(direction) != 3 or abs(math.hypot(*direction) - 1.0) > 0.02:
                raise ValueError(f"down: {list(direction)} is not a direction: three numbers whose squares add up to 1")
        return self


STEPS: dict[str, str] = {  # in the order in which they are done
    "standstill": "the tip hangs free and stays where it is: offset, drift and noise",
    "orientations": "the tool is turned and stands still: weight and centre of mass of the load behind the sensor",
    "shake": "the tip is shaken in free air: mass, and time between force and motion",
    "noise": "the tip oscillates in free air: noise of the velocity while it moves",
    "tap": "the tip taps on a stiff plate: time between force and motion again",
    "press": "the tip presses on a stiff plate: compliance of robot and sensor",
}
ON_A_PLATE = ("tap", "press")


class CalibrationSettings(Settings):
    """A calibration, by the steps that are named or, where none is, standstill and shake in one motion."""

    standstill: StepSettings | None = Field(default=None, description=STEPS["standstill"])
    orientations: Orientations | None = Field(default=None, description=STEPS["orientations"])
    shake: StepSettings | None = Field(default=None, description=STEPS["shake"])
    noise: StepSettings | None = Field(default=None, description=STEPS["noise"])
    tap: StepSettings | None = Field(default=None, description=STEPS["tap"])
    press: StepSettings | None = Field(default=None, description=STEPS["press"])

    trajectory: Trajectory | None = Field(
        default=None, description="the motion in free air; left out: the file's only [trajectory.*]"
    )
    motion: Literal["shake", "plate"] = Field(
        default="shake",
        description='"shake": in free air; "plate": pressed on a rigid plate, for a second delay and the compliance',
    )
    repeats: int = Field(default=3, ge=1, le=100, description="number of repeats of the motion")
    frequencies: tuple[Frequency, ...] = Field(
        default=(), description="frequencies of the shake; left out: those found in the motion"
    )
    settle: Time = Field(default=0.2, ge=0, description="part of each shake's beginning left for the robot to settle")
    gravity: bool = Field(
        default=True,
        description="the force is along gravity, so that the mass has a weight in the reading at standstill",
    )
    type_b: TypeB = Field(default=TypeB(), description="standard uncertainties that repeats do not show")
    top_speed: Speed = Field(default=0.25, gt=0, description="limit of the motion's speed")
    top_acceleration: Acceleration = Field(default=10.0, gt=0, description="limit of its acceleration")
    lowest: Length = Field(default=0.001, description="limit of its height over the work frame's origin, the skin")
    highest: Length = Field(default=0.3, description="upper limit of its height")
    deepest: Length = Field(default=0.001, ge=0, description="how far below the skin's height a tap or a press may aim")

    def limits(self, contact: bool) -> MotionLimits:
        """Return the limits of a motion in free air, or of one in contact with a plate."""
        low = -self.deepest if contact else self.lowest
        return MotionLimits.of_heights(low, self.highest, self.top_speed, self.top_acceleration)

    @property
    def steps(self) -> dict[str, StepSettings | Orientations]:
        """Named steps, in their order."""
        steps: dict[str, StepSettings | Orientations | None] = {name: getattr(self, name) for name in STEPS}
        return {name: step for name, step in steps.items() if step is not None}

    @model_validator(mode="after")
    def _frequencies_are_some(self) -> Self:
        if any(frequency <= 0 for frequency in self.frequencies):
            raise ValueError("frequencies must be positive")
        return self
