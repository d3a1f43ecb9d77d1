"""Limits of a motion, and the guard."""

import time
from dataclasses import replace

import numpy as np
import pytest
from palpate import Batch, Channel, ConfigurationError, DeviceError, OwnMotion, Setpoint, Stream, UnstoppedArmError
from palpate_calibration.settings import CalibrationSettings
from palpate_engine.alignment import AlignmentSettings, Ports
from palpate_engine.config.safety_wiring import contradictions, wire_safety
from palpate_engine.pipeline.live.arm_preparation import refuse_preload
from palpate_engine.pipeline.live.guard import Guard
from palpate_engine.pipeline.live.retreat_check import compare_readings, refuse_contact
from palpate_engine.pipeline.live.rise_check import ExpectedForce
from palpate_engine.safety import Reach, SafetySettings, check_motion, check_own_motion, check_setpoints, demand_safe
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
    assert report.duration == pytest.approx(PRESS.total_duration, abs=2e-3)
    assert report.low[2] == pytest.approx(-0.005, abs=1e-5)
    assert report.inward_speed == pytest.approx(report.speed)
    expected = 12 + 3000 * (report.inward_speed * 0.08 + report.inward_speed**2 / 2)
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
        (OwnMotion(0.02, 0.03, 1.0, yield_force=12.1), None),
        (OwnMotion(0.02, 0.03, 1.0, yield_force=0.025), "is that stated in N/m?"),
        (OwnMotion(0.02, 0.03, 1.0, stop=("reflex", 12.1)), None),
        (OwnMotion(0.02, 0.03, 1.0, stop=("reflex", 12.0)), "must be above [safety] stop_force = 12 N"),
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
PORTS = Ports.of(ALIGNMENT, {"s": (WRENCH,), "r": (TIP,)})


class _Arm:
    def __init__(self):
        self.retracted, self.stopped = [], False

    def batches(self):
        return iter(())

    def follow(self, trajectory):
        pass

    def stop(self):
        self.stopped = True

    def retract(self):
        self.retracted.append(time.monotonic())


def force(*values):
    n = len(values)
    stamps = np.arange(n, dtype=np.int64)
    return Batch("wrench", stamps, stamps, np.column_stack([np.zeros((n, 2)), values]))


def height(z, begin=0.0, period=1e-9):
    stamps = np.rint(1e9 * (begin + period * np.arange(20))).astype(np.int64)
    return Batch("tip", stamps, stamps, np.full((20, 1), z))


@pytest.fixture
def guard():
    """A guard after its standstill; this test may be held up for long, where the machine is."""
    made = Guard(limits(sensor_timeout=0.15, held_up=600.0), PORTS)
    made.arm = _Arm()
    rng = np.random.default_rng(0)
    made.check("s", force(*(1.0 + 0.05 * rng.standard_normal(100))))
    made.check("r", height(0.01))
    found = made.judge_standstill()
    assert found.force == pytest.approx(1.0, abs=0.02)
    assert found.force_std == pytest.approx(0.05, rel=0.2)
    made.begin({"r": made.arm})
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
        ("r", height(np.nan), "a reading of r.tip.z is invalid"),
    ],
)
def test_the_guard_trips_at_once(guard, device, batch, words):
    guard.check(device, batch)
    assert words in guard.reason
    assert len(guard.arm.retracted) == 1
    guard.trip("something later")
    assert words in guard.reason
    assert len(guard.arm.retracted) == 1


@pytest.mark.parametrize(("deeper", "hint"), [(True, True), (False, False)])
def test_a_force_that_falls_on_the_way_in_asks_for_the_sign(guard, deeper, hint):
    guard.check("r", height(0.002))
    guard.check("r", height(-0.001 if deeper else 0.003))
    guard.check("s", force(1.0, -12.0))
    assert ("force sign = -1" in guard.reason) == hint
    assert "the force is 13.0 N" in guard.reason


def test_the_sign_is_asked_for_although_an_arm_was_the_first_to_stop(guard):
    guard.trip("the force is 12.1 N")
    for place in (0.002, -0.001):
        guard.check("r", height(place))
    for _ in range(2):
        guard.check("s", force(1.0, -12.0))
    assert guard.reason.startswith("the force is 12.1 N; it falls while the tip goes deeper")
    assert guard.reason.count("force sign = -1") == 1


