"""A tool that is turned, on the simulated rig: the weight goes with it, and E is that of the normal."""

import math

import numpy as np
import pytest
from palpate.config import load_pipeline
from palpate.pipeline import run_pipeline
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
