"""A ramp and a long hold on a spring and a dashpot: a filter that knows the ramp is good, one that does not says so."""

import numpy as np
import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

STIFFNESS, DAMPING, MASS = 800.0, 12.0, 0.14  # [N/m], [N s/m], [kg]
PIPELINE = """
[device.log]
type = "csv-replay"
file = "record.csv"
time = { column = "time (s)", unit = "s" }
[device.log.columns]
force = { column = "force (N)", unit = "N" }
height = { column = "height (mm)", unit = "mm" }
velocity = { column = "velocity (mm/s)", unit = "mm/s" }
[alignment]
force = { channel = "log.force", uncertainty = "0.1 ms" }
position = "log.height"
velocity = { channel = "log.velocity", uncertainty = "0.1 ms" }
tip_mass = "140 g"
[model.kv]
type = "kelvin-voigt"
[estimator.ekf]
type = "ekf"
[estimator.ukf]
type = "ukf"
[estimator.afekf]
type = "afekf"
[estimator.afukf]
type = "afukf"
[estimator.kinematic]
type = "kinematic-ekf"
[estimator.fit]
type = "casadi-fit"
"""


def write(path, seed):
    """A second of air, 4 mm deep at 5 mm/s, and a hold until 10 s."""
    random, step = np.random.default_rng(seed), 2e-3
    time = np.arange(0.0, 10.0, step)
    height = 2e-3 - np.clip((time - 1.0) * 5e-3, 0.0, 6e-3)
    for _ in range(2):
        height = np.convolve(np.pad(height, 25, mode="edge"), np.full(25, 0.04), "same")[25:-25]
    velocity = np.gradient(height, step)
    force = np.where(height < 0, np.maximum(-STIFFNESS * height - DAMPING * velocity, 0.0), 0.0)
    force = force - MASS * np.gradient(velocity, step) + 0.02 * random.standard_normal(len(time))
    height = height + 5e-6 * random.standard_normal(len(time))
    velocity = velocity + 0.67e-3 * random.standard_normal(len(time))
    table = np.column_stack([time, force, 1e3 * height, 1e3 * velocity])
    head = "time (s),force (N),height (mm),velocity (mm/s)"
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.9g")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
def test_one_rule_judges_filters_and_fits(tmp_path, seed):
    """The force of the last second says nothing; what a filter learnt of the ramp before it does."""
    write(tmp_path / "record.csv", seed)
    (tmp_path / "p.toml").write_text(PIPELINE)
    tracks = run_pipeline(load_pipeline(tmp_path / "p.toml"), tmp_path / "run").tracks
    for name in ("kv/fit", "kv/kinematic"):
        found = tracks[name].parameters["stiffness"]
        assert tracks[name].verdict == found.verdict == "good"
        assert abs(found.value - STIFFNESS) < 4 * found.combined
    for name in ("kv/ekf", "kv/ukf", "kv/afekf", "kv/afukf"):
        assert tracks[name].parameters["damping"].verdict in ("not determined", "invalid")
        found = tracks[name].parameters["stiffness"]
        assert found.verdict != "good" or abs(found.value - STIFFNESS) < 2 * found.combined