def test_the_way_in_is_judged_by_where_the_tip_is_at_last(guard):
    stamps = np.arange(20, dtype=np.int64)
    for first, last in ((0.003, -0.001), (-0.001, 0.0)):  # it goes in, and out again
        guard.check("r", Batch("tip", stamps, stamps, np.linspace(first, last, 20)[:, None]))
    guard.check("s", force(1.0, -12.0))
    assert "force sign" not in guard.reason


def test_an_arm_that_cannot_retract_is_stopped():
    class Plain:
        stopped = 0

        def batches(self):
            return iter(())

        def follow(self, trajectory):
            pass

        def stop(self):
            self.stopped += 1

    guard, arm = Guard(limits(), PORTS), Plain()
    guard.trip("somebody asks")
    guard.begin({"r": arm})  # it was asked before there was an arm
    guard.close()
    assert arm.stopped


def test_without_readings_there_was_no_force():
    untouched = Guard(limits(), PORTS)
    assert (untouched.peak.tared, untouched.peak.untared) == (0.0, 0.0)


def test_the_guard_lets_pass_what_is_in_order(guard):
    guard.check("s", force(1.0, 12.9, -10.9))
    guard.check("r", height(-0.0069))
    assert guard.reason is None
    assert guard.peak.tared == pytest.approx(11.9, abs=0.02)


@pytest.mark.parametrize(
    ("units", "column", "trips"),
    [
        (("N*m", "N*m", "N*m", "N", "N", "N"), 5, True),  # torques first
        (("N*m", "N*m", "N*m", "N", "N", "N"), 3, True),  # across: a force, too
        (("N*m", "N*m", "N*m", "N", "N", "N"), 0, False),
        (("1",) * 5 + ("N", "1", "1"), 5, True),  # one of the channels of a DAQ
        (("1",) * 5 + ("N", "1", "1"), 2, False),
        (("1",) * 8, 7, True),  # nobody declared a unit: the channel that is named
        (("1",) * 8, 6, False),
    ],
)
def test_the_guard_watches_every_force_that_a_stream_declares(units, column, trips):
    stream = Stream("daq", tuple(Channel(f"c{i}", unit) for i, unit in enumerate(units)), 800.0)
    named = "N" if "N" in units else "1"
    last = len(units) - 1 - units[::-1].index(named)
    alignment = ALIGNMENT.model_validate({"force": f"s.daq.c{last}", "position": "r.tip.z"})
    guard = Guard(limits(torque=1e3), Ports.of(alignment, {"s": (stream,), "r": (TIP,)}))
    stamps = np.arange(20, dtype=np.int64)
    still = 0.5 + 1e-3 * np.random.default_rng(0).standard_normal((20, len(units)))
    guard.check("s", Batch("daq", stamps, stamps, still))
    guard.check("r", height(0.01))
    guard.judge_standstill()
    pushed = still.copy()
    pushed[-1, column] = 400.0
    guard.check("s", Batch("daq", stamps, stamps, pushed))
    assert (guard.reason is not None) == trips


def test_a_height_that_counts_downwards_keeps_its_depth_limit():
    alignment = ALIGNMENT.model_validate({"force": "s.wrench.z", "position": {"channel": "r.tip.z", "sign": -1}})
    guard = Guard(limits(), Ports.of(alignment, {"s": (WRENCH,), "r": (TIP,)}))
    guard.check("s", force(*np.linspace(0.9, 1.1, 20)))
    guard.check("r", height(-0.01))
    guard.judge_standstill()
    guard.check("r", height(-0.02))
    assert guard.reason is None
    guard.check("r", height(0.008))
    assert "the tip is at -8.00 mm, below the limit" in guard.reason


