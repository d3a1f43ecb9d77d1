"""`palpate repeat FILE`: one palpation again and again, each a run of its own, and what they say together."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from palpate.errors import ConfigurationError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_studies.force_error import force_error
from palpate_studies.repeated_runs import palpations

SHORT = ["--set", "trajectory.press.duration=2 s", "--set", 'run.tracks=["*/kinematic"]']


@pytest.fixture
def repeated(point_pipeline):
    with point_pipeline.open("a", encoding="utf-8") as file:
        file.write('\n[repeat]\ncount = 4\nwait = "10 s"\nstep = ["2 mm", "-1 mm"]\n')
    return point_pipeline


@pytest.mark.gate
@pytest.mark.slow
def test_each_is_a_run_of_its_own_and_moved_on(repeated, palpate, tmp_path):
    place = ["--set", "alignment.lateral_x=rig.tip.x", "--set", "alignment.lateral_y=rig.tip.y"]
    arguments = ["repeat", repeated, *SHORT, *place, "--out", "out", "--picture", "all.png", "--json"]
    done = palpate(*arguments)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["groups"]["runs"]
    assert found["count"] == 4
    assert len(set(found["values"])) == 4  # noise of its own
    assert (tmp_path / "all.png").stat().st_size > 10_000
    places = [np.genfromtxt(tmp_path / "out" / str(k) / "estimates.csv", delimiter=",")[50, 1:3] for k in range(1, 5)]
    np.testing.assert_allclose(np.diff(places, axis=0), 3 * [[0.002, -0.001]], atol=3e-5)
    band = found["force_error"]
    assert band["count"] == 4
    assert band["rms"] == pytest.approx(0.05, rel=0.2)  # the sensor's noise, since the model is the truth
    assert np.mean(band["std"]) == pytest.approx(0.05, rel=0.2)
    assert abs(np.mean(band["mean"])) < 0.01
    again = palpate("repeat", "out", "--json")  # the folder of all
    assert json.loads(again.stdout)["groups"]["runs"] == found
    third = tmp_path / "out" / "3" / "pipeline.toml"
    assert tomllib.loads(third.read_text())["trajectory"]["press"]["by"] == [0.004, -0.002]
    one = run_pipeline(load_pipeline(third), tmp_path / "one")
    assert one.tracks["dr/kinematic"].parameters["elasticity"].value == found["values"][2]


@pytest.mark.slow
def test_all_are_checked_before_anything_moves(repeated, palpate, tmp_path):
    with repeated.open("a", encoding="utf-8") as file:
        file.write(
            '\n[safety]\nlow = ["-5 mm", "-5 mm", "-8 mm"]\nhigh = ["5 mm", "5 mm", "50 mm"]\nspeed = "0.1 m/s"\n'
            'acceleration = "2 m/s^2"\nforce = "60 N"\nstop_force = "20 N"\nstiffness = "3 N/mm"\n'
        )
    done = palpate("repeat", repeated, *SHORT, "--out", "out")
    assert done.returncode == 2
    assert "palpation 4 of 4" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_what_cannot_be_repeated_is_told(point_pipeline, repeated):
    with pytest.raises(ConfigurationError, match="count"):
        load_pipeline(repeated, ["repeat.count=1"])
    repeated.write_text(repeated.read_text().partition("[repeat]")[0])
    with pytest.raises(ConfigurationError, match="no table"):
        next(palpations(load_pipeline(point_pipeline)))


def test_the_error_of_one_run_is_no_band(tmp_path):
    assert force_error([]) is None
    assert force_error([(tmp_path, "dr/ekf")]) is None


@pytest.mark.slow
def test_what_goes_by_the_clock_waits_between_palpations(repeated, palpate, tmp_path):
    """A fast simulation does not, or the tests above would take their waits of 10 s."""
    quick = ["duration=0.3 s", "standstill=0.3 s", "clearance=1 mm", "speed=50 mm/s"]
    quick = [text for setting in quick for text in ("--set", f"trajectory.press.{setting}")]
    quick += ["--set", "alignment.tare_duration=0.2 s", "--set", "repeat.count=2", *SHORT[2:]]
    palpate(
        "repeat", repeated, *quick, "--set", "device.rig.pace=real-time", "--set", "repeat.wait=0.5 s", "--out", "out"
    )
    lasted = json.loads((tmp_path / "out" / "1" / "result.json").read_text())["run"]["log_duration"]
    first, second = ((tmp_path / "out" / str(k) / "pipeline.toml").stat().st_mtime for k in (1, 2))
    assert second - first > lasted + 0.4  # the first block of readings comes a moment before its time


@pytest.mark.slow
def test_a_simulated_specimen_knows_what_was_done_to_it(repeated, tmp_path):
    """It softens at one place, is fresh at the next, and a run folder holds what it had been through."""
    soft = ['device.rig.specimen.conditioning={ softening = 0.1, palpations = 1.0, recovery = "100 s" }']
    still = list(palpations(load_pipeline(repeated, [*soft, 'repeat.step=["0 mm", "0 mm"]'])))
    counted = [one.devices["rig"].specimen.palpated for one in still]
    age = still[0].trajectories["press"].total_duration + 10.0
    np.testing.assert_allclose(counted, [sum(np.exp(-m * age / 100) for m in range(1, k + 1)) for k in range(4)])
    moved = palpations(load_pipeline(repeated, [*soft, 'repeat.step=["50 mm", "0 mm"]']))
    assert all(one.devices["rig"].specimen.palpated < 1e-9 for one in moved)
    short = replace(
        still[1], trajectories={"press": still[1].trajectories["press"].model_copy(update={"duration": 2.0})}
    )
    run = run_pipeline(short, tmp_path / "second")
    kept = load_pipeline(run.folder / "pipeline.toml").devices["rig"].specimen
    assert kept.palpated == pytest.approx(counted[1])
    found = run.tracks["dr/kinematic"].parameters["elasticity"]
    softened = 112.5e3 * kept.conditioning.factor(counted[1])
    assert abs(found.value - softened) < 3 * found.combined
    assert softened < 0.96 * 112.5e3
