"""Limits in the servo process, with the host's checks left out; judged by what the twin's arm truly did."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from palpate import DeviceError, ForceWatch, Setpoint, clock
from palpate_arms.setpoint_buffer import PERIOD
from palpate_devices.bota.device import BotaSensor
from palpate_devices.ur.command_echo import Echo
from palpate_devices.ur.device import UR
from palpate_engine.safety import SafetySettings
from palpate_simulation.twins.direct_client import DirectCommands
from palpate_trajectories.point import Point

from tests.devices.conftest import need_arm
from tests.devices.simulated_bench import PIPELINE, SHORT

WORK = {"origin": (-0.3, -0.13, 0.1)}
LIMITS = SafetySettings(
    low=(-0.005, -0.005, -0.007),
    high=(0.005, 0.005, 0.02),
    speed=0.04,
    acceleration=0.5,
    force=20.0,
    stop_force=12.0,
    stiffness=3000.0,
)
PRESS = Point(bias=0.002, amplitude=0.0005, clearance=0.003, standstill=0.0, duration=0.5)


@dataclass(frozen=True)
class Illegal:
    """Any positions, with any stated velocity."""

    positions: np.ndarray
    velocity: tuple = (0.0, 0.0, 0.0)

    @property
    def total_duration(self):
        return PERIOD * (len(self.positions) - 1)

    def at(self, time):
        row = np.clip(np.round(time / PERIOD).astype(int), 0, len(self.positions) - 1)
        stated = np.tile(np.array(self.velocity, float), (len(row), 1))
        return Setpoint(self.positions[row], stated, np.zeros(len(row), bool))


def rows(*places, count=200):
    """So many setpoints at each of some places."""
    return np.repeat(np.array(places, float), count, axis=0)


def device(twin, **changes):
    return UR.model_validate({"host": twin.host, "work": WORK, **changes})


def begun(link):
    """The batches of a link, once something is known."""
    batches = link.batches()
    seen = 0
    for batch in batches:
        seen += len(batch.time) * (batch.stream == "tip")
        if seen > 20:
            return batches
    raise AssertionError("no states")


def moved(twin, trajectory, limits=LIMITS, retreat=False, told=None, **changes):
    """Follow a trajectory by link alone: what it was stopped for, and the twin's truth; `told`: when it said so."""
    why, told = [], [] if told is None else told

    def stop(text):
        why.append(text)
        told.append(clock().now())

    with device(twin, **changes).connect(0) as link:
        batches = begun(link)
        link.limit(limits.of_an_arm, stop)
        twin.fault("mark")
        if retreat:
            link.retreat(0.5e-3, 2e-3)
        link.follow(trajectory)
        try:
            for _ in batches:
                pass
        except DeviceError as error:
            stop(str(error))
        health = link.health
    twin.wait(lambda state: state["joint_speed"] < 1e-3, 3.0)
    return " ".join(why), twin.state(), health


@pytest.mark.gate
@pytest.mark.slow
def test_a_lawful_motion_goes_through_and_keeps_its_limits(rig):
    why, truth, health = moved(rig, PRESS)
    assert why == ""
    assert truth["low"][2] == pytest.approx(-0.0025, abs=3e-4)
    assert truth["fastest_tip"] < 1.2 * LIMITS.speed
    assert truth["fastest_joint"] < np.radians(90)
    assert "own_stop" not in health


