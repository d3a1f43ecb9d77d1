"""Lumps along sweeps and on areas, from estimates whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from palpate import LogError
from palpate_maps import map_grid
from palpate_maps.map_analysis import (
    Lump,
    LumpSettings,
    Path2D,
    Sites,
    find_lumps,
    footprint,
    is_placed,
    line_coordinate,
    make_map,
    sites_along,
    update_progress,
)

from tests.maps.grids import plate


def sweep(dice, lumps, length=0.07, noise=0.005, base=112e3):
    """Sites every millimetre along y, with Gaussian lumps (middle, width, contrast)."""
    y = np.arange(-length / 2, length / 2, 1e-3)
    contrast = sum((c * np.exp(-0.5 * ((y - m) / w) ** 2) for m, w, c in lumps), np.zeros_like(y))
    slow = np.convolve(dice.standard_normal(len(y) + 4), np.ones(5) / np.sqrt(5), "valid")
    log = np.log(base * (1 + contrast)) + noise * slow
    place = np.column_stack([1e-6 * dice.standard_normal(len(y)), y])
    return Sites(place, log, np.full(len(y), noise), np.arange(len(y)) / 4.0, np.zeros(len(y), bool))


def turned(sites, way):
    """The same sweep, made in the other direction where `way` is -1."""
    back = sites[::way]
    return Sites(back.place, back.log, back.std, sites.time, back.standing)


def area(dice, lumps, noise=0.005):
    """Sites on lines 5 mm apart."""
    x, y = np.meshgrid(np.arange(-30, 31) * 1e-3, np.arange(-20, 21, 5) * 1e-3)
    x[1::2] = x[1::2, ::-1]
    place = np.column_stack([x.ravel(), y.ravel()])
    contrast = np.zeros(len(place))
    for mx, my, w, c in lumps:
        contrast += c * np.exp(-((place[:, 0] - mx) ** 2 + (place[:, 1] - my) ** 2) / (2 * w**2))
    log = np.log(112e3 * (1 + contrast)) + noise * dice.standard_normal(len(place))
    n = len(log)
    return Sites(place, log, np.full(n, noise), np.arange(n) / 4.0, np.zeros(n, bool))


def test_both_methods_read_a_lump_off_the_same_curve():
    """Also where the cumulative sums call the flank between two lumps a rise of its own."""
    sites = sweep(np.random.default_rng(0), [(-0.014, 0.006, 0.56), (0.012, 0.004, 0.08)])
    prominence, cusum = (find_lumps(sites, LumpSettings(method=method)).lumps for method in ("prominence", "cusum"))
    assert len(prominence) == 2
    assert [replace(lump, p=0.0) for lump in cusum] == [replace(lump, p=0.0) for lump in prominence]


@pytest.mark.parametrize("method", ["prominence", "cusum"])
@pytest.mark.parametrize("way", [1, -1])
def test_lumps_of_a_sweep_are_where_they_are(method, way):
    sites = sweep(np.random.default_rng(0), [(-0.014, 0.006, 0.45), (0.015, 0.005, 0.15)])
    first, second = find_lumps(turned(sites, way), LumpSettings(method=method, contact_radius=4e-3)).lumps
    assert first.place[1] == pytest.approx(-0.014, abs=1e-3)
    assert second.place[1] == pytest.approx(0.015, abs=1e-3)
    assert second.contrast == pytest.approx(0.15, abs=0.04)
    assert second.extent[0] == pytest.approx(2.355 * 0.005, rel=0.25)
    # Its own size is without the tip, and without the 4 mm over which the curve is smoothed.
    (size, std), own = first.size, 2.355 * np.sqrt(0.006**2 - 0.225 * 0.004**2)
    assert abs(size - own) < 3 * std < 0.2 * own
    assert first.p <= second.p < 1e-3


@pytest.mark.parametrize("method", ["prominence", "cusum"])
def test_homogeneous_sweeps_raise_no_alarm(method):
    settings = LumpSettings(method=method)
    alarms = [len(find_lumps(sweep(np.random.default_rng(seed), []), settings).lumps) for seed in range(100)]
    assert sum(alarms) == 0


@pytest.mark.parametrize("method", ["prominence", "cusum"])
def test_a_softer_place_is_no_lump(method):
    sites = sweep(np.random.default_rng(1), [(0.0, 0.006, -0.3)])
    assert find_lumps(sites, LumpSettings(method=method)).lumps == ()


@pytest.mark.parametrize("method", ["prominence", "cusum"])
def test_a_step_is_no_lump(method):
    sites = sweep(np.random.default_rng(1), [])
    stepped = replace(sites, log=sites.log + np.where(sites.place[:, 1] > 0.005, 0.2, 0.0))
    assert find_lumps(stepped, LumpSettings(method=method)).lumps == ()


def test_lumps_of_an_area():
    sites = area(np.random.default_rng(0), [(-0.015, 0.005, 0.005, 0.3), (0.012, -0.01, 0.004, 0.15)])
    found = sorted(find_lumps(sites).lumps, key=lambda lump: lump.place)
    assert [lump.place for lump in found] == [
        pytest.approx((-0.015, 0.005), abs=1.5e-3),
        pytest.approx((0.012, -0.01), abs=1.5e-3),
    ]


def patched(dice, low, high, contrast, noise=0.004, slope=3e-3):
    """Sites on lines 5 mm apart over a stiff rectangle with graded flanks [m]."""
    sites = area(dice, [], noise)
    outside = np.maximum(0.0, np.maximum(np.array(low) - sites.place, sites.place - np.array(high)))
    flank = np.exp(-0.5 * (np.hypot(*outside.T) / slope) ** 2)
    return replace(sites, log=sites.log + np.log1p(contrast * flank))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("low", "high", "contrast"),
    [
        ((-0.03, -0.02), (-0.01, 0.02), 0.3),  # a third
        ((-0.03, -0.01), (0.0, 0.01), 0.12),
        ((-0.022, -0.014), (0.016, 0.011), 0.08),  # six tenths with the flanks
        ((-0.022, -0.014), (0.016, 0.011), 0.5),
    ],
)
def test_what_covers_much_of_the_area_is_found_and_told(seed, low, high, contrast):
    found = find_lumps(patched(np.random.default_rng(seed), low, high, contrast))
    (lump,) = found.lumps
    wide = np.maximum(np.array(low) - 3.5e-3, (-0.03, -0.02)), np.minimum(np.array(high) + 3.5e-3, (0.03, 0.02))
    assert lump.place == pytest.approx(tuple((wide[0] + wide[1]) / 2), abs=2.5e-3)
    assert lump.extent == pytest.approx(tuple(wide[1] - wide[0]), rel=0.2)  # at half its height
    assert lump.contrast == pytest.approx(contrast, rel=0.25)
    assert lump.p < 1e-3
    assert found.background == pytest.approx(112e3, rel=0.005)
    assert found.several is None or "not one population" in found.warning


def test_half_of_the_area_is_no_background_without_a_word():
    found = find_lumps(patched(np.random.default_rng(0), (-0.03, -0.02), (0.0, 0.02), 0.3))
    assert 0.3 < found.several < 0.6


def test_a_soft_spot_makes_no_lump_of_the_rest():
    found = find_lumps(patched(np.random.default_rng(0), (-0.02, -0.01), (-0.005, 0.01), -0.3))
    assert found.lumps == ()
    assert found.background == pytest.approx(112e3, rel=0.005)


def test_the_stay_before_a_raster_is_no_point_on_its_lump():
    """The raster begins in the corner of a stiff patch: that stay neither places the lump nor checks it."""
    sites = patched(np.random.default_rng(0), (-0.03, -0.02), (-0.01, 0.0), 0.3)
    sites.standing[0] = True
    (lump,) = find_lumps(sites).lumps
    assert lump.place == pytest.approx((-0.02, -0.01), abs=2e-3)
    assert not lump.checked


@pytest.mark.slow
def test_homogeneous_areas_raise_no_alarm():
    alarms = [len(find_lumps(area(np.random.default_rng(seed), [])).lumps) for seed in range(25)]
    assert sum(alarms) == 0


def test_the_threshold_is_a_setting():
    sites = sweep(np.random.default_rng(2), [(0.0, 0.005, 0.1)])
    assert len(find_lumps(sites).lumps) == 1
    assert find_lumps(sites, LumpSettings(contrast=0.2)).lumps == ()


def test_too_little_is_refused():
    sites = sweep(np.random.default_rng(0), [])
    with pytest.raises(LogError, match="too few"):
        find_lumps(sites[:5])
    with pytest.raises(LogError, match="too short"):
        find_lumps(sites[:11])


def test_a_line_is_told_from_an_area():
    assert line_coordinate(sweep(np.random.default_rng(0), [])) is not None
    assert line_coordinate(area(np.random.default_rng(0), [])) is None


@pytest.mark.parametrize("method", ["gaussian-process", "average"])
def test_a_map_is_right_within_its_uncertainty(method):
    sites = area(np.random.default_rng(3), [(-0.01, 0.005, 0.006, 0.3)])
    field = make_map(sites, 1e-3, method)
    x, y = np.meshgrid(field.x, field.y)
    truth = 112e3 * (1 + 0.3 * np.exp(-((x + 0.01) ** 2 + (y - 0.005) ** 2) / (2 * 0.006**2)))
    assert field.value.shape == (41, 61)
    assert field.covered.all()
    error = (field.value - truth) / field.std
    assert np.mean(np.abs(error) < 2) > 0.9
    if method == "gaussian-process":
        assert np.sqrt(np.mean((field.value / truth - 1) ** 2)) < 0.01
        assert np.mean(error**2) == pytest.approx(1.0, abs=0.9)


def test_distances_in_portions_give_the_same_map(monkeypatch):
    """Ten thousand sites have a hundred million distances: they are never held at once."""
    sites = area(np.random.default_rng(3), [(-0.01, 0.005, 0.005, 0.3)])
    whole = make_map(sites, 2e-3, "average")
    monkeypatch.setattr(map_grid, "_MAX_DISTANCES", 5 * len(sites))
    pieces = make_map(sites, 2e-3, "average")
    assert pieces.length == whole.length
    np.testing.assert_allclose(pieces.value, whole.value, rtol=1e-13)
    np.testing.assert_allclose(pieces.std, whole.std, rtol=1e-7)  # a difference of squares


def test_the_significant_cells_are_those_of_the_lump():
    field = make_map(area(np.random.default_rng(3), [(-0.01, 0.005, 0.005, 0.3)]), 1e-3)
    x, y = np.meshgrid(field.x, field.y)
    from_lump = np.hypot(x + 0.01, y - 0.005)
    assert field.stiff[from_lump < 5e-3].all()
    assert not field.stiff[from_lump > 1.6e-2].any()
    assert field.p[from_lump < 5e-3].max() < 1e-4
    assert np.isfinite(field.p).all()


@pytest.mark.slow
def test_homogeneous_maps_have_no_significant_cell():
    stiff = [make_map(area(np.random.default_rng(seed), []), 2e-3, "average").stiff.any() for seed in range(20)]
    assert sum(stiff) == 0


def test_what_was_not_palpated_is_not_covered():
    sites = area(np.random.default_rng(3), [])
    hole = np.abs(sites.place[:, 1]) > 6e-3
    field = make_map(sites[hole], 1e-3)
    x, y = np.meshgrid(field.x, field.y)
    assert not field.covered[(np.abs(y) < 2e-3) & (np.abs(x) < 0.02)].any()
    assert np.isnan(field.value[~field.covered]).all()
    assert field.covered[np.abs(y) > 1e-2].all()


def test_a_path_becomes_sites_of_sweep_and_stay():
    time = np.arange(0.0, 20.0, 0.01)
    y = np.where(time < 10.0, 0.0, 0.004 * (time - 10.0))
    place = np.column_stack([np.zeros_like(y), y]) + 5e-6 * np.random.default_rng(0).standard_normal((len(y), 2))
    value = np.where(time < 5.0, 500e3, 100e3 * (1 + y))
    path = Path2D("dr/ekf", "elasticity", time, place, value, np.full(len(y), 1e3), 1.0)
    sites = sites_along(path)
    assert np.count_nonzero(sites.standing) == 1
    assert sites.value[sites.standing] == pytest.approx(100e3, rel=1e-3)  # the beginning of a stay does not count
    moving = sites[~sites.standing]
    assert 38 <= len(moving) <= 43
    assert moving.value == pytest.approx(100e3 * (1 + moving.place[:, 1]), rel=1e-4)


def test_a_stay_before_the_sweep_tells_what_is_scatter():
    time = np.arange(0.0, 27.0, 0.01)
    y = np.where(time < 10.0, 0.0, 0.004 * (time - 10.0))
    dice = np.random.default_rng(0)
    value = 100e3 * np.exp(0.004 * np.repeat(dice.standard_normal(len(time) // 25), 25))
    path = Path2D("dr/kinematic", "elasticity", time, np.column_stack([0 * y, y]), value, 0.02 * value, 1.0)
    assert sites_along(path).kept == pytest.approx(0.2, abs=0.08)
    # A filter that its innovations show to be too certain scatters no more for that.
    certain = sites_along(replace(path, std=path.std / 2, nis=4.0))
    assert certain.kept * certain.std == pytest.approx(sites_along(path).kept * sites_along(path).std)
    late = time > 8.5
    short = Path2D("dr/kinematic", "elasticity", time[late], path.place[late], value[late], path.std[late], 1.0)
    assert sites_along(short).kept == 0.7


def test_a_search_stops_once_its_lump_stays_in_place():
    def lump(x, p, checked=True):
        return Lump((x, 0.0), (0.01, 0.01), 0.3, 0.02, p, checked=checked)

    first, moved, stays = lump(0.0, 1e-6), lump(0.005, 1e-6), lump(0.0065, 1e-6)
    assert not is_placed(None, first, 1e-3)
    assert not is_placed(first, moved, 1e-3)
    assert is_placed(moved, stays, 1e-3)
    assert not is_placed(moved, lump(0.0065, 0.01), 1e-3)


def everywhere(places):
    return np.ones(len(places), bool)


def searching(sites, before=(), allows=everywhere):
    """What a search says of the lumps of sites."""
    nodes = np.stack(np.meshgrid(np.linspace(-0.04, 0.04, 41), np.linspace(-0.03, 0.03, 31)), axis=-1).reshape(-1, 2)
    return update_progress(find_lumps(sites), before, sites, plate(nodes, allows), 1e-3)


def with_points(sites, places, log):
    """Sites and point palpations."""
    n = len(places)
    joined = (np.vstack([sites.place, places]), np.append(sites.log, log), np.append(sites.std, np.full(n, 0.005)))
    return Sites(*joined, np.arange(len(sites) + n) / 4.0, np.append(sites.standing, np.ones(n, bool)))


def test_a_lump_is_done_once_points_confirm_it_and_leave_it_in_place():
    sites = area(np.random.default_rng(0), [(0.0, 0.0, 0.005, 0.3)])
    (first,) = searching(sites)
    assert not first.certain
    points = np.array([[0.0, 0.001], [0.004, 0.0], [-0.004, 0.0]])
    log = np.log(112e3 * (1 + 0.3 * np.exp(-(points**2).sum(axis=1) / (2 * 0.005**2))))
    confirmed = with_points(sites, points, log)
    (second,) = searching(confirmed)
    assert not second.certain  # nothing is known of where it was before
    (third,) = searching(confirmed, [second])
    assert third.done
    taken = footprint(sites.place, third.lump, 0.05, 4e-3)
    assert taken[np.hypot(*sites.place.T) < 8e-3].all()
    assert not taken[np.hypot(*sites.place.T) > 2.2e-2].any()


def test_a_lump_at_the_border_goes_on_or_is_said_to_be_cut():
    sites = area(np.random.default_rng(0), [(0.033, 0.0, 0.006, 0.4)])
    (open_,) = searching(sites)
    assert (open_.beyond, open_.cut) == (True, False)
    (cut,) = searching(sites, allows=lambda places: places[:, 0] < 0.0305)
    assert (cut.beyond, cut.cut) == (False, True)
    (inside,) = searching(area(np.random.default_rng(0), [(0.01, 0.0, 0.006, 0.4)]))
    assert (inside.beyond, inside.cut) == (False, False)


W = 10.0 / 2.3548 * 1e-3  # of lumps 10 mm wide at half their height


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8)])
def test_two_lumps_without_background_between_them_are_two(seed, way):
    """14 mm apart, of 30 %: no site between them is of the background."""
    apart = 7e-3 * np.array(way)
    found = find_lumps(area(np.random.default_rng(seed), [(*apart, W, 0.3), (*-apart, W, 0.3)]))
    places = sorted((lump.place for lump in found.lumps), key=lambda place: float(np.dot(place, way)))
    assert places == [pytest.approx(place, abs=1.5e-3) for place in (-apart, apart)]
    assert not any(lump.may_be_two for lump in found.lumps)


@pytest.mark.parametrize("seed", range(20))
def test_one_lump_is_told_as_one(seed):
    dice = np.random.default_rng(seed)
    place = dice.uniform(-12e-3, 12e-3, 2)
    found = find_lumps(area(dice, [(*place, W * dice.uniform(0.8, 1.4), dice.uniform(0.15, 0.5))]))
    (lump,) = found.lumps
    assert not lump.may_be_two
    assert found.warning is None or "two" not in found.warning
