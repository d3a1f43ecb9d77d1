"""The residual of a right model: noise of force and motion, and what is stated with an uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Floats, TrackEvidence
from palpate_engine import force_slopes
from palpate_kit.numerics.tip_travel import noise_of, rate_kernels

from palpate_uncertainty.force_noise import ForceNoise
from palpate_uncertainty.refit import Course

LONG = 8192  # samples, from which on the noise of the motion is summed over blocks (a choice: 16 s of a robot)
BLOCKS_OF_KERNEL = 4  # blocks of a kernel of the rate; with these a variance by the motion is within 3 % (0600)
NOISE_MEMORY = 4096  # samples, after which an autoregression of order 30 has died away (a choice)


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

    def covariance(self, weights: Floats) -> Floats:
        """Return the covariance (m, m) [N^2] of the sums of weights (n, m) times the residual.

        Three parts add up: the noise of the force, that of the motion, and the errors of stated quantities. Coloured
        noise acts by its spectrum: the covariance is the sum over frequencies of the transformed weights' products.
        """
        columns = weights.T
        if len(self.force.coefficients):
            n = transform_points(len(weights))
            # A real transform has each frequency but 0 and the highest for both signs.
            both = np.full(n // 2 + 1, 2.0)
            both[[0, -1]] = 1.0
            waves = np.fft.rfft(columns, n) * np.sqrt(both * self.force.spectrum(n) / n)
            covariance = self.force.excess * np.real(waves @ waves.conj().T)
        else:
            covariance = self.force.std**2 * (columns @ columns.T)
        # The heights and speeds, from which depth, rate and acceleration are derived.
        covariance = covariance + self._motion_covariance(columns)
        if self.stated.size:
            covariance = covariance + (stated := columns @ self.stated) @ stated.T
        return np.asarray(covariance)

    def _motion_covariance(self, columns: Floats) -> Floats:
        """Return the covariance (m, m) [N^2] of sums with weights (m, n) by the noise of heights and speeds.

        A height acts by the depth on its own sample, and by the rate on as many as its kernel has. Sums over a kernel
        vary slowly: of a long record they follow from the weights of blocks of a quarter of a kernel.
        """
        if columns.shape[1] < LONG or self._block_length < 2:
            return self._covariance_by(*self._weights_of_readings(columns))
        blocks = self._in_blocks
        weights = self._block_length * block_means(columns, self._block_length)
        covariance = blocks._covariance_by(*blocks._weights_of_readings(weights))
        # The part by the depth, of each sample instead of each block.
        by_depth, of_blocks = columns * self.by_depth, weights * blocks.by_depth
        return covariance + self.height**2 * (by_depth @ by_depth.T) - blocks.height**2 * (of_blocks @ of_blocks.T)

    def _weights_of_readings(self, columns: Floats) -> tuple[Floats, Floats]:
        """Return weights (m, n) of heights [N/m] and speeds [N s/m] in sums with the weights (m, n)."""
        rate = columns * self.by_rate
        of_heights = columns * self.by_depth + _back(rate, self.kernels[0])
        if self.mass:
            of_heights = of_heights + self.mass * _back(columns, self.kernels[2])
        if not self.speed:
            return of_heights, np.zeros((len(columns), 0))
        of_speeds = _back(rate, self.kernels[1])
        if self.mass:
            of_speeds = of_speeds + self.mass * _back(columns, self.kernels[3])
        return of_heights, of_speeds

    def _covariance_by(self, of_heights: Floats, of_speeds: Floats) -> Floats:
        """Return the covariance (m, m) [N^2] of sums with weights (m, n) of heights and of speeds."""
        return np.asarray(self.height**2 * (of_heights @ of_heights.T) + self.speed**2 * (of_speeds @ of_speeds.T))

    @property
    def _block_length(self) -> int:
        """Samples of a block, over which the kernel of the rate hardly changes."""
        return len(self.kernels[0]) // BLOCKS_OF_KERNEL

    @cached_property
    def _in_blocks(self) -> ResidualNull:
        """The same noise of the motion, of means of blocks."""
        length = self._block_length
        by_height, by_speed, bend, bend_by_speed = (kernel_of_means(kernel, length) for kernel in self.kernels)
        return replace(
            self, by_depth=block_means(self.by_depth, length), by_rate=block_means(self.by_rate, length),
            height=self.height / math.sqrt(length), speed=self.speed / math.sqrt(length),
            kernels=(by_height, by_speed, bend, bend_by_speed),
        )  # fmt: skip

    @cached_property
    def std(self) -> Floats:
        """(n,) [N] of each residual by noise alone."""
        rate, own_rate, bend, own_bend = (float(np.linalg.norm(kernel)) for kernel in self.kernels)
        by_height = self.by_depth**2 + (self.by_rate * rate) ** 2 + (self.mass * bend) ** 2
        by_speed = (self.by_rate * own_rate) ** 2 + (self.mass * own_bend) ** 2
        return np.sqrt(self.force.std**2 + by_height * self.height**2 + by_speed * self.speed**2)


def motion_noise(track: TrackEvidence) -> tuple[float, float, tuple[Floats, Floats, Floats, Floats]]:
    """Return noise of height [m] and of a speed channel [m/s], and the kernels by which a fit derives from them."""
    kept = track.kept
    step = float(np.median(np.diff(kept.time)))
    height, speed = noise_of(kept.position, kept.time), noise_of(kept.velocity, kept.time)
    usual = float(np.sqrt(np.nanmean(kept.velocity**2)))
    channel = track.ending is not None and track.ending.settings.velocity is not None
    return height, speed if channel else 0.0, rate_kernels((height, speed), usual, step, channel)


def slopes_of(course: Course, theta: Floats, surface: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Force (n,), Jacobian (n, k + 1) by parameters and surface, slopes by depth and by rate (n,) along a course."""
    depth, rows = course.depth(surface)[course.used], course.used
    force, by_parameter, by_depth, by_rate = force_slopes(course.model, depth, course.rate[rows], theta.tolist())
    jacobian: Any = np.nan_to_num(np.column_stack([by_parameter, by_depth]))
    return force, jacobian, np.nan_to_num(by_depth), np.nan_to_num(by_rate)