@pytest.mark.parametrize(
    ("positions", "velocity", "words"),
    [
        (rows((0, 0, 0.003), (0, 0, -0.0065)), (0, 0, 0), "setpoints move at 4750.0 mm/s"),
        (rows((0, 0, 0.003), (0, 0, -0.0075)), (0, 0, 0), "below the limit of -7 mm"),
        (rows((0.0, 0, 0.003)) + np.linspace(0, 1, 200)[:, None] * [0.006, 0, 0], (0.015, 0, 0), "x = 6.00 mm, above"),
        (rows((0.0, 0, 0.003)) - np.linspace(0, 1, 200)[:, None] * [0, 0.006, 0], (0, -0.015, 0), "y = -6.00 mm"),
        (rows((0, 0, 0.003)), (0, 0, -0.5), "state that they move at 500.0 mm/s"),
    ],
    ids=["jump", "deep", "x", "y", "stated"],
)
def test_illegal_setpoints_move_nothing(rig, positions, velocity, words):
    why, truth, health = moved(rig, Illegal(positions, velocity))
    assert words in why
    assert truth["fastest_tip"] < 1e-3
    assert words in health["own_stop"]["reason"]


@pytest.mark.parametrize("ask", [lambda link: link.follow(PRESS), lambda link: link.retreat(0.5e-3, 2e-3)])
def test_nothing_moves_before_limits_are_told(rig, ask):
    with device(rig).connect(0) as link:
        batches = begun(link)
        rig.fault("mark")
        ask(link)
        with pytest.raises(DeviceError, match="no limits were set"):
            for _ in batches:
                pass
    assert rig.state()["fastest_tip"] < 1e-3


@pytest.mark.parametrize("changes", [{"speed": float("nan")}, {"low": (0.0, 0.0, float("-inf"))}])
def test_a_limit_that_is_no_number_is_none(rig, changes):
    with device(rig).connect(0) as link:
        batches = begun(link)
        rig.fault("mark")
        link.limit(replace(LIMITS.of_an_arm, **changes), print)
        link.follow(PRESS)
        with pytest.raises(DeviceError, match="a limit is not a finite number"):
            for _ in batches:
                pass
    assert rig.state()["fastest_tip"] < 1e-3


def test_a_joint_that_would_be_too_fast_ends_the_motion(rig):
    why, truth, _ = moved(rig, PRESS, joint_speed="2 deg/s")
    assert "over 2 deg/s ([device.*] joint_speed)" in why
    assert truth["fastest_joint"] < np.radians(3.0)


@pytest.mark.parametrize("asked", [True, False])
def test_a_singular_posture_is_no_place_to_move(simulated, monkeypatch, asked):
    """An elbow that is stretched: joints that cancel one another out would drive the tip astray as one of them lags."""
    frame = {"origin": (-0.3, -0.25, 0.2), "rotation": (np.radians(-30.0), 0.0, 0.0)}
    sets = [f"twin.bench.work.{key}={[f'{x} {unit}' for x in frame[key]]}" for key, unit in
            (("origin", "m"), ("rotation", "rad"))]  # fmt: skip
    if not asked:  # the host's own check left out
        monkeypatch.setattr("palpate_arms.arm_approach.is_singular", lambda jacobian: False)
    twin = simulated(*SHORT, *sets)
    why, truth = [], {}
    with device(twin, work=frame).connect(0) as link:
        batches = begun(link)
        link.limit(LIMITS.of_an_arm, why.append)
        twin.fault("mark")
        try:
            link.follow(PRESS)
            for _ in batches:
                pass
        except DeviceError as error:
            why.append(str(error))
        clock().sleep(0.1)  # a refusal takes no simulated time: what comes of it does
        truth = twin.state()
    assert "near a singular posture" in why[0]
    assert truth["fastest_tip"] < 0.01
    assert np.ptp([truth["low"], truth["high"]], axis=0).max() < 1e-4


