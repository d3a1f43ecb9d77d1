"""The view of a map on a surface that turns: its numbers, and what it draws in a real Chromium."""

import base64
import io
import json
import math
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from matplotlib.image import imread
from palpate_engine import load_pipeline, run_pipeline
from palpate_kit.page.gate import page_files
from palpate_kit.runs.skin_grid import lump_shapes, read_lumps, skin_of_map, skin_over
from palpate_kit.runs.surface_map_file import SurfaceMap
from palpate_live.page_server import _FILES
from palpate_live.recorded_skin import skin_and_extent
from palpate_live.row_columns import describe_run
from palpate_maps.surface_map import make_surface_map
from palpate_surfaces import HalfEllipsoid

from tests.live_page.browser import CHROMIUM, browser
from tests.maps.test_surface_map import CENTRE, sites

BODY = HalfEllipsoid(half_axes=(0.06, 0.05, 0.04))
EXTENT = (-0.02, -0.01, -0.01), (0.02, 0.01, 0.005)
SCRIPT = (files("palpate_kit.page") / "static" / "skin.js").read_text(encoding="utf-8")
LUMP = {"x": CENTRE[0], "y": CENTRE[1], "extent": [0.008, 0.006], "z": -0.001}


def depth(x, y):
    """How far the body's skin is below its top [mm], at x and y [mm]."""
    return 40 * (math.sqrt(1 - (x / 60) ** 2 - (y / 50) ** 2) - 1)


@pytest.fixture(scope="module")
def skin():
    """A map on the body, with a lump."""
    made = make_surface_map(sites(), BODY, 1e-3, "elasticity", "Pa")
    return skin_of_map(made.map, [LUMP])


def test_a_skin_below_a_motion_is_the_surface_there():
    grid = skin_over(BODY, EXTENT)
    (x0, x1, columns), (y0, y1, lines) = grid["x"], grid["y"]
    assert (x0, x1, columns) == (-23.0, 23.0, 41)
    assert (y0, y1, lines) == (-13.0, 13.0, 24)
    assert len(grid["z"]) == columns * lines
    x, y = np.linspace(x0, x1, columns), np.linspace(y0, y1, lines)
    for line, column in ((0, 0), (11, 20), (23, 40), (5, 31)):
        assert grid["z"][line * columns + column] == pytest.approx(depth(x[column], y[line]), abs=0.006)
    wide = skin_over(BODY, ((-0.1, -0.01, 0.0), (0.1, 0.01, 0.0)))
    assert wide["z"][0] is None
    json.dumps(wide, allow_nan=False)


def test_a_map_is_its_skin_with_values_and_lumps(skin):
    columns, values = skin["x"][2], np.array([math.nan if v is None else v for v in skin["values"]])
    highest = int(np.nanargmax(values))
    x, y = (np.linspace(*skin[axis])[k] for axis, k in (("x", highest % columns), ("y", highest // columns)))
    assert (x, y) == pytest.approx(tuple(1e3 * CENTRE), abs=3.0)
    assert skin["z"][highest] == pytest.approx(depth(x, y), abs=0.006)
    assert skin["label"] == "elasticity, kPa"
    assert np.nanmin(values) <= skin["low"] < skin["high"] <= np.nanmax(values)
    assert skin["lumps"] == [[8.0, 3.0, 8.0, 6.0]]


def test_a_vertex_that_is_missing_is_null():
    place = np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 1e-3, 1e-3]])
    one = np.full(3, 5e4)
    found = skin_of_map(SurfaceMap(place, np.array([[0, 1, 2]]), one, one, one, "elasticity", "Pa"), [])
    assert found["z"] == [0.0, 0.0, 1.0, None]
    assert found["values"] == [50.0, 50.0, 50.0, None]


def test_vertices_a_few_micrometres_off_the_grid_have_their_columns_and_lines():
    """As points of a mesh have, at x and y of a grid of 1 mm."""
    made = make_surface_map(sites(), BODY, 1e-3, "elasticity", "Pa").map
    exact = skin_of_map(made, [])
    off = 2e-6 * np.random.default_rng(0).standard_normal(made.vertices.shape)
    found = skin_of_map(replace(made, vertices=made.vertices + off), [])
    assert [axis[2] for axis in (found["x"], found["y"])] == [axis[2] for axis in (exact["x"], exact["y"])]
    assert found["values"] == exact["values"]


def test_lumps_of_a_run_are_those_of_its_file(tmp_path):
    assert read_lumps(tmp_path) == []
    (tmp_path / "lumps.json").write_text(json.dumps({"lumps": [LUMP]}))
    assert lump_shapes(read_lumps(tmp_path)) == [[8.0, 3.0, 8.0, 6.0]]
    (tmp_path / "lumps.json").write_text("{")
    assert read_lumps(tmp_path) == []


def test_a_run_over_a_surface_tells_its_skin(a_run):
    told = describe_run(a_run(extent=EXTENT, surface=BODY), recorded=False)
    assert told["skin"] == skin_over(BODY, EXTENT)
    assert len(json.dumps(told)) < 32_000  # one datagram
    assert describe_run(a_run(extent=EXTENT), recorded=False)["skin"] is None
    assert describe_run(a_run(surface=BODY), recorded=False)["skin"] is None


