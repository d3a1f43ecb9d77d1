"""The lumps that a sweep would have shown."""

import numpy as np
import pytest
from palpate_maps.lump_power import PROBABILITY, WIDTH, peak_limit, sweep_power
from palpate_maps.map_analysis import LumpSettings, Sites, find_lumps
from scipy import stats

SETTINGS = LumpSettings()


def sweep(seed, contrast, noise):
    """A sweep of 70 mm with a lump of the width in the middle, or none; sites scatter by the noise that they state."""
    dice = np.random.default_rng(seed)
    y = np.arange(-0.035, 0.035, 1e-3)
    slow = np.convolve(dice.standard_normal(len(y) + 4), np.ones(5) / np.sqrt(5), "valid")
    log = np.log1p(contrast) * np.exp2(-((2 * y / WIDTH) ** 2)) + np.hypot(noise, SETTINGS.spread) * slow
    place = np.column_stack([np.zeros_like(y), y])
    return Sites(place, 11.6 + log, np.full(len(y), noise), np.arange(len(y)) / 4.0, np.zeros(len(y), bool), kept=1.0)


def test_the_limit_is_that_of_the_test():
    """p = m(m - 1)/2 x 2 sf(z) is the rate at the limit, unless the least contrast is more."""
    height = peak_limit(0.02, 15.0, SETTINGS)
    assert 15 * 14 * stats.norm.sf(height / 0.02) == pytest.approx(SETTINGS.rate)
    assert peak_limit(0.001, 15.0, SETTINGS) == pytest.approx(np.log1p(SETTINGS.contrast))


def test_noise_costs_power_and_the_sweep_says_so():
    powers = [find_lumps(sweep(0, 0.0, noise)).power.contrast for noise in (0.002, 0.01, 0.02)]
    assert powers[0] < powers[1] < powers[2]
    assert powers[1] == pytest.approx(
        sweep_power(np.sqrt(2) * np.hypot(0.01, 0.005), 0.069, SETTINGS).contrast, rel=0.02
    )


@pytest.mark.slow
def test_lumps_are_seen_as_often_as_said():
    """Sites with just the noise that is assumed, alike over 5 mm: a lump of the contrast is seen in four of five."""
    contrast = find_lumps(sweep(0, 0.0, 0.01)).power.contrast

    def share(times):
        return np.mean(
            [
                any(abs(lump.along) < 4e-3 for lump in find_lumps(sweep(k, times * contrast, 0.01)).lumps)
                for k in range(200)
            ]
        )

    assert share(0.5) < 0.4
    assert PROBABILITY - 0.1 < share(1.0) < PROBABILITY + 0.18
    assert share(1.5) > 0.97


def test_the_uncertainty_of_a_contrast_grows_with_it():
    """It is that of the contrast and not of its logarithm: (1 + contrast) times as large."""
    stds = []
    for contrast in (0.1, 1.0):
        (lump,) = find_lumps(sweep(1, contrast, 0.01)).lumps
        stds.append(lump.contrast_std / (1.0 + lump.contrast))
    assert stds[0] == pytest.approx(stds[1], rel=0.05)
