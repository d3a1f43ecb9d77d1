"""Repeated values of one quantity: the uncertainty of their mean."""

from __future__ import annotations

import math

import numpy as np
from palpate import Floats

from palpate_kit.numerics.unit_group import scatters

CORRELATED_FROM = 4  # values, from which on the correlation of neighbours is known well enough to count: a choice
MAX_CORRELATION = 0.99  # of neighbours, so that the uncertainty of the mean stays finite: a choice


def autocorrelation(values: Floats, lags: int) -> Floats:
    """Return the autocorrelation (lags + 1,) of values (n,), biased estimator, from lag 0; empty without scatter."""
    centred = np.asarray(values, float) - np.mean(values)
    power = float(centred @ centred)
    if not scatters(values):
        return np.zeros(0)
    lags = min(lags, len(centred) - 1)
    return np.array([float(centred[: len(centred) - lag] @ centred[lag:]) / power for lag in range(lags + 1)])


def neighbour_correlation(values: Floats) -> float:
    """Return the correlation coefficient of neighbours among values (n,) in their order; NaN without scatter."""
    by_lag = autocorrelation(values, 1)
    return float(by_lag[1]) if len(by_lag) > 1 else math.nan


def std_of_mean(values: Floats) -> float:
    """Return the standard uncertainty of the mean of values (n,) in their order; NaN for a single one.

    With the correlation r of neighbours: s/sqrt(n) sqrt((1 + r)/(1 - r)), r >= 0.
    """
    if len(values) < 2:
        return math.nan
    is_known = len(values) >= CORRELATED_FROM
    # Correlated neighbours count as fewer values; negative correlation is not trusted to count as more.
    r = min(max(neighbour_correlation(values), 0.0), MAX_CORRELATION) if is_known else 0.0
    return float(np.std(values, ddof=1)) / math.sqrt(len(values)) * math.sqrt((1 + r) / (1 - r))


def common_part(common: Floats) -> float:
    """Return what repeats have in common by what each of them states (m,); NaN where none does.

    Radius, Poisson's ratio, timing and mass have the same error in all repeats: it does not scatter, and no mean takes
    any of it away (GUM F.1.2.3).
    """
    return float(np.median(common)) if len(common) else math.nan


def combined_of_mean(std: float, common: Floats) -> float:
    """Return the combined standard uncertainty of a mean, by its own scatter and what repeats have in common (m,)."""
    return float(np.hypot(std, common_part(common) if len(common) else 0.0))
