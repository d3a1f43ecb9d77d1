"""Repeatability: what many estimates of one quantity say together (paper, section Estimates Correlation)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from palpate import Floats

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
        """Standard uncertainty of the mean with neighbours' correlation r: s/sqrt(n) sqrt((1 + r)/(1 - r)), r >= 0."""
        r = min(max(self.lag_one, 0.0), 0.99) if len(self.values) > 3 else 0.0
        return self.std / math.sqrt(len(self.values)) * math.sqrt((1 + r) / (1 - r))

    @property
    def lag_one(self) -> float:
        """Correlation coefficient of neighbours; NaN where there is no scatter."""
        found = autocorrelation(self.values, 1)
        return float(found[1]) if len(found) > 1 else math.nan

    @property
    def trend(self) -> tuple[float, float]:
        """Correlation coefficient with the order of taking, and its p-value without a trend; NaN for fewer than 3."""
        from scipy.stats import t as student

        if len(self.values) < 3 or not _scatters(self.values):
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


def _scatters(values: Floats) -> bool:
    """Whether values differ by more than rounding."""
    return bool(np.ptp(values) > 1e-12 * np.abs(values).max())


def autocorrelation(values: Floats, lags: int) -> Floats:
    """Autocorrelation (lags + 1,) of values (n,), biased estimator, from lag 0; empty where there is no scatter."""
    centred = np.asarray(values, float) - np.mean(values)
    power = float(centred @ centred)
    if not _scatters(values):
        return np.zeros(0)
    lags = min(lags, len(centred) - 1)
    return np.array([float(centred[: len(centred) - lag] @ centred[lag:]) / power for lag in range(lags + 1)])


def moving_average(values: Floats, window: int) -> Floats:
    """Means (n - window + 1,) over a sliding window; empty where there are fewer values than that."""
    if len(values) < window:
        return np.zeros(0)
    return np.convolve(values, np.full(window, 1.0 / window), mode="valid")


def welch_tests(groups: Mapping[str, Floats]) -> list[dict[str, Any]]:
    """Welch's t-test between every two groups: t, degrees of freedom, two-sided p-value of equal means."""
    from scipy.stats import t as student

    found = []
    for first, second in combinations(groups, 2):
        a, b = groups[first], groups[second]
        row: dict[str, Any] = {"first": first, "second": second}
        row |= {"difference_is": f"{second} - {first}", "difference": float(b.mean() - a.mean())}
        value = freedom = math.nan
        if len(a) > 1 and len(b) > 1 and (_scatters(a) or _scatters(b)):
            spread_a, spread_b = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
            value = row["difference"] / math.sqrt(spread_a + spread_b)
            freedom = (spread_a + spread_b) ** 2 / (spread_a**2 / (len(a) - 1) + spread_b**2 / (len(b) - 1))
        p_value = float(2 * student.sf(abs(value), freedom))
        found.append(row | {"t": float(value), "degrees_of_freedom": float(freedom), "p": p_value})
    return found


def common_edges(groups: Sequence[Floats]) -> Floats:
    """Edges of bins that all groups share, as fine as the group that asks for the finest, 30 bins at the most."""
    everything = np.concatenate(groups) if groups else np.zeros(0)
    if len(everything) < 2 or not _scatters(everything):
        return np.zeros(0)
    several = [values for values in groups if len(values) > 1 and _scatters(values)]
    widths = [float(np.diff(np.histogram_bin_edges(values, "auto"))[0]) for values in several]
    count = int(np.ceil(np.ptp(everything) / min(widths))) if widths else 10
    return np.asarray(np.histogram_bin_edges(everything, min(max(count, 1), 30)))


def anova(groups: Mapping[str, Floats]) -> dict[str, Any] | None:
    """Welch's analysis of variance over three or more groups, and Games and Howell's test of every two of them.

    Neither takes the groups' spreads for equal; None for fewer groups, or one without scatter.
    Sources: Welch 1951; Games and Howell 1976.
    """
    from scipy.stats import f_oneway, tukey_hsd

    if len(groups) < 3 or any(len(values) < 2 or not _scatters(values) for values in groups.values()):
        return None
    whole = f_oneway(*groups.values(), equal_var=False)
    pairs = tukey_hsd(*groups.values(), equal_var=False)
    names = list(groups)
    rows = [
        {"first": names[i], "second": names[j], "p": float(pairs.pvalue[i, j])}
        for i, j in combinations(range(len(names)), 2)
    ]
    return {"f": float(whole.statistic), "p": float(whole.pvalue), "pairs": rows}


def uncertainty_of_mean(values: Floats, common: Floats) -> dict[str, float]:
    """What runs have in common, and with it the combined standard uncertainty of the mean of their values (n,).

    Radius, Poisson's ratio, timing and mass have the same error in all repeats: it does not scatter, and no mean takes
    any of it away (GUM F.1.2.3). It is the median of what the runs state (m,); NaN where none does.
    """
    shared = float(np.median(common)) if len(common) else math.nan
    scatter = Repeatability(values).std_of_mean if len(values) > 1 else math.nan
    return {"common": shared, "combined_of_mean": float(np.hypot(scatter, shared if len(common) else 0.0))}


def against_truth(values: Floats, combined: Floats, truth: float) -> dict[str, float]:
    """Error of the mean of values (n,) against a truth, relative, and its standard uncertainty.

    That of the mean, and the median of what each run states: what is common to all runs does not average out. What of
    it is random counts twice, which errs to the safe side.
    """
    found = Repeatability(values)
    scatter = found.std_of_mean if len(values) > 1 else 0.0
    stated = float(np.median(combined)) if len(combined) else 0.0
    std = math.hypot(scatter, stated) / abs(truth)
    return {"truth": truth, "error": found.mean / truth - 1.0, "error_std": std, "by_scatter": scatter / abs(truth)}


def repeatability(groups: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Statistics of each group, and the tests between them; groups in the order of their names."""
    ordered = {name: np.asarray(groups[name], float) for name in sorted(groups)}
    edges = common_edges(list(ordered.values()))
    tables = {name: Repeatability(values).table(edges) for name, values in ordered.items()}
    return {"groups": tables, "tests": welch_tests(ordered), "anova": anova(ordered)}
