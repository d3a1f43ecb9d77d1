"""The ``[design]`` table: which palpations are compared, with which noise, prior knowledge and limits."""

from __future__ import annotations

import math
from typing import Self

from palpate import Acceleration, Force, Frequency, Length, Settings, Speed, Time
from palpate_engine import MotionLimits
from pydantic import Field, model_validator


class DesignLoop(Settings):
    """A position loop: speed command gain (z_d - z) + damping (z_d' - z'), which the speed follows with a lag."""

    gain: float = Field(default=20.0, gt=0, allow_inf_nan=False, description="proportional gain, in 1/s")
    damping: float = Field(default=0.5, ge=0, description="derivative gain")
    lag: Time = Field(default=0.01, ge=0, description="time constant of the inner speed loop")

    def passes(self, frequency: float) -> complex:
        """Motion over command at a frequency [Hz]: (K + D s)/(s (1 + T s) + K + D s)."""
        s = 2j * 3.141592653589793 * frequency
        return (self.gain + self.damping * s) / (s * (1 + self.lag * s) + self.gain + self.damping * s)


class DesignSettings(Settings):
    """Which palpations are compared, with which noise, prior knowledge and limits."""

    parameters: dict[str, float | str] = Field(
        default={}, description="what is expected, by parameter name; left out: the truth of a simulated rig"
    )
    frequencies: tuple[Frequency, ...] = Field(
        default=(0.5, 1.0, 2.0, 3.0, 5.0), min_length=1, description="of the sine"
    )
    amplitudes: tuple[Length, ...] = Field(
        default=(0.0005, 0.001, 0.0015), min_length=1, description="of the sine, as commanded"
    )
    multisines: tuple[tuple[Frequency, ...], ...] = Field(
        default=(), description="sines at once, which share each of the amplitudes between them"
    )
    depth: Length | None = Field(
        default=None, gt=0, description="mean depth; left out: that of the file's trajectory where it measures"
    )
    duration: Time | None = Field(default=None, gt=0, description="left out: that of the file's trajectory")
    rate: Frequency = Field(default=500.0, gt=0, description="rate at which the path is computed")
    force_rate: Frequency | None = Field(
        default=None, gt=0, description="rate of the force; left out: that of its stream, or 500 Hz"
    )
    force_std: Force | None = Field(
        default=None, gt=0, description="noise of the force; left out: that of [run] calibration, or 0.05 N"
    )
    position_rate: Frequency | None = Field(
        default=None, gt=0, description="rate of the position; left out: that of its stream, or 500 Hz"
    )
    position_std: Length | None = Field(
        default=None, ge=0, description="noise of the position; left out: that of [run] calibration, or 5 um"
    )
    velocity_std: Speed | None = Field(
        default=None, ge=0, description="noise of the velocity; left out: that of [run] calibration, or 0.67 mm/s"
    )
    tare_std: Force = Field(default=0.005, gt=0, description="uncertainty of the offset after a tare")
    unknown_bias: Force = Field(default=1.0, gt=0, description="uncertainty of the offset without one")
    timing_std: Time | None = Field(
        default=None,
        gt=0,
        description="uncertainty of the timing once it is known; left out: that of [run] calibration, or none",
    )
    unknown_skew: Time = Field(default=0.3e-3, gt=0, description="uncertainty of the timing without calibration")
    loop: DesignLoop = Field(default=DesignLoop(), description="how the robot follows its command")
    deepest: Length = Field(default=0.01, gt=0, description="limit of the depth")
    top_speed: Speed = Field(default=0.25, gt=0, description="limit of the speed, as commanded")
    top_acceleration: Acceleration = Field(default=5.0, gt=0, description="limit of the acceleration, as commanded")
    top_force: Force = Field(default=50.0, gt=0, description="limit of the force")

    @property
    def limits(self) -> MotionLimits:
        """Of the motion, as commanded."""
        return MotionLimits.of_heights(-self.deepest, math.inf, self.top_speed, self.top_acceleration)

    def within(self, limits: MotionLimits, force: float) -> Self:
        """With the tighter of these limits and others, and of two forces [N]."""
        motion = self.limits.tighter(limits)
        tighter = {
            "deepest": max(-motion.low[2], 0.0),
            "top_speed": motion.speed,
            "top_acceleration": motion.acceleration,
            "top_force": min(self.top_force, force),
        }
        return self.model_copy(update=tighter)

    @model_validator(mode="after")
    def _positive(self) -> Self:
        if any(value <= 0 for value in (*self.frequencies, *self.amplitudes)):
            raise ValueError("frequencies and amplitudes must be positive")
        if any(not group or any(f <= 0 for f in group) for group in self.multisines):
            raise ValueError("multisines must be lists of positive frequencies")
        return self
