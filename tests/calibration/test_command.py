"""`palpate calibrate`: from a rig that nobody knows to a viscosity that means something."""

import json
import tomllib
from datetime import UTC, datetime, timedelta

import palpate_engine as engine
import pytest
from palpate_kit.runs.calibration_file import read_calibration

QUICK = ("--set", "calibration.trajectory.duration=4 s", "--set", "calibration.trajectory.standstill=1 s")


@pytest.fixture
def late(root, tmp_path):
    """The example with a force that is 7 ms late, its mass not weighed."""
    text = (root / "pipelines" / "late.toml").read_text()
    weighed = next(line for line in text.splitlines() if "by a scale" in line)
    text = text.replace(weighed, "")
    file = tmp_path / "late.toml"
    file.write_text(text)
    return file


def viscosity(palpate, file, folder, *overrides):
    done = palpate("run", file, "--json", "--out", folder, "--set", 'run.tracks=["dr/kinematic"]', *overrides)
    assert done.returncode == 0, done.stderr
    track = json.loads(done.stdout)["tracks"]["dr/kinematic"]
    flags = [*track["flags"], *track.get("immaterial", ())]
    codes = [sign["code"] for flag in flags for sign in (flag, *flag.get("evidence", ()))]
    return track["parameters"], [*codes, *(one["fact"] for one in track["conditions"])]


@pytest.mark.slow
def test_calibration_turns_a_delay_into_a_viscosity(palpate, late, tmp_path):
    truth, shear = 362.0, 112.5e3 / 3
    weighed = ("--set", "alignment.tip_mass=163 g")
    before, flags = viscosity(palpate, late, tmp_path / "before", *weighed)
    assert "delay" in flags
    off = before["viscosity"]["value"] - truth  # it needs the delay
    assert off == pytest.approx(-shear * 7e-3, rel=0.05), "the force late by 7 ms takes G times 7 ms away"
    unsure = ("--set", "alignment.force.uncertainty=7 ms")
    found, _ = viscosity(palpate, late, tmp_path / "unsure", *weighed, *unsure)
    assert found["viscosity"]["verdict"] == "not determined"
    done = palpate("calibrate", late)
    assert done.returncode == 0, done.stderr
    for text in ("mass", "163.", "delay", "95 % interval", "3 shakes of 5 Hz", '[run] rig = "rig.toml"'):
        assert text in " ".join(done.stdout.split())
    after, flags = viscosity(palpate, late, tmp_path / "after", "--set", "run.rig=rig.toml")
    assert after["viscosity"]["value"] == pytest.approx(truth, rel=0.02)
    assert after["elasticity"]["value"] == pytest.approx(112.5e3, rel=0.01)
    assert "delay" not in flags
    assert not [code for code in flags if code.startswith("calibration")]
    found = after["viscosity"]
    assert found["systematic"] > 0
    assert found["combined"] >= max(found["systematic"], found["std"])
    assert found["systematic_timing"] == pytest.approx(after["elasticity"]["value"] / 3 * 3.5e-5, rel=0.3)
    assert found["equivalent_delay"] == pytest.approx(truth / shear, rel=0.03)


def test_the_file_says_what_it_takes_to_trust_it(palpate, late, tmp_path):
    target = tmp_path / "rig.toml"
    assert palpate("calibrate", late, *QUICK, "--out", target).returncode == 0
    tables = tomllib.loads(target.read_text())
    table, values = tables["measurement"], tables["measured"]
    mass = values["mass"]
    assert mass["unit"] == "kg"
    assert mass["interval"][0] < 0.163 < mass["interval"][1]
    assert len(mass["repeats"]) == 3
    assert {"fit", "type_a", "type_b", "std"} <= set(mass)
    assert datetime.now(UTC) - table["created"] < timedelta(hours=1)
    assert {value["unit"] for value in values.values()} == {"kg", "s", "N", "N/s", "m", "m/s"}
    assert table["devices"]["rig"] == {"serial_number": "SIM-0001", "type": "sim"}
    assert table["tip"] == {"type": "sphere", "radius": 0.005}
    assert table["channels"]["force"] == "rig.wrench.z"
    assert table["shake"]["frequencies"] == [pytest.approx(5.0, abs=1e-3)]
    assert "palpate" in table["versions"]
    assert {"offset", "bias", "drift", "force_std", "velocity_std", "paper_velocity_std"} <= set(values)
    assert table["command"].startswith("palpate calibrate ")


