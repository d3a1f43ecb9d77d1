"""Limits of a motion, and the guard."""

import time

import numpy as np
import pytest
from palpate import Batch, Channel, ConfigurationError, DeviceError, OwnMotion, Setpoint, Stream
from palpate.alignment import AlignmentSettings
from palpate.pipeline.guard import Guard
from palpate.safety import SafetySettings, check_motion, check_own_motion, check_setpoints, demand_safe
from palpate_trajectories.point import Point

LIMITS = {
    "low": (-0.005, -0.005, -0.007),
    "high": (0.005, 0.005, 0.02),
    "speed": 0.04,
    "acceleration": 0.5,
    "force": 20.0,
    "stop_force": 12.0,
    "stiffness": 3000.0,
    "latency": 0.06,
}
PRESS = Point(bias=0.004, duration=2.0)


def limits(**changes):
    return SafetySettings.model_validate({**LIMITS, **changes})


def test_a_motion_within_its_limits():
    report = demand_safe(PRESS, limits(), "here")
    assert report.problems == ()
    assert report.low[2] == pytest.approx(-0.005, abs=1e-5)
    assert report.inward_speed == pytest.approx(report.speed)
    expected = 12 + 3000 * (report.inward_speed * 0.06 + report.inward_speed**2 / 2)
    assert report.peak_force == pytest.approx(expected)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"low": (-0.005, -0.005, -0.004)}, "z goes to -5.00 mm, below the limit of -4.00 mm"),
        ({"high": (0.005, 0.005, 0.004)}, "z goes to 5.00 mm, above the limit of 4.00 mm"),
        ({"low": (0.001, -0.005, -0.007)}, "x goes to 0.00 mm, below the limit of 1.00 mm"),
        ({"speed": 0.01}, "the speed is"),
        ({"acceleration": 0.1}, "the acceleration is"),
        ({"stiffness": 30e3}, "the fastest approach"),
        ({"latency": 0.5}, "the fastest approach"),
    ],
)
def test_each_limit_is_checked(changes, words):
    with pytest.raises(ConfigurationError, match=r"breaks the limits") as caught:
        demand_safe(PRESS, limits(**changes), "here")
    assert words in str(caught.value)


def test_the_fastest_approach_just_keeps_the_force():
    for stiffness in (500.0, 3000.0, 30e3):
        table = limits(stiffness=stiffness)
        assert table.stop_force + table.overshoot(table.fastest) == pytest.approx(table.force)
    assert limits(stop_force=20.0).fastest == 0.0


def test_a_depth_that_only_the_middle_reaches_is_seen():
    """The limits hold over the whole motion, not only at its ends."""
    report = check_motion(Point(bias=0.004, amplitude=0.0035, duration=1.0), limits())
    assert any("below" in problem for problem in report.problems)


@pytest.mark.parametrize(
    ("own", "words"),
    [
        (OwnMotion(0.02, 0.03, 1.0), None),
        (OwnMotion(0.05, 0.03, 1.0), "the speed is 50.0 mm/s"),
        (OwnMotion(0.036, 0.03, 1.0), "the fastest approach"),
        (OwnMotion(0.02, 0.03, 0.5), "the arm brakes at 0.5 m/s^2"),
    ],
)
def test_what_an_arm_does_by_itself_is_checked(own, words):
    problems = check_own_motion(own, limits())
    assert (words is None) == (not problems)
    assert words is None or any(words in problem for problem in problems)


def test_a_way_of_one_setpoint_is_judged_too():
    zero = np.zeros((1, 3))
    assert check_setpoints(np.zeros(1), Setpoint(zero, zero, np.zeros(1, bool)), limits()).problems == ()
    report = check_setpoints(np.zeros(1), Setpoint(zero + 0.1, zero, np.zeros(1, bool)), limits())
    assert len(report.problems) == 3


WRENCH = Stream("wrench", tuple(Channel(axis, "N", (-500.0, 500.0)) for axis in "xyz"), 800.0)
TIP = Stream("tip", (Channel("z", "m"),), 500.0)
ALIGNMENT = AlignmentSettings.model_validate({"force": "s.wrench.z", "position": "r.tip.z"})


