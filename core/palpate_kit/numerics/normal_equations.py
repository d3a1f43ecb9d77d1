"""Covariances from normal equations, and linear regression with its standard errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

_SAFE_PIVOT = 1e-3  # of a matrix of diagonal 1: rounding grows by its inverse, to 1e-13 of the result at most; a choice
_MAX_SWEPT = 12  # unknowns, up to which plain numbers are faster than the call of LAPACK: measured
_MIN_LENGTH = 1e-300  # guards against a division by 0
_ROUNDING = 1e-14  # of the largest eigenvalue, up to which one is rounding


def scaled_inverse(normal: Floats) -> Floats:
    """Return the inverse (p, p) of normal equations J^T J (p, p) whose unknowns differ by many powers of ten.

    An unknown without effect, and a direction that rounding does not distinguish from none, have zeros.
    """
    lengths = np.sqrt(normal.diagonal())
    lengths[~(lengths > 0)] = 1.0
    across = lengths[:, None] * lengths
    return np.asarray(symmetric_inverse(normal / across, _ROUNDING) / across)


def standard_errors(slopes: Floats) -> Floats:
    """Return the standard deviations (p,) of unknowns with these slopes (n, p), for white noise of 1."""
    lengths = np.maximum(np.linalg.norm(slopes, axis=0), _MIN_LENGTH)
    unit = slopes / lengths
    inverse = symmetric_inverse(unit.T @ unit, _ROUNDING)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse), 0.0)) / lengths)


def symmetric_inverse(square: Floats, least: float) -> Floats:
    """Return the pseudo-inverse (p, p) of a symmetric matrix of diagonal 1.

    Eigenvalues up to `least` of the largest do not count.
    """
    if not len(square):
        return square
    if len(square) <= _MAX_SWEPT and (inverse := _sweep(square.tolist())) is not None:
        return np.array(inverse)
    values, directions = np.linalg.eigh(square)
    sizes = np.abs(values)
    kept = sizes > least * sizes.max()
    return np.asarray(directions * np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0) @ directions.T)


def _sweep(square: list[list[float]]) -> list[list[float]] | None:
    """Return the inverse of a symmetric matrix of diagonal 1, in plain numbers; None where it is near to having none.

    Sweeps one unknown after the other (Goodnight 1979); the call of LAPACK alone takes five times as long.
    """
    places = range(len(square))
    for k in places:
        row = square[k]
        pivot = row[k]
        if not pivot > _SAFE_PIVOT:
            return None
        scaled = [value / pivot for value in row]
        for i in places:
            if i != k:
                share = square[i][k]
                square[i] = [value - share * pivot_value for value, pivot_value in zip(square[i], scaled, strict=True)]
                square[i][k] = -share / pivot
        scaled[k] = 1.0 / pivot
        square[k] = scaled
    return square


@dataclass(frozen=True)
class LinearRegression:
    """The least squares of a target (n,) over columns (n, k)."""

    weights: Floats  # (k,)
    residual: Floats  # (n,) target minus columns times weights
    inverse: Floats  # (k, k) (X^T X)^-1

    @property
    def rms(self) -> float:
        """Root mean square of the residual."""
        return float(np.sqrt(self.residual @ self.residual / len(self.residual)))

    @property
    def noise(self) -> float:
        """Standard deviation of white noise that leaves this residual over n - k degrees of freedom."""
        return float(np.sqrt(self.residual @ self.residual / (len(self.residual) - len(self.weights))))

    def errors(self, noise: float | None = None) -> Floats:
        """Return the standard errors (k,) of the weights by a noise; by that of the residual without one."""
        spread = np.sqrt(np.maximum(np.diag(self.inverse), 0.0))
        return np.asarray((self.noise if noise is None else noise) * spread)


def linear_regression(columns: Floats, target: Floats) -> LinearRegression:
    """Return the least squares of a target (n,) over columns (n, k), which may differ by many powers of ten."""
    lengths = np.linalg.norm(columns, axis=0)
    lengths[~(lengths > 0)] = 1.0
    unit = columns / lengths
    weights = np.linalg.lstsq(unit, target, rcond=None)[0] / lengths
    inverse = symmetric_inverse(unit.T @ unit, _ROUNDING) / np.outer(lengths, lengths)
    return LinearRegression(np.asarray(weights, np.float64), target - columns @ weights, inverse)