def test_links_out_of_their_box_end_the_motion(rig):
    why, truth, _ = moved(rig, PRESS, links_low=("-2 m", "-2 m", "0.3 m"))
    assert "out of the box of [device.*] links_low" in why
    # It holds where it is, by a pose with noise: it trembles, and goes nowhere.
    assert np.ptp([truth["low"], truth["high"]], axis=0).max() < 1e-4


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        ((8.0, 0.0, 0.0), "turned by 8.0 deg"),
        ((0.0, 0.0, 90.0), 'work.turn = "90.0 deg" it would be off by 0.0 deg'),
    ],
)
def test_a_tool_that_looks_elsewhere_is_refused_before_anything_moves(simulated, turn, words):
    twin = simulated(*SHORT, f"twin.bench.tool_rotation={[f'{x} deg' for x in turn]}")
    with pytest.raises(DeviceError, match="orientation = 5 deg") as caught:
        moved(twin, PRESS)
    assert words in str(caught.value)
    assert twin.state()["fastest_joint"] < 1e-6
    # By the servo process as well, where the host does not look.
    with device(twin).connect(0) as link:
        batches, why = begun(link), []
        link.limit(LIMITS.of_an_arm, why.append)
        link._limits = None
        link.follow(PRESS)
        for _ in batches:
            pass
    assert "off the work frame, over 5 deg" in why[0]
    assert twin.state()["fastest_joint"] < np.radians(1.0)  # it holds where it is, by a pose with noise


@pytest.mark.gate
@pytest.mark.slow
def test_a_small_turn_is_made_slowly_on_the_way_about_the_tip(simulated):
    twin = simulated(*SHORT, 'twin.bench.tool_rotation=["3 deg", "-2 deg", "1 deg"]')
    why, truth, health = moved(twin, PRESS, retreat=True)
    assert why == ""
    assert truth["fastest_turn"] < 1.05 * LIMITS.angular_speed
    assert truth["fastest_tip"] < 1.2 * LIMITS.speed
    assert truth["fastest_joint"] < np.radians(30)
    assert max(map(abs, (*truth["low"][:2], *truth["high"][:2]))) < 0.1e-3  # the tip stays where it is
    assert health["tool_off_by_deg"] < 0.1


SLOW = Point(bias=0.006, amplitude=0.0005, clearance=0.003, standstill=0.0, duration=0.5, speed=0.01)


def moved_into(twin, fault, **changes):
    """A motion at 10 mm/s into which a fault comes at 0.5 mm deep.

    Why it ended, the truth, the height at the fault, and how long [s] after it the end was told (0 if it never was).
    """
    heights, times, told, over = [], [], [], []

    def make():
        found = twin.wait(lambda state: over or state["height"] < -0.0005)["height"]
        if not over:
            heights.append(found)
            times.append(twin.fault(fault))

    thread = clock().thread(make, "fault")
    thread.start()
    why, truth, _ = moved(twin, SLOW, told=told, **changes)
    over.append(True)
    thread.join()
    assert heights, f"the motion ended before the fault: {why}"
    return why, truth, heights[0], told[0] - times[0] if told else 0.0


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words", "delay"),
    [
        ("stuck-pose", "does not change in any digit", 0.026),
        ("jam", "has moved by|does not follow", 0.062),
        ("nan-pose", "pose or joints are not numbers", 0.002),
        ("short-states 200", "^ur at .*: the controller sends states of 1 bytes in place of 17: .*", 0.002),
        ("short-states 120", "^ur at .*: the controller sends states of 1 bytes in place of 17: .*", 0.002),
        ("short-states 16", "^ur at .*: the controller sends states of 1 bytes in place of 17: .*", 0.002),
        ("mute-control", "the control link is lost|program was stopped", 0.152),
    ],
)
def test_what_the_robot_says_is_doubted(rig, fault, words, delay):
    """In motion at 0.5 mm deep: told with its cause after a known delay [s], and the arm goes hardly further."""
    why, truth, height, after = moved_into(rig, fault)
    assert re.search(words, why), why
    assert after == pytest.approx(delay, abs=2e-3)
    assert truth["low"][2] > height - 0.0005
    assert truth["fastest_tip"] < 1.2 * LIMITS.speed


