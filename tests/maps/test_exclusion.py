"""What an exam excludes: virtual lumps of the stated contrast are found, nothing is excluded where nobody was."""

import json

import numpy as np
import pytest
from palpate_maps.line_peaks import by_prominence, curve_along
from palpate_maps.lump_criteria import FWHM, Findings, LumpPower, LumpSettings
from palpate_maps.lump_power import EXCLUDED_PROBABILITY
from palpate_maps.lumps import find_lumps
from palpate_maps.map_files import lumps_json
from palpate_maps.path_reader import Path2D

from tests.maps.test_bodies import points
from tests.maps.test_lumps import sweep


def empty(seed=0, noise=0.006, pitch=5e-3):
    return points(np.random.default_rng(seed), [(0.0, 0.0, 0.0, 1e-2)], (0.06, 0.04), pitch, noise)


def test_wider_lumps_are_excluded_from_a_lower_contrast_on():
    excluded = find_lumps(empty()).excluded
    contrasts = [power.contrast for power in excluded]
    assert contrasts == sorted(contrasts, reverse=True)
    assert all(power.probability == EXCLUDED_PROBABILITY for power in excluded)
    assert contrasts[-1] > LumpSettings().contrast  # none weaker is reported
    finer = find_lumps(empty(pitch=2.5e-3)).excluded
    assert finer[0].contrast < 0.5 * contrasts[0]


@pytest.mark.parametrize(("factor", "low", "high"), [(1.0, 17, 20), (0.6, 0, 8)])
def test_virtual_lumps_of_the_stated_contrast_are_found(factor, low, high):
    """At 20 places of the area, 8 mm wide."""
    power = next(power for power in find_lumps(empty()).excluded if power.width == 8e-3)
    dice, hits = np.random.default_rng(3), 0
    for _ in range(20):
        x, y = dice.uniform([-0.03, -0.02], [0.03, 0.02])
        lumps = find_lumps(points(dice, [(x, y, factor * power.contrast, power.width / FWHM)], (0.06, 0.04))).lumps
        hits += any(np.hypot(lump.place[0] - x, lump.place[1] - y) < 8e-3 for lump in lumps)
    assert low <= hits <= high


def test_of_places_that_were_not_visited_nothing_is_excluded():
    sites = empty()
    ring = sites[np.hypot(*sites.place.T) > 12e-3]
    assert find_lumps(ring).excluded[0].contrast == np.inf


def test_a_known_lump_leaves_the_rest_of_the_area():
    sites = points(np.random.default_rng(0), [(5e-3, 0.0, 0.5, 4e-3)], (0.06, 0.04))
    found = find_lumps(sites)
    assert len(found.lumps) == 1
    assert found.power.contrast == pytest.approx(find_lumps(empty()).power.contrast, rel=0.2)


def test_a_sweep_excludes_what_it_finds():
    settings = LumpSettings()
    curve = sweep(np.random.default_rng(0), [])
    excluded = by_prominence(curve_along(curve, curve.place[:, 1], settings), settings).excluded
    power = next(power for power in excluded if power.width == 10e-3)
    found = [
        find_lumps(sweep(np.random.default_rng(seed), [(0.0, 10e-3 / FWHM, power.contrast)])) for seed in range(20)
    ]
    assert sum(any(abs(lump.along) < 3e-3 for lump in each.lumps) for each in found) >= 17


def test_a_contrast_that_none_would_have_is_null():
    path = Path2D("dr/smoother", "elasticity", *(np.zeros(1) for _ in range(4)), 1.0)
    findings = Findings((), 1e5, 0.01, "x", excluded=(LumpPower(np.inf, 4e-3, 0.95),))
    assert json.loads(lumps_json(findings, path))["excluded"][0]["contrast"] is None


def test_a_track_that_lags_is_doubted():
    assert "does not follow the changes" in Findings((), 1e5, 0.01, "x", lags="dr/ekf").warning
