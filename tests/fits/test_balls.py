"""A sphere in words is a ball: by the command line, in rig.toml, in curves.csv and in Python; a pipeline's stays."""

import json
import tomllib

import numpy as np
import palpate as python
import palpate_engine as engine
import pytest
from palpate import ConfigurationError
from palpate_devices.mcap_replay import _has_simulation
from palpate_kit.curves.curve_table import latest_rows
from palpate_models import Sphere

R, E = 3e-3, 25e3  # [m], [Pa]
DEPTHS = (0.33, 0.5, 0.67, 0.83)  # of the radius
STATED = ("--delay", "0 ms +- 0.2 ms", "--tip-mass", "0 g", "--thickness", "half-space")
PIPELINE = """
[device.log]
type = "csv-replay"
file = "FILE"
time = { column = 0, unit = "s" }
columns = { force = { column = 1, unit = "N" }, position = { column = 2, unit = "mm" } }

[alignment]
force = { channel = "log.force", uncertainty = "0.2 ms" }
position = "log.position"
tip_mass = 0.0

[indenter.tip]
type = "TYPE"
radius = 0.003

[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
thickness = "half-space"

[estimator.fit]
type = "casadi-fit"
"""


def ball_force(depth):
    """Force [N] of an exact sphere at depths (n,) [m] (Sneddon 1965), the contact radius by bisection."""
    low, high = np.zeros(len(depth)), np.full(len(depth), R)
    for _ in range(60):
        a = (low + high) / 2
        is_deeper = a / 2 * np.log((R + a) / np.maximum(R - a, 1e-300)) > depth
        low, high = np.where(is_deeper, low, a), np.where(is_deeper, a, high)
    return E / 0.75 * ((low**2 + R**2) / 2 * np.log((R + low) / (R - low)) - low * R)


def press(share, seed=0):
    """Time [s], force [N] and height [m] of a press of a ball, so many of its radii deep, after 0.5 s of air."""
    time = np.arange(0.0, 2.6, 0.002)
    height = 0.3e-3 - np.minimum(np.maximum(time - 0.5, 0.0) * 1.5e-3, 0.3e-3 + share * R)
    noise = 2e-3 * np.random.default_rng(seed).standard_normal(len(time))
    return time, ball_force(np.maximum(-height, 0.0)) + noise, height


