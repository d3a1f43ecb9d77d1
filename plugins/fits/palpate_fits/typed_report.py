"""The typed report of a fit, made of its details."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

from palpate import BudgetRow, FitReport, Unknown


def fit_report(details: Mapping[str, Any], budget: Sequence[BudgetRow]) -> FitReport:
    """Residual, unknowns, evidence and budget, as every reader of fits knows them."""
    table, memory = details["unknowns"], details["autocorrelation"]
    return FitReport(
        rss=details["rss"],
        samples=details["samples"],
        unknowns={name: _unknown(known) for name, known in table.items()},
        correlations=_correlations(details["covariance"]["names"], details["covariance"]["matrix"]),
        aic=details["aic"],
        bic=details["bic"],
        basis=details["segment"],
        autocorrelation=memory["first"],
        effective_samples=memory["effective_samples"],
        bias=table["bias"]["value"],
        drift=table["slope"]["value"],
        cycles=int(details["cycles"]),
        budget=tuple(budget),
    )


def _unknown(known: Mapping[str, Any]) -> Unknown:
    std, random, systematic = (known.get(key) for key in ("std", "random", "systematic"))
    interval = tuple(known["interval"]) if "interval" in known else None
    return Unknown(known["value"], known["unit"], known["free"], std, random, systematic, interval)


def _correlations(names: list[str], covariance: list[list[float]]) -> dict[tuple[str, str], float]:
    found = {}
    for i, j in combinations(range(len(names)), 2):
        scale = math.sqrt(covariance[i][i] * covariance[j][j])
        if scale > 0:
            found[names[i], names[j]] = covariance[i][j] / scale
    return found
