"""A driver whose calls take long, in simulated time: refused where it cannot keep up, else told with the true rate."""

import re

import numpy as np
import pytest
from palpate import DeviceError, clock
from palpate_arms.driver_time import DriverTime, shortfall_text

from tests.devices.software_arms import unlike


def slow(base, method, duration, every=1):
    """A software arm of which every so many calls of a method take a time [s]; when its commands came."""
    commands, original = [], getattr(base, method)

    def call(self, *arguments):
        commands.append(clock().now())
        if len(commands) % every == 0:
            clock().sleep(duration)
        return original(self, *arguments)

    return unlike(base, **{method: call}), commands


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "named", "duration"), [("go_to", "send", 0.010), ("go_to", "send", 0.015), ("state", "read", 0.003)]
)
def test_a_driver_that_takes_more_than_a_period_is_refused_after_the_retreat(
    run_software_arm,
    software,
    method,
    named,
    duration,
):
    arm, _ = slow(software.SoftwareArm, method, duration)
    error, calls = run_software_arm(arm)
    assert isinstance(error, DeviceError)
    assert error.exit_code == 1
    assert calls == []
    time = float(re.search(rf"its driver is too slow: .*`{named}` (?:takes )?([\d.]+) ms", str(error))[1])
    assert time == pytest.approx(1e3 * duration, abs=1.0)
    assert arm.made[-1].tip()[0][2] == pytest.approx(0.0102, abs=0.3e-3)  # it truly did no more than the retreat


@pytest.mark.slow
def test_periods_that_are_lost_are_a_flag_with_the_true_rate(run_software_arm, software, tmp_path):
    """Every 20th call of 12 ms: 0.6 ms on the average, and a fifth of the periods without a command."""
    arm, commands = slow(software.SoftwareArm, "go_to", 0.012, 20)
    error, _ = run_software_arm(arm)
    assert error is None
    table = (tmp_path / "out" / "result.json").read_text()
    share, rate = re.search(
        r"([\d.]+)% of the arm's periods had no command: commands went out at (\d+) Hz", table
    ).groups()
    pauses = np.diff(commands)
    assert float(rate) == pytest.approx(len(pauses) / (commands[-1] - commands[0]), rel=0.05)
    assert float(share) == pytest.approx(100.0 * (1.0 - float(rate) / 500.0), abs=2.0)
    assert '"lost-periods"' in table


def test_a_single_late_call_of_a_busy_computer_is_no_slow_driver(monkeypatch):
    time, now = DriverTime(), [0]
    monkeypatch.setattr("palpate_arms.driver_time.clock", lambda: type("C", (), {"now_ns": lambda self: now[0]})())
    time.begin()
    for cycle in range(300):
        began = now[0]
        now[0] += 275_000_000 if cycle in (3, 10, 200) else 100_000
        time.add_send(began)
        time.end_cycle()
        assert time.refusal is None
    assert time.refusal is None
    assert sum(time.mean) == pytest.approx(0.1e-3)


@pytest.mark.parametrize(
    ("lost", "mean", "words"),
    [
        (0, 1e-3, None),
        (10, 1e-3, None),
        (11, 1.5e-3, r"^1\.1% .* at 495 Hz in place of 500 Hz, since its driver takes 1\.5 ms of each;"),
        (11, 0.1e-3, "since the computer was late"),
    ],
)
def test_lost_periods_are_told_beyond_one_per_cent(lost, mean, words):
    told = shortfall_text(lost, 1000 - lost, 495.0, mean)
    assert (told is None) if words is None else re.search(words, told)
