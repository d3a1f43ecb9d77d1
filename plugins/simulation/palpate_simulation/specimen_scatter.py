"""Stiffness of a simulated specimen that differs from place to place, and from palpation to palpation."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property

import numpy as np
from palpate import Floats, Length, Settings, Time
from pydantic import Field

from palpate_simulation.surface_relief import WAVES, plane_waves


class Scatter(Settings):
    """Stiffness that differs from place to place, as tissue's does: log-normal, with a mean of 1.

    The logarithm is a smooth random field of the plane with the covariance s^2 exp(-r^2/(2 length^2)), a sum of 64
    plane cosines like that of `relief`. One seed is one specimen.
    """

    std: float = Field(gt=0, le=0.5, description="standard deviation of the stiffness, relative to its mean")
    length: Length = Field(default=0.005, gt=0, description="distance over which it changes")
    seed: int = Field(default=0, ge=0, description="seed of the specimen")

    @cached_property
    def _waves(self) -> tuple[Floats, Floats]:
        """Wave numbers (64, 2) [1/m] and phases (64,)."""
        return plane_waves(self.seed, self.length)

    def at(self, x: Floats, y: Floats) -> Floats:
        """Return the factor (n,) of the stiffness at x, y (n,) [m]: exp(s g - s^2/2), g a field of variance 1.

        s^2 = ln(1 + std^2) makes it log-normal with a mean of 1 and the standard deviation `std`.
        """
        wave_numbers, phases = self._waves
        cosines = sum(np.cos(kx * x + ky * y + phase) for (kx, ky), phase in zip(wave_numbers, phases, strict=True))
        s = math.sqrt(math.log1p(self.std**2))
        return np.asarray(np.exp(s * math.sqrt(2.0 / WAVES) * np.asarray(cosines) - s**2 / 2))


class Conditioning(Settings):
    """Softening by earlier palpations of the same place, as filled rubber and tissue show, and its recovery.

    After n palpations the stiffness is 1 - softening (1 - exp(-n/palpations)) of that of untouched material. A
    palpation counts exp(-age/recovery - distance^2/(2 reach^2)): it is forgotten with time, and felt around its place.
    A phenomenon with numbers of one's own, not a theory of it (Mullins 1969 for rubber, Fung 1993 for tissue).
    """

    softening: float = Field(gt=0, lt=1, description="part of the stiffness that is finally lost")
    palpations: float = Field(
        default=2.0, gt=0, allow_inf_nan=False, description="number of palpations after which 63 % of it is lost"
    )
    recovery: Time | None = Field(default=None, gt=0, description="time in which it recovers to 1/e; left out: never")
    reach: Length = Field(default=0.005, gt=0, description="distance over which a palpation has an effect")

    def effective_count(self, earlier: Iterable[tuple[float, float]]) -> float:
        """Return the number of palpations that earlier ones count for, given as pairs of distance [m] and age [s].

        Each counts exp(-age/recovery - distance^2/(2 reach^2)).
        """
        forgetting_rate = 0.0 if self.recovery is None else 1.0 / self.recovery  # [1/s]
        weights = (math.exp(-age * forgetting_rate - 0.5 * (distance / self.reach) ** 2) for distance, age in earlier)
        return float(sum(weights))

    def factor(self, palpated: float) -> float:
        """Return the factor of the stiffness after `palpated` palpations: 1 - softening (1 - exp(-n/palpations))."""
        return 1.0 + self.softening * math.expm1(-palpated / self.palpations)
