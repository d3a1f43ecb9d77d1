"""A rig that gives way: springs in series, and what a pipeline is told of it."""

import numpy as np
import pytest
from palpate.errors import ConfigurationError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_simulation.series_compliance import motion_behind_spring
from palpate_simulation.skin_under_tip import SkinUnderTip

SHORT = ["trajectory.press.duration=3 s", 'run.tracks=["*/kinematic"]']


def specimen(root, **changes):
    sim = load_pipeline(root / "pipelines" / "filters.toml").devices["rig"]
    return sim.specimen.model_copy(update=changes)


def pushed(body, time, position, velocity):
    return SkinUnderTip(body, position).push(time, velocity)


def test_the_force_is_that_of_the_depth_that_is_left(root):
    body = specimen(root, surface=0.0)
    depth = np.linspace(-0.001, 0.005, 301)
    position = np.column_stack([0 * depth, 0 * depth, -depth])
    still, time = np.zeros_like(position), np.arange(len(depth)) * 1e-3
    stiff, soft = (pushed(body, time, *motion_behind_spring(body, time, position, still, k)) for k in (1e12, 2e4))
    np.testing.assert_allclose(stiff, pushed(body, time, position, still), atol=1e-6)
    left = position.copy()
    left[:, 2] += soft / 2e4
    np.testing.assert_allclose(soft, pushed(body, time, left, still), atol=1e-4)
    assert (soft <= stiff + 1e-9).all()
    assert soft[-1] < 0.95 * stiff[-1]


@pytest.mark.slow
def test_what_is_declared_tells_what_is_missing(root, tmp_path):
    """E is low by what the declared stiffness says, and the flag stands there."""
    sets = [*SHORT, "device.rig.series_stiffness=100 N/mm", "alignment.series_stiffness=100 N/mm"]
    result = run_pipeline(load_pipeline(root / "pipelines" / "filters.toml", sets), tmp_path / "soft")
    track = result.tracks["dr/kinematic"]
    found = track.parameters["elasticity"]
    assert found.value < 0.985 * 112.5e3
    assert "series-compliance" in {flag.code for flag in track.flags}
    assert abs(found.value - 112.5e3) < 2 * found.combined


@pytest.mark.slow
def test_what_remembers_is_refused(root):
    class Remembers:
        memory = True

    with pytest.raises(ConfigurationError, match="a specimen with memory cannot be behind a spring"):
        motion_behind_spring(specimen(root, model=Remembers()), np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), 1e4)
