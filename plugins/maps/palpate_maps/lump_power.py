"""How weak a lump a sweep would have shown: the power of the test for peaks that stand out."""

from __future__ import annotations

import numpy as np

from palpate_maps.lump_criteria import LumpPower, LumpSettings

PROBABILITY = 0.8
WIDTH = 10e-3  # [m] at half its height, of the lumps that powers are of: about as narrow as the contact leaves one


def peak_limit(std: float, rooms: float, settings: LumpSettings) -> float:
    """The height of the logarithm from which on a peak counts as a lump; its standard deviation is `std`.

    The largest of: log(1 + contrast), and that with p = m(m - 1)/2 x the two-sided normal tail at the rate, where the
    sweep has room for m sites.
    """
    from scipy import stats

    pairs = rooms * (rooms - 1) / 2
    return max(float(np.log1p(settings.contrast)), std * float(stats.norm.isf(min(settings.rate / (2 * pairs), 0.5))))


def sweep_power(std: float, length: float, settings: LumpSettings) -> LumpPower:
    """The power of a sweep of a length [m] where differences of its curve have a standard deviation.

    A Gaussian lump of log height H is seen as a H, a = s/sqrt(s^2 + w^2/12), behind the smoothing over w. Its peak is
    the highest that noise makes of it, the valleys next to it are the lowest: that adds 0.6 to 1.8 standard deviations
    of one end over 70 mm, more over 150 mm, about what a probability of 0.8 takes. So a H is the limit.
    """
    sigma = WIDTH / 2.3548
    passed = sigma / np.hypot(sigma, settings.width / np.sqrt(12))
    height = peak_limit(std, max(length / settings.width, 2.0), settings) / passed
    return LumpPower(float(np.expm1(height)), WIDTH, PROBABILITY)
