"""A tool that is turned, on the simulated rig: the weight goes with it, and E is that of the normal."""

import math

import numpy as np
import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_trajectories.stay import Stay

from tests.simulation.test_sim import QUIET, readings, rig

ABOVE = Stay(height=0.02, duration=0.5)


def test_a_tool_of_140_g_that_is_turned_by_20_degrees_weighs_0_08_n_less_along_and_0_47_n_across():
    level, turned = (
        readings(rig(tip_mass=0.14, tool_rotation=(0.0, angle, 0.0), **QUIET), ABOVE)["wrench"][1][0, :3]
        for angle in (0.0, math.radians(20.0))
    )
    assert level == pytest.approx([0.0, 0.0, -0.14 * 9.80665])
    assert turned - level == pytest.approx([-0.4696, 0.0, 0.0828], abs=1e-4)


@pytest.mark.parametrize("down", [(0.0, 0.0, -1.0), (0.6, 0.0, -0.8), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)])
@pytest.mark.parametrize("mounting", [None, (0.3, -0.2, 1.0)])
def test_a_tool_that_is_turned_for_a_calibration_has_gravity_where_it_is_said(down, mounting):
    wrench = readings(rig(tip_mass=0.2, mounting=mounting, **QUIET).turned(down), ABOVE)["wrench"][1][0, :3]
    assert wrench == pytest.approx(0.2 * 9.80665 * np.array(down), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("tool", [0.0, 20.0])
def test_elasticity_is_that_of_the_normal_on_a_skin_that_is_inclined(root, tmp_path, friction, tool):
    """A skin at 20 degrees, pressed straight down: -14 % by one axis and without friction."""
    normal = [-math.sin(math.radians(20)), 0.0, math.cos(math.radians(20))]
    sets = [
        'device.rig.specimen.relief={ tilt_x = "20 deg" }',
        f"device.rig.specimen.friction={friction}",
        f'device.rig.tool_rotation=["0 deg", "{tool} deg", "0 deg"]',
        "alignment.weight=turning",
        f"alignment.normal={normal}",
    ]
    result = run_pipeline(load_pipeline(root / "pipelines" / "point.toml", sets), tmp_path / "run")
    (track,) = result.tracks.values()
    found = track.parameters["elasticity"]
    assert abs(found.value - 112.5e3) < 2.0 * found.combined
    assert found.value == pytest.approx(112.5e3, rel=0.006)
    assert "systematic_normal" in found.table()
    assert not {"inclined-skin", "turned-weight"} & {flag.code for flag in track.flags}


ON_DOME = """
[surface.skin]
type = "mesh-free-dome"

[trajectory.press]
type = "{motion}"
surface = "skin"
{keys}

[safety]
low = ["-45 mm", "-45 mm", "-45 mm"]
high = ["45 mm", "45 mm", "30 mm"]
force = "30 N"
stop_force = "12 N"
stiffness = "5 N/mm"
depth = "6 mm"
"""
GRID = 'size = ["50 mm", "50 mm"]\npitch = "25 mm"\npress = { bias = "3 mm" }'
SWEEP = (
    'start = ["-15 mm", "5 mm"]\nend = ["20 mm", "5 mm"]\nspeed = "4 mm/s"\nsettle = "2 s"\npress = { bias = "3 mm" }'
)


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "keys"), [("grid-points", GRID), ("line-sweep", SWEEP)])
@pytest.mark.parametrize("skin", [False, True])
def test_elasticity_over_a_dome_is_that_of_its_curvature(root, tmp_path, motion, keys, skin):
    """A cap of 90 degrees, R_s 50 mm under a sphere of 5 mm, by its surface or as the model states it."""
    from tests.devices.test_stations import DOME

    (tmp_path / "dome.py").write_text(DOME.replace('{"dome"', '{"mesh-free-dome"').replace("gt=0,", "default=0.05,"))
    text = (root / "pipelines" / "point.toml").read_text()
    begin, end = text.index("[trajectory.press]"), text.index("[alignment]")
    table = 'surface = "skin"\nweight = "turning"\nlateral_x = "rig.tip.x"\nlateral_y = "rig.tip.y"\nforce = {'
    text = text[:begin] + ON_DOME.format(motion=motion, keys=keys) + text[end:].replace("force = {", table, 1)
    text = text.replace("seed = 1", 'seed = 1\nplugins = ["dome.py"]')
    (tmp_path / "dome.toml").write_text(text)
    sets = ['device.rig.specimen.relief={ radius_x = "50 mm", radius_y = "50 mm" }']
    sets += ['model.dr.skin={ skin_radius = "50 mm" }'] if skin else []
    result = run_pipeline(load_pipeline(tmp_path / "dome.toml", sets), tmp_path / "run")
    (track,) = result.tracks.values()
    found = track.parameters["elasticity"]
    assert found.value / 112.5e3 == pytest.approx(1.0, abs=0.006)
    assert abs(found.value - 112.5e3) < 2.0 * found.combined
    assert ("systematic_curvature" in found.table()) is not skin
    assert not {"turned-weight", "turned-tool"} & {flag.code for flag in track.flags}
