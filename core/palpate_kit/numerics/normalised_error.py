"""E_n: the agreement of a value with that of a reference within their expanded uncertainties."""

from __future__ import annotations

import math

COVERAGE = 2.0  # k of expanded uncertainties, some 95 % (ISO 13528)


def normalised_error(value: float, std: float, reference: float, reference_std: float) -> float:
    """Return E_n = (x - X)/sqrt(U_x^2 + U_X^2), U = 2 u: agreement up to 1 in magnitude.

    Source: ISO 13528:2022, 9.7; ISO/IEC 17043:2023.

    >>> round(normalised_error(115.0, 1.8, 112.5, 1.5), 4)
    0.5335
    """
    return (value - reference) / (COVERAGE * math.hypot(std, reference_std))