def test_a_calibration_is_limited_by_the_same_rules_as_a_run():
    wide = limits(low=(-1.0, -1.0, -1.0), high=(1.0, 1.0, 1.0))
    free, plate = CalibrationSettings().limits(contact=False), CalibrationSettings().limits(contact=True)
    assert (free.low[2], plate.low[2]) == (0.001, -0.001)
    times = np.arange(0.0, PRESS.total_duration, 1e-3)
    deep = [excess.what for excess in plate.excesses(Reach.of(times, PRESS.at(times)))]
    assert deep == ["low"]
    for table in (free, plate):
        both = table.tighter(wide.motion)
        assert both == wide.motion.tighter(table)
        assert both.speed == 0.04
        assert both.acceleration == 0.5
        assert both.low[2] == table.low[2]


NOTHING = Batch("wrench", np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)))
STILL = Batch("tip", np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 1)))
MS = 1_000_000  # [ns]


def at(batch, received):
    """The batch, as read and received at a time [ms]."""
    now = np.full(len(batch.time), received * MS)
    return replace(batch, time=now, received=now)


def test_silence_is_what_the_receiving_process_says_it_is(guard):
    """Its own stamps count: it looked, and there was nothing; how late this program asks does not matter."""
    guard.check("s", at(force(1.0), 1000), 1000 * MS)
    for looked in range(1010, 1150, 10):
        guard.check("s", NOTHING, looked * MS)
    assert guard.reason is None
    guard.check("s", NOTHING, 1170 * MS)
    guard.check("s", NOTHING, 1180 * MS)
    assert guard.reason.startswith("s.wrench.z is silent for 170 ms")  # whether the computer is busy may follow
    assert guard.arm.retracted


def test_a_program_that_comes_late_takes_no_silence_from_that(guard):
    """What came while it was held up is there, of one stream after the other."""
    guard.check("s", at(force(1.0), 1000), 1000 * MS)
    status = replace(NOTHING, stream="status", time=np.zeros(1, np.int64), values=np.zeros((1, 3)))
    for stream in ("status", "other", "third"):
        guard.check("s", at(replace(status, stream=stream), 1000), 1000 * MS)
    for stream in ("status", "other", "third"):  # 400 ms later
        guard.check("s", at(replace(status, stream=stream), 1400), 1400 * MS)
    guard.check("s", at(force(1.0), 1400), 1400 * MS)
    guard.check("s", NOTHING, 1410 * MS)
    assert guard.reason is None


def test_a_stream_that_stops_while_another_of_its_device_goes_on_is_silent(guard):
    guard.check("s", at(force(1.0), 1000), 1000 * MS)
    status = replace(NOTHING, stream="status", time=np.zeros(1, np.int64), values=np.zeros((1, 3)))
    for received in range(1010, 1200, 10):
        guard.check("s", at(status, received), received * MS)
    assert guard.reason.startswith("s.wrench.z is silent for 1")


def test_being_held_up_is_a_fault_of_its_own(guard):
    """Nobody asks the sensor's link: with or without readings, the arm must not go on unwatched."""
    guard._host._looked["s"] = time.monotonic() - 601.0
    deadline = time.monotonic() + 60
    while guard.reason is None and time.monotonic() < deadline:
        time.sleep(0.005)
    assert "this program was held up: it has not come to look at s for 601" in guard.reason
    assert "held_up = 600000 ms" in guard.reason
    assert guard.arm.retracted


def test_a_motion_that_is_done_is_no_longer_watched(guard):
    guard.ended("r")
    assert guard.state.phase == "over"
    guard.check("s", force(1.0, 400.0))
    guard.check("r", height(-0.1))
    for looked in range(1000, 2000, 10):
        guard.check("s", NOTHING, looked * MS)
    assert guard.reason is None


def test_a_stream_of_force_that_ends_while_an_arm_moves_trips(guard):
    guard.ended("s")
    assert guard.reason == "the stream of s has ended: s.wrench.z can no longer be watched"
    assert len(guard.arm.retracted) == 1
    assert guard.state.phase == "tripped"


def test_a_position_that_another_device_measures_trips_where_it_ends(guard):
    guard.stop.moving = {"another arm"}
    guard.ended("r")
    assert guard.reason == "the stream of r has ended: r.tip.z can no longer be watched"


@pytest.mark.parametrize("when", ["before the motion", "in motion"])
def test_a_stream_that_no_check_needs_may_end(guard, when):
    other = guard if when == "in motion" else Guard(limits(), PORTS)
    other.ended("camera")
    if other is not guard:
        other.begin({"r": guard.arm})
        other.close()
    assert other.reason is None
    assert other.ended_early == {"camera"}