@pytest.fixture
def presses(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curves").mkdir()
    for share in DEPTHS:
        time, force, height = press(share, seed=int(100 * share))
        table, head = np.column_stack([time, force, 1e3 * height]), "time (s),force (N),height (mm)"
        path = tmp_path / "curves" / f"{100 * share:.0f}.csv"
        np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.9g")
    return tmp_path


def pipeline(folder, kind, share=0.33):
    (folder / f"{kind}.toml").write_text(
        PIPELINE.replace("TYPE", kind).replace("FILE", f"curves/{100 * share:.0f}.csv")
    )
    return folder / f"{kind}.toml"


def rows_in(folder):
    return {row["curve"]: row for row in latest_rows(folder / "fits.csv")}


def assert_right(row):
    value, u = float(row["elasticity"]), float(row["elasticity_combined"])
    assert abs(value - E) < u
    assert (row["verdict"], row["elasticity_verdict"]) == ("good", "good")
    assert "tip:" not in row["conditions"]


@pytest.mark.gate
@pytest.mark.slow
def test_a_ball_reads_right_at_each_depth_by_tip_rig_and_curves_csv(presses, palpate):
    done = palpate("fit", "curves", "--tip", "sphere 3 mm", "--out", "fits", *STATED)
    assert done.returncode == 0, done.stderr
    assert "exact-sphere, radius 3 mm (diameter 6 mm); dr, nu 0.5, half-space" in " ".join(done.stdout.split())
    rows = rows_in(presses / "fits")
    assert len(rows) == len(DEPTHS)
    for row in rows.values():
        assert_right(row)
    (presses / "curves" / "rig.toml").write_text('tip = "sphere diameter 6 mm"\n')
    assert palpate("fit", "curves", "--out", "by-rig", *STATED).returncode == 0
    (presses / "curves" / "rig.toml").write_text('tip = "flat 2 mm"\n')
    (presses / "curves" / "curves.csv").write_text("curve,tip\n83.csv,sphere 3 mm\n")
    assert palpate("fit", "curves/83.csv", "--out", "by-list", *STATED).returncode == 0
    for name, row in rows.items():
        assert rows_in(presses / "by-rig")[name]["elasticity"] == row["elasticity"]
    deepest = next(name for name in rows if "83" in name)
    (listed,) = rows_in(presses / "by-list").values()
    assert listed["elasticity"] == rows[deepest]["elasticity"]


@pytest.mark.slow
def test_a_ball_in_python_reads_right_and_is_that_of_its_rig(presses):
    record = python.read("curves/33.csv", timing="0.2 ms", tip_mass="0 g")
    fit = python.fit(record, tip="sphere 3 mm", model="dr")
    assert abs(fit.elasticity.value - E) < fit.elasticity.combined
    by_rig = python.fit(record, rig={"tip": "sphere 3 mm"}, model="dr")
    assert by_rig.elasticity.value == fit.elasticity.value


@pytest.mark.slow
@pytest.mark.parametrize(("share", "percent"), [(0.33, 4), (0.83, 11)])
def test_the_sphere_of_a_pipeline_is_the_paraboloid_and_says_what_a_ball_would_give(presses, palpate, share, percent):
    found = {}
    for kind in ("sphere", "exact-sphere"):
        done = palpate("run", pipeline(presses, kind, share), "--json", "--out", kind)
        assert done.returncode == 0, done.stderr
        found[kind] = json.loads(done.stdout)["tracks"]["dr/fit"]
    tips = {kind: [one for one in track["conditions"] if one["fact"] == "tip"] for kind, track in found.items()}
    assert tips["exact-sphere"] == []
    (tip,) = tips["sphere"]
    assert tip["message"] == f"the tip is a paraboloid (a ball: elasticity {percent} % higher)"
    assert tip["remedy"] == 'type = "exact-sphere"'
    low, right = (found[kind]["parameters"]["elasticity"]["value"] for kind in ("sphere", "exact-sphere"))
    assert low + tip["shifts"]["elasticity"] == pytest.approx(right, rel=0.01)
    assert "exact-sphere" not in json.dumps(found["sphere"]["flags"])


def conditions_of_tip(fit):
    return [one["message"] for one in fit.track.document["conditions"] if one["fact"] == "tip"]


def test_the_condition_begins_at_a_tenth_of_the_radius():
    found = {}
    for share in (0.08, 0.33):
        time, force, height = press(share)
        record = python.record(time=time, force=force, height=height, timing="0.2 ms", tip_mass="0 g")
        found[share] = conditions_of_tip(python.fit(record, tip=Sphere(radius="3 mm"), model="dr"))
    assert found == {0.08: [], 0.33: ["the tip is a paraboloid (a ball: elasticity 4 % higher)"]}


@pytest.mark.slow
def test_a_simulated_rig_presses_a_paraboloid_and_its_replay_knows(point_pipeline, palpate, tmp_path):
    assert palpate("run", point_pipeline, "--set", 'run.tracks=["*/ekf"]', "--out", "run").returncode == 0
    assert palpate("replay", "run", "--out", "again").returncode == 0
    for name in ("run", "again"):
        (track,) = json.loads((tmp_path / name / "result.json").read_text())["tracks"].values()
        assert "tip" not in {one["fact"] for one in track["conditions"]}


@pytest.mark.parametrize(("kind", "simulated"), [("sim", True), ("csv-replay", False), ("nobody's", False)])
def test_a_log_is_of_a_simulation_by_the_devices_of_its_pipeline(kind, simulated):
    assert _has_simulation(f'[device.rig]\ntype = "{kind}"\n') is simulated


@pytest.mark.parametrize("kind", ["sphere", "exact-sphere", "neo-hookean-sphere"])
@pytest.mark.parametrize("size", ["3 mm", "4 mm"])
def test_the_law_of_a_pipeline_stays_where_a_ball_is_stated(presses, kind, size):
    """What a folder or an archive recorded by its pipeline stays what it was, the tips of curves.csv included."""
    by_options = engine.load_pipeline(pipeline(presses, kind), [f"rig.tip=sphere {size}"])
    assert engine.registry.load().name_of(type(by_options.models["dr"].indenter)) == kind
    assert by_options.models["dr"].indenter.radius == pytest.approx(1e-3 * float(size[0]))
    (presses / "rig.toml").write_text(f'tip = "sphere {size}"\n')
    by_file = ["run.rig=rig.toml"]
    if size == "4 mm":
        with pytest.raises(ConfigurationError, match="contradicts"):
            engine.load_pipeline(pipeline(presses, kind), by_file)
    else:
        assert engine.load_pipeline(pipeline(presses, kind), by_file).models == {
            "dr": engine.load_pipeline(pipeline(presses, kind)).models["dr"]
        }


def test_a_tip_that_states_its_law_or_another_shape_contradicts_the_pipeline(presses):
    for words in ("exact-sphere 3 mm", "paraboloid 3 mm", "flat 3 mm"):
        (presses / "rig.toml").write_text(f'tip = "{words}"\n')
        with pytest.raises(ConfigurationError, match="contradicts"):
            engine.load_pipeline(pipeline(presses, "sphere"), ["run.rig=rig.toml"])


@pytest.mark.slow
def test_a_folder_of_before_keeps_its_law_when_it_is_fitted_again(presses, palpate):
    """A folder whose pipeline has type = "sphere", as those that were made before, with a tip of one curve in words."""
    (presses / "curves" / "curves.csv").write_text("curve,tip\n83.csv,sphere 3.1 mm\n")
    done = palpate("fit", "curves", "--tip", "sphere 3 mm", "--out", "fits", "--no-refit", *STATED)
    assert done.returncode == 0, done.stderr
    settings = presses / "fits" / "pipeline.toml"
    settings.write_text(settings.read_text().replace('"exact-sphere"', '"sphere"'))
    assert palpate("fit", "fits", "--jobs", "1").returncode == 0
    assert {tip["type"] for tip in tomllib.loads(settings.read_text())["indenter"].values()} == {"sphere"}
    rows = rows_in(presses / "fits")
    low = {name: float(row["elasticity"] or row["elasticity_std"]) / E - 1.0 for name, row in rows.items()}
    assert all(-0.13 < share < -0.03 for share in low.values()), low


def test_one_ball_is_one_tip_whatever_the_law(presses):
    known = engine.registry.load()
    one, other = ({"type": kind, "radius": 0.003} for kind in ("sphere", "exact-sphere"))
    assert engine.is_same_tip(one, other, known)
    assert not engine.is_same_tip(one, {**other, "radius": 0.004}, known)
    assert not engine.is_same_tip(one, {**other, "type": "flat"}, known)
