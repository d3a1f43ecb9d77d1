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

WAVES = 64  # cosines of a random field (a choice): enough for a nearly normal height
CHUNK_SIZE = 4096  # places (a choice): the arrays of a chunk stay in the processor's cache
MIN_PARALLEL_CHUNKS = 4  # from which on threads take less time than they cost (a choice)
MAX_TILT = np.deg2rad(30.0)  # [rad] (a choice)


def plane_waves(seed: int, length: float) -> tuple[Floats, Floats]:
    """Return wave numbers (64, 2) [1/m] and phases (64,) of cosines, as random as a seed.

    The sum of the cosines has the covariance 32 exp(-r^2/(2 length^2)), r [m] being the distance of two places.
    """
    rng = np.random.default_rng(seed)
    wave_numbers = rng.standard_normal((WAVES, 2)) / length
    return wave_numbers, rng.uniform(0.0, 2 * np.pi, WAVES)


class Relief(Settings):
    """Height of the skin over its level: a tilt, curvature, and a smooth random roughness.

    A curved skin is a sphere, a cylinder or a torus that touches the tilted plane at the origin, with the radius
    `radius_x` along the plane's rise towards x and `radius_y` across that.

    Roughness is a sum of 64 plane cosines of random direction and phase whose wave numbers are drawn from a normal
    distribution of standard deviation 1/length in each axis: a stationary random field with the covariance
    std^2 exp(-r^2/(2 length^2)), smooth, and known with its slopes everywhere. One seed is one skin.
    """

    tilt_x: Angle = Field(default=0.0, ge=-MAX_TILT, le=MAX_TILT, description="rise towards positive x")
    tilt_y: Angle = Field(default=0.0, ge=-MAX_TILT, le=MAX_TILT, description="rise towards positive y")
    radius_x: Literal["flat"] | Length = Field(
        default="flat", description='radius of curvature towards x, negative in a hollow, or "flat"'
    )
    radius_y: Literal["flat"] | Length = Field(default="flat", description="the same towards y")
    roughness: Length = Field(default=0.0, ge=0, description="standard deviation of the random height")
    length: Length = Field(default=0.01, gt=0, description="correlation length of the random height")
    seed: int = Field(default=0, ge=0, description="seed of the random height")

    @model_validator(mode="after")
    def _check_radii(self) -> Self:
        """Return the relief; raises ValueError for a radius of 0."""
        if 0.0 in (self.radius_x, self.radius_y):
            raise ValueError('radius_x, radius_y: a radius of 0 is not a skin; write "flat" where it is not curved')
        return self

    @cached_property
    def form(self) -> SkinForm | None:
        """Tilt and curvature; None for a skin that is level and flat but for its roughness."""
        curvature_x = 0.0 if isinstance(self.radius_x, str) else 1.0 / self.radius_x
        curvature_y = 0.0 if isinstance(self.radius_y, str) else 1.0 / self.radius_y
        form = SkinForm(self._tilt, (curvature_x, curvature_y))
        return form if any((*form.slopes, *form.curvatures)) else None

    @cached_property
    def without_form(self) -> Relief:
        """The roughness alone."""
        return self.model_copy(update={"tilt_x": 0.0, "tilt_y": 0.0, "radius_x": "flat", "radius_y": "flat"})

    @cached_property
    def _waves(self) -> tuple[Floats, Floats, Floats]:
        """Wave numbers (64, 2) [1/m], phases (64,), and the amplitude of each [m]."""
        wave_numbers, phases = plane_waves(self.seed, self.length)
        # The variance of each cosine is 1/2.
        return wave_numbers, phases, np.full(WAVES, self.roughness * np.sqrt(2.0 / WAVES))

    def height_at(self, x: Floats, y: Floats) -> Floats:
        """Return the height (n,) [m] at x, y (n,) [m], of form and roughness."""
        height = self._smooth_height(x, y)
        self._for_each_chunk(lambda rows: self._add_roughness(x[rows], y[rows], height[rows]), len(height))
        return height

    def slopes_at(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return the slopes (n,) of the roughness towards x and y, at x, y (n,) [m]."""
        slope_x, slope_y = np.zeros_like(x), np.zeros_like(y)
        self._for_each_chunk(lambda rows: self._add_slopes(x[rows], y[rows], slope_x[rows], slope_y[rows]), len(x))
        return slope_x, slope_y

    @property
    def _tilt(self) -> tuple[float, float]:
        """Slopes of the tilted plane towards x and y."""
        return float(np.tan(self.tilt_x)), float(np.tan(self.tilt_y))

    def _smooth_height(self, x: Floats, y: Floats) -> Floats:
        """Return the height (n,) [m] of the form alone."""
        if self.form is not None and any(self.form.curvatures):
            return self.form.height(x, y)
        slope_x, slope_y = self._tilt
        return slope_x * x + slope_y * y

    def _for_each_chunk(self, add: Callable[[slice], None], count: int) -> None:
        """Call `add` for the rows of each chunk of `count` places, in threads for many chunks; never without roughness.

        `add` changes its rows of an array in place.
        """
        if self.roughness <= 0:
            return
        chunks = [slice(start, start + CHUNK_SIZE) for start in range(0, count, CHUNK_SIZE)]
        if len(chunks) < MIN_PARALLEL_CHUNKS:
            for rows in chunks:
                add(rows)
            return
        # NumPy releases the interpreter's lock while it computes thousands of cosines.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for _ in pool.map(add, chunks):
                pass

    def _add_roughness(self, x: Floats, y: Floats, height: Floats) -> None:
        """Add the roughness at x, y (n,) [m] to heights (n,) [m], in place."""
        for (kx, ky), phase, amplitude in zip(*self._waves, strict=True):
            height += amplitude * np.cos(kx * x + ky * y + phase)

    def _add_slopes(self, x: Floats, y: Floats, slope_x: Floats, slope_y: Floats) -> None:
        """Add the slopes of the roughness at x, y (n,) [m] to slopes (n,), in place."""
        for (kx, ky), phase, amplitude in zip(*self._waves, strict=True):
            derivative = -amplitude * np.sin(kx * x + ky * y + phase)  # by the phase [m]
            slope_x += kx * derivative
            slope_y += ky * derivative