@pytest.mark.gate
@pytest.mark.slow
def test_what_a_lost_link_holds_back_is_never_carried_out(rig):
    """Not even half a second later, when the network delivers again; the watchdog is far too slow to help."""
    why, _, height, after = moved_into(rig, "half-open 0.6", watchdog="1 Hz")
    clock().sleep(0.7)
    truth = rig.wait_at_rest()
    assert "the control link is lost" in why
    assert after == pytest.approx(0.104, abs=2e-3)
    assert truth["low"][2] > height - 0.0007
    assert truth["fastest_tip"] < 0.8 * LIMITS.speed  # its own way down has 0.4 of it


def test_nor_what_sockets_hold_back_from_the_real_client(restored):
    """The real client, whose commands wait in the kernel's buffers; it needs the wall clock: it has its own threads."""
    need_arm()
    patient = {"controller_timeout": 5.0, "watchdog": 1.0, "host_timeout": 10.0, "start": 60.0}
    why, _, height, _ = moved_into(restored, "half-open 0.6", **patient)
    clock().sleep(0.7)
    truth = restored.wait_at_rest()
    assert "the control link is lost" in why
    assert truth["low"][2] > height - 0.0007
    assert truth["fastest_tip"] < 0.8 * LIMITS.speed


@pytest.mark.gate
@pytest.mark.slow
def test_a_link_that_is_held_up_for_a_moment_is_none_that_is_lost(rig):
    """What lands at once is the way of a few periods: the command waits where the controller does not take it."""
    why, truth, _, _ = moved_into(rig, "half-open 0.06")
    assert why == ""
    assert truth["low"][2] == pytest.approx(-0.0065, abs=3e-4)
    assert truth["fastest_tip"] < LIMITS.speed


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words", "leaves"),
    [
        ("slider 0.6", "the speed slider was moved to 60 %; set it to 100 % on the pendant", True),
        ("slider 0", "the speed slider was moved to 0 %", False),
        (
            "speed-scaling 0.6",
            "the controller slows the arm to 60 % to keep its own limits of speed, force or power",
            True,
        ),
        ("reduced", "the robot has changed to reduced mode", True),
        ("robot-mode 6", "the robot is BACKDRIVE, not RUNNING", False),
    ],
)
def test_a_robot_that_is_not_at_full_speed_any_more_ends_the_motion(rig, fault, words, leaves):
    why, truth, height, after = moved_into(rig, fault)
    assert why.startswith((words, f"ur at {rig.host}: {words}"))
    assert after < 0.01
    assert truth["low"][2] > height - 0.0005
    assert (truth["height"] > 0.002) is leaves
    assert truth["fastest_tip"] < 1.2 * LIMITS.speed


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("slider 0.6", "the speed slider is at 60 %; set it to 100 % on the pendant"),
        ("speed-scaling 0.9", "the controller slows the arm to 90 % to keep its own limits"),
        ("robot-mode 5", "the robot is IDLE, not RUNNING"),
    ],
)
def test_a_robot_that_is_not_at_full_speed_does_not_begin(rig, fault, words):
    rig.fault(fault)
    with pytest.raises(DeviceError, match=re.escape(words)):
        rig.run()
    assert rig.state()["fastest_joint"] < 1e-6


@pytest.mark.gate
@pytest.mark.slow
def test_reduced_mode_alone_is_no_fault(rig):
    rig.fault("reduced")
    why, truth, _ = moved(rig, PRESS)
    assert why == ""
    assert truth["low"][2] == pytest.approx(-0.0025, abs=3e-4)


