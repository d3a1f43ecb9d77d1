"""Heights over a plane or a sphere as a Gaussian process, from heights with known uncertainties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats
from palpate_kit.numerics.gaussian_process import GaussianProcess, matern_5_2

# Choices.
_FREE_SIGMAS = 10.0  # of the heights: the standard deviation of height and slopes of the base itself, which are free
_GRID_ROUNDS = 4  # of the search for the largest likelihood, each on a grid around the best of the one before
_GRID_SIDE = 5  # points of a side of the grid
_LENGTH_RANGE = (0.15, 3.0)  # of the extent
_AMPLITUDE_RANGE = (0.3, 30.0)  # of the heights' standard deviation about a plane


@dataclass(frozen=True)
class HeightField:
    """A Gaussian process of heights h(q) with known noise, known at n coordinates q.

    Its covariance is f^2 (1 + q.q'/e^2) + s^2 (1 + r + r^2/3) exp(-r), r = sqrt(5) |q - q'|/l: free height and slopes,
    and a smooth part. Amplitude s and length l are those of the largest likelihood.
    Source: Rasmussen and Williams 2006, sections 2.7 and 5.4.
    """

    q: Floats  # (n, k) [m]
    prior: _Prior
    process: GaussianProcess  # of the heights
    height: Floats  # (n,) [m]
    std: Floats  # (n,) [m] of the noise

    @classmethod
    def of(cls, q: Floats, height: Floats, std: Floats) -> HeightField:
        """Return the process of heights (n,) [m] at q (n, k) [m], with standard deviations (n,) [m]."""
        extent = float(np.linalg.norm(np.ptp(q, axis=0)))
        roughness = float(np.std(height - _fitted_plane(q, height))) + float(np.median(std))
        free_std = _FREE_SIGMAS * (roughness + float(np.std(height)))

        def process_of(prior: _Prior) -> GaussianProcess:
            """Return the process under a prior."""
            return GaussianProcess.of(prior.covariance(q, q), std**2, height)

        # Logarithms of amplitude and length, from coarse to fine grids.
        scales = np.array([roughness, extent])
        low, high = np.log(scales * np.array([_AMPLITUDE_RANGE, _LENGTH_RANGE]).T)
        best = (low + high) / 2
        for _ in range(_GRID_ROUNDS):
            amplitudes, lengths = (np.linspace(a, b, _GRID_SIDE) for a, b in zip(low, high))
            grid = np.array([[amplitude, length] for amplitude in amplitudes for length in lengths])
            likelihoods = [process_of(_Prior(extent, free_std, *np.exp(node))).log_likelihood for node in grid]
            best = grid[int(np.argmax(likelihoods))]
            spacing = (high - low) / (_GRID_SIDE - 1)
            low, high = best - spacing, best + spacing
        amplitude, length = np.exp(best)
        prior = _Prior(extent, free_std, float(amplitude), float(length))
        return cls(q, prior, process_of(prior), height, std)

    def mean(self, q: Floats) -> Floats:
        """Return the heights (m,) [m] at q (m, k)."""
        return self.process.mean(self.prior.covariance(self.q, q))

    def covariance(self, q: Floats) -> Floats:
        """Return the covariance (m, m) [m^2] of the heights at q (m, k)."""
        return self.process.covariance(self.prior.covariance(q, q), self.prior.covariance(self.q, q))

    def left_out(self) -> Floats:
        """Return by how many standard deviations (n,) each height is off the prediction by the others."""
        return self.process.left_out()

    def deviation_from_others(self, row: int) -> float:
        """Return by how many standard deviations a height is off, with amplitude and length of the others alone."""
        is_other = np.arange(len(self.q)) != row
        others = HeightField.of(self.q[is_other], self.height[is_other], self.std[is_other])
        q = self.q[row][None]
        std = np.sqrt(others.covariance(q)[0, 0] + self.std[row] ** 2)
        return float(abs(self.height[row] - others.mean(q)[0]) / std)


@dataclass(frozen=True)
class _Prior:
    """The covariance of a height field before any height is known."""

    extent: float  # [m] e, over which a free slope counts
    free_std: float  # [m] f, of the free height and slopes
    amplitude: float  # [m] s
    length: float  # [m] l

    def covariance(self, q: Floats, other_q: Floats) -> Floats:
        """Return f^2 (1 + q.q'/e^2) + s^2 Matern(|q - q'|/l) (n, m) [m^2] of coordinates (n, k) and (m, k)."""
        distance = np.sqrt(((q[:, None] - other_q[None]) ** 2).sum(axis=2))
        free = self.free_std**2 * (1.0 + q @ other_q.T / self.extent**2)
        return np.asarray(free + self.amplitude**2 * matern_5_2(distance, self.length))


def _fitted_plane(q: Floats, height: Floats) -> Floats:
    """Return the linear function of q (n, k) that fits heights (n,) best, at each q."""
    design = np.column_stack([np.ones(len(q)), q])
    return np.asarray(design @ np.linalg.lstsq(design, height, rcond=None)[0])
