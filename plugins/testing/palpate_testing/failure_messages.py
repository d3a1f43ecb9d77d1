"""Demands of a check, which raise AssertionError with a complaint."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

TINY = 1e-300  # guards against a division by 0


def demand(holds: object, complaint: str) -> None:
    """Raise AssertionError with a complaint unless a condition is met."""
    if not holds:
        raise AssertionError(complaint)


def demand_close(actual: ArrayLike, expected: ArrayLike, tolerance: float, complaint: str) -> None:
    """Raise AssertionError unless two arrays agree within a tolerance relative to the largest expected value."""
    actual_array, expected_array = np.asarray(actual, float), np.asarray(expected, float)
    is_same_shape = actual_array.shape == expected_array.shape
    demand(is_same_shape, f"{complaint}: shape {actual_array.shape} instead of {expected_array.shape}")
    scale = max(float(np.max(np.abs(expected_array), initial=0.0)), TINY)
    largest_error = float(np.max(np.abs(actual_array - expected_array), initial=0.0)) / scale
    is_close = largest_error <= tolerance
    demand(is_close, f"{complaint}: off by {largest_error:.2g} of the largest value, allowed {tolerance:.2g}")
