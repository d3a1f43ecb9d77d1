"""Repeatability: statistics of many estimates of one quantity (paper, section Estimates Correlation)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.numerics.repeated_values import autocorrelation, neighbour_correlation, std_of_mean
from palpate_kit.numerics.unit_group import scatters
from palpate_kit.runs.run_groups import natural

WINDOW = 30  # values of the moving average, as in the paper
_MAX_LAG = 30  # of the autocorrelation, a choice: that window
_MAX_BINS = 30  # of a histogram, a choice: a screen
_USUAL_BINS = 10  # of groups of single values, which ask for no width: a choice
_NORMAL_95 = 1.96  # standard deviations of 95 % of a normal distribution
_TINY = 1e-300  # keeps a denominator above 0


@dataclass(frozen=True)
class Repeatability:
    """Estimates of one quantity in the order in which they were made."""

    values: Floats  # (n,)

    @property
    def mean(self) -> float:
        """The mean."""
        return float(self.values.mean())

    @property
    def std(self) -> float:
        """The standard uncertainty of one estimate: the scatter with n - 1; NaN for a single one."""
        return float(self.values.std(ddof=1)) if len(self.values) > 1 else math.nan

    @property
    def std_of_mean(self) -> float:
        """The standard uncertainty of the mean, with the correlation of neighbours."""
        return std_of_mean(self.values)

    @property
    def lag_one(self) -> float:
        """The correlation coefficient of neighbours; NaN without scatter."""
        return neighbour_correlation(self.values)

    @property
    def trend(self) -> tuple[float, float]:
        """The correlation coefficient r with the order of taking, and its p-value; NaN for fewer than 3.

        Without a trend, r sqrt((n - 2)/(1 - r^2)) has Student's distribution with n - 2 degrees of freedom.
        """
        from scipy.stats import t as student

        if len(self.values) < 3 or not scatters(self.values):
            return math.nan, math.nan
        r = float(np.corrcoef(np.arange(len(self.values)), self.values)[0, 1])
        degrees_of_freedom = len(self.values) - 2
        t = abs(r) * math.sqrt(degrees_of_freedom / max(1.0 - r**2, _TINY))
        return r, float(2 * student.sf(t, degrees_of_freedom))

    @property
    def window(self) -> int:
        """The window of the moving average: the paper's 30, or a third of the values if they are fewer than 90."""
        return min(WINDOW, max(len(self.values) // 3, 1))

    def table(self, edges: Floats) -> dict[str, Any]:
        """Return all statistics as plain data; the histogram is over bins with edges (m + 1,)."""
        # The histogram has no bins without scatter.
        counts = np.histogram(self.values, bins=edges)[0] if len(edges) else np.zeros(0, int)
        correlation, p_value = self.trend
        return {
            "count": len(self.values),
            "mean": self.mean,
            "std": self.std,
            "std_of_mean": self.std_of_mean,
            "correlation": self.lag_one,
            "correlation_with_order": correlation,
            "correlation_with_order_p": p_value,
            "autocorrelation": autocorrelation(self.values, _MAX_LAG).tolist(),
            # Within it are 95 % of the coefficients of values without a correlation.
            "autocorrelation_95": _NORMAL_95 / math.sqrt(len(self.values)),
            "moving_average": moving_average(self.values, self.window).tolist(),
            "moving_average_window": self.window,
            "histogram": {"counts": counts.tolist(), "edges": edges.tolist()},
            "values": self.values.tolist(),
        }


def moving_average(values: Floats, window: int) -> Floats:
    """Return means (n - window + 1,) of values (n,) over a sliding window; empty for fewer values than a window."""
    if len(values) < window:
        return np.zeros(0)
    return np.convolve(values, np.full(window, 1.0 / window), mode="valid")


def common_edges(groups: Sequence[Floats]) -> Floats:
    """Return the edges (m + 1,) of bins that all groups share, by NumPy's rule for the group with the narrowest bins.

    At most 30 bins; empty without scatter.
    """
    values = np.concatenate(groups) if groups else np.zeros(0)
    if len(values) < 2 or not scatters(values):
        return np.zeros(0)
    scattered_groups = [group for group in groups if len(group) > 1 and scatters(group)]
    widths = [float(np.diff(np.histogram_bin_edges(group, "auto"))[0]) for group in scattered_groups]
    count = int(np.ceil(np.ptp(values) / min(widths))) if widths else _USUAL_BINS
    return np.asarray(np.histogram_bin_edges(values, min(max(count, 1), _MAX_BINS)))


def error_of_mean(mean: float, std_of_mean: float, combined: Floats, truth: float) -> dict[str, float]:
    """Return the relative error of a mean against a truth, and its standard uncertainty.

    That is by the uncertainty of the mean, 0 for NaN, and by the median of the combined uncertainties (n,) of the runs:
    their common part does not average out. Their random part counts twice, which errs to the safe side.
    """
    scatter = 0.0 if math.isnan(std_of_mean) else std_of_mean
    usual_combined = float(np.median(combined)) if len(combined) else 0.0
    std = math.hypot(scatter, usual_combined) / abs(truth)
    return {"truth": truth, "error": mean / truth - 1.0, "error_std": std, "by_scatter": scatter / abs(truth)}


def repeatability(groups: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Return the statistics of each group of values, in the natural order of their names."""
    ordered = {name: np.asarray(groups[name], float) for name in sorted(groups, key=natural)}
    edges = common_edges(list(ordered.values()))
    return {name: Repeatability(values).table(edges) for name, values in ordered.items()}
