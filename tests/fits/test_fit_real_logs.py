"""Offline fits of the authors' logs."""

import importlib.util
import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

from tests.real_bags import unpack

_specification = importlib.util.spec_from_file_location("fit_cases", Path(__file__).with_name("test_fit.py"))
cases = importlib.util.module_from_spec(_specification)
_specification.loader.exec_module(cases)

POINT = """
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
thickness = "half-space"
[estimator.fit]
type = "casadi-fit"
"""

PRESS = """
[run]
name = "press"
plugins = ["models.py"]
[device.log]
type = "csv-replay"
file = "log.csv"
time = {{ column = 0, unit = "s" }}
columns = {{ z = {{ column = 1, unit = "m" }}, v = {{ column = 2, unit = "m/s" }}, fz = {{ column = 3, unit = "N" }} }}
[alignment]
force = {{ channel = "log.fz", sign = -1 }}
position = "log.z"
velocity = "log.v"
tare_duration = "0.2 s"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[model.hc]
type = "my-hunt-crossley"
[estimator.fit]
type = "casadi-fit"
segment = "{segment}"
"""

MODELS = '''
from palpate import ContactModel, Parameter, plugin

class HuntCrossley(ContactModel):
    """(K + B d') d^n, with d in mm."""

    parameters = (
        Parameter("stiffness", "K", "1", "force at 1 mm", role="elastic"),
        Parameter("damping", "B", "1", "damping at 1 mm", role="viscous"),
        Parameter("exponent", "n", "1", "exponent", lower=1.0, upper=4.0),
    )

    def force(self, depth, rate, theta, memory=()):
        return (theta[0] + theta[1] * rate) * (depth / 1e-3) ** theta[2]

@plugin
def palpate_models():
    return {"my-hunt-crossley": HuntCrossley}
'''


def rows_of_bag(path, folder):
    """Rows (n, k) of the Float64MultiArray messages on /data_control in a gzipped rosbag2 database."""
    database = folder / "bag.db3"
    unpack(path, database)
    connection = sqlite3.connect(database)
    query = (
        "select data from messages join topics on topic_id = topics.id where name = '/data_control' order by timestamp"
    )
    blobs = [row[0] for row in connection.execute(query)]
    connection.close()
    rows = []
    for blob in blobs:
        dimensions, _, count = struct.unpack_from("<III", blob, 4)
        assert dimensions == 0
        rows.append(struct.unpack_from(f"<{count}d", blob, 20))
    return np.array(rows)


@pytest.mark.parametrize(
    ("file", "radius", "motion_delay", "force_delay", "published"),
    [
        ("d10mm_soft", "5 mm", "22 ms", "0 ms", 125.0e3),
        ("d10mm_sphere", "5 mm", "22 ms", "0 ms", 171.4e3),
        ("d5mm_soft", "2.5 mm", "0 ms", "12 ms", 103.3e3),
    ],
)
def test_point_palpations_give_what_least_squares_gives(
    authors_log, tmp_path, file, radius, motion_delay, force_delay, published
):
    log = authors_log(file, radius, motion_delay, force_delay, tip_mass="")
    (tmp_path / "point.toml").write_text(log + POINT)
    track = run_pipeline(load_pipeline(tmp_path / "point.toml"), tmp_path / "out").tracks["dr/fit"]
    assert track.parameters["elasticity"].value == pytest.approx(published, rel=0.03)
    viscosity = track.parameters["viscosity"]
    assert viscosity.budget["timing"] == pytest.approx(track.parameters["elasticity"].value / 3 * 0.5e-3, rel=1e-6)
    assert 200 < viscosity.value < 500


@pytest.mark.parametrize("estimator", ["casadi-fit", "ekf"])
def test_a_slow_memory_without_a_standstill_is_a_note_with_the_row_of_its_misfit(authors_log, tmp_path, estimator):
    """A quarter of the residual's variance hangs together for longer than a channel does; branches take most of it."""
    (tmp_path / "point.toml").write_text(authors_log("d10mm_soft") + POINT.replace("casadi-fit", estimator))
    track = run_pipeline(load_pipeline(tmp_path / "point.toml"), tmp_path / "out").tracks["dr/fit"]
    assert "likely memory" in str(next(flag for flag in track.flags if flag.code == "model-discrepancy"))
    elasticity = track.parameters["elasticity"]
    assert elasticity.verdict == "good"
    assert elasticity.value == pytest.approx(127.2e3, rel=0.01)
    assert 0.02 < elasticity.budget["model_discrepancy"] / elasticity.value < 0.06


@pytest.fixture
def press(shared, tmp_path):
    """Run both models on one of the bags."""

    def run(bag, columns, segment):
        np.savetxt(tmp_path / "log.csv", rows_of_bag(shared / "rosbag2" / bag, tmp_path)[:, columns], delimiter=",")
        (tmp_path / "models.py").write_text(MODELS)
        (tmp_path / "press.toml").write_text(PRESS.format(segment=segment))
        return run_pipeline(load_pipeline(tmp_path / "press.toml"), tmp_path / "out")

    return run


@pytest.mark.slow
def test_the_foam_is_touched_before_the_force_says_so(press):
    result = press("foam_white_1_p.db3.gz", [0, 2, 4, 5], "load")
    track = result.tracks["dr/fit"]
    threshold = track.details["contact_points"]["threshold"]["surface"]
    assert 0.13e-3 < track.surface.value - threshold < 0.6e-3


@pytest.mark.slow
def test_a_deep_load_and_unload_prefers_hunt_and_crossley(press):
    from palpate_fits.fit_tables import evidence

    result = press("ur3e_load_unload_soft_1.db3.gz", [0, 3, 4, 5], "cycle")
    details = {name: track.details for name, track in result.tracks.items()}
    assert details["hc/fit"]["unknowns"]["exponent"]["value"] == pytest.approx(1.2, abs=0.1)
    assert details["hc/fit"]["rss"] < details["dr/fit"]["rss"]
    assert evidence(result.tracks).startswith("the record prefers hc/fit over dr/fit (BIC +")
