"""Identifiability: unknowns without an effect on the force, and pairs that a record cannot distinguish."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.numerics.normal_equations import symmetric_inverse

_LISTED_CORRELATION = 0.9  # from which on a pair is listed (choice)
INDISTINCT = 0.998  # correlation from which on one of two would be 1/sqrt(1 - rho^2) = 15 times better known alone
_SINGULAR = 1e-15  # of the largest eigenvalue of J^T J, columns of length 1: the rounding of a double


def identifiability(square: Floats, names: list[str], free: int) -> dict[str, Any]:
    """Return unknowns without an effect, and pairs of them by their correlation, from J^T J (k, k) of a Jacobian.

    The first `free` columns are those of the fit; the others are causes that were not fitted, each of which is set
    against every fitted one as if it had been. A pair's correlation is that of the estimates, all free unknowns open.
    """
    # Columns of length 1, so that unknowns in any unit compare.
    lengths = np.sqrt(square.diagonal())
    without_effect = [name for name, length in zip(names[:free], lengths.tolist(), strict=False) if length == 0]
    lengths[lengths == 0] = 1.0
    scaled = square / (lengths[:, None] * lengths)
    # Pairs of fitted unknowns, then each fitted one with a cause that was not fitted.
    pairs = []
    correlation = correlations(scaled[:free, :free])
    for i, j in combinations(range(free), 2):
        pairs.append(_pair(names[i], names[j], correlation[i, j], both_fitted=True))
    for cause in range(free, len(names)):
        rows = [*range(free), cause]
        extended = correlations(scaled[np.ix_(rows, rows)])
        for i in range(free):
            pairs.append(_pair(names[i], names[cause], extended[i, -1], both_fitted=False))
    # Those that are listed, the closest first.
    listed = [pair for pair in pairs if abs(pair["correlation"]) >= _LISTED_CORRELATION]
    listed.sort(key=lambda pair: -abs(pair["correlation"]))
    return {"pairs": listed, "without_effect": without_effect}


def _pair(first: str, second: str, correlation: float, both_fitted: bool) -> dict[str, Any]:
    """Return a pair of unknowns as ``result.json`` has it."""
    return {"first": first, "second": second, "correlation": float(correlation), "both_fitted": both_fitted}


def condition(jacobian: Floats) -> dict[str, Any]:
    """Return the singular values of a Jacobian (n, k) with columns of length 1, and largest over smallest."""
    lengths = np.sqrt(np.sum(jacobian**2, axis=0))
    scaled = jacobian / np.where(lengths > 0, lengths, 1.0)
    values = np.linalg.svd(np.linalg.qr(scaled, mode="r"), compute_uv=False) if len(lengths) else np.zeros(0)
    return {
        "singular_values": [float(value) for value in values],
        "condition": float(values[0] / values[-1]) if len(values) and values[-1] > 0 else None,
    }


def correlations(square: Floats) -> Floats:
    """Return the correlation (k, k) of the estimates that belong to J^T J (k, k), columns of J of length 1."""
    if not len(square):
        return np.zeros((0, 0))
    inverse = symmetric_inverse(square, _SINGULAR)
    variance = inverse.diagonal()
    std = np.sqrt(np.where(variance > 0, variance, 1.0))
    return np.asarray(np.minimum(np.maximum(inverse / (std[:, None] * std), -1.0), 1.0))
