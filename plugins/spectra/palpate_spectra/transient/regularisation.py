"""A spectrum of times, by regularised least squares without negative parts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate import Floats

_SEARCHED = np.geomspace(1e-4, 1e8, 25)  # weights of the roughness that are tried
_TURNS = 50  # of the search for numbers >= 0, for each


@dataclass(frozen=True)
class Weighing:
    """The numbers of a linear law, with their covariance."""

    values: Floats  # (free + k,) those that are not smoothed, then the spectrum's
    covariance: Floats  # of them, noise and what the smoothing cannot see together
    smoothing: float  # the weight that was taken
    chi2: float
    freedom: float
    roughness: float  # what the smoothing adds to chi2


def solve_regularised(
    columns: Floats, target: Floats, std: Floats, free: int, smoothing: float | None = None
) -> Weighing:
    """Numbers x >= 0 with columns @ x near the target (m,), whose noise has the standard deviations (m,).

    All but the first `free` numbers are a spectrum over evenly spaced logarithms of time: |(C x - y)/s|^2 + w |D2 x|^2,
    D2 the second difference of the spectrum, which is 0 beyond its longest time (Honerkamp and Weese 1989). The weight
    w is that of the largest evidence unless `smoothing` gives it. The covariance is that of the posterior, which holds
    the truth as often as it says on average over the spectrum (Wahba 1983); it is that of a noise that the residuals
    show, where this is larger than what was given.
    """
    a, y = columns / std[:, None], target / std
    k = columns.shape[1] - free
    rough = np.zeros((k + 2, columns.shape[1]))
    for i in range(k):
        rough[i : i + 3, free + i] = (1.0, -2.0, 1.0)
    rough = rough[2:]  # what goes on below the shortest time is not known
    size = max(float(np.abs(y).max() / np.abs(a).max()), 1e-300)
    weights = _SEARCHED / size**2 if smoothing is None else [smoothing]
    tried = [_at(a, y, rough, float(weight), k) for weight in weights]
    _, x, weight = max(tried, key=lambda one: one[0])
    precision = a.T @ a + weight * rough.T @ rough
    inverse = np.asarray(np.linalg.inv(precision + 1e-13 * np.diag(np.diag(precision))), np.float64)
    left = a @ x - y
    freedom = max(len(y) - float(np.trace(inverse @ (a.T @ a))), 1.0)
    chi2 = float(left @ left)
    bent = rough @ x
    return Weighing(x, inverse * max(chi2 / freedom, 1.0), weight, chi2, freedom, weight * float(bent @ bent))


def least(columns: Floats, target: Floats, std: Floats) -> float:
    """Chi^2 of the best x >= 0 for columns @ x near the target (m,), smooth or not."""
    from scipy.optimize import nnls

    return float(nnls(columns / std[:, None], target / std, maxiter=_TURNS * columns.shape[1])[1] ** 2)


def _at(a: Floats, y: Floats, rough: Floats, weight: float, rank: int) -> tuple[float, Floats, float]:
    """Logarithm of the evidence, the numbers, and the weight."""
    from scipy.optimize import nnls

    stacked = np.vstack([a, math.sqrt(weight) * rough])
    x = nnls(stacked, np.concatenate([y, np.zeros(len(rough))]), maxiter=_TURNS * a.shape[1])[0]
    left, bent = a @ x - y, rough @ x
    cost = float(left @ left) + weight * float(bent @ bent)
    precision = a.T @ a + weight * rough.T @ rough
    _, log_det = np.linalg.slogdet(precision + 1e-13 * np.diag(np.diag(precision)))
    return 0.5 * rank * math.log(weight) - 0.5 * float(log_det) - 0.5 * cost, x, weight