@pytest.mark.parametrize(("device", "words"), [("s", "s.wrench.z can no longer"), ("r", "r.tip.z can no longer")])
def test_a_stream_that_ended_at_standstill_lets_no_arm_move(device, words):
    early, arm = Guard(limits(), PORTS), _Arm()
    early.ended(device)
    assert early.reason is None  # nothing moves
    early.begin({"r": arm})
    early.close()
    assert words in early.reason
    assert arm.retracted


def test_once_all_arms_are_done_nothing_is_a_fault(guard):
    guard.ended("r")
    guard.ended("s")
    guard.ended("camera")
    guard.stop.failed("s: the sensor is disconnected", "s")
    assert guard.reason is None
    assert guard.ended_early == set()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.full(50, 30.0) + np.arange(50) % 2, "standstill_force"),
        (np.arange(50) % 2 * 4.0, "standstill_noise"),
        (np.zeros(3), "gave nothing usable"),
    ],
)
def test_an_implausible_rest_is_refused_with_advice(values, words):
    guard = Guard(limits(), PORTS)
    guard.check("s", force(*values))
    guard.check("r", height(0.01))
    with pytest.raises(DeviceError, match=words):
        guard.judge_standstill()


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ((0.01, 1.0), r"times what the filter declares \(\[estimator.ekf\] force_std = 0.01 N"),
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
        guard = Guard(limits(), Ports.of(alignment, {"s": (WRENCH,), "r": (TIP, twist)}))
        guard.check("s", force(*(factor * 0.03 * noise)))
        guard.check("r", height(0.01))
        stamps = np.arange(400, dtype=np.int64)
        guard.check("r", Batch("twist", stamps, stamps, (factor * 3e-4 * noise)[:, None]))
        if refused:
            with pytest.raises(DeviceError, match=words) as caught:
                guard.judge_standstill({"ekf": told})
            assert 'set noise = "measure"' in str(caught.value)
        else:
            assert guard.judge_standstill({"ekf": told}).velocity_std == pytest.approx(2.94e-4)


def setpoints(position, velocity=None, **more):
    times = 0.002 * np.arange(len(position))
    velocity = np.gradient(position, 0.002, axis=0) if velocity is None else velocity
    return times, Setpoint(position, velocity, np.zeros(len(position), bool), **more)


def test_positions_count_as_much_as_the_stated_velocity():
    """Zero stated, and a jump of 10 mm: speed, acceleration and the contradiction are told."""
    position = np.zeros((100, 3))
    position[50:, 2] = -0.005
    report = check_setpoints(*setpoints(position, np.zeros((100, 3))), limits())
    text = "; ".join(report.problems)
    assert "the speed is 2500.0 mm/s" in text
    assert "move at 2500.0 mm/s where their stated velocity is 0.0 mm/s" in text
    assert "the acceleration is" in text
    assert report.inward_speed == pytest.approx(2.5)
    honest = PRESS.at(np.arange(0.0, PRESS.total_duration, 0.002))
    assert not check_setpoints(*setpoints(honest.position, honest.velocity), limits()).problems
    drifting = setpoints(honest.position, honest.velocity + np.array([0.0, 0.002, 0.0]))
    assert any("stated velocity" in problem for problem in check_setpoints(*drifting, limits()).problems)


def test_a_turn_of_the_tool_counts_as_speed():
    position, still = np.zeros((100, 3)), np.zeros((100, 3))
    turning = np.outer(np.full(100, np.radians(9.0)), [0.0, 0.6, 0.8])

    def turned(pace):
        angles = np.outer(np.arange(100) * 0.002 - 0.1, pace * turning[0])
        return {"rotation": angles, "angular_velocity": pace * turning}

    slow = check_setpoints(*setpoints(position, still, **turned(1), lever=0.12), limits())
    assert slow.problems == ()
    assert slow.speed == pytest.approx(np.radians(9.0) * 0.12)
    fast = check_setpoints(*setpoints(position, still, **turned(2), lever=0.5), limits())
    assert any("turns at 18.0 deg/s, over the limit of 10.0 deg/s" in problem for problem in fast.problems)
    assert any("the speed is" in problem for problem in fast.problems)


