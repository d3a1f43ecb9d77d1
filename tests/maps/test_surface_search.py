"""A search over a surface: on a level plane the flat one, on a tilted one that of its skin; what it refuses by name."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_engine import load_pipeline
from palpate_maps.area_search import AreaSearch, SearchSettings
from palpate_maps.clearance import Clearance, PatchGrid
from palpate_maps.hidden_patches import EXPECTED, hidden_patches
from palpate_maps.lump_criteria import Lump
from palpate_maps.map_analysis import Proposal, area_of
from palpate_maps.search_actions import ActionGrid
from palpate_maps.search_motion import search_motion
from palpate_maps.search_progress import LumpProgress
from palpate_surfaces import HalfEllipsoid, Mesh, Plane, TouchedSurface
from scipy.spatial import KDTree

from tests.maps.grids import plate, skin_over
from tests.maps.test_search import NODES, PATCH, Motion, points
from tests.surfaces.bodies import ellipsoid, half, sheet, write_body

TILT = math.radians(45.0)
HALF_AXES = (0.06, 0.05, 0.04)  # [m]


def over(surface):
    """An area on a surface."""
    return skin_over(surface, NODES)


@pytest.mark.parametrize("aim", ["find", "outline", "map"])
def test_on_a_level_plane_it_is_the_flat_search(aim):
    sites, found = points(3, 60, (0.012, -0.006)), []
    for area in (plate(NODES), over(Plane())):
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


def bowl(folder):
    """A hollow of triangles, with radii of curvature of 80 and 60 mm, as a file."""
    vertices, faces = sheet(0.1, 41)
    vertices[:, 2] = vertices[:, 0] ** 2 / 0.16 + vertices[:, 1] ** 2 / 0.12
    return write_body(folder / "bowl.obj", vertices, faces)


def dome(folder):
    """Half an ellipsoid of triangles, as a file."""
    return write_body(folder / "dome.obj", *half(*ellipsoid(4, np.array(HALF_AXES))))


def touches_of(folder):
    """Touches of half an ellipsoid, 6 mm apart, as a table."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-36, 37, 6), np.arange(-30, 31, 6)))
    inside = (x / 45) ** 2 + (y / 38) ** 2 < 1
    body = HalfEllipsoid(half_axes=HALF_AXES).uppermost(1e-3 * np.column_stack([x, y])[inside])
    rows = [",".join(f"{1e3 * value:.6f}" for value in place) + ",0.1" for place in body.position]
    file = folder / "touches.csv"
    file.write_text("\n".join(["x [mm],y [mm],z [mm],u [mm]", *rows]) + "\n")
    return file


SURFACES = {
    "plane": lambda folder: Plane(),
    "half ellipsoid": lambda folder: HalfEllipsoid(half_axes=HALF_AXES),
    "bowl of triangles": lambda folder: Mesh(file=bowl(folder)),
    "dome of triangles": lambda folder: Mesh(file=dome(folder), position=(0.0, 0.0, -0.04), rotation=(0.0, 0.0, 0.1)),
    "touched": lambda folder: TouchedSurface(touches=(touches_of(folder),)),
}


@pytest.fixture(scope="module", params=SURFACES)
def curved(request, tmp_path_factory):
    """An area on one of the surfaces."""
    return over(SURFACES[request.param](tmp_path_factory.mktemp("surface")))


def test_every_part_of_a_surface_is_searched(curved):
    """Places at which a patch may hide are as close to each other as on a plane, or as the steepest skin asks for."""
    search = AreaSearch(curved, Motion(6e-3), SearchSettings(contrast=0.1))
    away, _ = KDTree(search.middles).query(curved.nodes)
    assert away.max() < 0.6 * search.settings.radius
    rows, columns = (len(np.unique(along)) for along in search.cells.T)
    assert len(search.middles) == rows * columns
    assert len(ActionGrid(search.middles, search.cells, Motion(6e-3))._rows) == rows + columns


