"""A table of a sweep that somebody else recorded becomes a map: by its columns, or by those that are stated."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

RATE = 250.0
RADIUS, E, ETA, MASS = 5e-3, 100e3, 300.0, 0.14
LUMP, CONTRAST, SIGMA = 3e-3, 0.5, 3.5e-3  # [m], of the Gaussian that the tip feels
TIP = ("--tip", "sphere 5 mm")


def smooth_step(x):
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


@pytest.fixture(scope="module")
def record():
    """Columns of a press, a stay of 3 s, and a line of 30 mm at 4 mm/s while the tip oscillates; noise of a rig."""
    time = np.arange(0.0, 12.5, 1 / RATE)
    place = -15e-3 + 30e-3 * np.clip((time - 4.5) / 7.5, 0.0, 1.0)
    sine = smooth_step(time - 1.8) * np.sin(2 * np.pi * 2 * (time - 1.8))
    height = 1e-3 - 4e-3 * smooth_step((time - 1.0) / 0.8) - 1e-3 * sine
    depth = np.maximum(-height, 0.0)
    speed, acceleration = -np.gradient(height, time), np.gradient(np.gradient(height, time), time)
    share = 1 + CONTRAST * np.exp(-0.5 * ((place - LUMP) / SIGMA) ** 2)
    force = 16 / 9 * np.sqrt(RADIUS) * E * depth**1.5 + 8 * ETA * np.sqrt(RADIUS * depth) * speed
    random = np.random.default_rng(0)
    force = share * force - MASS * acceleration + 0.02 * random.standard_normal(len(time))
    height, place = (1e3 * (column + 5e-6 * random.standard_normal(len(time))) for column in (height, place))
    return {"time [s]": time, "height [mm]": height, "force [N]": force, "way [mm]": place}


def write(path, record, names):
    """Write columns under other names, those of the record in the same order; without a time for three names."""
    columns = list(record.values())[-len(names) :]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "axis", "options"),
    [
        (("time [s]", "height [mm]", "force [N]", "y [mm]"), 1, ()),
        (("time [s]", "height [mm]", "force [N]", "way [mm]"), 0, ("--lateral", "way [mm]")),
        (("height [mm]", "force [N]", "y [mm]"), 1, ("--rate", "250 Hz")),
    ],
)
def test_a_table_of_a_sweep_is_a_map_with_its_lump(palpate, record, tmp_path, names, axis, options):
    (tmp_path / "work").mkdir()
    write(tmp_path / "sweep.csv", record, names)
    done = palpate("map", Path("..") / "sweep.csv", *TIP, *options, "--json", cwd=tmp_path / "work")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["kind"], answer["track"]) == ("sweep", "dr/smoother")
    assert answer["length"] == pytest.approx(30e-3, abs=1.5e-3)
    (lump,) = answer["lumps"]
    assert abs(lump["place"][axis] - LUMP) < 3 * lump["place_std"][axis] < 3e-3
    assert abs(lump["contrast"] - CONTRAST) < 0.05
    # The log of the run is the table: the track's own response is tried on it.
    (run,) = (tmp_path / "work" / "runs").iterdir()
    response = json.loads(palpate("map", "lumps", run, "--json").stdout)["response"]
    assert response["height"] == pytest.approx(1.0, abs=0.05)
    assert abs(response["lag"]) < 2e-4


def test_the_suggestion_of_a_sweep_follows_its_changes(palpate, record, tmp_path):
    """No filter of the paper, which is too slow for a sweep, and no fit of one value to all places."""
    named = write(tmp_path / "sweep.csv", record, ("time [s]", "height [mm]", "force [N]", "y [mm]"))
    text = palpate("info", named, "--suggest").stdout
    assert re.findall(r"\[estimator\.(\w+)\]", text) == ["smoother"]
    assert text.rstrip().endswith('sweep_speed = "4 mm/s"')
    point = write(tmp_path / "point.csv", {name: record[name] for name in list(record)[:3]}, list(record)[:3])
    assert "kinematic-smoother" not in palpate("info", point, "--suggest").stdout


@pytest.mark.parametrize(
    ("names", "options", "message"),
    [
        (("time [s]", "height [mm]", "force [N]", "y [mm]"), (), "state its tip"),
        (("height [mm]", "force [N]", "y [mm]"), TIP, "--rate '500 Hz'"),
        (
            ("time [s]", "height [mm]", "force [N]", "way [mm]"),
            (*TIP, "--lateral", "height [mm]"),
            "column height [mm] is the position",
        ),
        (("time [s]", "height [mm]", "force [N]", "way [mm]"), (*TIP, "--lateral", "wy [mm]"), "no column 'wy [mm]'"),
    ],
)
def test_what_a_sweep_lacks_is_asked_for(palpate, record, tmp_path, monkeypatch, names, options, message):
    monkeypatch.chdir(tmp_path)
    done = palpate("map", write(tmp_path / "sweep.csv", record, names), *options)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())
    assert not (tmp_path / "runs").exists()


def test_columns_of_a_run_are_its_own(palpate, tmp_path):
    done = palpate("map", tmp_path, "--lateral", "y")
    assert done.returncode == 2
    assert "--lateral" in done.stderr
