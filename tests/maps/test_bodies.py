"""Bodies that are fitted to the sites of an area: how many, where, how wide and how stiff, within their ±."""

import math
from dataclasses import replace

import numpy as np
import pytest
from palpate_maps.body_field import FWHM, Body, SiteField, fit_bodies, rise
from palpate_maps.body_search import lump_members
from palpate_maps.lump_criteria import size_without_tip
from palpate_maps.lumps import find_lumps
from palpate_maps.map_analysis import LumpSettings, Sites, make_map

from tests.maps.test_lumps import area

SIGMA = 8e-3 / FWHM


def points(dice, bumps, size=(0.04, 0.03), pitch=5e-3, noise=0.006):
    """Points of a grid over Gaussian lumps (x, y, contrast, sigma)."""
    axes = (np.arange(round(length / pitch) + 1) * pitch - length / 2 for length in size)
    place = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    contrast = sum(c * np.exp(-((place - [x, y]) ** 2).sum(axis=1) / (2 * w**2)) for x, y, c, w in bumps)
    log = np.log(112e3 * (1 + contrast)) + noise * dice.standard_normal(len(place))
    return Sites(place, log, np.full(len(place), noise), 3.0 * np.arange(len(place)), np.ones(len(place), bool))


def test_the_slopes_of_the_field_are_those_of_differences():
    """Two bodies on an inclined plane in space; the derivative of log(1 + s) by each unknown."""
    axes = np.linalg.qr(np.array([[1.0, 0.0], [0.0, 1.0], [0.3, 0.2]]))[0]
    bodies = [Body(np.array([1e-3, 0, 0]), 0.4, 4e-3, axes), Body(np.array([-4e-3, 5e-3, 0]), 0.2, 5e-3, axes)]
    places = 1e-2 * np.random.default_rng(0).standard_normal((20, 3))
    unknowns = [0.0, 0.0, 0.4, math.log(4e-3)]
    _, slopes = rise(bodies, places)
    for k, step in enumerate((1e-7, 1e-7, 1e-5, 1e-5)):
        ends = [
            rise([bodies[0].moved(np.array(unknowns) + way * step * np.eye(4)[k]), bodies[1]], places)[0]
            for way in (1, -1)
        ]
        np.testing.assert_allclose(slopes[:, k], (ends[0] - ends[1]) / (2 * step), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("gap", [12e-3, 16e-3, 20e-3])
@pytest.mark.parametrize("contrasts", [(1.0, 1.0), (0.3, 0.3), (1.0, 0.3)])
def test_two_lumps_are_two(gap, contrasts):
    dice = np.random.default_rng(int(1e3 * gap))
    middles = np.array([[-gap / 2, 1e-3], [gap / 2, -1e-3]])
    bumps = [(*middle, c, SIGMA) for middle, c in zip(middles, contrasts, strict=True)]
    lumps = sorted(find_lumps(points(dice, bumps)).lumps, key=lambda lump: lump.place)
    assert [lump.place for lump in lumps] == [pytest.approx(middle, abs=1.5e-3) for middle in middles]
    for lump, contrast in zip(lumps, contrasts, strict=True):
        assert abs(lump.contrast - contrast) < 3 * lump.contrast_std < 0.3 * contrast
        assert abs(lump.extent[0] - 8e-3) < 3 * lump.width_std * lump.extent[0]


def test_the_contrast_of_a_lump_off_every_site_is_that_of_its_middle():
    """The stiffest site shows 0.58 of it: 3.5 mm off."""
    dice = np.random.default_rng(0)
    (lump,) = find_lumps(points(dice, [(2.5e-3, 2.5e-3, 1.0, SIGMA)])).lumps
    assert lump.contrast == pytest.approx(1.0, abs=3 * lump.contrast_std)
    assert lump.place == pytest.approx((2.5e-3, 2.5e-3), abs=3 * max(lump.place_std))
    assert lump.contrast_std < 0.05


def test_contrasts_are_within_their_uncertainties():
    inside = 0
    for seed in range(30):
        dice = np.random.default_rng(seed)
        x, y = dice.uniform([-12e-3, -8e-3], [12e-3, 8e-3])
        (lump,) = find_lumps(points(dice, [(x, y, 0.4, dice.uniform(8e-3, 12e-3) / FWHM)])).lumps
        inside += abs(lump.contrast - 0.4) < 2 * lump.contrast_std
    assert inside >= 25  # of 30 with a probability of 0.95: 24 or fewer in 1 of 400


def test_few_sites_of_background_make_no_further_lump():
    """Three wide lumps cover half of the area; a weak one is found besides, nothing else is."""
    bumps = [(-16e-3, -8e-3, 0.5, 6e-3), (10e-3, 10e-3, 0.4, 6e-3), (14e-3, -10e-3, 0.12, 4e-3)]
    for seed in range(5):
        lumps = find_lumps(points(np.random.default_rng(seed), bumps, (0.05, 0.04))).lumps
        assert sorted(lump.place for lump in lumps) == [pytest.approx(b[:2], abs=2e-3) for b in sorted(bumps)]


def test_a_stretch_of_way_is_a_mean_of_the_field():
    """Sites 4 mm long over a lump 8 mm wide would be 6 % too low at its middle."""
    x = np.arange(-40, 41) * 0.5e-3
    place = np.column_stack([x, np.zeros(len(x))])
    site = np.arange(len(x)) // 8
    exact = SiteField(place, site, np.zeros(site.max() + 1))
    body = Body.at(np.zeros(2), 0.5, np.array([[1.0], [0.0]]), SIGMA)
    field = SiteField(place, site, exact.mean(rise([body], place)[0]))
    fit = fit_bodies(field, [Body.at(np.array([2e-3, 0.0]), 0.3, body.axes)], 1e-4)
    assert fit.bodies[0].contrast == pytest.approx(0.5, rel=1e-3)
    assert fit.bodies[0].place[0] == pytest.approx(0.0, abs=1e-5)


def test_a_body_beside_a_line_is_no_stiffer_than_seen_by_much():
    """Seen from one side, on the last of three lines: its height and its distance from the line are one number."""
    x, y = np.meshgrid(np.arange(-30, 31, 4) * 1e-3, np.array([0.0, 7e-3, 14e-3]))
    place = np.column_stack([x.ravel(), y.ravel()])
    contrast = 0.15 * np.exp(-((place - [15e-3, 17e-3]) ** 2).sum(axis=1) / (2 * 4.2e-3**2))
    log = np.log(112e3 * (1 + contrast)) + 0.003 * np.random.default_rng(0).standard_normal(len(place))
    sites = Sites(place, log, np.full(len(place), 0.003), np.arange(len(place)) / 1.0, np.zeros(len(place), bool))
    (lump,) = find_lumps(sites).lumps
    assert lump.contrast == pytest.approx(0.15, abs=max(2 * lump.contrast_std, 0.05))
    assert lump.contrast < 0.25
    assert lump.place_std[1] > lump.place_std[0]
    assert math.dist(lump.place, (15e-3, 17e-3)) < 4e-3


def test_the_tips_blur_is_taken_out_of_a_width():
    """A Gaussian 6 mm wide, blurred by a contact of 4.47 mm with the variance 0.225 a^2."""
    blurred = math.sqrt(6e-3**2 + 0.225 * (FWHM * 4.47e-3) ** 2)
    size, std = size_without_tip(blurred, 0.2e-3, 4.47e-3)
    assert size == pytest.approx(6e-3)
    assert std > 0.2e-3 * blurred / size
    assert size_without_tip(4e-3, 0.2e-3, 4.47e-3) is None


def test_lumps_in_a_triangle_are_no_stiff_part_of_the_area():
    bumps = [(-9e-3, -7e-3, 0.6, SIGMA), (9e-3, -7e-3, 0.6, SIGMA), (0.0, 8e-3, 0.6, SIGMA)]
    sites = points(np.random.default_rng(0), bumps, (0.06, 0.04))
    assert len(find_lumps(sites, LumpSettings(contact_radius=4.47e-3)).lumps) == 3
    plateau = points(np.random.default_rng(0), [(0.0, 0.0, 0.5, 12e-3)], (0.08, 0.06))
    assert len(find_lumps(plateau).lumps) == 1


def test_bodies_far_apart_are_two_however_uncertain_one_is():
    """40 mm apart: with standard deviations a hundred times as large no dip would be significant."""
    sites = points(np.random.default_rng(0), [(-20e-3, 0.0, 0.2, SIGMA), (20e-3, 0.0, 0.3, SIGMA)], (0.06, 0.03))
    field = SiteField(sites.place, np.arange(len(sites)), sites.log)
    starts = [Body.at(np.array([x, 0.0]), 0.2, np.eye(2)) for x in (-20e-3, 20e-3)]
    fit = fit_bodies(field, starts, 0.005)
    assert lump_members(replace(fit, covariance=1e4 * fit.covariance)) == [[1], [0]]


@pytest.mark.parametrize("contrast", [0.3, 1.0])
def test_cells_on_a_lump_narrower_than_the_pitch_have_an_honest_std(contrast):
    """Bumps 4 mm wide, pitch 5 mm: of the raised cells most are within two standard deviations, by their bodies."""
    shares = []
    for seed in range(4):
        dice = np.random.default_rng([seed, 40])
        x, y = dice.uniform([-14e-3, -9e-3], [14e-3, 9e-3])
        sites = points(dice, [(x, y, contrast, 4e-3 / FWHM)], noise=0.005)
        columns, rows = np.meshgrid(*(np.arange(-n, n + 1) * 1e-3 for n in (20, 15)))
        shape = np.exp(-0.5 * ((columns - x) ** 2 + (rows - y) ** 2) / (4e-3 / FWHM) ** 2)
        for fit in (None, find_lumps(sites).fit):
            field = make_map(sites, fit=fit)
            inside = np.abs(field.value - 112e3 * (1 + contrast * shape)) < 2 * field.std
            shares.append(inside[shape > 0.05].mean())
    without, with_bodies = np.reshape(shares, (4, 2)).mean(axis=0)
    assert without < 0.5
    assert with_bodies > 0.7
    assert field.length > 0.69 * 5e-3


def test_a_map_says_below_which_width_it_is_blind():
    """Points 5 mm apart have 3.5 mm between them and a place, lines of sites 2.5 mm."""
    dice = np.random.default_rng(0)
    assert make_map(points(dice, [(0, 0, 0, 1e-2)])).blind_below == pytest.approx(2 * 3.0e-3, rel=0.1)
    assert make_map(area(dice, [])).blind_below == pytest.approx(2 * 2.3e-3, rel=0.15)
