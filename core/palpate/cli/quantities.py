"""Numbers as people read them."""

from __future__ import annotations

import math

# SI unit -> what people write, and how many of it one SI unit is.
_PEOPLE = {"Pa": ("kPa", 1e-3), "m": ("mm", 1e3), "Pa*s": ("Pa s", 1.0)}


def people(unit: str) -> tuple[str, float]:
    """The unit that people write for an SI unit, and how many of it one SI unit is."""
    return _PEOPLE.get(unit, (unit, 1.0))


def measured(value: float, std: float) -> str:
    """A value and its uncertainty, to two digits of the uncertainty.

    >>> measured(126.5312, 0.2134)
    '126.53 ± 0.21'
    """
    if not math.isfinite(value):
        return "-"
    if not (math.isfinite(std) and std > 0):
        return f"{value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{digits}f} ± {std:.{digits}f}"
