"""Tests of a model against each respect in which it may be wrong, by the ratio of their likelihoods."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_uncertainty.alternative_fit import Refit
from palpate_uncertainty.channel_noise import Null, Runs, without_outliers
from palpate_uncertainty.chi_square import chance_of_more

_SMALLEST_VARIANCE = 1e-300  # in a quotient, in place of 0: near the smallest double


@dataclass(frozen=True)
class DirectedTest:
    """The part of a model's residual that one alternative takes."""

    p: float
    share: float  # of the variance
    bic: float  # of the model, less that of the alternative


def directed_tests(base: Refit, others: Iterable[Refit], runs: Runs, null: Null) -> dict[str, DirectedTest]:
    """Return, by reason, the test of each alternative that adds numbers to the model.

    `base` is the model fitted as it is, `others` are the fitted alternatives, `null` is the noise of the channel.
    Under the model an alternative of m more numbers takes a chi square of m degrees of freedom from the sum of squares
    of the whitened residuals over their variance (Wilks 1938). This shows a pattern below the noise of single samples,
    which means over bins or lags miss. The chi square is divided by `null.excess`: the null is itself an estimate, by
    which slow means of the whitened residual may vary more than those of white noise.
    """
    residual = _whitened(base.residual, runs, null)
    n = max(len(residual), 1)
    tests: dict[str, DirectedTest] = {}
    for other in others:
        if not (other.reason and other.extra):
            continue
        remainder = _whitened(other.residual, runs, null)
        variance = max(float(np.mean(remainder**2)), _SMALLEST_VARIANCE)
        gain = max(float(np.sum(residual**2)) / variance - len(residual), 0.0) / null.excess
        bic_gain = gain - other.extra * float(np.log(n))
        tests[other.reason] = DirectedTest(chance_of_more(other.extra, gain), gain * null.excess / n, bic_gain)
    return tests


def _whitened(residual: Floats, runs: Runs, null: Null) -> Floats:
    """Return the whitened residual of the samples that have a past, outliers clipped."""
    white, has_past = null.whitened(residual, runs)
    return without_outliers(white[has_past])
