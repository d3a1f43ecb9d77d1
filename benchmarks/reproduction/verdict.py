"""The verdict on a row, by twice the combined uncertainty of both numbers and by nothing that is set by hand."""

from __future__ import annotations

import math
from typing import Literal

from reproduction.item import PublishedNumber, half_digit

Status = Literal["reproduced", "outside", "no test", "fitted", "arithmetic", "simulated", "shown", "skipped", "failed"]

# Sources that move both numbers alike, since both take them from the same model of the same palpation.
COMMON = ("thickness", "radius", "poisson", "lack_of_fit")
WIDEST = 0.2  # of the published number: a tolerance beyond tests nothing


def judge(published: PublishedNumber, value: float, std: float) -> tuple[Status, float | None]:
    """Verdict and tolerance, None without one; `std` is that of the value without what is common to both.

    The paper's part is its standard uncertainty, or the rounding of the digits that it prints. A count is exact.
    """
    if published.shown:
        return "shown", None
    if published.fitted:
        return "fitted", None
    if published.source == "simulated":
        return "simulated", None
    own_digits = half_digit(published.value) / math.sqrt(3.0)
    tolerance = 2.0 * math.hypot(std, own_digits if published.spread is None else published.spread)
    if published.quantity == "lumps":
        tolerance = 0.0
    if not tolerance <= WIDEST * abs(published.number):
        return "no test", tolerance
    if not abs(value - published.number) <= tolerance + 1e-12:
        return "outside", tolerance
    return ("arithmetic" if published.source == "arithmetic" else "reproduced"), tolerance