@pytest.mark.gate
@pytest.mark.slow
def test_a_retraction_waits_for_a_controller_that_says_nothing_and_does_not_leap(rig):
    """Who does not hear it may not hear what it says: commands on a lost link come all at once when it is back."""
    with device(rig, controller_timeout="1 s", watchdog="1 Hz").connect(0) as link:
        batches = begun(link)
        link.limit(LIMITS.of_an_arm, print)
        heights = []

        def make():
            rig.wait(lambda state: state["height"] < 0.0005)
            rig.fault("freeze")
            clock().sleep(0.05)
            link.retract()
            for _ in range(2):
                clock().sleep(0.2)
                heights.append(rig.state()["height"])
            rig.fault("thaw")

        rig.fault("mark")
        thread = clock().thread(make, "fault")
        thread.start()
        link.follow(Point(bias=0.006, amplitude=0.0005, clearance=0.003, standstill=0.0, duration=0.5, speed=0.01))
        for _ in batches:
            pass
        thread.join()
        state = rig.wait(lambda state: state["height"] > 0.003)
        assert state["fastest_tip"] < 1.2 * LIMITS.speed
        assert heights[0] == pytest.approx(heights[1], abs=1e-5)
        assert heights[0] < 0.001


@pytest.mark.gate
@pytest.mark.slow
def test_it_waits_while_the_sensor_says_nothing(simulated):
    twin = simulated(*SHORT)
    sensor = BotaSensor.model_validate({"port": str(twin.port), "settle": "0.1 s", "sensor_timeout": "20 s"})
    slow = Point(bias=0.004, amplitude=0.001, clearance=0.003, standstill=0.0, duration=0.5, speed=0.01)
    with sensor.connect(0) as force, device(twin).connect(0) as link:
        batches = begun(link)
        link.limit(LIMITS.of_an_arm, print)
        link.watch_force(ForceWatch(force.shared("wrench"), (0, 1, 2), (0.0, 0.0, 0.0), 12.0, "sensor.wrench.z"))
        link.follow(slow)
        twin.wait(lambda state: state["height"] < 0.001)
        twin.fault("silent")
        clock().sleep(0.2)
        before = twin.state()["height"]
        clock().sleep(0.5)  # in which it would go 5 mm
        assert twin.state()["height"] == pytest.approx(before, abs=1e-5)
        twin.fault("sound")
        for _ in batches:
            pass
        assert "own_stop" not in link.health
    assert twin.state()["low"][2] == pytest.approx(-0.005, abs=3e-4)


def already_open(*_):
    """What the client library says of a link that was reset while it connects again."""
    raise RuntimeError("open: Already open")


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "name", "answer", "words"),
    [
        (Echo, "number", lambda *_: 40.001, r"its driver's `\w+` failed: ValueError: The value is not within \[0;40\]"),
        (DirectCommands, "servoL", already_open, r"the control link is lost: .*\(open: Already open\)"),
    ],
)
def test_an_error_in_the_servo_loop_stops_the_arm_and_is_told(simulated, monkeypatch, where, name, answer, words):
    """Whatever the client library, or we, did not expect."""
    twin = simulated(*SHORT)
    slow = Point(bias=0.004, amplitude=0.001, clearance=0.003, standstill=0.0, duration=0.5, speed=0.01)
    with device(twin).connect(0) as link:
        batches = begun(link)
        link.limit(LIMITS.of_an_arm, print)
        link.follow(slow)
        twin.wait(lambda state: state["height"] < 0.001)
        monkeypatch.setattr(where, name, answer)
        with pytest.raises(DeviceError, match=words):
            list(batches)
    clock().sleep(0.1)
    before = twin.state()["height"]
    clock().sleep(0.5)
    assert twin.state()["height"] == pytest.approx(before, abs=1e-6)
    assert before > -0.004


