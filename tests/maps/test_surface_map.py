"""Maps on a surface: those of the plane are the flat ones, lumps are where they are, and files say what was found."""

import base64
import hashlib
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from palpate import ConfigurationError, LogError, OutputError
from palpate_engine import load_pipeline, run_pipeline
from palpate_kit.figures import save_figure
from palpate_kit.runs.skin_places import skin_places, surface_of_run
from palpate_kit.runs.surface_map_figure import surface_map_figure
from palpate_kit.runs.surface_map_file import read_surface_map, write_surface_map
from palpate_maps.lumps import find_lumps
from palpate_maps.map_grid import make_map
from palpate_maps.sites import Sites
from palpate_maps.surface_map import make_surface_map, sites_on, surface_map_csv
from palpate_surfaces import HalfEllipsoid, Mesh, Plane

from tests.surfaces.bodies import ellipsoid, half, write_body

CENTRE = np.array([0.008, 0.003])  # of the lump


def sites(lump=0.3, seed=0):
    """Palpations on a grid, of a material with a lump."""
    rng = np.random.default_rng(seed)
    axis = np.linspace(-0.016, 0.016, 9)
    place = np.stack(np.meshgrid(axis, 0.8 * axis), axis=-1).reshape(-1, 2)
    contrast = lump * np.exp(-((place - CENTRE) ** 2).sum(axis=1) / (2 * 0.004**2))
    log = math.log(1e5) + np.log1p(contrast) + rng.normal(0.0, 0.01, len(place))
    count = len(place)
    return Sites(place, log, np.full(count, 0.005), np.arange(count) * 5.0, np.ones(count, bool))


@pytest.fixture(scope="module")
def breast(tmp_path_factory):
    file = write_body(tmp_path_factory.mktemp("breast") / "breast.stl", *half(*ellipsoid(3)))
    return Mesh(file=file, position=(0.0, 0.0, -0.04))


@pytest.fixture(scope="module")
def made(breast):
    return make_surface_map(sites(), breast, 4e-3, "elasticity", "Pa")


def test_on_a_level_plane_it_is_the_flat_map():
    flat, level = make_map(sites(), 4e-3), make_surface_map(sites(), Plane(), 4e-3, "elasticity", "Pa")
    at = [np.searchsorted(axis, level.map.vertices[:, i] - 1e-6) for i, axis in enumerate((flat.x, flat.y))]
    rows = at[1], at[0]
    np.testing.assert_allclose(level.map.value, flat.value[rows], rtol=1e-9)
    np.testing.assert_allclose(level.map.std, flat.std[rows], rtol=1e-6)
    np.testing.assert_allclose(level.map.p, flat.p[rows], rtol=1e-6)
    assert (level.stiff == flat.stiff[rows]).all()
    assert level.warning is None
    assert level.length == pytest.approx(flat.length)


def test_a_plane_that_stands_oblique_is_the_same_map_stretched():
    """Sites on a plane of 45 degrees are farther apart, by the factor of its slope, and so is all that is found."""
    turned = sites_on(sites(), Plane(tilt_x=math.radians(45.0)))
    assert np.ptp(turned.place[:, 2]) == pytest.approx(0.032)
    (lump,) = find_lumps(turned).lumps
    assert lump.height == pytest.approx(lump.place[0], abs=1e-12)


@pytest.mark.slow
def test_its_vertices_lie_on_the_body_and_look_outwards(made, breast):
    shown = made.map
    own = shown.vertices + np.array([0.0, 0.0, 0.04])
    np.testing.assert_allclose(((own / [0.03, 0.025, 0.04]) ** 2).sum(axis=1), 1.0, atol=2e-3)
    corners = shown.vertices[shown.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[:, 2] > 0).all()
    assert len(np.unique(shown.faces)) == len(shown.vertices)


def test_the_lump_is_where_it_is_with_its_p_value(made):
    stiffest = made.map.vertices[np.argmax(made.map.value)]
    assert np.linalg.norm(stiffest[:2] - CENTRE) < 3e-3
    near = np.linalg.norm(made.map.vertices[:, :2] - CENTRE, axis=1) < 3e-3
    assert (made.map.p[near] < 1e-3).all()
    assert made.stiff[near].all()
    assert not made.stiff[np.linalg.norm(made.map.vertices[:, :2] - CENTRE, axis=1) > 0.015].any()


