"""The curve along a sweep, and the peaks that stand out of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from palpate import Floats, LogError

from palpate_maps.lump_criteria import Findings, Lump, LumpSettings
from palpate_maps.lump_power import sweep_power
from palpate_maps.sites import Sites

STEP = 2.5e-4  # [m] between points of a sweep's curve


@dataclass(frozen=True)
class LineCurve:
    """The logarithm along a sweep, smoothed over the width of a site."""

    at: Floats  # (m,) [m]
    log: Floats  # (m,)
    noise: Floats  # (m,) standard deviation of a difference's one end
    sites: Sites
    along: Floats  # (n,) [m] of the sites

    def place(self, along: float) -> tuple[float, float]:
        """The place at a coordinate along the line."""
        design = np.column_stack([np.ones(len(self.along)), self.along])
        line, *_ = np.linalg.lstsq(design, self.sites.place, rcond=None)
        x, y = np.array([1.0, along]) @ line
        return float(x), float(y)

    def findings(self, lumps: list[Lump], method: str) -> Findings:
        """The lumps that were found along it."""
        background = float(np.exp(np.quantile(self.log, 0.25)))
        return Findings(
            tuple(lumps), background, float(np.median(self.noise)), method, self.at, np.asarray(np.exp(self.log))
        )


def curve_along(sites: Sites, along: Floats, settings: LumpSettings) -> LineCurve:
    """The curve of the sites of a sweep; raises LogError where it is too short for surroundings."""
    at = np.arange(along.min(), along.max(), STEP)
    if len(at) * STEP < 3 * settings.width:
        raise LogError(
            f"a sweep of {1e3 * len(at) * STEP:.3g} mm is too short to distinguish a lump from its surroundings"
        )
    kernel = np.exp(-0.5 * ((at[:, None] - along[None]) / (settings.width / np.sqrt(12))) ** 2)
    kernel /= np.maximum(kernel.sum(axis=1, keepdims=True), 1e-300)
    noise = np.sqrt(settings.spread**2 + sites.kept**2 * (kernel @ sites.std**2))
    return LineCurve(at, kernel @ sites.log, noise, sites, along)


def by_prominence(curve: LineCurve, settings: LumpSettings) -> Findings:
    """Peaks of the smoothed logarithm that stand out from the higher of the valleys next to them.

    The height of a peak over its higher valley (its prominence) is a difference of two means over `width`, both picked
    from the m that the sweep has room for. p = m(m - 1)/2 x the two-sided normal tail of that difference.
    """
    from scipy import signal, stats

    peaks, found = signal.find_peaks(curve.log, prominence=np.log1p(settings.contrast))
    widths, _, left, right = signal.peak_widths(curve.log, peaks, rel_height=0.5)
    rooms = max((curve.at[-1] - curve.at[0]) / settings.width, 2.0)
    pairs = rooms * (rooms - 1) / 2
    lumps = []
    for k, peak in enumerate(peaks):
        valleys = found["left_bases"][k], found["right_bases"][k]
        valley = max(valleys, key=lambda v: curve.log[v])
        std = float(np.hypot(curve.noise[peak], curve.noise[valley]))
        height = float(found["prominences"][k])
        p = min(1.0, pairs * 2 * float(stats.norm.sf(height / std)))
        if p <= settings.rate:
            middle = float(np.interp((left[k] + right[k]) / 2, np.arange(len(curve.at)), curve.at))
            extent = float(widths[k]) * STEP
            lumps.append(Lump(curve.place(middle), (extent, 0.0), float(np.expm1(height)), std, p, middle))
    std = float(np.median(curve.noise)) * np.sqrt(2.0)
    power = sweep_power(std, float(curve.at[-1] - curve.at[0]), settings)
    return replace(curve.findings(lumps, "prominence along the sweep"), power=power)
