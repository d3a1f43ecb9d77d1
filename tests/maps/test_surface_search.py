"""A search over a surface: on a level plane the flat one, on a tilted one that of its skin; what it refuses by name."""

import json
import math
import re

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_engine import load_pipeline
from palpate_maps.area_search import AreaSearch, SearchSettings
from palpate_maps.clearance import Clearance, PatchGrid
from palpate_maps.hidden_patches import EXPECTED, hidden_patches
from palpate_maps.map_analysis import Area, Proposal, area_of
from palpate_maps.search_actions import ActionGrid
from palpate_maps.search_motion import search_motion
from palpate_maps.search_skin import SearchSkin
from palpate_surfaces import HalfEllipsoid, Plane

from tests.maps.test_search import NODES, PATCH, Motion, everywhere_allowed, points

TILT = math.radians(45.0)


def over(surface):
    """An area on a surface."""
    found = surface.uppermost(NODES)
    skin = SearchSkin.at(surface, found, np.ones(len(NODES), bool))
    return Area(found.position, "the plate", everywhere_allowed, skin=skin)


@pytest.mark.parametrize("aim", ["find", "outline", "map"])
def test_on_a_level_plane_it_is_the_flat_search(aim):
    sites, found = points(3, 60, (0.012, -0.006)), []
    for area in (Area(NODES, "the plate", everywhere_allowed), over(Plane())):
        search = AreaSearch(area, Motion(6e-3), SearchSettings(aim, contrast=0.1))
        search.observe(sites, visited=True)
        found.append((search.next_round(), search.hiding.expected, search.lumps[0].lump.place))
    (flat, expected, place), (level, on_plane, above) = found
    assert [(each.place, each.end) for each in level] == [(each.place, each.end) for each in flat]
    np.testing.assert_allclose(on_plane, expected, rtol=1e-6)
    assert above == pytest.approx(place)


def test_what_may_hide_in_a_tilted_plane_is_what_may_hide_in_its_skin():
    """A plane of 45 degrees, laid level, is the same skin, longer by a root of 2 along x."""
    area, sites = over(Plane(tilt_x=TILT)), points(1, 40)
    longer = np.array([math.sqrt(2.0), 1.0])
    tilted = hidden_patches(points_at(sites, area.lift(sites.place)), area.nodes, PATCH)
    level = hidden_patches(points_at(sites, longer * sites.place), longer * NODES, PATCH)
    np.testing.assert_allclose(tilted.expected, level.expected, rtol=1e-6)
    assert tilted.risk > hidden_patches(sites, NODES, PATCH).risk


def points_at(sites, places):
    """The same sites elsewhere."""
    return type(sites)(places, sites.log, sites.std, sites.time, sites.standing)


def test_patches_are_expected_by_the_area_of_the_skin():
    body = over(HalfEllipsoid(half_axes=(0.05, 0.05, 0.05)))
    hiding = hidden_patches(points(0, 2)[:0], body.nodes, PATCH, extent=body.skin.stretch)
    assert hiding.expected.sum() == pytest.approx(EXPECTED)
    steep, top = np.argmin(body.skin.normal[:, 2]), np.argmax(body.skin.normal[:, 2])
    ratio = body.skin.normal[top, 2] / body.skin.normal[steep, 2]
    assert hiding.expected[steep] / hiding.expected[top] == pytest.approx(ratio)


def test_a_line_over_a_tilted_plane_gains_what_it_does_in_its_skin():
    longer = np.array([math.sqrt(2.0), 1.0]) * NODES
    row, expected = np.arange(21), np.full(len(NODES), EXPECTED / len(NODES))
    tilted, level = (
        Clearance.of(PatchGrid(nodes, PATCH), expected, 0.05, 0.008).lines(row)
        for nodes in (over(Plane(tilt_x=TILT)).nodes, longer)
    )
    np.testing.assert_allclose(tilted, level, rtol=1e-9)


def test_a_turn_of_the_tool_takes_its_time():
    """Of two points as far away, that where the normal is the same is sooner there."""
    body = HalfEllipsoid(half_axes=(0.05, 0.05, 0.05))
    area, motion = over(body), Motion(None, way_of_turn=0.05 / math.radians(8.0))
    turning = ActionGrid(area.nodes, motion, area.skin.normal)
    tip = area.nodes[0]
    seconds, plain = turning._travel(tip), ActionGrid(area.nodes, motion)._travel(tip)
    angle = np.arccos(np.clip(area.skin.normal @ area.skin.normal[0], -1.0, 1.0))
    far = angle > math.radians(20.0)
    np.testing.assert_allclose(seconds[far], 4.5 + angle[far] / math.radians(8.0), rtol=1e-6)
    assert (seconds[far] > plain[far]).all()
    assert seconds[0] == plain[0]


@pytest.fixture(scope="module")
def half_sphere(root):
    return load_pipeline(root / "pipelines" / "breast.toml", ['surface.breast.half_axes=["50 mm", "50 mm", "50 mm"]'])


