"""The typed report of a fit, made of its details."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

from palpate import BudgetRow, FitReport, Unknown


def fit_report(details: Mapping[str, Any], budget: Sequence[BudgetRow]) -> FitReport:
    """Return residual, unknowns, evidence and budget of the details of a fit, as fields."""
    unknowns, autocorrelation = details["unknowns"], details["autocorrelation"]
    return FitReport(
        rss=details["rss"],
        samples=details["samples"],
        unknowns={name: _unknown(entry) for name, entry in unknowns.items()},
        correlations=_correlations(details["covariance"]["names"], details["covariance"]["matrix"]),
        aic=details["aic"],
        bic=details["bic"],
        basis=details["segment"],
        autocorrelation=autocorrelation["first"],
        effective_samples=autocorrelation["effective_samples"],
        bias=unknowns["bias"]["value"],
        drift=unknowns["slope"]["value"],
        cycles=int(details["cycles"]),
        budget=tuple(budget),
    )


def _unknown(entry: Mapping[str, Any]) -> Unknown:
    """Return an unknown from its entry in the details."""
    std, random, systematic = (entry.get(key) for key in ("std", "random", "systematic"))
    interval = tuple(entry["interval"]) if "interval" in entry else None
    return Unknown(
        value=entry["value"],
        unit=entry["unit"],
        free=entry["free"],
        std=std,
        random=random,
        systematic=systematic,
        interval=interval,
    )


def _correlations(names: list[str], covariance: list[list[float]]) -> dict[tuple[str, str], float]:
    """Return the correlation of each pair of unknowns, by their names; none with one of variance 0."""
    correlations = {}
    for i, j in combinations(range(len(names)), 2):
        scale = math.sqrt(covariance[i][i] * covariance[j][j])
        if scale > 0:
            correlations[names[i], names[j]] = covariance[i][j] / scale
    return correlations
