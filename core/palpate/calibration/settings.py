"""The ``[calibration]`` table: how a calibration is done, and what nobody can measure there."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from palpate.parts import Settings
from palpate.trajectory import Trajectory
from palpate.units import Acceleration, Force, Frequency, Length, Mass, Speed, Time


class TypeB(Settings):
    """Standard uncertainties that are known otherwise than by repeating (type B)."""

    mass: Mass = Field(default=0.0, ge=0, description="of the mass, such as that of the position's scale")
    delay: Time = Field(default=0.0, ge=0, description="of the delay, such as that of two clocks")
    offset: Force = Field(default=0.0, ge=0, description="of the reading at rest")


class CalibrationSettings(Settings):
    """How a calibration is done."""

    trajectory: Trajectory | None = Field(
        default=None, description="the motion in free air; left out: the file's only [trajectory.*]"
    )
    motion: Literal["shake", "plate"] = Field(
        default="shake",
        description='"shake": in free air; "plate": pressed on a rigid plate, for a second delay and the compliance',
    )
    repeats: int = Field(default=3, ge=1, le=100, description="how often the motion is repeated")
    frequencies: tuple[Frequency, ...] = Field(
        default=(), description="frequencies of the shake; left out: those found in the motion"
    )
    settle: Time = Field(
        default=0.2, ge=0, description="how much of each shake's beginning is left to the robot to settle"
    )
    gravity: bool = Field(
        default=True, description="the force is along gravity, so that the mass has a weight in the reading at rest"
    )
    type_b: TypeB = Field(default=TypeB(), description="standard uncertainties that no repeat shows")
    top_speed: Speed = Field(default=0.25, gt=0, description="limit of the motion's speed")
    top_acceleration: Acceleration = Field(default=10.0, gt=0, description="limit of its acceleration")
    lowest: Length = Field(default=0.001, description="limit of its height over the work frame's origin, the skin")
    highest: Length = Field(default=0.3, description="upper limit of its height")

    @model_validator(mode="after")
    def _frequencies_are_some(self) -> Self:
        if any(frequency <= 0 for frequency in self.frequencies):
            raise ValueError("frequencies must be positive")
        return self