def test_of_a_half_sphere_the_cap_of_60_degrees_is_searched(half_sphere):
    """Its area is half of that of the half sphere; what is steeper than 87 degrees, a twentieth, is not counted."""
    area = area_of(half_sphere, half_sphere.trajectories["points"], 0.02 * np.array([[-1.0, -1.0], [1.0, 1.0]]), None)
    assert area.skin.normal[:, 2].min() >= 0.5
    assert np.hypot(*area.nodes[:, :2].T).max() == pytest.approx(0.05 * math.sin(math.radians(60.0)), abs=1e-3)
    assert area.share == pytest.approx(0.5 / 0.95, abs=0.02)
    assert not area.allows(np.array([[0.048, 0.0], [0.2, 0.0]])).any()


def test_a_patch_too_wide_for_the_skin_is_refused(half_sphere):
    """Half of the radius of curvature, 25 mm, is twice the radius of the widest patch."""
    motion = search_motion(half_sphere, "run", 2.0)
    area = area_of(half_sphere, motion.own, np.zeros((1, 2)), None)
    AreaSearch(area, motion, SearchSettings(radius=12.4e-3))
    words = "--radius: 13 mm: .* radius of curvature of 50 mm, on which a search is for patches of up to 12 mm"
    with pytest.raises(ConfigurationError, match=words):
        AreaSearch(area, motion, SearchSettings(radius=13e-3))


def test_an_area_beside_the_skin_is_refused(half_sphere):
    motion = half_sphere.trajectories["points"]
    with pytest.raises(
        ConfigurationError, match=r"--area: 60 to 70 mm.*nothing in it may be palpated: .* off the ellipsoid"
    ):
        area_of(half_sphere, motion, np.zeros((1, 2)), (0.06, 0.07, 0.0, 0.01))


def test_visits_turn_as_fast_as_the_run(half_sphere):
    own = half_sphere.trajectories["points"].model_copy(update={"turn_speed": 0.05, "travel_speed": 0.02})
    pipeline = type(half_sphere)(**{**vars(half_sphere), "trajectories": {"points": own}})
    motion = search_motion(pipeline, "run", 2.0)
    visit = motion.along([Proposal((0.0, 0.0), 0.0, 0.0, 0.0), Proposal((0.02, 0.0), 0.0, 0.0, 0.0)])
    assert (visit.turn_speed, visit.travel_speed) == (0.05, 0.02)
    assert visit.followed is own.surface
    assert motion.way_of_turn == pytest.approx(0.4)
    assert motion.can_go([Proposal((0.0, 0.0), 0.0, 0.0, 0.0)])
    assert not motion.can_go([Proposal((0.0, 0.0), 0.0, 0.0, 0.0), Proposal((0.09, 0.0), 0.0, 0.0, 0.0)])


RASTER = """
[trajectory.lines]
type = "raster"
surface = "breast"
size = ["54 mm", "28 mm"]
pitch = "14 mm"
speed = "6 mm/s"
settle = "4 s"
press = { bias = "4 mm", amplitude = "1 mm", frequency = "3 Hz" }

"""


@pytest.mark.slow
def test_the_lumps_of_the_half_ellipsoid_are_found_by_search(root, tmp_path, palpate):
    """Three lines, then lines and points until no patch of 10 % remains with more than 5 %.

    Seeds 1 to 3 find the three, to within 2 mm; the fourth finds one more, 4.6 ± 3.5 % stiffer at p = 0.00015.
    """
    text = (root / "pipelines" / "breast.toml").read_text().replace("seed = 1\n", "seed = 2\n")
    text = text[: text.index("[trajectory.points]")] + RASTER + text[text.index("[alignment]") :]
    (tmp_path / "lines.toml").write_text(text)
    assert palpate("run", tmp_path / "lines.toml", "--out", tmp_path / "run").returncode == 0
    box = "-30 mm, 30 mm, -25 mm, 25 mm"
    done = palpate(
        *("map", "search", tmp_path / "run", "--go", "--risk", "0.05", "--contrast", "0.1"),
        *("--area", box, "--budget", "250", "--json"),
    )
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["stopped"].startswith("every lump is certain")
    assert answer["risk"] <= 0.05
    assert any(place["end"] for places in answer["rounds"] for place in places)
    lumps = np.array([each["lump"]["place"] for each in answer["lumps"] if each["certain"]])
    truth = np.array([[-0.02, -0.01], [0.012, 0.018], [0.025, -0.008]])
    assert len(lumps) == 3
    assert (np.linalg.norm(lumps[:, None] - truth, axis=2).min(axis=0) < 4e-3).all()
    heads = (tmp_path / "run" / "maps" / "hidden.csv").read_text().splitlines()
    assert heads[0] == "x_m,y_m,z_m,expected_patches"
    assert re.fullmatch(r"-?[\d.]+,-?[\d.]+,-0\.\d+,\S+", heads[1])
