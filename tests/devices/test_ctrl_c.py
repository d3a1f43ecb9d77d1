"""Ctrl-C again and again while the tip is pressed in: judged by what the twin's arm did, in simulated time."""

import json
import re
import signal

import numpy as np
import pytest
from palpate import clock
from palpate_engine.pipeline import run_pipeline

from tests.devices.simulated_bench import readings
from tests.devices.test_live import signals_of_a_terminal, touching


def press(rig, tmp_path, times, *overrides):
    """Run the example with Ctrl-C at some times [s] after the tip is pressed in: the result, and what the arm did."""
    due, path = list(times), []
    begun = []

    def progress(*_):
        state = rig.state()
        path.append((clock().now(), state["height"], state["tip_speed"]))
        if not begun and touching(state):
            begun.append(clock().now())
        while begun and due and clock().now() >= begun[0] + due[0]:
            due.pop(0)
            signal.raise_signal(signal.SIGINT)

    with signals_of_a_terminal():
        result = run_pipeline(rig.pipeline("trajectory.press.duration=30 s", *overrides), tmp_path / "out", progress)
    assert not due
    return result, np.array(path), begun[0]


@pytest.mark.gate
@pytest.mark.slow
def test_five_presses_within_a_second_are_one(rig, tmp_path, capsys):
    result, _, _ = press(rig, tmp_path, [0.0, 0.01, 0.02, 0.03, 0.05])
    assert result.interrupted.startswith("stopped by Ctrl-C")
    assert rig.wait_at_rest()["height"] > 0.002  # it has left the material
    assert (tmp_path / "out" / "result.json").exists()
    assert readings(tmp_path / "out" / "log.mcap", "arm", "tip")
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "palpate: Ctrl-C: the arm stops and leaves the material"
    assert len(lines) == 5
    assert all("counts as the first one" in line for line in lines[1:])


@pytest.mark.slow
def test_a_later_press_stops_the_retraction_where_it_is(rig, tmp_path, capsys):
    """A retraction at 1 mm/s from some 3 mm deep takes longer than a second."""
    slow = ("device.arm.retract_speed=1 mm/s", "trajectory.press.bias=4 mm")
    result, _, begun = press(rig, tmp_path, [0.15, 0.2, 1.3, 1.4], *slow)
    state = rig.wait_at_rest()
    assert clock().now() - begun < 2.5
    assert state["height"] < -0.0005  # pressed in, and the process waited until it stood there
    height, force = re.search(
        r"stands at a height of (\S+) mm, pressed in at (\S+) N: lift it in", result.interrupted
    ).groups()
    assert float(height) == pytest.approx(1e3 * state["height"], abs=0.1)
    assert float(force) > 0.2
    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if "the arm stops where it is" in line] == lines[2:]
    stop = json.loads((tmp_path / "out" / "result.json").read_text())["run"]["live"]["stop"]
    assert "lift it in freedrive" in stop["reason"]