@pytest.mark.gate
@pytest.mark.slow
def test_the_force_stops_it_although_nobody_of_the_host_looks(simulated, force_limit):
    """The job reads nothing for as long as the motion takes: the servo process reads the sensor by itself."""
    twin = simulated(*SHORT, "twin.bench.specimen.elasticity=2.25 MPa", "twin.bench.specimen.viscosity=7240 Pa*s")
    sensor = BotaSensor.model_validate({"port": str(twin.port), "settle": "0.1 s"})
    deep = Point(bias=0.004, amplitude=0.001, clearance=0.003, standstill=0.0, duration=1.0)
    with sensor.connect(0) as force, device(twin).connect(0) as link:
        batches, why = begun(link), []
        rest = np.concatenate([b.values for b, _ in zip(force.batches(), range(60), strict=False)
                               if b.stream == "wrench"])  # fmt: skip
        link.limit(LIMITS.of_an_arm, why.append)
        tare = tuple(rest[:, :3].mean(axis=0).tolist())
        link.watch_force(ForceWatch(force.shared("wrench"), (0, 1, 2), tare, 12.0, "sensor.wrench.z"))
        link.follow(deep)
        state = twin.wait(lambda state: state["peak_force"] > 12.0)
        state = twin.wait(lambda state: state["height"] > 0.002)
        for _ in batches:
            pass
        assert "over the limit of 12 N that stops the motion" in link.health["own_stop"]["reason"]
    assert state["peak_force"] < force_limit.bound(2.25e6, 0.0165)
    assert state["fastest_tip"] < 1.2 * LIMITS.speed


def test_payload_tool_and_model_are_told(simulated):
    twin = simulated(*SHORT, 'twin.bench.tcp_rotation=["0 deg", "0 deg", "45 deg"]', "twin.bench.robot=ur5e")
    found = []
    for changes in ({}, {"payload": "0.35 kg", "payload_centre": ["0 mm", "0 mm", "40 mm"]}):
        with device(twin, **changes).connect(0) as link:
            begun(link)
            found.append(link.health)
    assert found[0]["model"] == "ur5e"
    assert found[0]["payload"] == 0.0
    assert found[1]["payload"] == pytest.approx(0.35)
    assert found[0]["tool_off_by_deg"] < 0.1  # the pendant's turn of the tool is kept
    with (
        pytest.raises(DeviceError, match=r"from where the joints of a ur3e put it"),
        device(twin, model="ur3e").connect(0),
    ):
        pass


@pytest.mark.gate
@pytest.mark.slow
def test_looking_leaves_a_running_program_alone(rig):
    with device(rig).connect(0) as link:
        batches = begun(link)
        before = rig.state()["uploads"]
        with device(rig).observe(0) as other:
            begun(other)
            place, facts = other.approach_path(PRESS)[1].position[0], other.health
        assert rig.state()["uploads"] == before
        assert place[2] == pytest.approx(0.004, abs=1e-4)
        assert facts["tool_off_by_deg"] < 0.1
        link.limit(LIMITS.of_an_arm, print)
        link.follow(PRESS)  # it still commands
        began = clock().now()
        for _ in batches:
            pass
        assert clock().now() - began > PRESS.total_duration
    assert rig.state()["low"][2] < -0.002


def test_a_retreat_needs_room(rig):
    with device(rig).connect(0) as link:
        begun(link)
        link.limit(LIMITS.model_copy(update={"high": (0.005, 0.005, 0.004)}).of_an_arm, print)
        with pytest.raises(DeviceError, match="no room for the retreat"):
            link.retreat(0.5e-3, 2e-3)


def refused(twin, *overrides):
    with pytest.raises(DeviceError) as caught:
        twin.run('run.tracks=["dr/ekf"]', *overrides, out=f"out{len(overrides)}")
    return str(caught.value)


@pytest.mark.gate
@pytest.mark.slow
def test_a_preload_is_refused_whatever_the_tare_hides(simulated):
    """The tip 5 mm deep at the start, 17 N on the skin: by its size, by its sum, by a retreat; never pressed deeper."""
    twin = simulated(*SHORT, "twin.bench.height=-5 mm", "twin.bench.specimen.elasticity=366 kPa")
    assert "over [safety] standstill_force = 5 N" in refused(twin)
    before = twin.state()
    assert "over force = 20 N" in refused(twin, "safety.standstill_force=50 N")
    many = ("safety.standstill_force=50 N", "safety.force=60 N")
    assert "the tip touches something: sensor.wrench.z fell by" in refused(twin, *many)
    after = twin.state()
    assert after["low"][2] > -0.00502
    assert after["peak_force"] < before["peak_force"] + 0.1


