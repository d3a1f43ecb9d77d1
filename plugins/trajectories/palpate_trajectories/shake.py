"""A shake in free air, for calibration."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Depth, Floats, Frequency, Length, Setpoint, Time, Trajectory
from pydantic import Field, model_validator


class Shake(Trajectory):
    """A sine or several at once, along the tip's axis and in free air: standstill, shake, standstill.

    z(t) = height + w(t) sum_k A sin(2 pi f_k t + phi_k), w a fifth-order ramp from 0 to 1 and back, so that position,
    velocity and acceleration are continuous; phases phi_k = pi k (k + 1)/n keep the peaks of a multi-sine low
    (Schroeder 1970). The measured part begins `settle` after the full amplitude is reached. From such a motion follow
    the tip's mass, u = m d'' (paper, mass identification), and the time between force and motion.
    """

    frequencies: tuple[Frequency, ...] = Field(
        default=(5.0,), min_length=1, max_length=6, description="frequency of each sine"
    )
    amplitude: Depth = Field(default=0.003, gt=0, description="amplitude of each sine, as commanded")
    height: Length = Field(default=0.05, gt=0, description="height above the nominal surface around which it goes")
    duration: Time = Field(default=10.0, gt=0, description="length of the measured part")
    settle: Time = Field(default=0.5, ge=0, description="full amplitude before the measured part, for the robot")
    ramp: Time = Field(default=1.0, gt=0, description="length of the rise to the full amplitude, and of the fall")
    standstill: Time = Field(
        default=1.5, ge=0, description="standstill in free air before and after, for offset and noise"
    )

    @model_validator(mode="after")
    def _check_height(self) -> Any:
        """Raise ValueError where the sines could lower the tip to the skin."""
        if any(frequency <= 0 for frequency in self.frequencies):
            raise ValueError("frequencies must be positive")
        # The sines are at their peaks together in the worst case.
        lowest = self.height - len(self.frequencies) * self.amplitude
        if lowest <= 0:
            raise ValueError(f"height {self.height:g} m lowers the tip to {lowest:g} m: it must stay in air")
        return self

    @property
    def total_duration(self) -> float:
        """The time from rest to rest [s]."""
        return 2 * self.standstill + 2 * self.ramp + self.settle + self.duration

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints (n, 3): z = height + w(t) a sum sin(2 pi f_k t + phi_k), w with smooth ramps."""
        # The window w and its slope.
        t = np.asarray(time, float) - self.standstill
        fall_begins = self.ramp + self.settle + self.duration
        rise, rise_slope = _smooth_step(t / self.ramp)
        fall, fall_slope = _smooth_step((fall_begins + self.ramp - t) / self.ramp)
        window, slope = rise * fall, (rise_slope * fall - rise * fall_slope) / self.ramp
        wave, rate = self._sines(t)
        # Height and its derivative, by the product rule.
        position, velocity = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        position[:, 2] = self.height + window * wave
        velocity[:, 2] = window * rate + slope * wave
        return Setpoint(position, velocity, (t >= self.ramp + self.settle) & (t < fall_begins))

    def _sines(self, t: Floats) -> tuple[Floats, Floats]:
        """Return the sum of the sines [m] and its rate [m/s], each (n,), at times (n,) [s] since the shake begins."""
        wave, rate = np.zeros_like(t), np.zeros_like(t)
        for k, frequency in enumerate(self.frequencies):
            omega = 2 * np.pi * frequency
            phase = np.pi * k * (k + 1) / len(self.frequencies)  # Schroeder 1970
            wave += self.amplitude * np.sin(omega * t + phase)
            rate += self.amplitude * omega * np.cos(omega * t + phase)
        return wave, rate


def _smooth_step(x: Floats) -> tuple[Floats, Floats]:
    """Return the fifth-order step from 0 at x = 0 to 1 at x = 1, at rest at both ends, and its slope.

    s = 10 x^3 - 15 x^4 + 6 x^5, the only one whose slope s' = 30 x^2 (1 - x)^2 and second derivative are 0 at both.
    """
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2
