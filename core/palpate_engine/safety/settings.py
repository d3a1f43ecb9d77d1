"""The limits of a motion on a live arm, and what stops it: the ``[safety]`` table."""

from __future__ import annotations

import math

from palpate.arm_limits import NO_DEPTH, ArmLimits
from palpate.parts import Settings
from palpate.units import Acceleration, Angle, AngularSpeed, Depth, Force, Length, Speed, Stiffness, Time, Torque
from pydantic import Field, ValidationInfo, field_validator

from palpate_engine.safety.motion_limits import MotionLimits
from palpate_engine.safety.tool_clearance import ToolBody


class SafetySettings(Settings):
    """The ``[safety]`` table: limits of a motion, and what stops it. A live robot does not move without one.

    Between a force of `stop_force` on the skin and the tip at rest lie the time tau, which is the delay of the sensor's
    filter, the age of a reading and the latency, and the braking at deceleration a. Against a material of stiffness K
    the force rises by K (v tau + v^2/2a) in that time: where this exceeds `force` for the fastest inward speed v, the
    motion is refused.
    """

    low: tuple[Length, ...] = Field(
        min_length=3,
        max_length=3,
        description="corner of the workspace box in the work frame; its z is the depth limit",
    )
    high: tuple[Length, ...] = Field(min_length=3, max_length=3, description="the opposite corner")
    depth: Depth | None = Field(
        default=None, gt=0, description="largest depth below a surface that a motion follows, along its normal"
    )
    tool: ToolBody | None = Field(
        default=None, description="what hangs above the tip, to be kept clear of a surface that a motion follows"
    )
    speed: Speed = Field(default=0.05, gt=0, le=1.0, description="fastest tip")
    retract_speed: Speed | None = Field(
        default=None,
        gt=0,
        le=0.25,
        description="fastest tip in a retraction, outwards along the normal, overshoot included; left out: speed",
    )
    acceleration: Acceleration = Field(default=1.0, gt=0, le=50.0, description="largest acceleration of the tip")
    orientation: Angle = Field(
        default=math.radians(5.0),
        gt=0,
        le=0.5,
        description="largest angle between the tool and the normal of work frame or surface, from the start on",
    )
    angular_speed: AngularSpeed = Field(
        default=math.radians(10.0),
        gt=0,
        le=1.0,
        description="fastest turn of the tool, on the way to the start and from place to place",
    )
    force: Force = Field(gt=0, le=1e4, description="force that must not be exceeded")
    stop_force: Force = Field(gt=0, le=1e4, description="force that stops the motion, along any axis, tared")
    torque: Torque = Field(default=3.0, gt=0, le=1e3, description="torque that stops the motion, about any axis, tared")
    stiffness: Stiffness = Field(ge=1.0, le=1e9, description="stiffest material that the tip may meet")
    latency: Time = Field(default=0.05, gt=0, description="longest time from a reading to the beginning of braking")
    sensor_delay: Time | None = Field(
        default=None,
        ge=0,
        le=1.0,
        description="of the sensor's filter; left out: what the force's delay or the device says",
    )
    deceleration: Acceleration = Field(default=1.0, gt=0, description="of braking")
    sensor_timeout: Time = Field(
        default=0.1, gt=0, description="a sensor or robot that is silent for longer stops the motion"
    )
    reading_age: Time = Field(
        default=0.02,
        gt=0,
        le=1.0,
        description="a reading or state that comes later than this, beyond the promptest of the run, stops the motion",
    )
    held_up: Time = Field(
        default=0.5, gt=0, description="this program being held up for longer, by others or by itself, stops the motion"
    )
    standstill: Time = Field(
        default=1.0, ge=0.2, description="standstill in free air before the motion: tare and noise"
    )
    standstill_force: Force = Field(
        default=5.0, gt=0, description="largest reading at standstill, weight and offset together"
    )
    standstill_noise: Force = Field(
        default=0.6, gt=0, description="largest standard deviation of the force at standstill"
    )
    standstill_speed: Speed = Field(
        default=0.005, gt=0, description="largest standard deviation of the velocity at standstill"
    )
    standstill_excess: float = Field(
        default=3.0, gt=1, description="how many times the noise that a filter declares the noise at standstill may be"
    )

    @field_validator("retract_speed")
    @classmethod
    def _not_below_speed(cls, value: float | None, info: ValidationInfo) -> float | None:
        """Return a speed of retraction; raises ValueError where it is below that of the motion."""
        speed = info.data.get("speed")
        if value is not None and speed is not None and value < speed:
            raise ValueError(
                f"{1e3 * value:g} mm/s is below speed = {1e3 * speed:g} mm/s, at which a retraction begins: it is for "
                "leaving faster than that; [device.*] retract_speed is for leaving more slowly"
            )
        return value

    @property
    def reaction(self) -> float:
        """Time [s] from a force on the skin to the beginning of braking: sensor's delay, a reading's age, latency."""
        return self.prompt_reaction + self.reading_age

    @property
    def prompt_reaction(self) -> float:
        """Time [s] likewise where readings come as promptly as they do in a sound rig."""
        return self.latency + (self.sensor_delay or 0.0)

    def overshoot(self, speed: float) -> float:
        """Force [N] by which the limit is overrun at an inward speed [m/s]: K (v tau + v^2/2a)."""
        return self.stiffness * (speed * self.reaction + speed**2 / (2.0 * self.deceleration))

    def excess(self, peak: float) -> str | None:
        """Return by how much a force [N] passed `force`, in words; None where it did not."""
        if peak <= self.force:
            return None
        return f"the force reached {peak:.1f} N, {peak - self.force:.1f} N over [safety] force = {self.force:g} N"

    @property
    def rise_window(self) -> float:
        """Way [m] inwards within which the force has to rise: half of what lies between `stop_force` and `force`."""
        return (self.force - self.stop_force) / (2.0 * self.stiffness)

    @property
    def motion(self) -> MotionLimits:
        """Limits of the motion alone, without the force."""
        return MotionLimits(self.low, self.high, self.speed, self.acceleration)

    @property
    def fastest(self) -> float:
        """Inward speed [m/s] at which the overshoot just fits between `stop_force` and `force`."""
        braking_way = max(self.force - self.stop_force, 0.0) / self.stiffness
        a, tau = self.deceleration, self.reaction
        return a * (math.sqrt(tau**2 + 2.0 * braking_way / a) - tau)

    @property
    def of_an_arm(self) -> ArmLimits:
        """Limits that an arm has to keep by itself."""
        depth = NO_DEPTH if self.depth is None else self.depth
        limits = self.low, self.high, self.speed, self.acceleration, self.orientation, self.angular_speed
        return ArmLimits(*limits, depth, self.reading_age, self.retract_speed or 0.0)
