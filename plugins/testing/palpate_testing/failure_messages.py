"""How a check reports what is wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def demand(holds: object, complaint: str) -> None:
    """Raise AssertionError with a complaint unless a condition is met."""
    if not holds:
        raise AssertionError(complaint)


def demand_close(found: ArrayLike, expected: ArrayLike, tolerance: float, complaint: str) -> None:
    """Raise AssertionError unless two arrays agree within a tolerance relative to the largest expected value."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    demand(found.shape == expected.shape, f"{complaint}: shape {found.shape} instead of {expected.shape}")
    scale = max(float(np.max(np.abs(expected), initial=0.0)), 1e-300)
    worst = float(np.max(np.abs(found - expected), initial=0.0)) / scale
    demand(worst <= tolerance, f"{complaint}: off by {worst:.2g} of the largest value, allowed {tolerance:.2g}")
