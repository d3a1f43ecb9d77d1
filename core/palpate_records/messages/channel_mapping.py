"""The mapping of numbers of topics to the channels of a device."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from palpate import Floats, Settings
from pydantic import Field, model_validator

from palpate_records.messages.readings import FieldReading, si_unit


class Orientation(Settings):
    """The pose whose quaternion turns the frame of a vector into the fixed frame."""

    topic: str = Field(min_length=1, description='topic, such as "/tcp_pose_broadcaster/pose"')
    field: str = Field(default="pose.orientation", min_length=1, description="path to the quaternion x, y, z, w")


class MappedSignal(Settings):
    """One channel: a number in the messages of one topic. Its sign and its delay belong into [alignment]."""

    topic: str = Field(min_length=1, description='topic, such as "/ft_sensor/wrench"')
    field: str = Field(min_length=1, description='path to the number, such as "wrench.force.z" or "data"')
    index: int | None = Field(default=None, ge=0, description="which element, where the field is an array")
    select: str | None = Field(default=None, description="joint (JointState) or child frame (TFMessage) of the number")
    unit: str = Field(default="1", description='unit of the recorded number, such as "mm" or "N"')
    direction: tuple[float, float, float] | None = Field(
        default=None, description="field is a vector x, y, z; the channel is its component along this direction"
    )
    orientation: Orientation | Literal["kinematics"] | None = Field(
        default=None,
        description="the pose that rotates the vector's frame, or the kinematics; direction is then in its frame",
    )
    scale: float = Field(default=1.0, description="factor on the recorded number, for readings in counts")

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        """Raise ValueError for a unit, scale or direction without a meaning, and for contradicting keys."""
        si_unit(self.unit)
        if not (np.isfinite(self.scale) and self.scale != 0.0):
            raise ValueError("scale must be a finite number other than 0")
        if self.direction is not None and not 0 < np.linalg.norm(self.direction) < np.inf:
            raise ValueError("direction must not be of length 0")
        if self.direction is not None and self.index is not None:
            raise ValueError("direction takes the whole vector: leave out index")
        if self.orientation is not None and self.direction is None:
            raise ValueError("orientation needs a direction")
        return self

    @property
    def readings(self) -> tuple[FieldReading, ...]:
        """The numbers to read: one, or the three of a vector."""
        if self.direction is not None:
            return tuple(FieldReading(f"{self.field}.{axis}", None, self.select) for axis in "xyz")
        return (FieldReading.parse(self.field, self.index, self.select),)

    @property
    def unit_vector(self) -> Floats | None:
        """The direction with length 1; None for a field that is a number."""
        return None if self.direction is None else np.array(self.direction) / np.linalg.norm(self.direction)


class TimeField(Settings):
    """The time as a number in the same messages."""

    field: str = Field(min_length=1, description="path to the number")
    index: int | None = Field(default=None, ge=0, description="which element, where the field is an array")
    unit: str = Field(default="s", description="its unit")

    @model_validator(mode="after")
    def _a_time(self) -> Self:
        if si_unit(self.unit)[0] != "s":
            raise ValueError(f"{self.unit!r} is not a unit of time")
        return self


Clock = Literal["stamp", "log", "publish"] | TimeField
