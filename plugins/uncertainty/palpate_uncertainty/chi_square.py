"""The tail of a chi-square, without the import of scipy."""

from __future__ import annotations

import math


def chance_of_more(freedom: int, value: float) -> float:
    """Return the probability that a chi-square of whole degrees of freedom is more than a value.

    Q(k/2, x/2) as a finite sum (Abramowitz and Stegun 1964, 26.4.4 and 26.4.5).
    """
    if not value > 0.0:
        return math.nan if math.isnan(value) else 1.0
    half, odd = 0.5 * value, freedom % 2
    if math.isinf(half):
        return 0.0
    powers = [i + 0.5 * odd for i in range(freedom // 2)]
    terms = [math.exp(power * math.log(half) - half - math.lgamma(power + 1.0)) for power in powers]
    return min(math.fsum(terms) + (math.erfc(math.sqrt(half)) if odd else 0.0), 1.0)
