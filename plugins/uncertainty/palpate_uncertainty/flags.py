"""A flag for the effect on values of a robot and a sensor that give way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from palpate import Flag

_MIN_SHARE = 0.01  # of a parameter, a choice: a smaller shift has no sentence


def compliance_flags(shares: Mapping[str, float], stiffness: float | None) -> Iterator[Flag]:
    """Yield the flag of parameters that a robot's compliance shifts by over 1 %; `shares` of their values by name."""
    strong = [f"{name} by {100 * share:.2g} %" for name, share in shares.items() if share > _MIN_SHARE]
    if stiffness is not None and strong:
        yield Flag(
            "series-compliance",
            f"robot and sensor have a stiffness of {1e-3 * stiffness:.3g} N/mm, which shifts "
            f"{', '.join(strong)}; it is not corrected",
        )
