"""The ``[alignment]`` table: the channels of force, position and velocity, and the facts that are known of them."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, WithJsonSchema, field_validator, model_validator
from pydantic_core import PydanticCustomError

from palpate.parts import Settings
from palpate.surface import Surface
from palpate.units import Angle, Delay, Force, ForceDrift, Quantity, Stiffness, Time, TipMass, quantity_schema, to_si

# The unit of a role's channel; a channel of undeclared unit ("1") is accepted.
SIGNAL_UNITS = {"force": "N", "position": "m", "velocity": "m/s"}
_DIRECTION_STD = math.radians(2.0)  # a choice: standard uncertainty of a direction without a declared one
_DIRECTION_RANGE = (1e-6, 1e6)  # a choice: lengths of three numbers that are a direction
_MAX_FORCE = 500.0  # [N], a choice: a larger number without a unit was meant in another one


class Signal(Settings):
    """One channel in one role; a plain text is short for ``{ channel = "..." }``."""

    channel: str = Field(description='device, stream and column, such as "rig.wrench.z"')
    sign: Literal[1, -1] = Field(default=1, description="-1 where the channel counts the other way round")
    delay: Delay = Field(default=0.0, description="declared lateness: the true time is the time-stamp minus this")
    uncertainty: Delay | None = Field(
        default=None, ge=0, description="standard uncertainty of the delay; undeclared: unknown"
    )
    measured: bool = Field(default=False, description="of a position: it is stated to be measured, and no command")
    time: Literal["stamp", "received"] = Field(
        default="stamp", description="the stream's own time-stamps, or host arrival"
    )

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, data: Any) -> Any:
        return {"channel": data} if isinstance(data, str) else data


_TOUCH = {"anyOf": [{"enum": ["noise"]}, quantity_schema("N"), {"type": "null"}]}
_TARE = {"anyOf": [{"enum": ["free-air", "none", "calibrated"]}, quantity_schema("N")]}


class AlignmentSettings(Settings):
    """The table: channels of the samples, and the facts of rig and record that turn streams into samples."""

    force: Signal = Field(description="force along the surface normal, positive where it pushes the tip out")
    position: Signal = Field(
        description="height of the tip, positive out of the material; its stream sets the instants"
    )
    velocity: Signal | None = Field(
        default=None, description="velocity of that height; left out: central difference of it"
    )
    measuring: Signal | None = Field(default=None, description="above 0.5 while the motion is meant for estimation")
    lateral_x: Signal | None = Field(default=None, description="x of the tip along the surface, for sweeps and maps")
    lateral_y: Signal | None = Field(default=None, description="y of the tip along the surface, for sweeps and maps")
    tip_mass: TipMass | None = Field(
        default=None, ge=0, description="mass of all that hangs behind the sensor; 0 where it is known to be nothing"
    )
    tip_mass_uncertainty: TipMass | None = Field(default=None, ge=0, description="its standard uncertainty")
    weight: Literal["tared", "removed", "turning"] = Field(
        default="tared",
        description='"tared": the tare or the recording took it; "removed": subtract tip_mass times gravity; '
        '"turning": subtract it as it turns with the tool, by the orientation in the stream of the position',
    )
    mounting: tuple[Angle, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="rotation vector of the sensor on the tool, whose z looks at the skin; left out: its z looks out "
        'of the skin, ["180 deg", 0, 0], where the force has sign = 1, else as the tool',
    )
    mounting_uncertainty: Angle | None = Field(
        default=None, ge=0, description="standard uncertainty of it about each axis; left out: 2 deg"
    )
    euler: str | None = Field(
        default=None,
        pattern="^(?:XYZ|XZY|YXZ|YZX|ZXY|ZYX|xyz|xzy|yxz|yzx|zxy|zyx)$",
        description='order of the turns of a pose with roll, pitch and yaw, about x, y and z: "ZYX" about the axes as '
        'they turn, "zyx" about those that stand still',
    )
    gravity: tuple[float, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="direction of gravity in the frame of the tool's pose; left out: what the arm says, or [0, 0, -1]",
    )
    normal: tuple[float, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="outward normal of the skin in the frame of the tool's pose: force and motion along it are used, "
        "from all three axes; left out: the axes that force, position and velocity name",
    )
    surface: Surface | None = Field(
        default=None,
        description="surface over which the tip goes: force and motion along its normal at each place are used, "
        "and the height is that above it",
    )
    normal_uncertainty: Angle | None = Field(
        default=None, ge=0, description="standard uncertainty of its direction, about each axis; left out: 2 deg"
    )
    bias: tuple[Force, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="reading of the sensor's three axes without load and weight, for a tool that turns; left out: that "
        'of a calibration where tare = "calibrated", else none',
    )
    series_stiffness: Stiffness | None = Field(
        default=None,
        gt=0,
        description="stiffness of robot and sensor, which yield before the material; its effect is reported",
    )
    beam: Stiffness | None = Field(
        default=None,
        gt=0,
        description="stiffness of the beam or spring between a stage, whose height the position is, and the tip: what "
        "it yields by under the force is added to the height",
    )
    beam_uncertainty: Stiffness | None = Field(
        default=None, ge=0, description="standard uncertainty of the stiffness of the beam"
    )
    tare: Annotated[float | Literal["free-air", "none", "calibrated"], WithJsonSchema(_TARE)] = Field(
        default="free-air",
        description='"free-air": mean of the first tare_duration, at rest in air; "calibrated": the offset of '
        '[run] calibration; "none"; or a force',
    )
    tare_uncertainty: Force | None = Field(
        default=None, ge=0, description="standard uncertainty of a tare that is a force"
    )
    tare_duration: Time = Field(
        default=0.9, gt=0, description="length of the free-air window at the beginning of the record"
    )
    touch_lag: Time = Field(
        default=0.5,
        ge=0,
        le=0.5,
        description="how long samples are held back until the first touch, to find where contact began; 0: contact "
        "begins where the force passes touch_force",
    )
    touch_force: Annotated[float | Literal["noise"] | None, WithJsonSchema(_TOUCH)] = Field(
        default=None,
        description='force that counts as touch; "noise": what neither drift, nor travel, nor inertia explains within '
        "10 sigma of the record's air, where that is less than 0.05 N; left out: the same where tip_mass is 0, else "
        "5 sigma of the free air, or 0.25 N",
    )
    drift: ForceDrift = Field(
        default=1.5 / 3600,
        ge=0,
        description="what the sensor's zero may drift by, which touch_force grows by; 1.5 N/h is a six-axis sensor's; "
        "by the air itself where tip_mass is 0 and 10 sigma are less than 0.05 N",
    )
    force_limit: Force | None = Field(
        default=None, gt=0, description="readings at or beyond this magnitude are saturated"
    )
    gap: Time = Field(
        default=0.02, gt=0, description="a longer pause between readings is a gap; nothing is interpolated over it"
    )

    @property
    def timing_uncertainty(self) -> float | None:
        """The standard uncertainty [s] of the time between force and motion; None where neither side declares any."""
        force, motion = self.force.uncertainty, (self.velocity or self.position).uncertainty
        return None if force is None and motion is None else math.hypot(force or 0.0, motion or 0.0)

    @property
    def zero_uncertainty(self) -> float | None:
        """The standard uncertainty [N] that is stated of the zero of the force; None where free air determines it."""
        return None if self.tare == "free-air" else self.tare_uncertainty

    @property
    def force_zero(self) -> Literal["air", "stated", "open"]:
        """The source of the zero of the force: the record's own air, a statement, or none.

        A force as it was recorded whose zero has an uncertainty is one that was zeroed, which states it.
        """
        if self.tare == "free-air":
            return "air"
        return "open" if self.tare == "none" and self.tare_uncertainty is None else "stated"

    @property
    def orientation_uncertainties(self) -> dict[str, tuple[float, bool]]:
        """The standard uncertainty [rad] of mounting and normal, as far as used, and True for a declared one."""
        stated = {"mounting": self.mounting_uncertainty} if self.is_oriented else {}
        stated |= {"normal": self.normal_uncertainty} if self.is_projecting else {}
        uncertainties = dict[str, tuple[float, bool]]()
        for name, std in stated.items():
            uncertainties[name] = (_DIRECTION_STD if std is None else std, std is not None)
        return uncertainties

    @property
    def is_oriented(self) -> bool:
        """True if samples depend on the tool's orientation."""
        return self.weight == "turning" or self.is_projecting

    @property
    def is_projecting(self) -> bool:
        """True if force and motion are those along a stated normal."""
        return self.normal is not None or self.surface is not None

    @model_validator(mode="after")
    def _check_normal(self) -> AlignmentSettings:
        """Raise ValueError for a normal and a surface, and for a beam under a tool that turns or has a velocity."""
        if self.normal is not None and self.surface is not None:
            raise ValueError("give either normal or surface")
        if self.beam is not None and (self.is_oriented or self.velocity is not None):
            raise ValueError(
                "beam: is for a tool that does not turn, and whose velocity is that of its height: leave it out"
            )
        return self

    @field_validator("gravity", "normal")
    @classmethod
    def _check_direction(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        shortest, longest = _DIRECTION_RANGE
        if value is not None and not shortest < math.hypot(*value) < longest:
            raise ValueError("must be a direction: three finite numbers that are not all 0")
        return value

    @field_validator("tare", mode="before")
    @classmethod
    def _read_tare(cls, value: Any) -> Any:
        return _force_or_word(value, ("free-air", "calibrated", "none"), "1.8 N")

    @field_validator("touch_force", mode="before")
    @classmethod
    def _read_touch(cls, value: Any) -> Any:
        force = None if value is None else _force_or_word(value, ("noise",), "0.5 N")
        if isinstance(force, float) and not force > 0.0:
            raise PydanticCustomError("tare", "{reason}", {"reason": "must be greater than 0 N"})
        return force


def _force_or_word(value: Any, allowed_words: tuple[str, ...], example: str) -> Any:
    """Return a force [N], or one of `allowed_words`; raises PydanticCustomError."""
    if value in allowed_words:
        return value
    try:
        force = to_si(value, "N")
    except ValueError as error:
        allowed = ", ".join(f'"{word}"' for word in allowed_words)
        reason = f'{value!r} is not one of {allowed} and a force such as "{example}"'
        raise PydanticCustomError("tare", "{reason}", {"reason": reason}) from error
    if not isinstance(value, str) and (doubt := Quantity("N", most=_MAX_FORCE).doubt(force)):
        raise PydanticCustomError("tare", "{reason}", {"reason": doubt})
    return force