@pytest.mark.slow
def test_a_recorded_log_calibrates_like_the_rig_that_made_it(palpate, late, tmp_path):
    """Record a shake with `palpate run`, then calibrate from the log."""
    begin, end = late.read_text().index("[trajectory.press]"), late.read_text().index("[calibration]")
    text = late.read_text()[:begin] + '[trajectory.shake]\ntype = "shake"\namplitude = "5 mm"\n'
    text += late.read_text()[end:] + '\n[sink.log]\ntype = "mcap"\n'
    (tmp_path / "shake.toml").write_text(text)
    overrides = ("--set", "alignment.tip_mass=163 g", "--set", 'run.tracks=["dr/ekf"]')
    done = palpate("run", tmp_path / "shake.toml", "--out", tmp_path / "shaken", *overrides)
    assert done.returncode == 0, done.stderr
    replay = tmp_path / "replay.toml"
    replay.write_text(
        '[device.rig]\ntype = "mcap-replay"\nfile = "shaken/log.mcap"\n'
        '[alignment]\nforce = "rig.wrench.z"\nposition = "rig.tip.z"\nvelocity = "rig.twist.z"\n'
    )
    done = palpate("calibrate", replay)
    assert done.returncode == 0, done.stderr
    table = tomllib.loads((tmp_path / "rig.toml").read_text())
    assert table["measured"]["mass"]["value"] == pytest.approx(0.163, abs=2e-3)
    assert table["measured"]["delay"]["value"] == pytest.approx(0.007, abs=3e-4)
    assert "type_a" not in table["measured"]["mass"]
    assert len(table["measurement"]["devices"]["rig"]["sha256"]) == 64


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("calibration.trajectory.amplitude=60 mm", "must stay in air"),
        ("calibration.trajectory.amplitude=20 mm", "top_speed: the motion reaches"),
        ("calibration.top_acceleration=1", "top_acceleration: the motion reaches 4.9"),
        ("calibration.lowest=48 mm", "lowest: the motion reaches 0.045 m"),
        ("calibration.trajectory.amplitude=0.05 mm", "the amplitude is too small"),
        ("device.rig.force_limit=1.05 N", "saturated"),
        ("calibration.repeat=4", "unknown key 'repeat'; did you mean 'repeats'"),
        ("calibration.trajectory.frequencies=[]", "frequencies"),
        ("alignment.force=rig.wrench.zz", "no device has a channel"),
    ],
)
def test_what_cannot_be_calibrated_is_refused_with_the_reason(palpate, late, tmp_path, override, message):
    done = palpate("calibrate", late, *QUICK, "--set", override)
    assert done.returncode == 2, done.stdout + done.stderr
    assert message in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "rig.toml").exists()


def test_a_sensor_that_is_stuck_is_refused(palpate, late):
    """Without noise and drift it repeats one reading at standstill."""
    done = palpate("calibrate", late, *QUICK, "--set", "device.rig.force_std=0 N", "--set", "device.rig.drift=0 N/s")
    assert done.returncode == 2
    assert "the force sensor is stuck: it repeats one reading for" in " ".join(done.stderr.split())


def test_a_tip_that_touches_is_refused(palpate, late, tmp_path):
    """The skin is 3.4 mm high, and the tip is shaken through it."""
    low = ("calibration.trajectory.height=5.5 mm", "calibration.lowest=0 mm", "device.rig.specimen.surface=3.4 mm")
    done = palpate("calibrate", late, *QUICK, *(word for override in low for word in ("--set", override)))
    assert done.returncode == 2, done.stdout
    assert "contact" in done.stderr
    assert not (tmp_path / "rig.toml").exists()


def test_a_folder_that_is_not_there_is_told_before_anything_moves(palpate, late, tmp_path):
    done = palpate("calibrate", late, "--out", tmp_path / "none" / "c.toml")
    assert done.returncode == 2
    assert "no folder" in " ".join(done.stderr.split())
    assert "repeat" not in done.stderr


def test_facts_that_a_person_wrote_stay_and_an_older_calibration_too_unless_told_otherwise(palpate, late, tmp_path):
    target = tmp_path / "rig.toml"
    target.write_text('# the blue stand\nmount = "200 N/mm"\n')
    assert palpate("calibrate", late, *QUICK).returncode == 0
    text = target.read_text()
    assert text.startswith('# the blue stand\nmount = "200 N/mm"\n')
    assert "[measured.mass]" in text
    done = palpate("calibrate", late, *QUICK)
    assert done.returncode == 2
    assert "holds a calibration already" in done.stderr
    assert target.read_text() == text
    assert palpate("calibrate", late, *QUICK, "--force").returncode == 0
    assert target.read_text().count("[measured.mass]") == 1
    (tmp_path / "pipeline.toml").write_text(late.read_text())
    refused = palpate("calibrate", late, *QUICK, "--out", "pipeline.toml")
    assert refused.returncode == 2
    assert "is a pipeline" in refused.stderr
    loaded = engine.load_pipeline(late, ["run.rig=rig.toml"])  # without the mass that the file states
    assert loaded.alignment.tip_mass == pytest.approx(0.163, abs=2e-3)
    assert loaded.alignment.series_stiffness == 200e3


def test_a_calibration_file_of_an_older_version_is_read(palpate, late, tmp_path):
    assert palpate("calibrate", late, *QUICK).returncode == 0
    old = read_calibration(tmp_path / "rig.toml")
    (tmp_path / "old.toml").write_text(old.text())
    assert "[values.mass]" in (tmp_path / "old.toml").read_text()
    assert read_calibration(tmp_path / "old.toml") == old
