"""The curve along a sweep, and the peaks that stand out of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from palpate import Floats, LogError

from palpate_maps.body_field import FWHM, Body, SiteField, fit_bodies
from palpate_maps.body_lumps import own_size
from palpate_maps.lump_criteria import Findings, Lump, LumpSettings
from palpate_maps.lump_power import sweep_exclusion, sweep_power
from palpate_maps.sites import Sites, merge_sites, site_numbers

STEP = 2.5e-4  # [m] between points of a sweep's curve: 16 in a site's width, a choice
_MIN_WIDTHS = 3  # site widths in a sweep: a lump and a valley on both sides
_BACKGROUND_QUANTILE = 0.25  # of the curve: its lower quartile, since lumps lie above the background only
_MIN_ROOMS = 2.0  # sites in a sweep: a peak and a valley
_WINDOW = 1.5  # extents of a peak to either side, whose sites say how well its body is placed: a choice
_TINY = 1e-300  # least sum of weights: far from all sites the curve does not divide by 0


@dataclass(frozen=True)
class LineCurve:
    """The logarithm along a sweep, smoothed over the width of a site."""

    at: Floats  # (m,) [m]
    log: Floats  # (m,)
    noise: Floats  # (m,) standard deviation of a difference's one end
    sites: Sites
    along: Floats  # (n,) [m] of the sites

    def place(self, along: float) -> tuple[float, float]:
        """Return the place at a coordinate along the line."""
        design = np.column_stack([np.ones(len(self.along)), self.along])
        line, *_ = np.linalg.lstsq(design, self.sites.place, rcond=None)
        x, y = np.array([1.0, along]) @ line
        return float(x), float(y)

    @property
    def direction(self) -> Floats:
        """(2,) change of the place with the coordinate along the line."""
        return np.subtract(self.place(1.0), self.place(0.0))

    def findings(self, lumps: list[Lump], method: str) -> Findings:
        """Return the lumps that were found along it."""
        background = float(np.exp(np.quantile(self.log, _BACKGROUND_QUANTILE)))
        return Findings(
            lumps=tuple(lumps),
            background=background,
            spread=float(np.median(self.noise)),
            method=method,
            coordinate=self.at,
            curve=np.asarray(np.exp(self.log)),
        )


def curve_along(sites: Sites, along: Floats, settings: LumpSettings) -> LineCurve:
    """Return the curve of the sites of a sweep; raises LogError where it is too short for surroundings."""
    coordinate = np.arange(along.min(), along.max(), STEP)
    if len(coordinate) * STEP < _MIN_WIDTHS * settings.width:
        raise LogError(
            f"a sweep of {1e3 * len(coordinate) * STEP:.3g} mm is too short to distinguish a lump from its surroundings"
        )
    # Gaussian weights with the standard deviation of a window of a site's width w, w/sqrt(12).
    kernel = np.exp(-0.5 * ((coordinate[:, None] - along[None]) / (settings.width / np.sqrt(12))) ** 2)
    kernel /= np.maximum(kernel.sum(axis=1, keepdims=True), _TINY)
    # Sites differ by the spread in any case; of the estimator's variance the part that neighbours do not share.
    noise = np.sqrt(settings.spread**2 + sites.kept**2 * (kernel @ sites.std**2))
    return LineCurve(at=coordinate, log=kernel @ sites.log, noise=noise, sites=sites, along=along)


def by_prominence(curve: LineCurve, settings: LumpSettings) -> Findings:
    """Return peaks of the smoothed logarithm that stand out from the higher of the valleys next to them.

    `curve` is the logarithm of the stiffness along a sweep, smoothed over the width of a site. The height of a peak
    over its higher valley (its prominence) is a difference of two means over `width`, both picked from the m that the
    sweep has room for. p = m(m - 1)/2 x the two-sided normal tail of that difference.
    """
    from scipy import stats

    length = float(curve.at[-1] - curve.at[0])
    rooms = max(length / settings.width, _MIN_ROOMS)
    pairs = rooms * (rooms - 1) / 2
    lumps = []
    for peak in peaks(curve, float(np.log1p(settings.contrast))):
        p = min(1.0, pairs * 2 * float(stats.norm.sf(peak.height / peak.std)))
        if p <= settings.rate:
            lumps.append(lump_of_peak(curve, peak, settings, p))
    # The power is that of a difference of two points of median noise.
    std = float(np.median(curve.noise)) * np.sqrt(2.0)
    power, excluded = sweep_power(std, length, settings), sweep_exclusion(std, length, settings)
    return replace(curve.findings(lumps, "prominence along the sweep"), power=power, excluded=excluded)


def lump_of_peak(curve: LineCurve, peak: Peak, settings: LumpSettings, p: float) -> Lump:
    """Return the lump of a peak, whose place and extent have the standard deviations of a body fitted to its sites.

    The sites are those of the curve's width about it, up to a width of the peak beyond its flanks.
    """
    # A body on the sites about the peak, whose covariance is that of place, contrast and width.
    width = settings.width
    coarse, number = merge_sites(curve.sites, width), site_numbers(curve.sites, width)
    field = SiteField(curve.along[:, None], number, coarse.log)
    window = np.abs(field.middle[:, 0] - peak.middle) <= _WINDOW * max(peak.extent, width)
    start = Body.at(np.array([peak.middle]), float(np.expm1(peak.height)), np.eye(1), peak.extent / FWHM)
    fit = fit_bodies(field.chosen(window), [start], float(np.median(curve.noise)))
    place_variance, _, width_variance = np.diag(fit.covariance)[1:].tolist()
    place_std = curve.direction * float(np.sqrt(place_variance))
    contrast, width_std = float(np.expm1(peak.height)), float(np.sqrt(width_variance))
    return Lump(
        place=curve.place(peak.middle),
        extent=(peak.extent, 0.0),  # along the sweep; across it nothing is known
        contrast=contrast,
        contrast_std=(1 + contrast) * peak.std,
        p=p,
        along=peak.middle,
        place_std=(float(abs(place_std[0])), float(abs(place_std[1]))),
        width_std=width_std,
        size=own_size(fit.bodies, width_std, settings.contact_radius),
    )


@dataclass(frozen=True)
class Peak:
    """A peak of a sweep's curve."""

    highest: float  # [m] along the sweep
    middle: float  # [m] along the sweep, between its points at half its height
    extent: float  # [m] at half its height
    height: float  # of the logarithm, over the higher valley
    std: float  # standard deviation of that height


def peaks(curve: LineCurve, least_height: float) -> list[Peak]:
    """Return the peaks of a curve that are at least so high over the higher of their valleys."""
    from scipy import signal

    rows, properties = signal.find_peaks(curve.log, prominence=least_height)
    widths, _, first, last = signal.peak_widths(curve.log, rows, rel_height=0.5)
    summits = []
    for k, row in enumerate(rows):
        valley = max((properties["left_bases"][k], properties["right_bases"][k]), key=lambda base: curve.log[base])
        middle = float(np.interp((first[k] + last[k]) / 2, np.arange(len(curve.at)), curve.at))
        std = float(np.hypot(curve.noise[row], curve.noise[valley]))
        height, extent = float(properties["prominences"][k]), float(widths[k]) * STEP
        summits.append(Peak(highest=float(curve.at[row]), middle=middle, extent=extent, height=height, std=std))
    return summits
