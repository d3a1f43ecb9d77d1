"""`palpate info`: from a log nobody has described to a fit."""

import json

import numpy as np
import pytest

from tests.devices.bags import array_message, press, write_bag

ARRAY = "std_msgs/msg/Float64MultiArray"


@pytest.fixture
def bag(tmp_path):
    """A bag with one array of numbers without names."""
    time, height, speed, force = press(8.0)
    rows = np.column_stack([time, height, speed, force])
    messages = [(round(t * 1e9), array_message(row)) for t, row in zip(time, rows, strict=True)]
    return write_bag(tmp_path / "bag.db3", [("/data_control", ARRAY, messages)])


def test_what_a_log_holds(palpate, bag):
    done = palpate("info", bag.name)
    assert done.returncode == 0, done.stderr
    for text in ("/data_control", ARRAY, "4000", "500.0", "data[4]", "4000 messages over 7.998 s"):
        assert text in done.stdout


def test_a_suggested_pipeline_runs_as_it_is(palpate, bag, tmp_path):
    suggested = palpate("info", bag.name, "--suggest")
    assert suggested.returncode == 0, suggested.stderr
    (tmp_path / "log.toml").write_text(suggested.stdout)
    done = palpate("run", "log.toml", "--json")
    assert done.returncode == 0, done.stderr
    track = json.loads(done.stdout)["tracks"]["dr/ekf"]
    # A force of 1.2e4 d^1.5 on the 5 mm tip: E = 3/4 (1 - 1/4) kappa / sqrt(R), without viscosity.
    truth = 0.75 * 0.75 * 1.2e4 / np.sqrt(0.005)
    assert track["parameters"]["elasticity"]["value"] == pytest.approx(truth, rel=0.08)


@pytest.mark.parametrize("name", ["ur3e_load_unload_soft_1", "foam_white_1_p"])
def test_the_authors_bags_from_suggestion_to_estimates(palpate, shared, tmp_path, name):
    suggested = palpate("info", shared / "rosbag2" / f"{name}.db3.gz", "--suggest")
    assert suggested.returncode == 0, suggested.stderr
    (tmp_path / "log.toml").write_text(suggested.stdout)
    done = palpate("run", "log.toml", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["tracks"]["dr/ekf"]["parameters"]["elasticity"]
    assert 10e3 < found["value"] < 500e3
    assert found["combined"] > 0


def test_what_cannot_be_looked_into(palpate, tmp_path):
    (tmp_path / "notes.txt").write_text("no log")
    for name, words in (("none.db3", "there is no such file"), ("notes.txt", "no device reads such a log")):
        done = palpate("info", name)
        assert done.returncode == 2
        assert words in done.stderr
        assert "Traceback" not in done.stderr


def test_names_from_a_log_do_not_break_the_pipeline(palpate, tmp_path):
    time, height, speed, force = press()
    rows = np.column_stack([time, height, speed, force])
    messages = [(round(t * 1e9), array_message(row)) for t, row in zip(time, rows, strict=True)]
    write_bag(tmp_path / 'odd "name".db3', [('/a "b" \\ \n[c]', ARRAY, messages)])
    suggested = palpate("info", 'odd "name".db3', "--suggest")
    (tmp_path / "log.toml").write_text(suggested.stdout)
    assert palpate("check", "log.toml").returncode == 0
