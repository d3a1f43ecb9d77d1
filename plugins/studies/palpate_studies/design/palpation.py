"""Palpations side by side: each setting with its bounds, what it asks of the robot, and which is best."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate import ContactModel
from palpate_engine import Reach, force_slopes

from palpate_studies.design.bounds import CramerRaoBound, Nuisances, cramer_rao
from palpate_studies.design.measurement_noise import MeasurementNoise
from palpate_studies.design.settings import DesignSettings
from palpate_studies.design.tip_path import DepthPath, sine_path

Case = Literal["known", "unknown skew", "unknown bias", "unknown both"]


@dataclass(frozen=True)
class Palpation:
    """One setting with its bounds."""

    frequencies: tuple[float, ...]  # [Hz]
    amplitude: float  # [m] of each sine, as commanded
    travel: float  # [m] the tip's real swing about the mean depth
    bounds: Mapping[Case, CramerRaoBound]
    refused: str | None  # the limit that it breaks

    def relative(self, case: Case, theta: Mapping[str, float]) -> dict[str, float]:
        """Bounds over the expected values."""
        return _over(self.bounds[case].parameters, theta)

    def relative_bias(self, theta: Mapping[str, float]) -> dict[str, float]:
        """What the interpolation of the force moves the parameters by, over the expected values."""
        return _over(self.bounds["known"].bias, theta)

    def relative_rmse(self, case: Case, theta: Mapping[str, float]) -> dict[str, float]:
        """Root mean square errors over the expected values."""
        return _over({name: self.bounds[case].rmse(name) for name in theta}, theta)


def _over(values: Mapping[str, float], theta: Mapping[str, float]) -> dict[str, float]:
    return {name: value / abs(theta[name]) if theta[name] else math.inf for name, value in values.items()}


def palpations(
    model: ContactModel,
    theta: Sequence[float],
    settings: DesignSettings,
    tip_mass: float,
    depth: float,
    duration: float,
    sensing: MeasurementNoise,
) -> list[Palpation]:
    """Every frequency and multi-sine with every amplitude."""
    cases: dict[Case, Nuisances] = {
        "known": Nuisances(settings.tare_std, settings.timing_std),
        "unknown skew": Nuisances(settings.tare_std, settings.unknown_skew),
        "unknown bias": Nuisances(settings.unknown_bias, settings.timing_std),
        "unknown both": Nuisances(settings.unknown_bias, settings.unknown_skew),
    }
    found = []
    for frequencies in [*((f,) for f in settings.frequencies), *settings.multisines]:
        for amplitude in settings.amplitudes:
            sines = [(frequency, amplitude / len(frequencies)) for frequency in frequencies]
            path = sine_path(depth, sines, duration, settings.rate, settings.loop)
            slopes = force_slopes(model, path.depth, path.rate, theta)
            noise = sensing.noise(path, slopes[2], slopes[3])
            error = sensing.interpolation(path, slopes[0] + tip_mass * path.acceleration, slopes[3], settings.loop.lag)
            bounds: dict[Case, CramerRaoBound] = {
                case: cramer_rao(model, theta, path, tip_mass, noise, nuisances, slopes, error)
                for case, nuisances in cases.items()
            }
            travel = float(abs(path.depth - depth).max())
            refused = _refusal(float(slopes[0].max()), path, sines, settings)
            found.append(Palpation(tuple(frequencies), amplitude / len(frequencies), travel, bounds, refused))
    return found


def _refusal(
    force: float,
    path: DepthPath,
    sines: Sequence[tuple[float, float]],
    settings: DesignSettings,
) -> str | None:
    """The first limit that a setting breaks, in words; None where it keeps them all."""
    speed = sum(2 * math.pi * f * a for f, a in sines)
    sudden = sum((2 * math.pi * f) ** 2 * a for f, a in sines)
    if path.depth.min() <= 0:
        return "leaves contact"
    heights = -np.array([path.depth.max(), path.depth.min()])
    along = np.zeros(2)
    reach = Reach(np.append(along, heights[0]), np.append(along, heights[1]), speed, sudden)
    for excess in settings.limits.excesses(reach):
        match excess.what:
            case "speed":
                return f"{speed * 1e3:.3g} mm/s"
            case "acceleration":
                return f"{sudden:.3g} m/s^2"
            case _:
                return f"{path.depth.max() * 1e3:.3g} mm deep"
    if max(f for f, _ in sines) > settings.rate / 4:
        return "too few samples a period"
    return f"{force:.3g} N" if force > settings.top_force else None


def best(found: Iterable[Palpation], theta: Mapping[str, float], case: Case = "known") -> Palpation | None:
    """The setting within the limits whose relative errors have the smallest sum of squares; None where none is.

    The error is that of an estimator that reaches the bound: scatter and what the interpolation moves, together.
    """

    def cost(palpation: Palpation) -> float:
        return sum(share**2 for share in palpation.relative_rmse(case, theta).values())

    allowed = [palpation for palpation in found if palpation.refused is None and math.isfinite(cost(palpation))]
    return min(allowed, key=cost, default=None)