@pytest.mark.slow
def test_lumps_on_the_body_have_a_height(breast):
    (lump,) = find_lumps(sites_on(sites(), breast)).lumps
    assert math.dist(lump.place, CENTRE) < 3e-3
    assert lump.height == pytest.approx(0.04 * (math.sqrt(1 - (8 / 30) ** 2 - (3 / 25) ** 2) - 1), abs=2e-3)
    assert not find_lumps(sites_on(sites(lump=0.0), breast)).lumps


def test_distances_that_are_too_long_are_said(made):
    """Half of the smallest radius of the body's top, which is the one across its short side."""
    assert made.reach == pytest.approx(0.5 * 0.025**2 / 0.04, rel=0.2)
    assert replace(made, length=0.9 * made.reach).warning is None
    assert "interpolated over 20 mm by straight distances" in replace(made, length=0.02).warning


def test_a_site_beside_the_body_is_refused(breast):
    beside = sites()
    beside.place[4] = [0.05, 0.0]
    with pytest.raises(ConfigurationError, match=r"place 5 of 81 \(x 50.0, y 0.0 mm\): no mesh"):
        sites_on(beside, breast)


def test_few_sites_and_fine_cells_are_refused(breast):
    with pytest.raises(LogError, match="3 sites are too few for a map"):
        make_surface_map(sites()[:3], breast, 2e-3, "elasticity", "Pa")
    with pytest.raises(ConfigurationError, match="cells; 250000 are allowed"):
        make_surface_map(sites(), breast, 1e-5, "elasticity", "Pa")


def test_the_file_is_read_back_and_by_others(made, tmp_path):
    import trimesh

    file = tmp_path / "map.ply"
    file.write_bytes(write_surface_map(made.map))
    again = read_surface_map(file)
    for key in ("vertices", "faces", "value", "std", "p"):
        np.testing.assert_array_equal(getattr(again, key), getattr(made.map, key))
    assert (again.parameter, again.unit) == ("elasticity", "Pa")
    other = trimesh.load_mesh(file, process=False)
    np.testing.assert_allclose(other.vertices, made.map.vertices)
    assert other.visual.vertex_colors.shape == (len(made.map.vertices), 4)
    raw = other.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(np.ravel(raw["elasticity_std"]), made.map.std)


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[:-7],
        lambda data: b"",
        lambda data: data.replace(b"property double p\n", b""),
        lambda data: data[:-4] + b"\xff\xff\xff\x7f",
        lambda data: data.replace(b"element vertex", b"element edge"),
    ],
)
def test_damaged_files_are_named(made, tmp_path, damage):
    file = tmp_path / "map.ply"
    file.write_bytes(damage(write_surface_map(made.map)))
    with pytest.raises(LogError, match=r"map\.ply: is not a map of a surface, or a damaged one"):
        read_surface_map(file)
    with pytest.raises(LogError, match="cannot be read"):
        read_surface_map(tmp_path / "no.ply")


@pytest.mark.slow
def test_the_table_and_the_picture(made, tmp_path):
    rows = surface_map_csv(made).splitlines()
    assert rows[0] == "x_m,y_m,z_m,elasticity,elasticity_std,p,stiff"
    assert len(rows) == len(made.map.vertices) + 1
    figure = surface_map_figure(made.map, made.map.vertices, [(0.0, 0.0, 0.0, 2e-5)])
    assert [text.get_text() for text in figure.axes[0].texts] == ["1: p 2e-05"]
    titles = [axis.get_title(loc="left") or axis.get_title() for axis in figure.axes[:3]]
    assert titles == ["from above", "from the front", "from the right"]
    save_figure(figure, tmp_path / "map.png")
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(OutputError):
        save_figure(figure, tmp_path / "map.bmp")


