"""The very motion of a run, above the specimen and slower: what the arm did, and that nothing was palpated."""

import numpy as np
import pytest
from palpate import ConfigurationError, LogError
from palpate_commands.lifted_run import lifted
from palpate_engine import load_pipeline, run_pipeline
from palpate_kit.runs.run_folder import RunFolder
from palpate_trajectories.lifted_motion import LiftedTrajectory
from palpate_trajectories.point import Point

from tests.devices.simulated_bench import SHORT, readings

ABOVE = (*SHORT, "twin.bench.height=14 mm", "trajectory.press.duration=0.5 s")


@pytest.fixture
def twin(simulated):
    return simulated(*ABOVE)


def test_it_is_the_motion_of_the_run_higher_and_slower():
    press, times = Point(bias=0.002, amplitude=0.0005, clearance=0.003, standstill=0.0), np.linspace(0, 3, 301)
    motion = LiftedTrajectory(of=press, lift=0.02, pace=0.25)
    ours, theirs = motion.at(4 * times), press.at(times)
    assert motion.total_duration == 4 * press.total_duration
    assert ours.position == pytest.approx(theirs.position + np.array([0, 0, 0.02]))
    assert ours.velocity == pytest.approx(0.25 * theirs.velocity)
    assert (ours.measuring == theirs.measuring).all()


@pytest.mark.slow
def test_a_lifted_run_touches_nothing_and_nothing_takes_it_for_a_palpation(twin):
    pipeline = lifted(twin.pipeline(), "10 mm", "50 %")
    twin.fault("mark")
    result = run_pipeline(pipeline, twin.folder / "out")
    truth = twin.state()
    press = next(iter(twin.pipeline().trajectories.values()))
    lowest = press.at(np.linspace(0, press.total_duration, 2000)).position[:, 2].min()
    assert truth["low"][2] == pytest.approx(lowest + 0.010, abs=3e-4)
    assert truth["fastest_tip"] < 0.02  # on the way to the start, which has its own speed
    assert result.run["log_duration"] > 2 * press.total_duration
    assert truth["peak_force"] < 0.05
    found = RunFolder(result.folder).result
    assert found["run"]["lifted"] == {"height": pytest.approx(0.010), "pace": 0.5}
    assert found["tracks"] == {}
    assert "stop" not in found["run"]["live"]
    with pytest.raises(LogError, match=r"log\.mcap: was recorded 10 mm above the specimen \(--lift\): nothing was"):
        readings(result.folder / "log.mcap", "sensor", "wrench")
    with pytest.raises(LogError, match="nothing was palpated"):
        twin.replay(result.folder / "log.mcap", "again")
    load_pipeline(result.folder / "pipeline.toml")  # it reproduces the run


@pytest.mark.parametrize(
    ("lift", "speed", "words"),
    [
        ("3 mm", None, r"--lift 3 mm: the tip would still go to z = -\d\.\d mm; at least \d+ mm keep it 1 mm above"),
        ("60 mm", None, r"--lift 60 mm: the motion up there breaks the limits of \[safety\]:\n  z goes to 63"),
        ("-2 mm", None, "expected a height above 0"),
        ("nan mm", None, "--lift 'nan mm'"),
        ("20 kg", None, "is a mass, not a length"),
        ("10 mm", "120 %", "--speed '120 %': expected more than 0 % and at most 100 %"),
        ("10 mm", "0 %", "more than 0 % and at most 100 %"),
        ("10 mm", "nan %", "more than 0 % and at most 100 %"),
        ("10 mm", "0.25", "more than 0 % and at most 100 %"),
    ],
)
def test_bad_heights_and_speeds_are_named(twin, lift, speed, words):
    with pytest.raises(ConfigurationError, match=words):
        lifted(twin.pipeline(), lift, speed)


def test_a_force_leads_nothing_above_the_specimen(twin):
    sets = ("trajectory.press.type=force-hold", "trajectory.press.force=2 N")
    with pytest.raises(ConfigurationError):
        lifted(twin.pipeline(*sets), "10 mm", None)


def test_a_speed_without_a_lift_is_refused(palpate, root):
    done = palpate("run", root / "pipelines" / "point.toml", "--speed", "25%")
    assert done.returncode == 2
    assert "--speed is for --lift" in done.stderr
