"""Heights over a plane or a sphere as a Gaussian process, from heights with known uncertainties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

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
    weights: Floats  # (n,) K^-1 h
    inverse: Floats  # (n, n) K^-1
    height: Floats  # (n,) [m]
    std: Floats  # (n,) [m]

    @classmethod
    def of(cls, q: Floats, height: Floats, std: Floats) -> HeightField:
        """The process of heights (n,) at q (n, k), known to (n,)."""
        extent = float(np.linalg.norm(np.ptp(q, axis=0)))
        size = float(np.std(height - _linear(q, height))) + float(np.median(std))
        fixed = extent, _FREE * (size + float(np.std(height)))
        low, high = np.log(np.array([size, extent]) * np.array([_AMPLITUDES, _LENGTHS]).T)
        best = (low + high) / 2
        for _ in range(_ROUNDS):
            axes = [np.linspace(a, b, _SIDE) for a, b in zip(low, high)]
            grid = np.array([[a, b] for a in axes[0] for b in axes[1]])
            best = grid[int(np.argmax([_likelihood(q, height, std, *fixed, *np.exp(at)) for at in grid]))]
            half = (high - low) / (_SIDE - 1)
            low, high = best - half, best + half
        amplitude, length = np.exp(best)
        inverse: Floats = np.asarray(np.linalg.inv(_covariance(q, q, *fixed, amplitude, length) + np.diag(std**2)))
        return cls(q, *fixed, float(amplitude), float(length), inverse @ height, inverse, height, std)

    def mean(self, q: Floats) -> Floats:
        """(m,) [m] heights at q (m, k)."""
        return np.asarray(self._to(q) @ self.weights)

    def covariance(self, q: Floats) -> Floats:
        """(m, m) [m^2] of the heights at q (m, k)."""
        to = self._to(q)
        return np.asarray(self._between(q, q) - to @ self.inverse @ to.T)

    def left_out(self) -> Floats:
        """(n,) by how many standard deviations each height is off what the others say."""
        return np.asarray(self.weights / np.sqrt(np.diag(self.inverse)))

    def deviation_from_others(self, row: int) -> float:
        """By how many standard deviations a height is off, with amplitude and length of the others alone."""
        rest = np.arange(len(self.q)) != row
        others = HeightField.of(self.q[rest], self.height[rest], self.std[rest])
        at = self.q[row][None]
        std = np.sqrt(others.covariance(at)[0, 0] + self.std[row] ** 2)
        return float(abs(self.height[row] - others.mean(at)[0]) / std)

    def _to(self, q: Floats) -> Floats:
        return self._between(q, self.q)

    def _between(self, q: Floats, other: Floats) -> Floats:
        return _covariance(q, other, self.extent, self.free, self.amplitude, self.length)


def _linear(q: Floats, height: Floats) -> Floats:
    """The linear function of q that fits best, at each."""
    design = np.column_stack([np.ones(len(q)), q])
    return np.asarray(design @ np.linalg.lstsq(design, height, rcond=None)[0])


def _covariance(q: Floats, other: Floats, extent: float, free: float, amplitude: float, length: float) -> Floats:
    squares = ((q[:, None] - other[None]) ** 2).sum(axis=2)
    r = np.sqrt(5.0 * squares) / length
    smooth = amplitude**2 * (1.0 + r + r * r / 3.0) * np.exp(-r)
    return np.asarray(free**2 * (1.0 + q @ other.T / extent**2) + smooth)


def _likelihood(
    q: Floats, height: Floats, std: Floats, extent: float, free: float, amplitude: float, length: float
) -> float:
    """Logarithm of it, but for a constant."""
    root = np.linalg.cholesky(_covariance(q, q, extent, free, amplitude, length) + np.diag(std**2))
    solved = np.linalg.solve(root, height)
    return -0.5 * float(solved @ solved) - float(np.log(np.diag(root)).sum())