@pytest.mark.gate
@pytest.mark.slow
def test_a_light_touch_is_felt(simulated):
    twin = simulated(*SHORT, "twin.bench.height=0.1 mm")  # the skin is at 0.3 mm
    assert "the tip touches something" in refused(twin)
    assert twin.state()["low"][2] > 0.00008


@dataclass(frozen=True)
class Swing:
    """Down and up in free air at a peak speed [m/s] just below its limit, from a second on."""

    peak: float
    total_duration: float = 3.0
    frequency = 1.5  # [Hz]

    def at(self, time):
        time = np.clip(np.asarray(time, float), 0.0, self.total_duration)
        angle, part = 2 * np.pi * self.frequency * time, np.clip(time, 0.0, 1.0)
        rise, rate = part**2 * (3 - 2 * part), 6 * part * (1 - part)
        swing = self.peak / (2 * np.pi * self.frequency)
        position, velocity = np.zeros((len(time), 3)), np.zeros((len(time), 3))
        position[:, 2] = 0.008 + swing * rise * np.cos(angle)
        velocity[:, 2] = swing * rate * np.cos(angle) - self.peak * rise * np.sin(angle)
        return Setpoint(position, velocity, np.zeros(len(time), bool))


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("control", ["servo", "pd"])
@pytest.mark.parametrize("held", [0.003, 0.005, 0.009, 0.06])
def test_a_controller_that_stops_listening_makes_no_two_steps_in_one_tick(rig, held, control):
    """All along a motion near its limit; at 1.36 times its speed the tip was, where two full steps came at once."""
    limits = LIMITS.model_copy(update={"acceleration": 3.0, "stop_force": 30.0, "force": 100.0})
    over = []

    def hold_back():
        rig.wait(lambda state: state["tip_speed"] > 0.8 * LIMITS.speed)
        while not over:
            rig.fault(f"half-open {held}")
            clock().sleep(held + 0.0431)

    clock().thread(hold_back, "hold back").start()
    why, truth, _ = moved(rig, Swing(0.98 * LIMITS.speed), limits, control=control)
    over.append(True)
    assert why == ""
    assert 0.85 * LIMITS.speed < truth["fastest_tip"] < 1.2 * LIMITS.speed


@pytest.mark.slow
@pytest.mark.parametrize(("leap", "goes_on"), [(1.0, True), (-1.0, True), (2.0, False), (-2.0, False)])
def test_a_pose_that_leaps_less_than_the_tracking_moves_the_arm_by_as_much_and_no_number_is_good(rig, leap, goes_on):
    """In contact, and [mm]: what stays unseen of a lying pose stands in the safety case; 4.78 mm deep is the plan."""
    deepest = -4.78e-3 - 1e-3 * leap  # [m] the heights of poses that are a millimetre too high are met deeper
    made = []

    def lie():
        while not made:
            if rig.state()["height"] < -0.002:
                made.append(rig.fault(f"pose-offset 0 0 {leap}"))
            clock().sleep(0.01)

    thread = clock().thread(lie, "lie")
    thread.start()
    if not goes_on:
        with pytest.raises(DeviceError, match=r"the arm does not follow: it is 2\.\d+ mm from its command, over 1\.98"):
            rig.run()
        assert rig.truth.low[2] > -3e-3  # it stands where it was
    else:
        tracks = rig.run().tracks
        assert rig.truth.low[2] == pytest.approx(deepest, abs=2e-5)
        assert all(track.verdict == "doubtful" for track in tracks.values())
    thread.join()
    assert made
    assert "or leaps by 1 mm" in (PIPELINE.parents[1] / "docs" / "safety-case.md").read_text()
