"""Tests of a model against each respect in which it may be wrong, by the ratio of their likelihoods."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from palpate import Floats

from palpate_uncertainty.channel_noise import Null, Runs
from palpate_uncertainty.chi_square import chance_of_more
from palpate_uncertainty.model_alternatives import Refit

_CLIPPED = 6.0  # standard deviations; what is beyond is an outlier
_NEARLY = 10.0  # of twice the logarithm of the likelihood, within which an alternative explains as well as the best


def directed_tests(base: Refit, others: Iterable[Refit], runs: Runs, null: Null) -> Mapping[str, tuple[float, float]]:
    """By reason: p of what an alternative takes from the residual, and the share of the variance that it takes.

    Under the model an alternative of m more numbers takes a chi square of m degrees of freedom from the sum of squares
    of the whitened residuals over their variance (Wilks 1938). A pattern below the noise of single samples, which means
    over bins or lags miss, shows so. The variance of slow means that the null does not know divides it.
    """
    left = _whitened(base.residual, runs, null)
    found = {}
    for other in others:
        if other.reason and other.extra:
            less = _whitened(other.residual, runs, null)
            power = max(float(np.mean(less**2)), 1e-300)
            gain = max(float(np.sum(left**2)) / power - len(left), 0.0) / null.excess
            found[other.reason] = chance_of_more(other.extra, gain), gain * null.excess / max(len(left), 1)
    return found


def near_best(found: Mapping[str, tuple[float, float]], samples: int, level: float) -> list[str]:
    """The reasons, of a p below a level each, that explain a record nearly as well as the best of them."""
    most = max((share for _, share in found.values()), default=0.0)
    return [name for name, (p, share) in found.items() if p < level and samples * (most - share) < _NEARLY]


def _whitened(residual: Floats, runs: Runs, null: Null) -> Floats:
    white, known = null.whitened(residual, runs)
    white = white[known]
    scale = float(np.median(np.abs(white - np.median(white)))) * 1.4826 if len(white) else 0.0
    return np.clip(white, -_CLIPPED * scale, _CLIPPED * scale) if scale else white
