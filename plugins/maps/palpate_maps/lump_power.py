"""The weakest lump that a sweep would have shown: the power of the test for peaks that stand out."""

from __future__ import annotations

import numpy as np

from palpate_maps.lump_criteria import LumpPower, LumpSettings

PROBABILITY = 0.8  # of seeing that lump (decision 0283): a choice, as of a test's power
WIDTH = 10e-3  # [m] at half its height, of the lumps that powers are of: about as narrow as the contact leaves one
_WIDTH_OF_GAUSSIAN = 2.3548  # full width at half of the height over the standard deviation: 2 sqrt(2 log 2)


def peak_limit(std: float, rooms: float, settings: LumpSettings) -> float:
    """The height of the logarithm from which on a peak counts as a lump; its standard deviation is `std`.

    The largest of: log(1 + contrast), and that with p = m(m - 1)/2 x the two-sided normal tail at the rate, where the
    sweep has room for m sites.
    """
    from scipy import stats

    pairs = rooms * (rooms - 1) / 2
    return max(float(np.log1p(settings.contrast)), std * float(stats.norm.isf(min(settings.rate / (2 * pairs), 0.5))))


def sweep_power(std: float, length: float, settings: LumpSettings) -> LumpPower:
    """The smallest relative height of a Gaussian lump that a sweep of `length` [m] finds with probability 0.8.

    `std` is the standard deviation of a difference of the sweep's log stiffness. Smoothing over a window w lowers a
    lump of log height H and width s to a H, a = s/sqrt(s^2 + w^2/12), which must reach the limit for peaks. Noise
    raises the highest point and lowers the valleys, by 0.6 to 1.8 standard deviations in all over 70 mm and by more
    over 150 mm: about what a probability of 0.8 needs, so that nothing is added for it.
    """
    sigma = WIDTH / _WIDTH_OF_GAUSSIAN
    smoothed = sigma / np.hypot(sigma, settings.width / np.sqrt(12))
    height = peak_limit(std, max(length / settings.width, 2.0), settings) / smoothed
    return LumpPower(float(np.expm1(height)), WIDTH, PROBABILITY)