def block_means(values: Floats, length: int) -> Floats:
    """Return the means (..., b) of so many neighbours each, along the last axis; a rest at the end is left out."""
    whole = values[..., : values.shape[-1] // length * length]
    return np.asarray(whole.reshape(*values.shape[:-1], -1, length) @ np.full(length, 1.0 / length))


def kernel_of_means(kernel: Floats, length: int) -> Floats:
    """Return the kernel (q,) by which the means of blocks of a convolution follow from those of its input.

    k_j = sum_i (1 - |i|/length) kernel_(j length + i), of an odd number of samples, scaled to the variance that white
    noise has by the kernel itself: what varies within the blocks of the input is lost.
    """
    box = np.full(length, 1.0 / length)
    of_pairs: Floats = length * np.convolve(kernel, np.convolve(box, box))
    of_means = of_pairs[len(of_pairs) // 2 % length :: length]
    power = length * float(np.sum(np.convolve(kernel, box) ** 2))
    return of_means * math.sqrt(power / float(of_means @ of_means)) if power > 0 else of_means


def transform_points(count: int) -> int:
    """Return the points of a transform of so many samples, of which the last are not next to the first."""
    points = count + min(count, NOISE_MEMORY)
    if points <= 2 * NOISE_MEMORY:
        return 1 << int(np.ceil(np.log2(max(points, 4))))
    return -(-points // NOISE_MEMORY) * NOISE_MEMORY


def _back(weights: Floats, kernel: Floats) -> Floats:
    """Return the weights (m, n) of readings from those of their convolution with a kernel."""
    # One row behind the other, with zeros between, so that one convolution is for all.
    rows, count = weights.shape
    apart = np.zeros((rows, count + len(kernel) - 1))
    apart[:, :count] = weights
    begin = (len(kernel) - 1) // 2
    return np.convolve(apart.ravel(), kernel[::-1])[begin : begin + apart.size].reshape(apart.shape)[:, :count]