@pytest.mark.slow
def test_a_recorded_run_has_the_skin_that_it_palpated(root, tmp_path):
    text = (root / "pipelines" / "breast.toml").read_text()
    text = text.replace('size = ["66 mm", "54 mm"]', 'places = [["-10 mm", "5 mm"], ["10 mm", "15 mm"]]')
    (tmp_path / "two.toml").write_text(text.replace('pitch = "6 mm"\n', ""))
    run_pipeline(load_pipeline(tmp_path / "two.toml"), tmp_path / "run")
    surface, (low, high) = skin_and_extent(tmp_path / "run")
    assert isinstance(surface, HalfEllipsoid)
    assert surface.half_axes == (0.06, 0.05, 0.04)
    assert low[:2] == pytest.approx((-0.01, 0.005), abs=1.5e-3)
    assert high[:2] == pytest.approx((0.01, 0.015), abs=1.5e-3)
    assert skin_and_extent(tmp_path) == (None, None)


def test_the_page_is_below_250_kilobytes():
    assert sum(len(file.read_bytes()) for file in _FILES.values()) < 250_000
    assert "skin.js" in page_files("palpate_live", ("index.html",))


PAGE = """<!doctype html><canvas id="skin" style="width: 560px"></canvas>
<script type="application/json" id="data">{data}</script>
<script type="module">{script}
const data = JSON.parse(document.getElementById("data").textContent);
const view = new SkinView(document.getElementById("skin"));
Object.assign(window, {{ data, view, meansOnSkin }});
view.show(data, data);
</script>"""


def pixels(tab):
    """The picture (rows, columns, 4), once it is drawn."""
    tab.ask("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    picture = tab.ask("document.getElementById('skin').toDataURL('image/png').split(',')[1]")
    return np.rint(255 * imread(io.BytesIO(base64.b64decode(picture)))).astype(np.uint8)


def colours(picture, colour):
    """How many pixels have a colour."""
    return int(np.all(np.abs(picture[..., :3].astype(int) - colour) < 8, axis=-1).sum())


YELLOW, LUMPS = (253, 231, 37), (208, 28, 28)


@pytest.mark.live
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
def test_it_turns_by_keys_and_mouse_and_shows_lumps_and_legend(skin, tmp_path):
    (tmp_path / "page.html").write_text(PAGE.format(data=json.dumps(skin), script=SCRIPT))
    with browser(700, 700) as chromium:
        tab = chromium.open((tmp_path / "page.html").as_uri())
        label = tab.until("document.getElementById('skin')?.getAttribute('aria-label')")
        assert label.startswith("Map on the surface, elasticity, kPa from ")
        assert "1 lumps outlined. The arrow keys turn it" in label
        first = pixels(tab)
        legend = first[735:745, 40:560, :3]
        assert np.abs(legend[5, 2].astype(int) - (68, 1, 84)).max() < 12
        assert np.abs(legend[5, -3].astype(int) - YELLOW).max() < 12
        assert colours(first[:690], LUMPS) > 200
        assert colours(first[:690], YELLOW) > 100
        tab.ask("document.getElementById('skin').focus()")
        tab.key("ArrowRight")
        turned = pixels(tab)
        assert (turned[:690] != first[:690]).any()
        np.testing.assert_array_equal(turned[730:752, 40:560], first[730:752, 40:560])
        tab.key("Home")
        np.testing.assert_array_equal(pixels(tab), first)
        x, y = tab.place("skin")
        for kind, at in (("mousePressed", x), ("mouseMoved", x + 60), ("mouseReleased", x + 60)):
            tab.call("Input.dispatchMouseEvent", type=kind, x=at, y=y, button="left", buttons=1, clickCount=1)
        assert tab.ask("view.azimuth") == pytest.approx(-0.5 + 60 / 120, abs=0.02)
        tab.ask("view.elevation = -1.2; view.draw()")
        below = pixels(tab)
        assert colours(below[:690], LUMPS) == 0  # they are on the other side
        assert colours(below[:690], (227, 232, 235)) > 10_000  # as is the skin's outside
        picture = tab.ask("view.elevation = Math.PI / 2; view.azimuth = 0; view.draw(); view.onCanvas([8, 3, 0])")
        from_above = pixels(tab)
        rows, columns_ = np.nonzero(np.all(np.abs(from_above[:690, :, :3].astype(int) - LUMPS) < 8, axis=-1))
        assert (columns_.mean(), rows.mean()) == pytest.approx(picture, abs=4.0)


@pytest.mark.live
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
def test_estimates_are_where_the_tip_touches(skin, tmp_path):
    """Tips 4 mm below the skin along its normal: their values are at the nodes over them, aside of their ends."""
    grid = skin_over(BODY, ((-0.02, -0.02, 0.0), (0.02, 0.02, 0.0)))
    nodes = [(20, 20), (4, 36), (36, 8)]
    axes = [np.linspace(*grid[axis]) for axis in "xy"]
    feet = BODY.uppermost(1e-3 * np.array([[axes[0][i], axes[1][j]] for i, j in nodes]))
    tips = feet.position - 4e-3 * feet.normal
    assert np.linalg.norm((tips - feet.position)[1:, :2], axis=1).min() > 1e-3
    rows = [[*tip[:2].tolist(), -4e-3, 10.0 * (k + 1)] for k, tip in enumerate(tips)]
    (tmp_path / "page.html").write_text(PAGE.format(data=json.dumps(skin), script=SCRIPT))
    with browser(700, 700) as chromium:
        tab = chromium.open((tmp_path / "page.html").as_uri())
        tab.until("window.meansOnSkin && 1")
        means = tab.ask(f"meansOnSkin({json.dumps(grid)}, (i) => {json.dumps(rows)}[i], 3)")
    assert {k: v for k, v in enumerate(means) if v is not None} == {
        j * grid["x"][2] + i: 10.0 * (k + 1) for k, (i, j) in enumerate(nodes)
    }
