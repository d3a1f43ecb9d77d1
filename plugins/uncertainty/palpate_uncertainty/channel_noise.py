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

ENOUGH = 200  # samples at standstill
OUTLIER = 6.0  # standard deviations; what is beyond is an outlier, which is flagged as such
_MAX_ORDER = 30  # order of the autoregression


@dataclass(frozen=True)
class Null:
    """Noise as an autoregression: e_t = x_t - sum of c_k x_(t-k) is white."""

    coefficients: Floats  # (p,); empty: white
    samples: int  # that it was found from; 0 where nothing was measured
    source: Literal["standstill", "residual", "assumed"]
    excess: float = 1.0  # variance that slow means of whitened noise may have, by what is not known of the coefficients

    def whitened(self, values: Floats, runs: Runs) -> tuple[Floats, NDArray[np.bool_]]:
        """White noise (n,) where `values` (n,) are this noise, and which samples have all that it takes (n,)."""
        white = values.copy()
        known = np.isfinite(values)
        for lag, share in enumerate(self.coefficients.tolist(), start=1):
            white[lag:] -= share * values[:-lag]
            known[:lag] = False
            known[lag:] &= (runs[lag:] == runs[:-lag]) & np.isfinite(values[:-lag])
        return white, known


def without_outliers(white: Floats) -> Floats:
    """Values (n,) with what is beyond 6 standard deviations, by their median size, brought back to these."""
    scale = deviation(white)
    return np.clip(white, -OUTLIER * scale, OUTLIER * scale) if scale else white


def deviation(values: Floats) -> float:
    """Standard deviation of normal values (n,), by the median of their distances from their median."""
    return 1.4826 * median(np.abs(values - median(values))) if len(values) else 0.0


WHITE = Null(np.zeros(0), 0, "assumed")


def null_of(noise: Floats, source: Literal["standstill", "residual"] = "standstill") -> Null:
    """Return the autoregression (Burg 1968) of the order that BIC prefers; white where samples are too few."""
    known = noise[np.isfinite(noise)]
    n = len(known)
    if n < ENOUGH or float(np.ptp(known)) == 0.0:
        return WHITE
    known = known - known.mean()
    best, best_bic = np.zeros(0), n * math.log(float(np.mean(known**2)))
    for order, (coefficients, power) in enumerate(_burg(known, min(_MAX_ORDER, n // 20)), start=1):
        bic = n * math.log(max(power, 1e-300)) + order * math.log(n)
        if bic < best_bic:
            best, best_bic = coefficients, bic
    return Null(best, n, source, _excess(known, best) if len(best) else 1.0)


def _excess(noise: Floats, coefficients: Floats) -> float:
    """((1 - c + 2.5 u)/(1 - c))^2, c the sum of the coefficients and u its standard error: the slow noise left at most.

    The coefficients' covariance is s^2 R^-1/n (Brockwell and Davis 1991, section 8.10).
    """
    n, order = len(noise), len(coefficients)
    lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    gamma = np.array([float((noise[lag:] * noise[: n - lag]).sum()) / n for lag in range(order + 1)])
    power = max(float(gamma[0] - coefficients @ gamma[1:]), 0.0)
    error = np.sqrt(max(power * float(np.linalg.solve(gamma[lags], np.ones(order)).sum()), 0.0) / n)
    rest = max(1.0 - float(coefficients.sum()), 1e-3)
    return float(((rest + 2.5 * error) / rest) ** 2)


def _burg(values: Floats, highest: int) -> list[tuple[Floats, float]]:
    """Coefficients (p,) and the power of what is left, for the orders 1 to `highest`."""
    forward, backward = values[1:], values[:-1]
    coefficients, power = np.zeros(0), float(values @ values) / len(values)
    found = []
    for _ in range(highest):
        energy = float(forward @ forward + backward @ backward)
        if energy <= 0:
            break
        reflection = 2.0 * float(forward @ backward) / energy
        coefficients = np.concatenate([coefficients - reflection * coefficients[::-1], [reflection]])
        power *= 1.0 - reflection**2
        found.append((coefficients, power))
        forward, backward = (forward - reflection * backward)[1:], (backward - reflection * forward)[:-1]
    return found
