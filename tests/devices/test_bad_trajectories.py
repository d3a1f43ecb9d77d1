"""Trajectories that raise, or return what is no setpoint, at any stage of a run: what is told and what the arm did."""

import json

import numpy as np
import pytest
from palpate import ConfigurationError, PluginError, Setpoint, duration_of, setpoints_at
from palpate_trajectories.point import Point

from tests.devices.simulated_bench import readings

PRESS = Point(bias=0.002, amplitude=0.0005, clearance=0.003, standstill=0.0, duration=0.5)


def broken(found, how):
    match how:
        case "raise":
            raise ValueError("no setpoint")
        case "leave":
            raise SystemExit(3)
        case "nan":
            velocity = found.velocity.copy()
            velocity[-1, 2] = np.nan
            return Setpoint(found.position, velocity, found.measuring)
        case "short":
            return Setpoint(found.position[:-1], found.velocity, found.measuring)
        case "flat":
            return Setpoint(found.position[:, 2], found.velocity, found.measuring)
        case "list":
            return [found]
        case "texts":
            return Setpoint(found.position.astype(str), found.velocity, found.measuring)
        case "turning":
            return Setpoint(found.position, found.velocity, found.measuring, np.zeros(1), np.zeros(1))
        case "turned":
            return Setpoint(found.position, found.velocity, found.measuring, np.zeros_like(found.position))


WORDS = {
    "raise": r"trajectory Point failed at 0\.000 to .* s: ValueError: no setpoint \(.*\.py, line \d+, in .*\)",
    "leave": r"trajectory Point failed at .* s: SystemExit: 3",
    "nan": r"trajectory Point: a setpoint is not a finite number: velocity at [\d.]+ s",
    "short": r"position for (\d+) times is float64 of shape \(\d+, 3\); expected an array of numbers \(\1, 3\)",
    "flat": r"position for (\d+) times is float64 of shape \(\1,\)",
    "list": "trajectory Point: its `at` returns list, not Setpoint",
    "texts": r"position for \d+ times is <U\d+ of shape",
    "turning": r"rotation for 3 times is float64 of shape \(1,\); expected an array of numbers \(3, 3\)",
    "turned": r"angular_velocity for 3 times is NoneType; expected an array of numbers \(3, 3\)",
}


@pytest.mark.parametrize("how", WORDS)
def test_what_is_no_setpoint_is_told(monkeypatch, how):
    right = Point.at
    monkeypatch.setattr(Point, "at", lambda self, time: broken(right(self, time), how))
    with pytest.raises(PluginError, match=WORDS[how]):
        setpoints_at(PRESS, np.array([0.0, 0.1, 0.2]))


@pytest.mark.parametrize("length", [np.nan, np.inf, -1.0, "long", None])
def test_a_duration_that_is_none_is_told(monkeypatch, length):
    monkeypatch.setattr(Point, "total_duration", property(lambda self: length))
    with pytest.raises(
        PluginError, match=r"trajectory Point: its total_duration is .*; expected a finite number of seconds"
    ):
        duration_of(PRESS)


def test_a_duration_that_raises_is_told(monkeypatch):
    monkeypatch.setattr(Point, "total_duration", property(lambda self: 1 / 0))
    with pytest.raises(PluginError, match=r"trajectory Point failed: ZeroDivisionError: division by zero \(.*line"):
        duration_of(PRESS)


def run_with(rig, monkeypatch, how, begins, out):
    """Run with a trajectory that goes wrong from the question on of which `begins` holds, given all so far."""
    right, asked = Point.at, []

    def at(self, time):
        asked.append(len(time))
        found = right(self, time)
        return broken(found, how) if begins(asked) else found

    monkeypatch.setattr(Point, "at", at)
    rig.fault("mark")
    with pytest.raises(PluginError, match="trajectory Point"):
        rig.run(out=out)
    state = rig.wait_at_rest()
    assert state["low"][2] > 3.9e-3  # it began at 4 mm, and went no further than the retreat
    assert state["peak_force"] < 0.1
    return state


@pytest.mark.gate
@pytest.mark.slow
def test_a_motion_that_cannot_be_planned_leaves_nothing(rig, monkeypatch):
    for count, how in enumerate(("raise", "nan", "short"), 1):
        with monkeypatch.context() as context:
            run_with(rig, context, how, lambda asked, count=count: len(asked) == count, f"out{count}")
        assert not (rig.folder / f"out{count}").exists()


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("how", ["raise", pytest.param("nan", marks=pytest.mark.slow)])
def test_a_motion_that_goes_wrong_once_the_run_has_begun_leaves_result_and_log(rig, monkeypatch, how):
    """All its setpoints are asked for once more when the arm is to follow: after single ones, for the way there."""
    state = run_with(rig, monkeypatch, how, lambda asked: 1 in asked and asked[-1] > 1, "bad")
    assert state["high"][2] == pytest.approx(4.5e-3, abs=1e-4)  # the retreat was made
    table = json.loads((rig.folder / "bad" / "result.json").read_text())
    assert "trajectory Point" in table["run"]["live"]["stop"]["reason"]
    for track in table["tracks"].values():
        assert any(f["code"] == "interrupted" and "trajectory Point" in f["message"] for f in track["flags"])
    wrench = sum(len(batch.time) for batch in readings(rig.folder / "bad" / "log.mcap", "sensor", "wrench"))
    assert wrench == table["run"]["live"]["devices"]["sensor"]["readings"]


@pytest.mark.slow
def test_a_motion_that_ends_pressed_in_moves_nothing(rig, monkeypatch):
    whole = Point.total_duration.fget
    monkeypatch.setattr(Point, "total_duration", property(lambda self: whole(self) - 0.5))
    rig.fault("mark")
    with pytest.raises(
        ConfigurationError, match=r"it ends with the tip .* mm below the skin, where the tip would stay"
    ):
        rig.run()
    assert rig.truth.low[2] > 3.9e-3