def test_the_sensor_s_delay_is_part_of_the_overshoot():
    """K (v tau + v^2/2a) with tau from the force on the skin, not from the reading."""
    late = limits(sensor_delay="10 ms")
    assert late.overshoot(0.02) - limits().overshoot(0.02) == pytest.approx(3000 * 0.02 * 0.01)
    assert late.fastest < limits().fastest


@pytest.mark.parametrize(
    ("key", "value"), [("speed", "40 m/s"), ("stiffness", "1e-6 N/mm"), ("stop_force", "12 kN"), ("orientation", 3.0)]
)
def test_limits_that_are_slips_of_the_pen(key, value):
    with pytest.raises(ValueError, match=key):
        limits(**{key: value})


def test_contact_is_felt_by_what_a_retreat_takes_away():
    rng = np.random.default_rng(0)
    noise = rng.normal(0.6, 0.05, 2000)
    assert abs(compare_readings(noise[:800], noise[800:1040], 1).change) < 0.02
    felt = compare_readings(noise[:800], noise[800:1040] - 0.05, 1)
    assert felt.change == pytest.approx(0.05, abs=0.02)
    with pytest.raises(DeviceError, match=r"touches something: s\.wrench\.z fell by 0\.0"):
        refuse_contact(felt, "s.wrench.z")
    with pytest.raises(DeviceError, match=r"rose by .*sign = -1"):
        refuse_contact(compare_readings(noise[:800], noise[800:1040] + 0.05, 1), "s.wrench.z")
    refuse_contact(replace(felt, drift=0.1), "s.wrench.z")
    assert compare_readings(noise[:800], noise[:5], 1) is None


def test_free_air_is_hardly_ever_taken_for_contact():
    """White noise, and noise through a filter of 10 readings: no false alarm in 1000."""
    rng = np.random.default_rng(1)
    for _ in range(500):
        white = rng.normal(0.0, 0.05, 1100)
        for noise in (white, np.convolve(white, np.ones(10) / 10, "valid")):
            refuse_contact(compare_readings(noise[:800], noise[-240:], 1), "f")


def test_a_preload_that_the_tare_would_hide_is_refused():
    streams = {"s": (WRENCH,), "r": (TIP,)}
    port = Ports.of(ALIGNMENT, streams)["force"]
    refuse_preload(2.0, limits(), port)
    with pytest.raises(DeviceError, match=r"could feel 29\.8 N, over force = 20 N"):
        refuse_preload(-17.8, limits(), port)
    # With a known offset the force on the skin is known: an offset is none, and a light touch is seen.
    refuse_preload(-17.8, limits(), port, -17.7)
    with pytest.raises(
        DeviceError, match=r"reads 2\.00 N at standstill, 1\.40 N from the known offset: the tip touches"
    ):
        refuse_preload(2.0, limits(), port, 0.6)


def device(channel, **facts):
    streams = (Stream("wrench", (channel,), 800.0, delay=0.003),)
    return type("Rig", (), {"streams": streams, **facts})()


def test_the_wiring_adds_its_own_delays():
    arm = device(Channel("z", "m"), own_motion=OwnMotion(0.02, 0.03, 1.0, 0.25))
    alignment = AlignmentSettings.model_validate({"force": "s.wrench.z", "position": "r.wrench.z"})
    sensor = device(Channel("z", "N", (-500.0, 500.0)), shared_streams=("wrench",))
    table = wire_safety(limits(), alignment, {"r": arm, "s": sensor})
    assert (table.sensor_delay, table.latency) == (0.003, 0.06)
    alone = device(Channel("z", "N", (-500.0, 500.0)))
    assert wire_safety(limits(), alignment, {"r": arm, "s": alone}).latency == 0.25
    stated = wire_safety(limits(sensor_delay="9 ms"), alignment, {"r": arm, "s": sensor})
    assert stated.sensor_delay == pytest.approx(0.009)
    assert not contradictions(alignment, {"r": arm, "s": sensor})


