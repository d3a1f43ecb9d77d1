"""A spectrum of times, by regularised least squares without negative parts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import Floats

# Choices.
_SMOOTHING_GRID = np.geomspace(1e-4, 1e8, 25)  # weights of the roughness in units of the data's: two a decade
_NNLS_ITERATIONS = 50  # for each unknown; scipy's default is 3
_JITTER = 1e-13  # of the diagonal of a precision matrix, so that rounding leaves it positive
_MIN_SIZE = 1e-300  # keeps a division by a size finite


@dataclass(frozen=True)
class SpectrumEstimate:
    """The coefficients of a linear law, with their covariance."""

    values: Floats  # (free + k,) those that are not smoothed, then the spectrum's
    covariance: Floats  # (free + k, free + k) by the noise, and by what smoothing leaves open
    smoothing: float  # weight w of the roughness
    chi2: float
    freedom: float  # degrees of freedom of chi2
    roughness: float  # w |D2 x|^2, which the smoothing adds to chi2


def solve_regularised(
    columns: Floats, target: Floats, std: Floats, free: int, smoothing: float | None = None
) -> SpectrumEstimate:
    """Return coefficients x >= 0 with columns @ x near the target (m,), whose noise has standard deviations (m,).

    `columns` is (m, free + k). All but the first `free` coefficients are a spectrum over evenly spaced logarithms of
    time: x minimises |(C x - y)/s|^2 + w |D2 x|^2, D2 the second difference of the spectrum, which is 0 beyond its
    longest time (Honerkamp and Weese 1989). The weight w is that of the largest evidence unless `smoothing` states it.
    The covariance is that of the posterior, which holds the truth as often as it says on average over the spectrum
    (Wahba 1983); it is widened where the residuals show more noise than was stated.
    """
    a, y = columns / std[:, None], target / std
    spectrum_size = columns.shape[1] - free
    roughness_matrix = _roughness_matrix(free, spectrum_size)
    if smoothing is None:
        size = max(float(np.abs(y).max() / np.abs(a).max()), _MIN_SIZE)  # of a coefficient
        weights = [float(weight) for weight in _SMOOTHING_GRID / size**2]
        x, weight = _most_evident(a, y, roughness_matrix, weights, spectrum_size)
    else:
        weight = float(smoothing)
        x = _minimise(a, y, roughness_matrix, weight)

    precision = a.T @ a + weight * roughness_matrix.T @ roughness_matrix
    covariance = np.asarray(np.linalg.inv(precision + _JITTER * np.diag(np.diag(precision))), np.float64)
    residual = a @ x - y
    # The trace is the number of parameters that the data determine (effective degrees of freedom of a smoother).
    freedom = max(len(y) - float(np.trace(covariance @ (a.T @ a))), 1.0)
    chi2 = float(residual @ residual)
    second_differences = roughness_matrix @ x
    return SpectrumEstimate(
        values=x,
        covariance=covariance * max(chi2 / freedom, 1.0),
        smoothing=weight,
        chi2=chi2,
        freedom=freedom,
        roughness=weight * float(second_differences @ second_differences),
    )


def _roughness_matrix(free: int, spectrum_size: int) -> Floats:
    """Return D2 (k, free + k), the second differences of a spectrum that is 0 beyond its longest time.

    The two differences that reach below the shortest time are left out: how the spectrum goes on there is not known.
    """
    differences = np.zeros((spectrum_size + 2, free + spectrum_size))
    for i in range(spectrum_size):
        differences[i : i + 3, free + i] = (1.0, -2.0, 1.0)
    return differences[2:]


def min_chi2(columns: Floats, target: Floats, std: Floats) -> float:
    """Return chi^2 of the best x >= 0, smooth or not, for columns (m, p) @ x near the target (m,)."""
    from scipy.optimize import nnls

    max_iterations = _NNLS_ITERATIONS * columns.shape[1]
    _, residual_norm = nnls(columns / std[:, None], target / std, maxiter=max_iterations)
    return float(residual_norm**2)


def _most_evident(
    a: Floats, y: Floats, roughness_matrix: Floats, weights: list[float], spectrum_size: int
) -> tuple[Floats, float]:
    """Return the coefficients and the weight of the roughness whose evidence is the largest.

    log(evidence) = rank(D2)/2 log(w) - log|A^T A + w D2^T D2|/2 - (|A x - y|^2 + w |D2 x|^2)/2, up to a constant.
    """
    candidates = []
    for weight in weights:
        x = _minimise(a, y, roughness_matrix, weight)
        residual, second_differences = a @ x - y, roughness_matrix @ x
        cost = float(residual @ residual) + weight * float(second_differences @ second_differences)
        precision = a.T @ a + weight * roughness_matrix.T @ roughness_matrix
        _, log_determinant = np.linalg.slogdet(precision + _JITTER * np.diag(np.diag(precision)))
        evidence = 0.5 * spectrum_size * math.log(weight) - 0.5 * float(log_determinant) - 0.5 * cost
        candidates.append((evidence, x, weight))
    _, x, weight = max(candidates, key=lambda candidate: candidate[0])
    return x, weight


def _minimise(a: Floats, y: Floats, roughness_matrix: Floats, weight: float) -> Floats:
    """Return the x >= 0 of the least |A x - y|^2 + w |D2 x|^2."""
    from scipy.optimize import nnls

    stacked = np.vstack([a, math.sqrt(weight) * roughness_matrix])
    stacked_target = np.concatenate([y, np.zeros(len(roughness_matrix))])
    return np.asarray(nnls(stacked, stacked_target, maxiter=_NNLS_ITERATIONS * a.shape[1])[0])