class _Arm:
    def __init__(self):
        self.retracted = []

    def batches(self):
        return iter(())

    def follow(self, trajectory):
        pass

    def stop(self):
        pass

    def retract(self):
        self.retracted.append(time.monotonic())


def force(*values):
    n = len(values)
    stamps = np.arange(n, dtype=np.int64)
    return Batch("wrench", stamps, stamps, np.column_stack([np.zeros((n, 2)), values]))


def height(z):
    stamps = np.arange(20, dtype=np.int64)
    return Batch("tip", stamps, stamps, np.full((20, 1), z))


@pytest.fixture
def guard():
    made = Guard(limits(stale=0.15), ALIGNMENT, {"s": (WRENCH,), "r": (TIP,)})
    made.arm = _Arm()
    rng = np.random.default_rng(0)
    made.check("s", force(*(1.0 + 0.05 * rng.standard_normal(100))))
    made.check("r", height(0.01))
    found = made.judge_rest()
    assert found.force == pytest.approx(1.0, abs=0.02)
    assert found.force_std == pytest.approx(0.05, rel=0.2)
    made.begin([made.arm])
    yield made
    made.close()


@pytest.mark.parametrize(
    ("device", "batch", "words"),
    [
        ("s", force(1.0, 14.0), "the force is 13.0 N"),
        ("s", force(1.0, -12.0), "the force is 13.0 N"),
        ("s", force(np.nan, 1.0), "over range or invalid"),
        ("s", force(500.0), "at the end of its range"),
        ("r", height(-0.008), "below the limit"),
    ],
)
def test_the_guard_trips_at_once(guard, device, batch, words):
    guard.check(device, batch)
    assert words in guard.reason
    assert len(guard.arm.retracted) == 1
    guard.trip("something later")
    assert words in guard.reason
    assert len(guard.arm.retracted) == 1


def test_the_guard_lets_pass_what_is_in_order(guard):
    guard.check("s", force(1.0, 12.9, -10.9))
    guard.check("r", height(-0.0069))
    assert guard.reason is None
    assert guard.peak == pytest.approx(11.9, abs=0.02)


def test_silence_trips_the_guard(guard):
    deadline = time.monotonic() + 5
    while guard.reason is None and time.monotonic() < deadline:
        guard.check("r", height(0.0))
        time.sleep(0.005)
    assert guard.reason.startswith("s.wrench.z is silent")
    assert guard.arm.retracted


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.full(50, 30.0) + np.arange(50) % 2, "rest_force"),
        (np.arange(50) % 2 * 4.0, "rest_noise"),
        (np.zeros(3), "gave nothing usable"),
    ],
)
def test_an_implausible_rest_is_refused_with_advice(values, words):
    guard = Guard(limits(), ALIGNMENT, {"s": (WRENCH,), "r": (TIP,)})
    guard.check("s", force(*values))
    guard.check("r", height(0.01))
    with pytest.raises(DeviceError, match=words):
        guard.judge_rest()


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ((0.01, 1.0), r"times what the filter was told \(\[estimator.ekf\] force_std = 0.01 N"),
        ((1.0, 1e-4), r"\[estimator.ekf\] velocity_std = 0.1 mm/s"),
    ],
)
def test_noise_that_a_filter_does_not_expect_is_refused_with_advice(told, words):
    """At three times what it was told; just below, it is not."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(400)
    noise /= noise.std(ddof=1)
    twist = Stream("twist", (Channel("z", "m/s"),), 500.0)
    alignment = ALIGNMENT.model_validate({**ALIGNMENT.model_dump(), "velocity": "r.twist.z"})
    for factor, refused in ((0.98, False), (1.02, True)):
        guard = Guard(limits(), alignment, {"s": (WRENCH,), "r": (TIP, twist)})
        guard.check("s", force(*(factor * 0.03 * noise)))
        guard.check("r", height(0.01))
        stamps = np.arange(400, dtype=np.int64)
        guard.check("r", Batch("twist", stamps, stamps, (factor * 3e-4 * noise)[:, None]))
        if refused:
            with pytest.raises(DeviceError, match=words) as caught:
                guard.judge_rest({"ekf": told})
            assert 'set noise = "measure"' in str(caught.value)
        else:
            assert guard.judge_rest({"ekf": told}).velocity_std == pytest.approx(2.94e-4)
