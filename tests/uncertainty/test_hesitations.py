"""Point palpations on a busy computer: hesitations of the arm raise no flag, and the values are right."""

from dataclasses import replace

import numpy as np
import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_filters import ExtendedKalmanFilter
from palpate_uncertainty.identifiability import identifiability

from tests.hesitating import hesitate

PIPELINE = """
[device.rig]
type = "sim"
tip_mass = "{mass} g"
[device.rig.specimen]
model = "dr"
elasticity = "112.5 kPa"
viscosity = "362 Pa*s"
surface = "0.3 mm"
[trajectory.press]
type = "point"
bias = "4 mm"
amplitude = "1 mm"
frequency = "2 Hz"
duration = "8 s"
[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "0.3 ms" }}
position = "rig.tip.z"
velocity = {{ channel = "rig.twist.z", uncertainty = "0.3 ms" }}
measuring = "rig.setpoint.measuring"
tip_mass = "{mass} g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
thickness = "half-space"
[estimator.ekf]
type = "ekf"
start_depth = "4 mm"
start_depth_std = "0.5 mm"
first_guess = {{ elasticity = "100 kPa", viscosity = "300 Pa*s" }}
first_guess_std = {{ elasticity = "30 kPa", viscosity = "100 Pa*s" }}
[estimator.kinematic]
type = "kinematic-ekf"
[estimator.smoother]
type = "kinematic-smoother"
[estimator.fit]
type = "casadi-fit"
"""
JUDGED = {
    *("lack-of-fit", "too-stiff", "outliers", "coloured-innovations", "inconsistent", "correlated-residuals", "misfit"),
    "diagnosis-failed",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("held_up", "mass"),
    [
        *(((0.0, 1.0), 140), ((0.008, 1.0), 140), ((0.008, 2.5), 140), ((0.020, 1.0), 140), ((0.020, 2.5), 140)),
        *(((0.008, 2.5), 500), ((0.020, 1.0), 500)),
    ],
)
def test_a_hesitation_is_no_fault_of_the_model(tmp_path, monkeypatch, held_up, mass):
    file = tmp_path / "p.toml"
    file.write_text(PIPELINE.format(mass=mass))
    hesitate(monkeypatch, *held_up)
    result = run_pipeline(load_pipeline(file), tmp_path / "run")
    flags = {(str(name), flag.code) for name, track in result.tracks.items() for flag in track.flags}
    assert {flag for flag in flags if flag[1] in JUDGED} == set()
    elasticity = result.tracks["dr/fit"].parameters["elasticity"]
    assert abs(elasticity.value - 112.5e3) < 3 * elasticity.combined


def test_a_motion_that_hesitates_all_the_time_shows_nothing_of_the_uncertainty(evidence):
    """No sample of it is fitted: that is no parameter without an effect on the force."""
    point = evidence("clean", ExtendedKalmanFilter(start_from="fit"), mass=0.14)
    assert identifiability([point])
    late = 0.008 * (np.arange(len(point.kept.time)) // 20)
    held_up = replace(point, kept=replace(point.kept, time=point.kept.time + late))
    assert held_up.kept.hesitating.mean() > 0.99
    assert identifiability([held_up]) == {}
