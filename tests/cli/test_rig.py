"""``palpate check motion``, ``doctor`` and ``twin``."""

import os

import pytest
from palpate import ConfigurationError
from palpate_engine.cli import call

from tests.processes import PALPATE, PIPE, start

HOST = f"127.7.{os.getpid() % 250}.2"


@pytest.fixture
def live(root):
    return root / "pipelines" / "point_ur3e.toml"


def called(*words):
    """The command line within this process: quicker than one of its own."""
    return call([*map(str, words)])


def test_a_plan_shows_the_motion_and_connects_to_nothing(capsys, live, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    called("check", "motion", live)
    text = capsys.readouterr().out
    assert "#" in text
    assert "z             -5 to 5 mm (limits -7 to 20)" in text
    assert "at most 16.0 N by computation" in text
    assert (
        "device arm: moves to the start on its own, straight, from at most 30 mm away at no more than 20 mm/s" in text
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [["check", "motion"], ["run", "--out", "never"]], ids=" ".join)
def test_a_motion_beyond_its_limits_never_starts(live, words):
    with pytest.raises(ConfigurationError, match=r"below the limit of -7.00 mm"):
        called(*words, live, "--set", "trajectory.press.bias=8 mm")


@pytest.mark.parametrize("words", [["check", "motion"], ["run", "--out", "never"]], ids=" ".join)
def test_an_arm_that_goes_too_fast_to_the_start(live, words):
    with pytest.raises(ConfigurationError, match=r"the way to the start: the speed is 60.0 mm/s"):
        called(*words, live, "--set", "device.arm.approach_speed=60 mm/s")


def test_a_robot_without_limits_does_not_move(live, tmp_path):
    text = live.read_text()
    begin, end = text.index("[safety]"), text.index("[trajectory.press]")
    bare = tmp_path / "bare.toml"
    bare.write_text(text[:begin] + text[end:])
    with pytest.raises(ConfigurationError, match=r"needs a \[safety\] table"):
        called("run", bare, "--out", tmp_path / "out")


def test_a_pipeline_without_a_twin(root):
    with pytest.raises(ConfigurationError, match=r"expected one \[twin\.\*\] table"):
        called("twin", root / "pipelines" / "filters.toml")


def test_the_doctor_has_nothing_to_examine_where_nothing_is_live(palpate, root, monkeypatch):
    """No motion is computed, either."""
    monkeypatch.setattr("palpate_commands.rig_examination.check_motion", None)
    done = palpate("doctor", root / "pipelines" / "raster.toml")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "note rig: is not live: nothing to examine",
        "0 ok, 1 note, 0 bad; -v prints all",
    ]


@pytest.mark.slow
def test_the_doctor(palpate, live, tmp_path):
    pytest.importorskip("rtde_control", reason="ur-rtde is not installed")
    pytest.importorskip("serial", reason="pyserial is not installed")
    sets = ["--set", f"device.arm.host={HOST}", "--set", f"device.sensor.port={tmp_path / 'sensor'}"]
    twin_sets = ["--set", f"twin.bench.host={HOST}", "--set", f"twin.bench.port={tmp_path / 'sensor'}"]
    sick = palpate("doctor", live, *sets)
    assert sick.returncode == 2
    assert "the RTDE port 30004 cannot be reached" in sick.stdout
    twin = start(PALPATE, "twin", live, *twin_sets, stdin=PIPE, stdout=PIPE, text=True)
    try:
        assert twin.stdout.readline().startswith("ready")
        patient = (
            "device.sensor.sensor_timeout=5 s",
            "device.arm.controller_timeout=5 s",
            "safety.sensor_timeout=5 s",
            "device.arm.watchdog=1 Hz",
        )
        slack = [word for item in patient for word in ("--set", item)]
        done = palpate("doctor", live, *sets, *slack, "--set", "alignment.gap=5 s", "--duration", "0.6", "-v")
        assert done.returncode == 0, done.stdout + done.stderr
        assert "ok   standstill: force" in done.stdout
        assert "SCHED_FIFO" in done.stdout or "no real-time scheduling" in done.stdout
        twin.stdin.write("state\n")
        twin.stdin.flush()
        assert '"joint_speed": 0.0' in twin.stdout.readline()
    finally:
        twin.stdin.close()
        assert twin.wait(60) == 0
        twin.stdout.close()
