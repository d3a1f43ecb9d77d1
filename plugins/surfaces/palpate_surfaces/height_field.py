"""Heights over a plane or a sphere as a Gaussian process, from heights with known uncertainties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats
from palpate_kit.numerics.gaussian_process import GaussianProcess, matern_5_2

_FREE = 10.0  # of the heights' standard deviation: that of height and slopes of the base itself, which are free
_ROUNDS, _SIDE = 4, 5  # of the search for the largest likelihood, and points of a side of its grid
_LENGTHS = (0.15, 3.0)  # of the extent
_AMPLITUDES = (0.3, 30.0)  # of the heights' standard deviation


@dataclass(frozen=True)
class HeightField:
    """A Gaussian process with the covariance s^2 (1 + r + r^2/3) exp(-r), r = sqrt(5) |q - q'|/l, and linear terms.

    Amplitude s and length l are those of the largest likelihood; the noise is the heights' own.
    Source: Rasmussen and Williams 2006, sections 2.7 and 5.4.
    """

    q: Floats  # (n, k) [m]
    extent: float  # [m] over which a free slope counts
    free: float  # [m] standard deviation of the free terms
    amplitude: float  # [m]
    length: float  # [m]
    process: GaussianProcess  # of the heights
    height: Floats  # (n,) [m]
    std: Floats  # (n,) [m]

    @classmethod
    def of(cls, q: Floats, height: Floats, std: Floats) -> HeightField:
        """Return the process of heights (n,) at q (n, k), known to (n,)."""
        extent = float(np.linalg.norm(np.ptp(q, axis=0)))
        size = float(np.std(height - _linear(q, height))) + float(np.median(std))
        fixed = extent, _FREE * (size + float(np.std(height)))
        low, high = np.log(np.array([size, extent]) * np.array([_AMPLITUDES, _LENGTHS]).T)
        best = (low + high) / 2
        for _ in range(_ROUNDS):
            axes = [np.linspace(a, b, _SIDE) for a, b in zip(low, high)]
            grid = np.array([[a, b] for a in axes[0] for b in axes[1]])
            likelihoods = [_process(q, height, std, *fixed, *np.exp(at)).log_likelihood for at in grid]
            best = grid[int(np.argmax(likelihoods))]
            half = (high - low) / (_SIDE - 1)
            low, high = best - half, best + half
        amplitude, length = np.exp(best)
        process = _process(q, height, std, *fixed, amplitude, length)
        return cls(q, *fixed, float(amplitude), float(length), process, height, std)

    def mean(self, q: Floats) -> Floats:
        """(m,) [m] heights at q (m, k)."""
        return self.process.mean(self._between(self.q, q))

    def covariance(self, q: Floats) -> Floats:
        """(m, m) [m^2] of the heights at q (m, k)."""
        return self.process.covariance(self._between(q, q), self._between(self.q, q))

    def left_out(self) -> Floats:
        """(n,) by how many standard deviations each height is off what the others say."""
        return self.process.left_out()

    def deviation_from_others(self, row: int) -> float:
        """By how many standard deviations a height is off, with amplitude and length of the others alone."""
        rest = np.arange(len(self.q)) != row
        others = HeightField.of(self.q[rest], self.height[rest], self.std[rest])
        at = self.q[row][None]
        std = np.sqrt(others.covariance(at)[0, 0] + self.std[row] ** 2)
        return float(abs(self.height[row] - others.mean(at)[0]) / std)

    def _between(self, q: Floats, other: Floats) -> Floats:
        return _covariance(q, other, self.extent, self.free, self.amplitude, self.length)


def _linear(q: Floats, height: Floats) -> Floats:
    """Return the linear function of q that fits best, at each."""
    design = np.column_stack([np.ones(len(q)), q])
    return np.asarray(design @ np.linalg.lstsq(design, height, rcond=None)[0])


def _covariance(q: Floats, other: Floats, extent: float, free: float, amplitude: float, length: float) -> Floats:
    distance = np.sqrt(((q[:, None] - other[None]) ** 2).sum(axis=2))
    return np.asarray(free**2 * (1.0 + q @ other.T / extent**2) + amplitude**2 * matern_5_2(distance, length))


def _process(
    q: Floats, height: Floats, std: Floats, extent: float, free: float, amplitude: float, length: float
) -> GaussianProcess:
    return GaussianProcess.of(_covariance(q, q, extent, free, amplitude, length), std**2, height)
