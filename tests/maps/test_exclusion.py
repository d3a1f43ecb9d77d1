"""What an exam excludes: virtual lumps of the stated contrast are found, nothing is excluded where nobody was."""

import json

import numpy as np
import pytest
from palpate_kit.figures import figure_of, style
from palpate_kit.runs.exclusion_figure import draw_exclusion
from palpate_kit.runs.skin_grid import read_lump_findings, read_lumps
from palpate_maps.body_field import FWHM
from palpate_maps.exclusion import site_directions
from palpate_maps.line_peaks import by_prominence, curve_along
from palpate_maps.lump_criteria import Findings, LumpPower, LumpSettings, TrackResponse
from palpate_maps.lump_power import EXCLUDED_PROBABILITY
from palpate_maps.lumps import find_lumps
from palpate_maps.map_files import lumps_json
from palpate_maps.path_reader import Path2D

from tests.maps.test_bodies import points
from tests.maps.test_lumps import area, sweep


def empty(seed=0, noise=0.006, pitch=5e-3):
    return points(np.random.default_rng(seed), [(0.0, 0.0, 0.0, 1e-2)], (0.06, 0.04), pitch, noise)


def test_wider_lumps_are_excluded_from_a_lower_contrast_on():
    """Up to a width of which the area holds enough background."""
    excluded = find_lumps(empty()).excluded
    contrasts = [power.contrast for power in excluded]
    assert contrasts[:4] == sorted(contrasts[:4], reverse=True)
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


def test_the_way_of_a_raster_alternates_and_stays_have_none():
    lines = area(np.random.default_rng(0), [])
    direction = site_directions(lines)
    np.testing.assert_allclose(direction[:61], np.tile([1.0, 0.0], (61, 1)), atol=1e-9)
    np.testing.assert_allclose(direction[62:121], np.tile([-1.0, 0.0], (59, 1)), atol=1e-9)
    assert not site_directions(empty()).any()


@pytest.mark.parametrize("width", [4e-3, 8e-3])
def test_the_response_is_that_of_a_filter_along_the_way(width):
    """A Gaussian that a Gaussian kernel blurs and shifts along x is as high, as wide and as late as stated."""
    response, sigma = TrackResponse(0.9, 1e-3, 2e-3), width / FWHM
    x = np.linspace(-0.03, 0.03, 601)
    lump = np.exp(-0.5 * (x / sigma) ** 2)
    kernel = np.exp(-0.5 * ((x - 1e-3) / 2e-3) ** 2)
    blurred = 0.9 * np.convolve(lump, kernel / kernel.sum(), "same")
    line = np.column_stack([x, np.zeros_like(x)])
    shape = response.shape(line, np.tile([1.0, 0.0], (len(x), 1)), sigma)
    np.testing.assert_allclose(shape, blurred, atol=5e-3)
    assert shape.max() == pytest.approx(response.share(sigma), rel=1e-3)
    assert response.shape(np.zeros(2), np.zeros(2), sigma) == pytest.approx(0.9)  # the tip stands: no way, no lag


@pytest.mark.parametrize("sites", [area(np.random.default_rng(0), []), sweep(np.random.default_rng(0), [])])
def test_a_slow_track_excludes_less_of_narrow_lumps(sites):
    ideal, slow = (find_lumps(sites, LumpSettings(response=r)) for r in (TrackResponse(), TrackResponse(0.8, 0, 4e-3)))
    assert slow.excluded[0].contrast > 1.8 * ideal.excluded[0].contrast
    assert slow.excluded[-1].contrast > 1.1 * ideal.excluded[-1].contrast
    blind = find_lumps(sites, LumpSettings(response=TrackResponse(height=0.0)))
    assert all(power.contrast == np.inf for power in blind.excluded)


def test_of_an_area_its_places_count():
    """Half of the area was not visited: nothing is excluded in it, though all is between the sites."""
    sites = empty()
    between = np.stack(np.meshgrid([-0.02, 0.0, 0.02], [-0.01, 0.01]), axis=-1).reshape(-1, 2)
    inside = find_lumps(sites, None, (between, np.ones(6))).excluded
    assert inside[2].contrast < 0.2
    beyond = np.vstack([between, between + np.array([0.1, 0.0])])
    assert all(power.contrast == np.inf for power in find_lumps(sites, None, (beyond, np.ones(12))).excluded)


@pytest.mark.parametrize(
    ("contrasts", "title"), [((None, 0.1, 0.05), "excluded with 0.95"), ((None,) * 3, "excludes nothing")]
)
def test_the_curve_is_drawn_over_the_widths_at_which_lumps_are_excluded(contrasts, title):
    entries = [{"width": w, "contrast": c, "probability": 0.95} for w, c in zip((4e-3, 8e-3, 15e-3), contrasts)]
    with style():
        _, axes = figure_of()
        draw_exclusion(axes[0, 0], entries)
    assert axes[0, 0].get_title("left") + axes[0, 0].get_title() == title
    lines = axes[0, 0].lines
    if contrasts[1] is not None:
        np.testing.assert_allclose(lines[0].get_xydata(), [[8, 10], [15, 5]])
    else:
        assert not lines


@pytest.mark.parametrize("text", ["{", "[]", '{"lumps": 3}', '{"lumps": [], "excluded": {}}', ""])
def test_a_damaged_file_of_lumps_has_none(tmp_path, text):
    (tmp_path / "lumps.json").write_text(text)
    assert read_lumps(tmp_path) == []
    assert read_lump_findings(tmp_path) == {}
