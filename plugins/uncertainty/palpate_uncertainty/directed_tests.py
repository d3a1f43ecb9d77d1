"""Tests of a model against each respect in which it may be wrong, by the ratio of their likelihoods."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_uncertainty.alternative_fit import Refit
from palpate_uncertainty.channel_noise import Null, Runs, without_outliers
from palpate_uncertainty.chi_square import chance_of_more


@dataclass(frozen=True)
class DirectedTest:
    """The part of a model's residual that one alternative takes."""

    p: float
    share: float  # of the variance
    bic: float  # less than that of the model, by so much


def directed_tests(base: Refit, others: Iterable[Refit], runs: Runs, null: Null) -> dict[str, DirectedTest]:
    """By reason, the test of each alternative that adds numbers to the model.

    Under the model an alternative of m more numbers takes a chi square of m degrees of freedom from the sum of squares
    of the whitened residuals over their variance (Wilks 1938). A pattern below the noise of single samples, which means
    over bins or lags miss, shows so. The variance of slow means that the null does not know divides it.
    """
    left = _whitened(base.residual, runs, null)
    n, found = max(len(left), 1), {}
    for other in others:
        if other.reason and other.extra:
            less = _whitened(other.residual, runs, null)
            power = max(float(np.mean(less**2)), 1e-300)
            gain = max(float(np.sum(left**2)) / power - len(left), 0.0) / null.excess
            bic = gain - other.extra * float(np.log(n))
            found[other.reason] = DirectedTest(chance_of_more(other.extra, gain), gain * null.excess / n, bic)
    return found


def _whitened(residual: Floats, runs: Runs, null: Null) -> Floats:
    white, known = null.whitened(residual, runs)
    return without_outliers(white[known])