def test_a_patch_that_nobody_was_near_is_as_likely_as_before(curved):
    """Sites to the left of the middle, and a lump to the right: what remains is what was expected there beforehand."""
    area = curved
    left, lump = NODES[NODES[:, 0] < -0.004], area.lift(np.array([[0.02, 0.005]]))
    sites = points(3, 90, where=left)
    search = AreaSearch(area, Motion(6e-3), SearchSettings(contrast=0.1, risk=0.05))
    before = hidden_patches(sites[:0], search.middles, PATCH, extent=search._extent)
    rise = 5.0 * PATCH.profile(area.lift(sites.place), lump)[:, 0]
    search.observe(replace(sites, log=sites.log + rise), visited=False)
    far = KDTree(area.lift(sites.place)).query(search.middles)[0] > 2.0 * PATCH.radius
    assert far.mean() > 0.2
    assert (search.hiding.expected[far] > (1.0 - 1e-9) * before.expected[far]).all()
    assert search.hiding.risk > 1.0 - np.exp(-(1.0 - 1e-9) * before.expected[far].sum())
    assert search.ended() is None
    assert search.next_round()


def test_a_wide_lump_clears_no_place_that_nobody_was_near(curved):
    """The flank of a lump is as wide as its extent, of which only a part was palpated."""
    search = AreaSearch(curved, Motion(6e-3), SearchSettings(contrast=0.1, risk=0.05))
    left = NODES[NODES[:, 0] < -0.02]
    sites = points(3, 40, where=left)
    search.observe(sites, visited=False)
    wide = Lump((-0.02, 0.0), (0.1, 0.1), 0.3, 0.01, 1e-9)
    search.lumps = [LumpProgress(wide, certain=True, beyond=False, cut=False)]
    far = KDTree(curved.lift(sites.place)).query(search.middles)[0] > 2.0 * PATCH.radius
    assert not search._on_lumps(search.middles)[far].any()
    assert search._on_lumps(search.middles)[~far].any()


@pytest.mark.parametrize("name", ["half ellipsoid", "touched"])
def test_the_middle_of_a_lump_may_lie_beyond_what_is_known(name, tmp_path):
    """A fit places the middle of a half seen lump outside of the touches: it is as high as the skin next to it."""
    area = over(SURFACES[name](tmp_path))
    outside, inside = np.array([[0.09, 0.0]]), np.array([[0.01, 0.0]])
    assert area.skin.surface.uppermost(outside).unknown
    lifted = area.lift(np.vstack([outside, inside]))
    nearest = area.nodes[np.argmin(np.linalg.norm(area.nodes[:, :2] - outside, axis=1))]
    assert lifted[0].tolist() == [*outside[0], nearest[2]]
    assert lifted[1].tolist() == area.skin.surface.uppermost(inside).position[0].tolist()


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
    turning = ActionGrid(area.nodes, area.cells, motion, area.skin.normal)
    tip = area.nodes[0]
    seconds, plain = turning._travel(tip), ActionGrid(area.nodes, area.cells, motion)._travel(tip)
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


BOWL = """
[surface.breast]
type = "mesh"
file = "bowl.obj"
position_uncertainty = "0.3 mm"
rotation_uncertainty = "1 deg"

"""
LUMP = '    { shape = "sphere", place = ["5 mm", "25 mm"], radius = "6 mm", depth = "3 mm", peak = 0.5 },\n]\n\n'


@pytest.mark.slow
def test_a_lump_outside_of_the_lines_in_a_bowl_of_triangles_is_found(root, tmp_path, palpate):
    """Two lines 14 mm apart, a lump of 50 % 18 mm off the nearer one, and a search of 60 x 60 mm about both.

    One of some thousand nodes was searched: "no lump was found", a patch remained with 0.012 %, and nothing moved.
    """
    text = (root / "pipelines" / "breast.toml").read_text()
    text = text[: text.index("[surface.breast]")] + BOWL + text[text.index("[device.rig]") :]
    text = text[: text.index("inclusions = [") + 15] + LUMP + RASTER + text[text.index("[alignment]") :]
    (tmp_path / "lines.toml").write_text(text.replace('["54 mm", "28 mm"]', '["54 mm", "14 mm"]'))
    bowl(tmp_path)
    assert palpate("run", "lines.toml", "--out", "run").returncode == 0
    search = "map", "search", "run", "--risk", "0.05", "--contrast", "0.1", "--area", "-30 mm, 30 mm, -30 mm, 30 mm"
    before = json.loads(palpate(*search, "--json").stdout)
    assert 0.3 < before["risk"] < 0.8  # half of the area is far from both lines, and 1.5 patches were expected in it
    assert before["lumps"] == []
    done = palpate(*search, "--go", "--budget", "20", "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["stopped"] == "20 s of motion are spent"
    assert answer["risk"] > 0.05
    (lump,) = answer["lumps"]
    assert lump["lump"]["place"] == pytest.approx([5e-3, 25e-3], abs=4e-3)
    assert lump["lump"]["p"] < 1e-6
