"""The shape of a simulated skin: tilt, random roughness."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from palpate import Angle, Floats, Length, Settings
from pydantic import Field

WAVES = 64
_STEEPEST = np.deg2rad(30.0)


def plane_waves(seed: int, length: float) -> tuple[Floats, Floats]:
    """Wave numbers (64, 2) [1/m] and phases (64,) of cosines whose sum has the covariance exp(-r^2/(2 length^2))."""
    dice = np.random.default_rng(seed)
    numbers = dice.standard_normal((WAVES, 2)) / length
    return numbers, dice.uniform(0.0, 2 * np.pi, WAVES)


class Relief(Settings):
    """Height of the skin over its level: a tilt and a smooth random roughness.

    Roughness is a sum of 64 plane cosines of random direction and phase whose wave numbers are drawn from a normal
    distribution of standard deviation 1/length in each axis: a stationary random field with the covariance
    std^2 exp(-r^2/(2 length^2)), smooth, and known with its slopes everywhere. One seed is one skin.
    """

    tilt_x: Angle = Field(default=0.0, ge=-_STEEPEST, le=_STEEPEST, description="rise towards positive x")
    tilt_y: Angle = Field(default=0.0, ge=-_STEEPEST, le=_STEEPEST, description="rise towards positive y")
    roughness: Length = Field(default=0.0, ge=0, description="standard deviation of the random height")
    length: Length = Field(default=0.01, gt=0, description="correlation length of the random height")
    seed: int = Field(default=0, ge=0, description="which of all such skins")

    @cached_property
    def _waves(self) -> tuple[Floats, Floats, Floats]:
        """Wave numbers (64, 2) [1/m], phases (64,), and the amplitude of each [m]."""
        numbers, phases = plane_waves(self.seed, self.length)
        return numbers, phases, np.full(WAVES, self.roughness * np.sqrt(2.0 / WAVES))

    def at(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Height [m] and its slopes towards x and y, each (n,)."""
        along_x, along_y = float(np.tan(self.tilt_x)), float(np.tan(self.tilt_y))
        height = along_x * x + along_y * y
        slope_x, slope_y = np.full_like(height, along_x), np.full_like(height, along_y)
        if self.roughness > 0:
            for (kx, ky), phase, amplitude in zip(*self._waves, strict=True):
                angle = kx * x + ky * y + phase
                height = height + amplitude * np.cos(angle)
                steepness = -amplitude * np.sin(angle)
                slope_x, slope_y = slope_x + kx * steepness, slope_y + ky * steepness
        return height, slope_x, slope_y
