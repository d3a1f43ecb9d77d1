"""The weakest lump that a sweep would have shown: the power of the test for peaks that stand out."""

from __future__ import annotations

import numpy as np

from palpate_maps.body_field import FWHM
from palpate_maps.lump_criteria import LumpPower, LumpSettings

WIDTHS = (4e-3, 6e-3, 8e-3, 10e-3, 15e-3, 20e-3)  # [m] at half their height, of virtual lumps
EXCLUDED_PROBABILITY = 0.95  # of finding what an exam excludes: a choice, as of a risk
MAX_CONTRAST = 100.0  # of a lump, beyond which none is excluded: a choice
_TINY = 1e-12  # least share of a lump's height that a track shows
_MIN_WIDTHS = 3  # of a lump in a sweep: its own, and a valley on both sides
PROBABILITY = 0.8  # of seeing that lump (decision 0283): a choice, as of a test's power
WIDTH = 10e-3  # [m] at half its height, of the lumps that powers are of: about as narrow as the contact leaves one


def peak_limit(std: float, rooms: float, settings: LumpSettings) -> float:
    """Return the height of the logarithm from which on a peak counts as a lump; its standard deviation is `std`.

    The largest of: log(1 + contrast), and that with p = m(m - 1)/2 x the two-sided normal tail at the rate, where the
    sweep has room for m sites.
    """
    from scipy import stats

    pairs = rooms * (rooms - 1) / 2
    return max(float(np.log1p(settings.contrast)), std * float(stats.norm.isf(min(settings.rate / (2 * pairs), 0.5))))


def sweep_exclusion(std: float, length: float, settings: LumpSettings) -> tuple[LumpPower, ...]:
    """Return by width the contrast that a sweep finds with 0.95, away from its ends by a width and more.

    Of lumps of the height that is found with 0.8, each noise more by the difference of the two normal quantiles.
    """
    from scipy import stats

    more = float(stats.norm.ppf(EXCLUDED_PROBABILITY) - stats.norm.ppf(PROBABILITY))
    return tuple(
        LumpPower(_least_contrast(std, length, settings, width, more), width, EXCLUDED_PROBABILITY)
        for width in WIDTHS
        if length > _MIN_WIDTHS * width
    )


def sweep_power(std: float, length: float, settings: LumpSettings) -> LumpPower:
    """Return the smallest relative height of a Gaussian lump that a sweep of `length` [m] finds with probability 0.8.

    `std` is the standard deviation of a difference of the sweep's log stiffness. Smoothing over a window w lowers a
    lump of log height H and width s to a H, a = s/sqrt(s^2 + w^2/12), which must reach the limit for peaks. Noise
    raises the highest point and lowers the valleys, by 0.6 to 1.8 standard deviations in all over 70 mm and by more
    over 150 mm: about what a probability of 0.8 needs, so that nothing is added for it.
    """
    return LumpPower(_least_contrast(std, length, settings, WIDTH, 0.0), WIDTH, PROBABILITY)


def _least_contrast(std: float, length: float, settings: LumpSettings, width: float, more: float) -> float:
    """Return the contrast of a lump of a width [m] whose peak exceeds the limit by so many standard deviations.

    The track's response and the smoothing over a site lower its logarithm along the way; infinite beyond 100.
    """
    # Smoothing over a site of width w blurs the lump by the standard deviation of a window, w/sqrt(12).
    sigma, response = width / FWHM, settings.response
    length_of_peak = np.hypot(np.hypot(sigma, response.blur), settings.width / np.sqrt(12))
    share = float(response.height * sigma / length_of_peak)
    limit = peak_limit(std, max(length / settings.width, 2.0), settings)
    height = (limit + more * std) / max(share, _TINY)
    return float(np.expm1(height)) if height < np.log1p(MAX_CONTRAST) else float("inf")
