"""What the residual of a right model is: noise of force and motion, and what is stated with an uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Floats, TrackEvidence
from palpate_engine import force_slopes
from palpate_kit.numerics.tip_travel import noise_of, rate_kernels

from palpate_uncertainty.channel_noise import null_of
from palpate_uncertainty.refit import Course

AIR, READINGS = 0.2, 100  # [s] and readings without contact that tell the noise
_STILL = 1e-4  # [m]
_NEAR = 0.05  # of the way in contact, above which the air before it is air
_COARSE = 0.5  # of the noise, above which a step of the readings counts beside it


@dataclass(frozen=True)
class ForceNoise:
    """The noise of the force, as an autoregression of white noise."""

    std: float  # [N]
    coefficients: Floats  # (p,) of the autoregression; empty: white
    readings: int  # that tell it

    @classmethod
    def of(cls, track: TrackEvidence) -> ForceNoise | None:
        """From standstill, else from the air before the contact; None where there is too little of both."""
        rest = air_readings(track)
        if rest is None:
            return None
        null, std = null_of(rest), float(np.std(rest, ddof=1))
        steps = np.abs(np.diff(track.kept.force))
        least = float(steps[steps > 0].min()) if (steps > 0).any() else 0.0
        share = float(np.mean(steps == 0)) if len(steps) else 0.0
        if share > 0.02 or least > _COARSE * std:  # readings in steps: those add noise that the air need not show
            std = float(np.hypot(std, least / np.sqrt(12.0)))
        return cls(std, null.coefficients, len(rest)) if std > 0 else None

    def spectrum(self, n: int) -> Floats:
        """Power (m,) [N^2] over the frequencies of a real transform of n points; of white noise the variance."""
        if not len(self.coefficients):
            return np.full(n // 2 + 1, self.std**2)
        inverse = np.abs(np.fft.rfft(np.concatenate([[1.0], -self.coefficients]), n)) ** -2
        # Over all n frequencies the mean is the variance.
        whole = 2.0 * inverse.sum() - inverse[0] - (inverse[-1] if n % 2 == 0 else 0.0)
        return np.asarray(inverse * self.std**2 * n / whole)


def air_readings(track: TrackEvidence) -> Floats | None:
    """Force (n,) [N] without contact that tells the noise: at standstill, else on the way; None where it is short."""
    known = np.isfinite(track.air_force)
    time, force, place = track.air_time[known], track.air_force[known], track.air_position[known]
    if len(time) < READINGS:
        return None
    moving = np.abs(place - place[0]) > _STILL
    until = int(np.argmax(moving)) if moving.any() else len(place)
    if until < READINGS or time[until - 1] - time[0] < AIR:
        kept = track.kept.position
        way = track.surface - float(np.nanmin(kept)) if len(kept) else 0.0
        near = place < track.surface + _NEAR * way
        until = int(np.argmax(near)) if near.any() else len(place)
    if until < READINGS or time[until - 1] - time[0] < AIR:
        return None
    return np.asarray(force[:until])


@dataclass(frozen=True)
class ResidualNull:
    """The variance of any weighted sum of a track's residual where its model is right."""

    force: ForceNoise
    by_depth: Floats  # (n,) [N/m]
    by_rate: Floats  # (n,) [N s/m]
    mass: float  # [kg]
    height: float  # [m] noise of a height
    speed: float  # [m/s] noise of a speed with a channel of its own, else 0
    kernels: tuple[Floats, Floats, Floats, Floats]  # of the rate by heights and speeds, of the acceleration by both
    stated: Floats = field(default_factory=lambda: np.zeros((1, 0)))  # (n, s) [N] one u of each stated quantity

    def variance(self, weights: Floats) -> float:
        """[N^2] of sum w r."""
        n = 1 << int(np.ceil(np.log2(max(2 * len(weights), 4))))
        power = np.abs(np.fft.rfft(weights, n)) ** 2 * self.force.spectrum(n)
        of_force = (2.0 * power.sum() - power[0] - power[-1]) / n
        rate = weights * self.by_rate
        by_height = weights * self.by_depth + _back(rate, self.kernels[0])
        if self.mass:
            by_height = by_height + self.mass * _back(weights, self.kernels[2])
        of_motion = self.height**2 * float(by_height @ by_height)
        if self.speed:
            by_speed = _back(rate, self.kernels[1]) + self.mass * _back(weights, self.kernels[3])
            of_motion += self.speed**2 * float(by_speed @ by_speed)
        of_stated = float(np.sum((weights @ self.stated) ** 2)) if self.stated.size else 0.0
        return float(of_force) + of_motion + of_stated

    @cached_property
    def std(self) -> Floats:
        """(n,) [N] of each residual by noise alone."""
        rate, own_rate, bend, own_bend = (float(np.linalg.norm(kernel)) for kernel in self.kernels)
        by_height = self.by_depth**2 + (self.by_rate * rate) ** 2 + (self.mass * bend) ** 2
        by_speed = (self.by_rate * own_rate) ** 2 + (self.mass * own_bend) ** 2
        return np.sqrt(self.force.std**2 + by_height * self.height**2 + by_speed * self.speed**2)

    @property
    def rms(self) -> float:
        """[N] of the residual."""
        return float(np.sqrt(np.mean(self.std**2) + np.mean(np.sum(self.stated**2, axis=1))))


def motion_noise(track: TrackEvidence) -> tuple[float, float, tuple[Floats, Floats, Floats, Floats]]:
    """Noise of the height [m] and of a channel of speed [m/s], and the kernels by which a fit derives from them."""
    kept = track.kept
    step = float(np.median(np.diff(kept.time)))
    height, speed = noise_of(kept.position), noise_of(kept.velocity)
    usual = float(np.sqrt(np.nanmean(kept.velocity**2)))
    channel = track.ending is not None and track.ending.settings.velocity is not None
    return height, speed if channel else 0.0, rate_kernels((height, speed), usual, step, channel)


def slopes_of(course: Course, theta: Floats, surface: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Force (n,), Jacobian (n, k + 1) by parameters and surface, slopes by depth and by rate (n,) along a course."""
    depth, rows = course.depth(surface)[course.used], course.used
    force, by_parameter, by_depth, by_rate = force_slopes(course.model, depth, course.rate[rows], theta.tolist())
    jacobian: Any = np.nan_to_num(np.column_stack([by_parameter, by_depth]))
    return force, jacobian, np.nan_to_num(by_depth), np.nan_to_num(by_rate)


def _back(weights: Floats, kernel: Floats) -> Floats:
    """Weights (n,) of readings from those of their convolution with a kernel."""
    return np.asarray(np.convolve(weights, kernel[::-1], "same"))
