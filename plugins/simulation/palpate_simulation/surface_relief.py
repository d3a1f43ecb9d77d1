"""The shape of a simulated skin: tilt, curvature, random roughness."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Literal, Self

import numpy as np
from palpate import Angle, Floats, Length, Settings
from pydantic import Field, model_validator

from palpate_simulation.skin_form import SkinForm

WAVES = 64
_TOGETHER = 4096  # places; what is worked on stays in the processor's cache
_MANY = 4  # times that many places, from which on threads pay
_STEEPEST = np.deg2rad(30.0)


def plane_waves(seed: int, length: float) -> tuple[Floats, Floats]:
    """Wave numbers (64, 2) [1/m] and phases (64,) of cosines whose sum has the covariance exp(-r^2/(2 length^2))."""
    dice = np.random.default_rng(seed)
    numbers = dice.standard_normal((WAVES, 2)) / length
    return numbers, dice.uniform(0.0, 2 * np.pi, WAVES)


class Relief(Settings):
    """Height of the skin over its level: a tilt, curvature, and a smooth random roughness.

    A curved skin is a sphere, a cylinder or a torus that touches the tilted plane at the origin, with the radius
    `radius_x` along the plane's rise towards x and `radius_y` across that.

    Roughness is a sum of 64 plane cosines of random direction and phase whose wave numbers are drawn from a normal
    distribution of standard deviation 1/length in each axis: a stationary random field with the covariance
    std^2 exp(-r^2/(2 length^2)), smooth, and known with its slopes everywhere. One seed is one skin.
    """

    tilt_x: Angle = Field(default=0.0, ge=-_STEEPEST, le=_STEEPEST, description="rise towards positive x")
    tilt_y: Angle = Field(default=0.0, ge=-_STEEPEST, le=_STEEPEST, description="rise towards positive y")
    radius_x: Literal["flat"] | Length = Field(
        default="flat", description='radius of curvature towards x, negative in a hollow, or "flat"'
    )
    radius_y: Literal["flat"] | Length = Field(default="flat", description="the same towards y")
    roughness: Length = Field(default=0.0, ge=0, description="standard deviation of the random height")
    length: Length = Field(default=0.01, gt=0, description="correlation length of the random height")
    seed: int = Field(default=0, ge=0, description="seed of the random height")

    @model_validator(mode="after")
    def _a_radius_has_a_length(self) -> Self:
        if 0.0 in (self.radius_x, self.radius_y):
            raise ValueError('radius_x, radius_y: a radius of 0 is not a skin; write "flat" where it is not curved')
        return self

    @cached_property
    def form(self) -> SkinForm | None:
        """Tilt and curvature; None of a skin that is level and flat but for its roughness."""
        by_x, by_y = (0.0 if isinstance(one, str) else 1.0 / one for one in (self.radius_x, self.radius_y))
        found = SkinForm(self._tilt, (by_x, by_y))
        return found if any((*found.slopes, *found.curvatures)) else None

    @cached_property
    def without_form(self) -> Relief:
        """The roughness alone."""
        return self.model_copy(update={"tilt_x": 0.0, "tilt_y": 0.0, "radius_x": "flat", "radius_y": "flat"})

    @cached_property
    def _waves(self) -> tuple[Floats, Floats, Floats]:
        """Wave numbers (64, 2) [1/m], phases (64,), and the amplitude of each [m]."""
        numbers, phases = plane_waves(self.seed, self.length)
        return numbers, phases, np.full(WAVES, self.roughness * np.sqrt(2.0 / WAVES))

    def height_at(self, x: Floats, y: Floats) -> Floats:
        """Height (n,) [m] at x, y (n,) [m]."""
        height = self._level(x, y)
        self._rough(lambda rows: self._roughen(x[rows], y[rows], height[rows]), len(height))
        return height

    def slopes_at(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Slopes (n,) of the roughness towards x and y, at x, y (n,) [m]."""
        slope_x, slope_y = np.zeros_like(x), np.zeros_like(y)
        self._rough(lambda rows: self._slope(x[rows], y[rows], slope_x[rows], slope_y[rows]), len(x))
        return slope_x, slope_y

    @property
    def _tilt(self) -> tuple[float, float]:
        return float(np.tan(self.tilt_x)), float(np.tan(self.tilt_y))

    def _level(self, x: Floats, y: Floats) -> Floats:
        if self.form is not None and any(self.form.curvatures):
            return self.form.height(x, y)
        along_x, along_y = self._tilt
        return along_x * x + along_y * y

    def _rough(self, work: Callable[[slice], None], places: int) -> None:
        """Have work on the roughness done, where there is some: thousands of places at a time, many by all cores."""
        if self.roughness <= 0:
            return
        rows = [slice(begin, begin + _TOGETHER) for begin in range(0, places, _TOGETHER)]
        if len(rows) < _MANY:
            for one in rows:
                work(one)
            return
        with ThreadPoolExecutor(os.cpu_count()) as pool:  # cosines of thousands let go of the interpreter
            for _ in pool.map(work, rows):
                pass

    def _roughen(self, x: Floats, y: Floats, height: Floats) -> None:
        """Add the roughness to heights (n,)."""
        for (kx, ky), phase, amplitude in zip(*self._waves, strict=True):
            height += amplitude * np.cos(kx * x + ky * y + phase)

    def _slope(self, x: Floats, y: Floats, slope_x: Floats, slope_y: Floats) -> None:
        """Add the slopes of the roughness (n,)."""
        for (kx, ky), phase, amplitude in zip(*self._waves, strict=True):
            steepness = -amplitude * np.sin(kx * x + ky * y + phase)
            slope_x += kx * steepness
            slope_y += ky * steepness
