"""A search: the field that grows by a site, what may still hide, where to go, and when it is over."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_engine import load_pipeline
from palpate_maps.area_search import AreaSearch, SearchSettings
from palpate_maps.clearance import Clearance, PatchGrid
from palpate_maps.field_gain import FieldGain
from palpate_maps.hidden_patches import EXPECTED, Hiding, Patch, hidden_patches
from palpate_maps.map_analysis import Knowledge, Sites, area_of, find_lumps
from palpate_maps.map_figures import _patch_density, hiding_picture
from palpate_maps.next_places import passes
from palpate_maps.search_actions import ActionGrid
from palpate_maps.stiffness_field import FieldKernel, StiffnessField, interpolated

from tests.maps.grids import cells_of, plate

PATCH = Patch(5e-3, 0.1)
NODES = np.stack(np.meshgrid(np.linspace(-0.03, 0.03, 21), np.linspace(-0.02, 0.02, 14)), axis=-1).reshape(-1, 2)


def points(seed, count, lump=None, where=NODES, noise=0.006):
    """Points at random nodes, with the least patch at a place."""
    dice = np.random.default_rng(seed)
    place = where[dice.choice(len(where), count, replace=False)]
    log = 11.6 + noise * dice.standard_normal(count)
    if lump is not None:
        log += PATCH.profile(place, np.array([lump]))[:, 0]
    return Sites(place, log, np.full(count, 0.013), 5.0 * np.arange(count), np.ones(count, bool))


def test_a_field_that_grows_is_the_one_that_is_solved_at_once():
    """m = k' K^-1 y and v = k - k' K^-1 k, with the covariance written out."""
    sites, kernel = points(0, 60, (0.0, 0.0)), FieldKernel(4e-3, 8e-3, 2e-5)
    field = StiffnessField(NODES, kernel, 60)
    field.factorise(sites[:20])
    for place, log, std in zip(sites.place[20:], sites.log[20:], sites.std[20:], strict=True):
        field.add(place, log, std**2, 11.6)

    def covariance(a, b):
        ratio = np.sqrt(3) * np.linalg.norm(a[:, None] - b[None], axis=2) / 8e-3
        return 4e-3 * (1 + ratio) * np.exp(-ratio)

    noisy = covariance(sites.place, sites.place) + np.diag(sites.std**2 + 2e-5)
    cross = covariance(sites.place, NODES)
    mean = 11.6 + cross.T @ np.linalg.solve(noisy, sites.log - 11.6)
    variance = 4e-3 - np.einsum("nm,nm->m", cross, np.linalg.solve(noisy, cross))
    np.testing.assert_allclose(field.mean(11.6), mean, rtol=1e-9)
    np.testing.assert_allclose(field.std, np.sqrt(variance), rtol=1e-6)


def test_the_kernel_is_fitted_again_once_the_sites_contradict_it():
    sites = points(0, 90)
    calm = Knowledge.of(sites[:70], NODES)
    assert Knowledge.of(sites[:80], before=calm).field is calm.field
    wild = replace(sites, log=sites.log + np.where(np.arange(90) < 70, 0.0, 0.2 * (-1.0) ** np.arange(90)))
    assert Knowledge.of(wild[:80], before=calm).field is not calm.field


def test_before_anything_is_palpated_a_patch_remains_as_expected():
    nothing = points(0, 2)[:0]
    assert hidden_patches(nothing, NODES, PATCH).risk == pytest.approx(1 - np.exp(-EXPECTED))


def test_what_is_palpated_everywhere_hides_nothing_and_a_hole_hides_what_it_may():
    assert hidden_patches(points(0, 200), NODES, PATCH).risk < 1e-4
    left = NODES[NODES[:, 0] < 0.0]
    hiding = hidden_patches(points(0, 120, where=left), NODES, PATCH)
    beyond = NODES[:, 0] > 0.01
    assert hiding.expected[beyond].sum() == pytest.approx(EXPECTED * beyond.mean(), rel=0.1)
    assert hiding.expected[NODES[:, 0] < -0.004].sum() < 1e-3


def test_the_picture_of_a_cleared_area_is_dark():
    """Its scale goes up to what was expected beforehand, 1.5 patches in 63 mm x 43.1 mm of cells."""
    hiding = hidden_patches(points(0, 200), NODES, PATCH)
    axis = hiding_picture(hiding, cells_of(NODES), []).axes[0]
    (image,) = axis.images
    assert image.get_clim() == pytest.approx((0.0, 100 * EXPECTED / (6.3 * 4.3077)), rel=1e-3)
    assert np.ptp(np.asarray(image.get_array())) < 0.01 * image.get_clim()[1]
    assert axis.get_title(loc="left") == "a patch remains with less than 0.01 %"


@pytest.mark.parametrize("stiffer", [1.0, 3.0])
def test_a_patch_that_is_there_is_likely_and_where_it_is(stiffer):
    sites = points(1, 100)
    log = sites.log + stiffer * PATCH.profile(sites.place, np.array([[0.011, -0.007]]))[:, 0]
    hiding = hidden_patches(replace(sites, log=log), NODES, PATCH)
    place, number = hiding.likely
    assert number > 20
    assert place == pytest.approx([0.011, -0.007], abs=4e-3)
    assert hiding.risk > 0.99


def test_the_level_and_the_unit_do_not_matter():
    sites = points(2, 40)
    hiding = hidden_patches(sites, NODES, PATCH)
    shifted = hidden_patches(replace(sites, log=sites.log + np.log(1e3)), NODES, PATCH)
    np.testing.assert_allclose(shifted.expected, hiding.expected, rtol=1e-6)


@pytest.mark.slow
def test_a_patch_is_missed_as_often_as_stated():
    """Sites by the model itself: of the cases whose risk is stated about 5 %, in 5 % a patch remains."""
    stated, remains = [], []
    for seed in range(500):
        dice = np.random.default_rng(seed)
        count = dice.poisson(EXPECTED)
        middles = NODES[dice.choice(len(NODES), count, replace=False)]
        sites = points(seed, 45, noise=0.009)
        sites = replace(sites, log=sites.log + PATCH.profile(sites.place, middles).sum(axis=1))
        hiding = hidden_patches(sites, NODES, PATCH)
        if 0.01 < hiding.risk < 0.3:
            stated.append(hiding.risk)
            remains.append(count > 0)
    error = (np.mean(remains) - np.mean(stated)) / np.sqrt(np.mean(stated) / len(stated))
    assert len(stated) > 60
    assert abs(error) < 4


@dataclass
class Motion:
    """Times of points and lines."""

    line_speed: float | None
    first_point: float = 5.0
    shortest: float = 16e-3
    way_of_turn: float = 0.36

    def can_go(self, proposals):
        return True

    def seconds_to(self, distance):
        return 4.5 + distance / 0.05

    def seconds_along(self, way):
        return 4.0 + way / self.line_speed


FREE, ALL = np.zeros(len(NODES), bool), np.ones(len(NODES), bool)


def first_action(gain, speed, tip=(0.0, 0.0), count=1, closed=FREE, through=ALL):
    """What is done first at a speed along lines."""
    return ActionGrid(NODES, cells_of(NODES), Motion(speed)).next_round(gain, count, np.array(tip), closed, through)[0]


def test_a_line_is_taken_where_it_clears_more_in_a_second():
    everywhere = np.full(len(NODES), EXPECTED / len(NODES))
    gain = Clearance.of(PatchGrid(NODES, PATCH), everywhere, 0.05, 0.008)
    quick, slow, none = (first_action(gain, speed) for speed in (6e-3, 2e-4, None))
    assert quick.end is not None
    assert slow.end is None
    assert none.end is None
    assert quick.worth > slow.worth == none.worth
    corner = np.where(np.hypot(*(NODES - (0.03, 0.02)).T) < 4e-3, everywhere, 0.0)
    best = first_action(Clearance.of(PatchGrid(NODES, PATCH), corner, 0.001, 0.008), None)
    assert np.hypot(*(NODES[best.start] - (0.03, 0.02))) < 8e-3


def test_a_line_begins_at_its_nearer_end_and_goes_through_what_is_asked_for():
    everywhere = np.full(len(NODES), EXPECTED / len(NODES))
    gain = Clearance.of(PatchGrid(NODES, PATCH), everywhere, 0.05, 0.008)
    for tip in ((0.03, 0.02), (-0.03, -0.02)):
        line = first_action(gain, 6e-3, tip)
        from_start, from_end = (np.hypot(*(NODES[node] - tip)) for node in (line.start, line.end))
        assert from_start <= from_end
    through = np.hypot(*(NODES - (0.015, -0.01)).T) < 2e-3
    line = first_action(gain, 6e-3, through=through)
    (low, high), way = np.sort(NODES[[line.start, line.end]], axis=0), NODES[through]
    assert ((way >= low - 1e-9) & (way <= high + 1e-9)).all(axis=1).any()


def test_the_gain_of_a_line_is_that_of_its_sites_together():
    """C - C_S (C_SS + r)^-1 C_S, with the covariance after all sites written out."""
    known = Knowledge.of(points(0, 40, (0.0, 0.0)), NODES)
    rows, weight = np.arange(len(NODES)), known.field.std**2
    gain, row = FieldGain.of(known, rows, weight), np.arange(21, 29)
    covariance = known.field.covariance(rows, rows)
    site = known.field.kernel.noise + 0.013**2
    shared = covariance[row]
    taken = np.einsum("ij,ij->j", shared, np.linalg.solve(covariance[np.ix_(row, row)] + site * np.eye(8), shared))
    assert gain.lines(row)[-1] == pytest.approx(taken.sum(), rel=1e-6)
    assert gain.lines(row)[0] == pytest.approx(gain.points()[row[0]], rel=1e-9)
    assert gain.after(3).points()[40] < gain.points()[40]


def test_each_point_and_each_crossing_is_a_pass():
    line = np.column_stack([np.linspace(-0.02, 0.02, 21), np.zeros(21)])
    place = np.vstack([line, line[::-1, ::-1], np.zeros((2, 2))])
    standing = np.r_[np.zeros(42, bool), np.ones(2, bool)]
    sites = Sites(place, np.zeros(44), np.full(44, 0.01), np.arange(44.0), standing)
    assert passes(sites, np.array([[0.0, 0.0], [0.015, 0.0], [0.03, 0.0]]), 4e-3).tolist() == [4, 1, 0]


def test_a_map_of_more_nodes_is_the_field():
    sites = points(4, 60, (0.0, 0.0))
    field = StiffnessField.of(sites, NODES, 11.6)
    mean, std, length = interpolated(sites, NODES, 11.6)
    assert length == field.kernel.length
    np.testing.assert_allclose(mean, field.mean(11.6), atol=1e-9)
    np.testing.assert_allclose(std, field.std, rtol=1e-6)


@pytest.mark.parametrize("visits", [8, 20, 40])
def test_visits_to_lumps_do_not_make_them_the_background(visits):
    """A line of 15 sites, four of them on each of two lumps, and then most of all sites on these."""
    middles = np.array([[-0.014, -0.003], [0.014, 0.006]])
    found = 0
    for seed in range(4):
        dice = np.random.default_rng(seed)
        line = np.column_stack([np.linspace(-0.028, 0.028, 15), np.zeros(15)])
        place = np.vstack([line, *(middle + 0.003 * dice.standard_normal((visits, 2)) for middle in middles)])
        log = 11.6 + 2 * PATCH.profile(place, middles).sum(axis=1) + 0.005 * dice.standard_normal(len(place))
        standing = np.arange(len(place)) >= 15
        lumps = find_lumps(Sites(place, log, np.full(len(place), 0.01), 5.0 * np.arange(len(place)), standing)).lumps
        off = [min((np.hypot(*(lump.place - middle)) for lump in lumps), default=1.0) for middle in middles]
        found += sum(distance < 4e-3 for distance in off)
    assert found == 8


def searching(settings, seed, budget=400, lump=(0.012, -0.006)):
    """A search over points that say the truth with noise; seconds of motion it took."""
    search = AreaSearch(plate(NODES), Motion(None), settings)
    dice = np.random.default_rng(seed)
    sites = points(seed, 12, lump)
    search.observe(sites, visited=False)
    for number in range(budget // 15):
        places = search.next_round()
        if not places or search.ended():
            return search, 15.0 * number
        place = np.array([p.place for p in places])
        log = 11.6 + 0.006 * dice.standard_normal(len(place))
        log += PATCH.profile(place, np.array([lump]))[:, 0] if lump else 0.0
        time = sites.time[-1] + 5.0 * np.arange(1, len(place) + 1)
        new = Sites(place, log, np.full(len(place), 0.013), time, np.ones(len(place), bool))
        columns = zip(*((s.place, s.log, s.std, s.time, s.standing) for s in (sites, new)), strict=True)
        sites = Sites(*(np.concatenate(column) for column in columns))
        search.observe(sites, visited=True)
    return search, float(budget)


@pytest.mark.slow
@pytest.mark.parametrize("lump", [None, (0.012, -0.006)])
def test_a_search_ends_at_its_risk_with_what_is_there(lump):
    search, seconds = searching(SearchSettings(contrast=0.1, risk=0.05), 3, lump=lump)
    assert seconds < 400
    assert search.hiding.risk <= 0.05
    known = [*(item.lump.place for item in search.lumps), *search.patches]
    assert len(known) == (lump is not None)
    if lump is not None:
        assert known[0] == pytest.approx(lump, abs=4e-3)


def test_an_outline_goes_to_the_flanks_and_a_map_to_the_unknown():
    place = np.stack(np.meshgrid(np.linspace(-0.03, 0.0, 9), np.linspace(-0.02, 0.02, 11)), axis=-1).reshape(-1, 2)
    height = 0.3 * np.exp2(-((np.hypot(place[:, 0] + 0.015, place[:, 1]) / 5e-3) ** 2))
    n = len(place)
    noise = 0.004 * np.random.default_rng(0).standard_normal(n)
    sites = Sites(place, 11.6 + height + noise, np.full(n, 0.008), np.arange(n) * 5.0, np.ones(n, bool))
    where = {"outline": NODES[NODES[:, 0] < 0.0], "map": NODES}
    nexts = {}
    for aim, nodes in where.items():
        area = plate(nodes)
        search = AreaSearch(area, Motion(None), SearchSettings(aim, 1, 0.15))
        for _ in range(2):  # a lump is certain once it stays in place
            search.observe(sites, visited=True)
        (nexts[aim],) = search.next_round()
        assert search.ended() is None
    assert 2e-3 < np.hypot(nexts["outline"].place[0] + 0.015, nexts["outline"].place[1]) < 9e-3
    assert nexts["map"].place[0] > 0.005


@pytest.mark.parametrize(
    ("box", "words"),
    [
        ((0.03, 0.04, 0.0, 0.01), "lies outside of the workspace of \\[safety\\], x -25 to 25 mm"),
        ((0.0, 0.0, 0.0, 0.01), "is empty"),
    ],
)
def test_an_area_that_the_limits_do_not_reach_is_named(root, box, words):
    pipeline = load_pipeline(root / "pipelines" / "raster_ur3e.toml")
    with pytest.raises(ConfigurationError, match=f"--area.*{words}"):
        area_of(pipeline, pipeline.trajectories["raster"], np.zeros((1, 2)), box)


def test_of_an_area_only_what_the_limits_reach_is_searched(root):
    pipeline = load_pipeline(root / "pipelines" / "raster_ur3e.toml")
    area = area_of(pipeline, pipeline.trajectories["raster"], np.zeros((1, 2)), (0.0, 0.05, -0.01, 0.01))
    assert area.nodes[:, 0].max() <= 0.025 + 1e-9
    assert area.share == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"risk": 0.0}, "--risk"),
        ({"risk": 1.0}, "--risk"),
        ({"risk": float("nan")}, "--risk"),
        ({"contrast": 0.0}, "--contrast"),
        ({"sure": 1.0}, "--sure"),
        ({"radius": -1e-3}, "--radius"),
    ],
)
def test_what_is_no_search_is_refused(wrong, word):
    with pytest.raises(ConfigurationError, match=word):
        SearchSettings(**wrong)


@pytest.mark.parametrize("columns", [[0, 2, 4, 6], [0, 2, 5], [0, 2, 7, 9]])
def test_the_picture_of_hidden_patches_has_each_cell_about_its_place(columns):
    """Columns that a thinned grid has left, 1 mm apart in the grid, also with others between them than every second."""
    cells = np.array([[column, row] for row in (0, 2) for column in columns])
    middles = 1e-3 * cells.astype(float)
    expected = 1e-3 * (1.0 + np.arange(len(cells)))
    field, (left, right, low, high) = _patch_density(Hiding(middles, expected, 5e-3), cells)
    pixel = (right - left) / field.shape[1], (high - low) / field.shape[0]
    cell_area = 2.0 * 2.0 / 100  # [cm^2]
    for (x, y), patches in zip(1e3 * middles, expected, strict=True):
        column, row = int((x - left - 0.5) // pixel[0]), int((y - low - 0.5) // pixel[1])
        assert field[row, column] == pytest.approx(100 * patches / cell_area)
        assert field[row, int((x - left + 0.5) // pixel[0])] == field[row, column]
    shown = np.isfinite(field).sum() * pixel[0] * pixel[1]
    assert shown == pytest.approx(100 * cell_area * len(cells))