def stopped_at(guard, z=-0.002):
    guard.check("r", height(z))
    guard.check("s", force(1.0, 13.5))
    assert guard.reason.startswith("the force is 12.5 N, over the limit of 12 N")


@pytest.mark.parametrize("goes", ["on", "out", "on a little"])
def test_an_arm_that_goes_on_inwards_after_a_stop_does_not_obey(guard, goes):
    stopped_at(guard)
    for k, z in enumerate({"on": (-0.004, -0.0065), "out": (-0.003, 0.0), "on a little": (-0.004, -0.0055)}[goes]):
        guard.check("r", height(z, 0.2 * k))  # v tau + v^2/2a are 3.2 mm
    obeys = goes != "on"
    assert ("does not obey: since it was to stop, the tip has gone 4.5 mm deeper, of 4.2 mm" in guard.reason) != obeys
    assert ("PRESS THE EMERGENCY STOP: the tip moves at" in guard.reason) != obeys
    assert (guard.stop.calls_for_stop is None) == obeys
    assert isinstance(guard.error, UnstoppedArmError) != obeys
    assert guard.arm.stopped != obeys
    assert guard.stop.is_stranded != obeys


def test_an_arm_that_fails_while_it_leaves_is_a_second_fault_and_one_that_has_left_is_none(guard):
    stopped_at(guard)
    guard.stop.failed("s: the sensor is disconnected", "s")
    assert "disconnected" not in guard.reason  # it is not needed to leave
    guard.check("r", height(-0.0018, period=6e-3))
    guard.stop.failed("r: the robot is in a protective stop; unlock it.", "r")
    assert guard.stop.is_stranded
    assert (
        "; the arm was to leave, and that has failed: r: the robot is in a protective stop; unlock it. The tip stands "
        "at a height of -1.8 mm and feels 12.5 N." in guard.reason
    )


def test_an_arm_that_never_ends_its_retraction_is_said(guard):
    guard.stop.demand_rest(8.0)
    assert guard.reason is None  # nothing was stopped
    stopped_at(guard)
    guard.check("r", height(-0.002, period=6e-3))
    guard.stop.halt_late()
    assert guard.arm.stopped
    guard.stop.demand_rest(8.0)
    assert "that has failed: r: no end of its motion within 8 s. The tip stands at a height of -2.0 mm" in guard.reason
    assert guard.stop.calls_for_stop is None


def test_an_arm_that_fails_without_states_since_the_stop_is_called_out(guard, capsys):
    guard.check("r", height(-0.002, period=6e-3))  # it stood, before the stop
    guard.stop.failed("r: its process ended (killed by SIGKILL).", "r")
    call = "PRESS THE EMERGENCY STOP: no states show that the tip stands; at last it was at a height of -2.0 mm"
    assert f"killed by SIGKILL). {call}" in guard.reason
    assert capsys.readouterr().err.startswith(f"\apalpate: {call}")
    assert isinstance(guard.error, UnstoppedArmError)
    assert guard.state.calls_for_stop


def with_stamps(batch, ahead):
    return replace(batch, time=batch.time + round(1e9 * ahead))


@pytest.mark.parametrize("made", [force(1.0), height(0.01)], ids=["force", "position"])
def test_a_stamp_that_leaps_ahead_of_its_arrival_is_named(guard, made):
    device = "s" if made.stream == "wrench" else "r"
    guard.check(device, with_stamps(made, 0.3))
    guard.check(device, with_stamps(made, -4.0))  # late: no matter here
    assert guard.reason is None
    guard.check(device, with_stamps(made, 10.3))
    name = {"s": "s.wrench.z", "r": "r.tip.z"}[device]
    assert guard.reason == f"a time-stamp of {name} is 10 s ahead of its arrival, beyond all before it"


def test_clocks_that_are_apart_are_named_before_anything_moves():
    guard = Guard(limits(), PORTS)
    guard.check("s", with_stamps(force(*np.random.default_rng(0).normal(1.0, 0.05, 100)), 10.0))
    for _ in range(20):
        guard.check("r", height(0.01))
    with pytest.raises(DeviceError, match=r"of s.wrench.z are 10 s ahead of those of r.tip.z: set their clocks"):
        guard.judge_standstill()


