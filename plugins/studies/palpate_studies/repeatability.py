"""Repeatability: what many estimates of one quantity say together (paper, section Estimates Correlation)."""

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

WINDOW = 30  # of the moving average, as in the paper
_LAGS = 30


@dataclass(frozen=True)
class Repeatability:
    """Estimates of one quantity in the order of their taking."""

    values: Floats  # (n,)

    @property
    def mean(self) -> float:
        """Mean."""
        return float(self.values.mean())

    @property
    def std(self) -> float:
        """Standard uncertainty of one estimate: the scatter with n - 1; NaN for a single one."""
        return float(self.values.std(ddof=1)) if len(self.values) > 1 else math.nan

    @property
    def std_of_mean(self) -> float:
        """Standard uncertainty of the mean, with the correlation of neighbours."""
        return std_of_mean(self.values)

    @property
    def lag_one(self) -> float:
        """Correlation coefficient of neighbours; NaN without scatter."""
        return neighbour_correlation(self.values)

    @property
    def trend(self) -> tuple[float, float]:
        """Correlation coefficient with the order of taking, and its p-value without a trend; NaN for fewer than 3."""
        from scipy.stats import t as student

        if len(self.values) < 3 or not scatters(self.values):
            return math.nan, math.nan
        rho = float(np.corrcoef(np.arange(len(self.values)), self.values)[0, 1])
        freedom = len(self.values) - 2
        size = abs(rho) * math.sqrt(freedom / max(1.0 - rho**2, 1e-300))
        return rho, float(2 * student.sf(size, freedom))

    @property
    def window(self) -> int:
        """Of the moving average: the paper's 30, or a third of the values where they are fewer than 90."""
        return min(WINDOW, max(len(self.values) // 3, 1))

    def table(self, edges: Floats) -> dict[str, Any]:
        """Everything, as plain data; the histogram over the given edges of bins."""
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
            "autocorrelation": autocorrelation(self.values, _LAGS).tolist(),
            "autocorrelation_95": 1.96 / math.sqrt(len(self.values)),
            "moving_average": moving_average(self.values, self.window).tolist(),
            "moving_average_window": self.window,
            "histogram": {"counts": counts.tolist(), "edges": edges.tolist()},
            "values": self.values.tolist(),
        }


def moving_average(values: Floats, window: int) -> Floats:
    """Means (n - window + 1,) over a sliding window; empty where there are fewer values than that."""
    if len(values) < window:
        return np.zeros(0)
    return np.convolve(values, np.full(window, 1.0 / window), mode="valid")


def common_edges(groups: Sequence[Floats]) -> Floats:
    """Edges of bins that all groups share, as fine as the group that asks for the finest, 30 bins at most."""
    everything = np.concatenate(groups) if groups else np.zeros(0)
    if len(everything) < 2 or not scatters(everything):
        return np.zeros(0)
    several = [values for values in groups if len(values) > 1 and scatters(values)]
    widths = [float(np.diff(np.histogram_bin_edges(values, "auto"))[0]) for values in several]
    count = int(np.ceil(np.ptp(everything) / min(widths))) if widths else 10
    return np.asarray(np.histogram_bin_edges(everything, min(max(count, 1), 30)))


def against_truth(mean: float, std_of_mean: float, combined: Floats, truth: float) -> dict[str, float]:
    """Error of a mean against a truth, relative, and its standard uncertainty.

    That of the mean, 0 where it does not show (NaN), and the median of what each run states: what is common to all runs
    does not average out. What of it is random counts twice, which errs to the safe side.
    """
    scatter = 0.0 if math.isnan(std_of_mean) else std_of_mean
    stated = float(np.median(combined)) if len(combined) else 0.0
    std = math.hypot(scatter, stated) / abs(truth)
    return {"truth": truth, "error": mean / truth - 1.0, "error_std": std, "by_scatter": scatter / abs(truth)}


def repeatability(groups: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Statistics of each group; groups in the order of their names."""
    ordered = {name: np.asarray(groups[name], float) for name in sorted(groups, key=natural)}
    edges = common_edges(list(ordered.values()))
    return {name: Repeatability(values).table(edges) for name, values in ordered.items()}