@pytest.fixture(scope="module")
def grid_run(root, breast, tmp_path_factory):
    """A grid of points over a lump, in a pipeline with a surface."""
    folder = tmp_path_factory.mktemp("grid")
    head, rest = (root / "pipelines" / "points.toml").read_text().split("[trajectory.points]")
    motion = (
        '[trajectory.points]\ntype = "grid-points"\nsize = ["24 mm", "24 mm"]\npitch = "4 mm"\nduration = "1.5 s"\n'
        'press = { bias = "4 mm", amplitude = "1 mm", frequency = "2 Hz" }\n'
        '[[device.rig.specimen.inclusions]]\nshape = "sphere"\nplace = ["5 mm", "3 mm"]\n'
        f'[surface.breast]\ntype = "mesh"\nfile = "{breast.file}"\nposition = ["0 mm", "0 mm", "-40 mm"]\n\n'
    )
    head = head.replace('relief = { roughness = "0.05 mm", length = "10 mm", tilt_y = "0.3 deg" }', "")
    (folder / "grid.toml").write_text(head + motion + rest[rest.index("[alignment]") :])
    run_pipeline(load_pipeline(folder / "grid.toml"), folder / "run")
    return folder / "run"


@pytest.mark.slow
def test_the_commands_map_a_run_on_its_surface(grid_run, palpate, tmp_path):
    done = palpate("map", grid_run, "--cell", "2 mm", "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["kind"] == "surface"
    assert {name.rpartition(".")[2] for name in answer["files"]} == {"csv", "ply", "png"}
    found = json.loads(palpate("map", "lumps", grid_run, "--json").stdout)
    assert [(lump["x"], lump["y"]) for lump in found["lumps"]] == [pytest.approx((0.005, 0.003), abs=3e-3)]
    assert found["lumps"][0]["z"] < 0
    done = palpate("plot", grid_run, "map", "-o", tmp_path / "plots")
    assert "The map of palpate map on the surface" in done.stdout
    assert palpate("report", grid_run).returncode == 0
    page = (grid_run / "report.html").read_text()
    assert "on the surface" in page
    (script,) = re.findall(r'<script type="module">(.*?)</script>', page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"img-src data:; script-src 'sha256-{digest}'\">" in page  # no other script may run
    assert '<figure id="turning" hidden>' in page  # without scripts the picture from three sides stays
    (data,) = re.findall(r'<script type="application/json" id="skin-data">(.*?)</script>', page, re.DOTALL)
    skin = json.loads(data)
    assert len(skin["z"]) == len(skin["values"]) == skin["x"][2] * skin["y"][2]
    assert len(skin["lumps"]) == 1
    assert "http" not in script + data


@pytest.mark.slow
def test_a_surface_that_the_run_does_not_have_is_refused(grid_run, palpate):
    done = palpate("map", grid_run, "--surface", "brest")
    assert done.returncode == 2
    assert "it has no surface 'brest' (there are: breast)" in done.stderr
    done = palpate("map", grid_run, "--method", "average")
    assert done.returncode == 2
    assert "a map on a surface is a Gaussian process, in a PLY file" in done.stderr


def test_the_place_that_is_pressed_is_not_that_of_the_tip():
    """A tip 5 mm below a half ellipsoid along its normal is up to 3 mm aside of the place that it came from."""
    body = HalfEllipsoid(half_axes=(0.06, 0.05, 0.04))
    lateral = np.random.default_rng(4).uniform(-0.03, 0.03, (300, 2))
    skin, height = body.uppermost(lateral), np.linspace(-0.006, 0.002, 300)
    tip = (skin.position + height[:, None] * skin.normal)[:, :2]
    assert np.linalg.norm(tip - lateral, axis=1).max() > 2e-3
    np.testing.assert_allclose(skin_places(body, tip, height), lateral, atol=0.1e-3)
    beside = skin_places(body, np.array([[0.09, 0.0]]), np.array([-0.005]))
    np.testing.assert_array_equal(beside, [[0.09, 0.0]])


def test_of_several_surfaces_a_map_takes_the_one_that_the_run_was_aligned_along(root, tmp_path):
    text = (root / "pipelines" / "breast.toml").read_text() + '\n[surface.table]\ntype = "plane"\n'
    (tmp_path / "pipeline.toml").write_text(text)
    assert isinstance(surface_of_run(tmp_path), HalfEllipsoid)
    assert isinstance(surface_of_run(tmp_path, "table"), Plane)
    aligned = 'surface = "breast"                     # force and motion along the normal\n'
    (tmp_path / "pipeline.toml").write_text(text.replace(aligned, "").replace('weight = "turning"\n', ""))
    with pytest.raises(ConfigurationError, match=r"choose one of its surfaces \(there are: breast, table\)"):
        surface_of_run(tmp_path)