TORQUES = Stream("wrench", (*WRENCH.channels, *(Channel(f"t{axis}", "N*m") for axis in "xyz")), 800.0)


@pytest.mark.parametrize(
    ("torque", "words"),
    [
        ((0.2, 0.0, 2.9), None),
        ((0.2, 0.0, 3.2), "the torque is 3.10 N*m, over the limit of 3 N*m that stops the motion ([safety] torque)"),
        ((-2.95, 0.0, 0.1), "the torque is 3.15 N*m"),
        ((np.nan, 0.0, 0.0), "a reading of the torque is over range or invalid"),
    ],
)
@pytest.mark.parametrize("measured", [True, False])
def test_a_torque_stops_the_motion_where_it_is_measured(torque, words, measured):
    guard = Guard(limits(), Ports.of(ALIGNMENT, {"s": (TORQUES,), "r": (TIP,)}))

    def wrench(rows):
        stamps = np.arange(len(rows), dtype=np.int64)
        torques = rows[:, 3:] if measured else np.full((len(rows), 3), np.nan)
        return Batch("wrench", stamps, stamps, np.hstack([rows[:, :3], torques]))

    rest = np.tile([0.0, 0.0, 1.0, 0.2, 0.0, 0.1], (100, 1))
    rest += 0.01 * np.random.default_rng(0).standard_normal(rest.shape)
    guard.check("s", wrench(rest - rest.mean(axis=0) + rest[:1].round(1)))
    for _ in range(20):
        guard.check("r", height(0.01))
    guard.judge_standstill()
    guard.begin({"r": (arm := _Arm())})
    guard.check("s", wrench(np.array([[0.0, 0.0, 1.5, *torque]])))
    assert (guard.reason is None) == (words is None or not measured)
    assert not (words and measured) or words in guard.reason
    assert bool(arm.retracted) == (guard.reason is not None)
    guard.close()


@pytest.mark.parametrize(
    ("saturates", "stated", "words"),
    [(False, 1e3, None), (True, 1e3, "s.wrench.z rises by"), (False, 200.0, "the stiffest material gives")],
)
def test_the_guard_of_any_arm_trips_where_the_force_disagrees_with_the_way_in(guard, saturates, stated, words):
    guard.expect_force(ExpectedForce(0.0, 1e9, stated, 0.0))
    guard.rise.begin_touches()
    rng = np.random.default_rng(2)
    for k in range(400):  # 10 mm/s into 1 N/mm
        depth = 1e-5 * k - 1e-3
        push = min(1e3 * max(depth, 0.0), 1.5 if saturates else 1e3)
        guard.check("r", at(height(-depth), 1000 + k))
        guard.check("s", at(force(*(1.0 + push + 0.05 * rng.standard_normal(4))), 1000 + k))
    assert guard.reason is None if words is None else words in guard.reason


def test_what_was_felt_while_the_arm_came_to_rest_belongs_to_the_reason(guard):
    guard.check("s", force(1.0, 14.0))
    assert guard.account == guard.reason
    guard.ended("r")
    assert guard.awaits_readings(0.0)
    guard.check("s", force(26.0))  # later readings of before
    assert guard.account == f"{guard.reason}; the force reached 25.0 N, 5.0 N over [safety] force = 20 N"
    assert guard.awaits_readings(0.5)
    guard.check("s", force(1.0))
    assert not guard.awaits_readings(0.5)


class Ending(Point):
    """A press that ends somewhere on its way out."""

    early: float = 0.0

    @property
    def total_duration(self):
        """Less than that of the press."""
        return super().total_duration - self.early


@pytest.mark.parametrize(("early", "ends"), [(0.0, None), (0.15, None), (0.8, "5.00 mm"), (1.5, "5.00 mm")])
def test_a_motion_that_ends_pressed_in_is_refused(early, ends):
    motion = Ending(bias=0.004, duration=2.0, early=early)
    height = float(motion.at(np.array([motion.total_duration])).position[0, 2])
    problems = check_motion(motion, limits()).problems
    assert any("mm below the skin, where the tip would stay" in text for text in problems) == (height < 0)
    assert (ends is None) == (height >= 0)
