"""The report of an offline fit in addition to its estimates, the same for every fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Unknown:
    """One unknown of a fit, SI; where it was held fixed, with at most a `std` that was stated."""

    value: float
    unit: str
    free: bool = True
    std: float | None = None  # standard uncertainty without timing
    random: float | None = None  # of it, from the residuals
    systematic: float | None = None  # of it, from what was declared
    interval: tuple[float, float] | None = None


_PERCENT = 100.0


@dataclass(frozen=True)
class Effect:
    """The effect of one source of uncertainty on one unknown."""

    sensitivity: float | None  # unit of the unknown per unit of the source
    contribution: float | None  # standard uncertainty; None where that of the source is not known
    percent: float | None  # of the value

    @classmethod
    def of(cls, value: float, contribution: float, sensitivity: float | None = None) -> Effect:
        """Return the effect of a source that contributes a standard uncertainty to a value."""
        return cls(sensitivity, contribution, _PERCENT * contribution / abs(value) if value else None)


@dataclass(frozen=True)
class BudgetRow:
    """One source of uncertainty of a fit."""

    source: str
    std: float | None  # None where it is not declared
    unit: str
    effects: Mapping[str, Effect]  # by unknown


@dataclass(frozen=True)
class FitReport:
    """Residual, unknowns and evidence of a fit; fields that a fit does not know stay at their default."""

    rss: float  # [N^2] sum of the squared residuals
    samples: int
    unknowns: Mapping[str, Unknown]
    correlations: Mapping[tuple[str, str], float] = field(default_factory=dict)  # of pairs of free unknowns
    aic: float | None = None
    bic: float | None = None
    basis: str = ""  # what was fitted; evidence compares fits of one basis and equally many samples
    autocorrelation: float | None = None  # of neighbouring residuals
    effective_samples: float | None = None  # independent samples that the correlated ones are worth
    bias: float = 0.0  # [N] that the force reads too much at the middle of the fitted samples
    drift: float = 0.0  # [N/s] by which that grows
    cycles: int = 0  # of the motion that can be fitted by themselves
    budget: tuple[BudgetRow, ...] = ()

    @property
    def rms(self) -> float:
        """The root mean square of the residuals [N]."""
        return math.sqrt(self.rss / self.samples) if self.samples else math.nan

    def table(self) -> dict[str, Any]:
        """Return the report as in ``result.json``."""
        pairs = [{"first": a, "second": b, "value": value} for (a, b), value in self.correlations.items()]
        return {**asdict(self), "rms": self.rms, "correlations": pairs}
