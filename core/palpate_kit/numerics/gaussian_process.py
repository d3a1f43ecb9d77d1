"""A Gaussian process from values at places: its covariance functions, its likelihood and its posterior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from palpate import Floats


def matern_3_2(distance: Floats, length: float) -> Floats:
    """Return the correlation (1 + r) exp(-r), r = sqrt(3) d/l, of a process that has one derivative."""
    ratio = np.sqrt(3.0) / length * distance
    return np.asarray((1.0 + ratio) * np.exp(-ratio))


def matern_5_2(distance: Floats, length: float) -> Floats:
    """Return the correlation (1 + r + r^2/3) exp(-r), r = sqrt(5) d/l, of a process that has two derivatives."""
    ratio = np.sqrt(5.0) / length * distance
    return np.asarray((1.0 + ratio + ratio * ratio / 3.0) * np.exp(-ratio))


def whiten(lower: Floats, columns: Floats) -> Floats:
    """Return L^-1 columns (n, m) or (n,), L the lower Cholesky factor (n, n) of a covariance."""
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(lower, columns, lower=True, check_finite=False))


def cholesky_factor(covariance: Floats, noise: Floats | float = 0.0) -> Floats:
    """Return the lower Cholesky factor (n, n) of a covariance (n, n) with a noise variance (n,) on its diagonal."""
    from scipy.linalg import cholesky

    noisy = covariance.copy()
    noisy[np.diag_indices_from(noisy)] += noise
    return np.asarray(cholesky(noisy, lower=True, overwrite_a=True, check_finite=False))


@dataclass(frozen=True)
class GaussianProcess:
    """The posterior of a process of mean 0 by noisy values at n places. Source: Rasmussen and Williams 2006, 2.2."""

    lower: Floats  # (n, n) Cholesky factor L of the covariance K of the values, their noise included
    white: Floats  # (n,) L^-1 of the values

    @classmethod
    def of(cls, covariance: Floats, noise: Floats | float, values: Floats) -> Self:
        """Return the process of values (n,) with a prior covariance (n, n) and noise variances (n,)."""
        lower = cholesky_factor(covariance, noise)
        return cls(lower, whiten(lower, values))

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the likelihood of the values, but for a constant."""
        return -0.5 * float(self.white @ self.white) - float(np.log(np.diag(self.lower)).sum())

    @cached_property
    def weights(self) -> Floats:
        """K^-1 of the values (n,)."""
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self.lower, self.white, trans=1, lower=True, check_finite=False))

    def mean(self, cross: Floats) -> Floats:
        """Return the posterior mean (m,) at places whose prior covariances with the values are `cross` (n, m)."""
        return np.asarray(self.weights @ cross)

    def covariance(self, prior: Floats, cross: Floats) -> Floats:
        """Return the posterior covariance (m, m) of places by their own `prior` (m, m) and `cross` (n, m)."""
        columns = whiten(self.lower, cross)
        return np.asarray(prior - columns.T @ columns)

    def left_out(self) -> Floats:
        """Return by how many standard deviations (n,) each value is off what the others say (5.4.2)."""
        precision = (whiten(self.lower, np.eye(len(self.white))) ** 2).sum(axis=0)  # diagonal of K^-1
        return np.asarray(self.weights / np.sqrt(precision))
