"""The null of the tests: the noise of the channel as it is, not white noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.tip_travel import median

Runs = NDArray[np.int64]  # (n,) number of the stretch without a gap that a sample belongs to

# A record with a long standstill of nearly white noise does not come near any but the first.
MIN_SAMPLES = 200  # at standstill (choice)
OUTLIER = 6.0  # standard deviations (choice); a value beyond them is an outlier, which is flagged as such
MEDIAN_TO_STD = 1.4826  # standard deviation of normal noise over the median of its absolute value
_MAX_ORDER = 30  # of the autoregression (choice)
_SAMPLES_PER_COEFFICIENT = 20  # of an autoregression, at least (choice)
_ERRORS_OF_SUM = 2.5  # standard errors by which the sum of the coefficients may be too large (choice)
_MIN_WHITENING = 1e-3  # of slow noise, that whitening leaves at least; a choice that bounds the excess
_SMALLEST_POWER = 1e-300  # in a logarithm, in place of 0: near the smallest double


@dataclass(frozen=True)
class Null:
    """Noise as an autoregression: e_t = x_t - sum of c_k x_(t-k) is white."""

    coefficients: Floats  # (p,); empty: white
    samples: int  # that it was found from; 0 where nothing was measured
    source: Literal["standstill", "residual", "assumed"]
    excess: float = 1.0  # variance that slow means of whitened noise may have, by what is not known of the coefficients

    def whitened(self, values: Floats, runs: Runs) -> tuple[Floats, NDArray[np.bool_]]:
        """Return e (n,) of values x (n,), and True (n,) for the samples that have all that e takes."""
        white = values.copy()
        has_past = np.isfinite(values)
        for lag, share in enumerate(self.coefficients.tolist(), start=1):
            white[lag:] -= share * values[:-lag]
            has_past[:lag] = False
            has_past[lag:] &= (runs[lag:] == runs[:-lag]) & np.isfinite(values[:-lag])
        return white, has_past


def without_outliers(white: Floats) -> Floats:
    """Return values (n,), those beyond 6 standard deviations (by their median size) clipped to these."""
    scale = deviation(white)
    return np.clip(white, -OUTLIER * scale, OUTLIER * scale) if scale else white


def deviation(values: Floats) -> float:
    """Return the standard deviation of normal values (n,), by the median of their distances from their median."""
    return MEDIAN_TO_STD * median(np.abs(values - median(values))) if len(values) else 0.0


WHITE = Null(np.zeros(0), 0, "assumed")


def null_of(noise: Floats, source: Literal["standstill", "residual"] = "standstill") -> Null:
    """Return the autoregression (Burg 1968) of the order that BIC prefers; white where samples are too few."""
    noise = noise[np.isfinite(noise)]
    n = len(noise)
    if n < MIN_SAMPLES or float(np.ptp(noise)) == 0.0:
        return WHITE
    noise = noise - noise.mean()
    best, best_bic = np.zeros(0), n * math.log(float(np.mean(noise**2)))
    max_order = min(_MAX_ORDER, n // _SAMPLES_PER_COEFFICIENT)
    for order, (coefficients, power) in enumerate(_burg(noise, max_order), start=1):
        bic = n * math.log(max(power, _SMALLEST_POWER)) + order * math.log(n)
        if bic < best_bic:
            best, best_bic = coefficients, bic
    return Null(best, n, source, _excess(noise, best) if len(best) else 1.0)


def _excess(noise: Floats, coefficients: Floats) -> float:
    """Return ((1 - c + 2.5 u)/(1 - c))^2: the variance that slow means of whitened noise have at most.

    c is the sum of the coefficients, and u its standard error by their covariance s^2 R^-1/n, in which R (p, p) are the
    autocovariances and s^2 is the power of the white noise (Brockwell and Davis 1991, section 8.10).
    """
    n, order = len(noise), len(coefficients)
    lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    autocovariance = np.array([float((noise[lag:] * noise[: n - lag]).sum()) / n for lag in range(order + 1)])
    power = max(float(autocovariance[0] - coefficients @ autocovariance[1:]), 0.0)
    variance = power * float(np.linalg.solve(autocovariance[lags], np.ones(order)).sum())
    error = np.sqrt(max(variance, 0.0) / n)
    whitening = max(1.0 - float(coefficients.sum()), _MIN_WHITENING)
    return float(((whitening + _ERRORS_OF_SUM * error) / whitening) ** 2)


def _burg(values: Floats, max_order: int) -> list[tuple[Floats, float]]:
    """Return the coefficients (p,) and the power of the whitened noise, for the orders 1 to `max_order`.

    By Burg's recursion (1968): each order adds the reflection coefficient 2 f.b/(f.f + b.b), f and b the errors of the
    forward and backward predictions of the order before.
    """
    forward, backward = values[1:], values[:-1]
    coefficients, power = np.zeros(0), float(values @ values) / len(values)
    autoregressions = []
    for _ in range(max_order):
        energy = float(forward @ forward + backward @ backward)
        if energy <= 0:
            break
        reflection = 2.0 * float(forward @ backward) / energy
        coefficients = np.concatenate([coefficients - reflection * coefficients[::-1], [reflection]])
        power *= 1.0 - reflection**2
        autoregressions.append((coefficients, power))
        forward, backward = (forward - reflection * backward)[1:], (backward - reflection * forward)[:-1]
    return autoregressions
