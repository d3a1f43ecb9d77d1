"""What palpate publishes, read by a program that is not ours: Fast DDS, the library under rmw_fastrtps."""

import csv
import json

import numpy as np
import pytest
from palpate_engine import load_pipeline, run_pipeline

pytestmark = [pytest.mark.talks, pytest.mark.slow]
BASE = "/palpate/dr/kinematic"
SWEEP = """
[run]
estimates_interval = 0
[device.rig]
type = "sim"
tip_mass = "140 g"
force_limit = "3 N"
pace = "real-time"
[device.rig.specimen]
name = "S5"
model = "dr"
friction = 0.1
[trajectory.sweep]
type = "line-sweep"
start = ["0 mm", "-4 mm"]
end = ["0 mm", "4 mm"]
speed = "4 mm/s"
settle = "1 s"
press = {{ bias = "4 mm", amplitude = "1 mm", frequency = "2 Hz" }}
[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "4 ms" }}
position = "rig.tip.z"
velocity = "rig.twist.z"
measuring = "rig.setpoint.measuring"
lateral_x = "rig.tip.x"
lateral_y = "rig.tip.y"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
poisson = 0.5
[estimator.kinematic]
type = "kinematic-ekf"
sweep_speed = "4 mm/s"
[sink.ros]
type = "ros2"
domain = {domain}
interface = "lo"
interval = "10 ms"
"""
PARAMETERS = ("elasticity", "viscosity")
COLUMNS = [f"dr/kinematic:{name}{end}" for name in PARAMETERS for end in ("", "_std")]
LEVELS = {"note": 1, "doubtful": 1, "invalid": 2}  # OK 0, WARN 1, ERROR 2


def test_what_is_published_is_what_the_run_has_written(subscribe, domain, tmp_path):
    topics = [*(f"{BASE}/{name} vector" for name in PARAMETERS), f"{BASE}/map cloud", "/palpate/flags flags"]
    end = subscribe(*topics)
    file = tmp_path / "run.toml"
    file.write_text(SWEEP.format(domain=domain))
    result = run_pipeline(load_pipeline(file), tmp_path / "run")
    heard = {}
    for topic, *parts in end():
        heard.setdefault(topic, []).append(parts)
    with (result.folder / "estimates.csv").open() as table:
        rows = [row for row in csv.DictReader(table) if row[COLUMNS[0]]]
    written = np.array([[float(row[column]) for column in ("time_s", "x_m", "y_m", *COLUMNS)] for row in rows])
    for k, name in enumerate(PARAMETERS):
        vectors = np.array([parts[2:] for parts in heard[f"{BASE}/{name}"]])
        assert len(vectors) > 150
        assert set(vectors[:, 0]) == {"surface"}
        value, std, time = vectors[:, 1:].astype(float).T
        where = np.abs(written[:, :1] - time).argmin(axis=0)
        assert np.abs(written[where, 0] - time).max() < 1e-9
        assert np.abs(value / written[where, 3 + 2 * k] - 1).max() < 1e-9  # the digits of the table
        assert np.abs(std / written[where, 4 + 2 * k] - 1).max() < 1e-9
    cloud = heard[f"{BASE}/map"][-1]
    fields = ["x", "y", "z", *(f"{name}{end}" for name in PARAMETERS for end in ("", "_std"))]
    assert cloud[4:11] == fields
    points = np.array(cloud[11:], float).reshape(-1, 7)
    assert len(points) == int(cloud[3]) > 20
    for point in points:  # each is a row of the table, in single precision, at a place within 0.2 mm
        row = written[np.abs(written[:, 3] - point[3]).argmin()]
        assert np.abs(point[3:] / row[3:] - 1).max() < 1e-6
        assert np.abs(point[:2] - row[1:3]).max() < 2.5e-4
    found = json.loads((result.folder / "result.json").read_text())["tracks"]["dr/kinematic"]["flags"]
    expected = {f"palpate: dr/kinematic: {flag['code']}": (LEVELS[flag["severity"]], flag["message"]) for flag in found}
    flags = heard["/palpate/flags"][-1][3:]
    said = {name: (int(level), text) for level, name, text in zip(flags[::3], flags[1::3], flags[2::3], strict=True)}
    assert expected
    assert expected.items() <= said.items()
