"""The handshake: an arm whose poses and commands are of different frames, judged by where its tip truly goes."""

import importlib
import math
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from palpate import RETREAT, RETREAT_SPEED, ArmLimits, DeviceError, clock
from palpate_arms.arm_state import ArmState
from palpate_arms.echoed_pose import echo_delay, last_digit
from palpate_arms.handshake import Handshake, target_problem
from palpate_arms.handshake_path import StatedArm, outward_path, sideways_path
from palpate_arms.obedience import Obedience
from palpate_arms.servo import Commander
from palpate_arms.servo_law import own_law, straight_path
from palpate_arms.station_plane import LEVEL
from palpate_arms.tracking_error import TrackingError
from palpate_kit.kinematics.rotations import matrix_of, pose_of
from palpate_testing import simulated_time
from palpate_trajectories.raster import Raster

from tests.devices.simulated_bench import PIPELINE, SHORT
from tests.devices.software_arms import NAME, WORK, listen, unlike, use

SAFETY_CASE = Path(__file__).parents[2] / "docs" / "safety-case.md"
LIMITS = ArmLimits((-0.02,) * 3, (0.02,) * 3, speed=0.04, acceleration=0.5, orientation=0.1, angular_speed=0.2)
PRESS = {"bias": 0.001, "amplitude": 1e-4, "frequency": 4.0, "clearance": 0.003}
RASTER = Raster(size=(0.006, 0.003), pitch=0.003, speed=0.005, press=PRESS)


def first_motion(device, software, trajectory=None):
    """How far and how fast the tip truly went from rest, where it ended, how long it took, and what was said."""
    places = []
    with simulated_time(), device.connect(0) as link:
        said = listen(link)
        clock().sleep(0.3)
        arm = software.SoftwareArm.made[-1]
        link.limit(LIMITS, said.append)
        if trajectory is None:
            duration = link.retreat(RETREAT, RETREAT_SPEED)
        else:
            link.follow(trajectory)
            duration = 2.0
        began = clock().now()
        while clock().now() < began + duration + 0.3:
            places.append(arm.place_now())
            clock().sleep(0.001)
        health, words = link.health, "; ".join(said)
    places = np.array(places)
    speed = np.linalg.norm(places[2:] - places[:-2], axis=1).max() / 0.002
    way = places - places[0]
    farthest = np.linalg.norm(way, axis=1).max()
    return SimpleNamespace(said=words, way=way, farthest=farthest, speed=speed, took=duration, health=health)


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("offset", ["0 0 -4", "0 0 4", "4 0 0"])
def test_commands_in_another_frame_than_the_target_move_nothing(rig, offset):
    rig.fault(f"pose-offset {offset}")
    begin = rig.state()
    with pytest.raises(DeviceError, match=r"its controller's target is 4.0\d mm from the pose that it reports"):
        rig.run()
    assert rig.world.truth.facts()["fastest_tip"] == 0.0
    assert rig.state()["pose"] == begin["pose"]


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("offset", ["0 0 -4", "0 0 4", "0 0 -0.5"])
def test_commands_in_another_frame_move_the_arm_at_most_by_what_the_frames_are_apart(rig, offset):
    """4 mm low: 312 mm/s of 40 and 48.3 N of 20 before."""
    rig.fault(f"frame-offset {offset}")
    begin = rig.world.position.copy()
    with pytest.raises(
        DeviceError, match=r", when it was commanded to stay where it is \(are its commands of the flange"
    ):
        rig.run()
    facts = rig.world.truth.facts()
    reached = np.maximum(np.array(facts["high"]) - begin, begin - np.array(facts["low"]))
    assert np.linalg.norm(reached) < 0.25e-3
    assert facts["fastest_tip"] < LIMITS.speed * 1.1
    assert rig.truth.force < 0.01


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("rate", [250, 125])
@pytest.mark.parametrize("standstill", [0.2, 0.202, 0.204, 0.206])
def test_however_seldom_states_come_the_first_command_acts_for_one_period(rig, rate, standstill):
    """With 250 states a second the arm leapt by 0.6 mm at 74 mm/s in two periods before, or in one, as it happened."""
    rig.fault("frame-offset 0 0 4")
    rig.fault(f"state-rate {rate}")
    begin = rig.world.position.copy()
    with pytest.raises(DeviceError, match=", when it was commanded to stay where it is"):
        rig.run(f"safety.standstill={standstill} s")
    facts = rig.world.truth.facts()
    reached = np.maximum(np.array(facts["high"]) - begin, begin - np.array(facts["low"]))
    assert np.linalg.norm(reached) < 0.25e-3
    assert 0.0 < facts["fastest_tip"] < LIMITS.speed * 1.1


@pytest.mark.parametrize(
    ("period", "ages"), [(0.002, (0, 1, 2)), (0.004, (1, 2, 3, 4)), (0.008, (5, 6, 7, 8, 9)), (0.01, (7, 8, 9, 10, 11))]
)
def test_the_first_command_comes_a_period_before_a_state(period, ages):
    """Ages [ms] of the latest state at which it is sent."""
    robot = SimpleNamespace(
        driver=SimpleNamespace(target=lambda: None),
        motion_state=ArmState(np.zeros(3), np.zeros(3), np.eye(3), [], True),
        target_of=lambda place: place,
        seen=0,
        state_period=period,
    )
    obedience = Obedience(robot, SimpleNamespace(give=0.0), {}, gives_way=False)
    commander = Commander(own_law(RETREAT_SPEED, 0.5), np.zeros(3))
    assert not obedience.must_wait(0)  # nothing is commanded
    assert obedience.retreat(commander, RETREAT, RETREAT_SPEED) is None
    assert tuple(age for age in range(30) if not obedience.must_wait(1_000_000 * age)) == ages
    waits = [obedience.must_wait(0) for _ in range(100)] if period > 0.002 else [False]
    assert sum(waits) < 50  # states that come faster than before
    assert not waits[-1]
    obedience.note_command(np.zeros(3))
    assert not any(obedience.must_wait(1_000_000 * age) for age in range(30))


def flange_for_tip(base):
    """It takes a pose of the tip for one of the flange: 120 mm off."""
    return unlike(base, go_to=lambda self, pose: base.go_to(self, pose_of(matrix_of(pose) @ self.tool)))


def changed(base, change):
    """It takes the way from the first command for another one."""

    def go_to(self, pose):
        self.first = getattr(self, "first", pose)
        way = change(np.array(pose[:3]) - self.first[:3])
        return base.go_to(self, [*(np.array(self.first[:3]) + way).tolist(), *pose[3:]])

    return unlike(base, go_to=go_to)


def matrix(*rows):
    return lambda base: changed(base, lambda way: np.array(rows) @ way)


def turned(base):
    """It takes a rotation vector for one in other units."""
    return unlike(base, go_to=lambda self, pose: base.go_to(self, [*pose[:3], *(0.95 * np.array(pose[3:])).tolist()]))


X, Y, Z = np.eye(3)
STAY = (
    r"the arm moved by [\d.]+ mm, at \d+ mm/s, when it was commanded to stay where it is \(are its commands of the fl"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words", "farthest"),
    [
        (flange_for_tip, STAY, 24e-3),  # 12 mm in each of its ticks, until a state shows it
        (turned, r"the tool turned by \d", 12e-3),
        (matrix(X, Y, -Z), "and has moved by 0.0. mm the other way .is the sign of an axis reversed", 0.06e-3),
        (matrix(Z, Y, X), "in the work frame .are the axes of its commands those of its poses", 0.21e-3),
        (matrix(X, Y, 1e3 * Z), "are its commands in other units than its poses", 5e-3),
        (matrix(X, Y, 2 * Z), "are its commands in other units than its poses", 0.45e-3),
        (matrix(X, Y, 0 * Z), "does it take commands", 1e-5),
    ],
)
def test_a_driver_with_a_mistake_is_refused_with_its_likely_cause(mine, software, monkeypatch, fault, words, farthest):
    """A tip that was 120 mm off went at 5.95 m/s before."""
    use(monkeypatch, software, fault(software.SoftwareArm))
    done = first_motion(mine[0].Arm(host="127.0.0.1", work=WORK), software)
    assert re.search(words, done.said), done.said
    assert done.farthest < farthest


@pytest.mark.slow
def test_how_far_an_arm_goes_whose_frames_are_120_mm_apart_is_stated(mine, software, monkeypatch):
    """Also one on a spring: it may move by what it gives way to, and not by that."""

    class Soft(mine[0].Arm):
        @property
        def controller_stiffness(self):
            return 2500.0

    use(monkeypatch, software, flange_for_tip(software.SoftwareArm))
    for kind in (mine[0].Arm, Soft):
        software.SoftwareArm.made.clear()
        done = first_motion(kind(host="127.0.0.1", work=WORK), software)
        assert re.search(STAY, done.said), done.said
        assert done.farthest == pytest.approx(11.9e-3, abs=0.1e-3)
    assert "120 mm apart, joints without limits: 11.9 mm in one tick" in SAFETY_CASE.read_text()


@pytest.mark.slow
@pytest.mark.parametrize("fault", [matrix(-X, Y, Z), matrix(X, -Y, Z), matrix(Y, X, Z), matrix(-X, -Y, Z)])
def test_before_a_raster_lateral_axes_are_shown(mine, software, monkeypatch, fault):
    use(monkeypatch, software, fault(software.SoftwareArm))
    device = mine[0].Arm(host="127.0.0.1", work=WORK)
    done = first_motion(device, software, RASTER)
    assert "the other way" in done.said or "are the axes of its commands" in done.said, done.said
    assert np.abs(done.way[:, :2]).max() < 0.35e-3
    assert done.way[:, 2].min() > -1e-5


@pytest.mark.slow
def test_a_sound_arm_shows_its_axes_and_goes_on(mine, software):
    device = mine[0].Arm(host="127.0.0.1", work=WORK)
    done = first_motion(device, software, RASTER)
    assert not done.said
    assert done.farthest > 1e-3
    assert [round(1e3 * answer["commanded"], 2) for answer in done.health["handshake"]] == [
        0,
        0.05,
        0.2,
        0.5,
        0,
        0.3,
        0.42,
    ]


@pytest.mark.slow
def test_each_connection_has_one_handshake_and_later_retreats_are_as_before(mine, software):
    device, answers = mine[0].Arm(host="127.0.0.1", work=WORK), []
    for _ in range(2):
        with simulated_time(), device.connect(0) as link:
            said = listen(link)
            clock().sleep(0.3)
            link.limit(LIMITS, said.append)
            durations = []
            for _ in range(2):
                durations.append(link.retreat(RETREAT, RETREAT_SPEED))
                clock().sleep(durations[-1] + 0.1)
                answers.append(len(link.health["handshake"]))
            usual = straight_path(np.zeros(3), RETREAT * Z, own_law(RETREAT_SPEED, device.acceleration)).times[-1]
        assert said == []
        assert durations[1] == pytest.approx(usual, abs=0.03)
        assert durations[0] > durations[1]
    assert answers == [4, 4, 4, 4]  # to stay and three steps, of each connection


@pytest.mark.slow
def test_a_tip_in_contact_makes_no_sidestep(simulated, tmp_path):
    """Before a raster: only a tip that has shown that it is free goes across."""
    text = PIPELINE.read_text()
    begin, end = text.index("[trajectory.press]"), text.index("[alignment]")
    motion = 'type = "raster"\nsize = ["2 mm", "1 mm"]\npitch = "1 mm"\nspeed = "4 mm/s"\nsettle = "0.2 s"\n'
    motion += 'press = { bias = "1 mm", amplitude = "0.1 mm", frequency = "8 Hz", clearance = "3 mm" }\n'
    (tmp_path / "raster.toml").write_text(f"{text[:begin]}[trajectory.press]\n{motion}\n{text[end:]}")
    sets = [entry for entry in SHORT if "trajectory" not in entry and "height" not in entry]
    rig = simulated(*sets, "twin.bench.height=-1 mm", pipeline=tmp_path / "raster.toml")
    rig.fault("mark")
    with pytest.raises(DeviceError, match="the tip touches something"):
        rig.run()
    assert np.subtract(rig.truth.high, rig.truth.low)[:2].max() < 0.05e-3
    assert rig.truth.high[2] > -0.7e-3  # it did retreat


def rounded(place, digit, cut=False):
    """A place in the last digit [m] of a controller; 0: in all of them."""
    return [digit * (math.floor if cut else round)(x / digit) for x in place] if digit else list(place)


def report(monkeypatch, place):
    """Let the driver report another place of the tip, made of the true one and of past commands with their times."""
    driver = importlib.import_module(f"{NAME}.driver").Driver
    read, send, past = driver.read, driver.send, []

    def sent(self, pose):
        past.append((clock().now(), pose[:3]))
        return send(self, pose)

    def reported(self):
        if (reading := read(self)) is None:
            return None
        pose = pose_of(self.model.tip(list(reading.joints), self.tool)[0])
        return replace(reading, pose=[*place(pose[:3], past), *pose[3:]])

    monkeypatch.setattr(driver, "send", sent)
    monkeypatch.setattr(driver, "read", reported)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("late", "digit", "cut"),
    [(0, 0, False), (0.02, 0, False), (0.011, 0, False), (0, 1e-6, False), (0.021, 1e-5, False), (0.02, 1e-6, True)],
)
def test_poses_that_are_commands_are_refused_however_late_and_rounded(mine, software, monkeypatch, late, digit, cut):
    def echo(place, past):
        due = [command for time, command in past if time <= clock().now() - late]
        return rounded((due or [place])[-1], digit, cut)

    report(monkeypatch, echo)
    done = first_motion(mine[0].Arm(host="127.0.0.1", work=WORK), software)
    assert re.search("is its command, in every digit", done.said), done.said
    assert done.farthest < RETREAT + 0.05e-3


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.15, 0.3])
def test_states_that_are_late_from_the_start_are_named_as_a_cause(mine, software, monkeypatch, late):
    driver = importlib.import_module(f"{NAME}.driver").Driver
    read, past = driver.read, []

    def read_late(self):
        if (reading := read(self)) is not None:
            past.append((clock().now(), reading))
        due = [reading for time, reading in past if time <= clock().now() - late]
        return (due or [past[0][1]])[-1] if past else None

    monkeypatch.setattr(driver, "read", read_late)
    done = first_motion(mine[0].Arm(host="127.0.0.1", work=WORK), software)
    assert "do its states come late?" in done.said, done.said
    assert done.farthest < RETREAT + 0.05e-3


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.005, 0.02, 0.1])
@pytest.mark.parametrize("digit", [0, 1e-6, 1e-5])
def test_a_lag_alone_or_no_scatter_is_no_reason(mine, software, monkeypatch, lag, digit):
    monkeypatch.setattr(software, "JITTER", 0.0)
    monkeypatch.setattr(software, "LAG", lag)
    report(monkeypatch, lambda place, past: rounded(place, digit))
    done = first_motion(mine[0].Arm(host="127.0.0.1", work=WORK, lag=lag), software)
    assert not done.said
    assert done.way[-1, 2] == pytest.approx(RETREAT, abs=0.03e-3)


def on_a_spring(friction):
    """Masses on springs in the joints, damping ratio 0.3, held back by dry friction, as it were, of so much [m]."""

    def made(base):
        def advance(self):
            omega = 30.0  # [1/s]
            while self.now + 0.002 <= clock().now():
                self.now += 0.002
                pull = omega**2 * (self.target - self.q) - 0.6 * omega * self.qd
                dry = omega**2 * friction * 2.0
                moving = np.abs(self.qd) > 1e-4
                force = np.where(
                    moving, pull - dry * np.sign(self.qd), np.sign(pull) * np.maximum(np.abs(pull) - dry, 0)
                )
                after = self.qd + 0.002 * force
                self.qd = np.where(moving & (after * self.qd < 0), 0.0, after)
                self.q = self.q + 0.002 * self.qd
                self.feel()

        return unlike(base, advance=advance)

    return made


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "motion"), [(0.0, RASTER), (1e-3, None), (0.1e-3, RASTER)])
def test_an_arm_that_gives_way_is_judged_by_direction(mine, software, monkeypatch, friction, motion):
    class Soft(mine[0].Arm):
        @property
        def controller_stiffness(self):
            return 2500.0

    use(monkeypatch, software, on_a_spring(friction)(software.SoftwareArm))
    done = first_motion(Soft(host="127.0.0.1", work=WORK, lag=0.03), software, motion)
    assert not done.said


def with_deadband(deadband):
    """It leaves a command undone that is nearer than that."""

    def made(base):
        def go_to(self, pose):
            here = self.model.tip(self.target.tolist(), self.tool)[0][:3, 3]
            way = np.array(pose[:3]) - here
            gone = max(np.linalg.norm(way) - deadband, 0.0)
            place = here + way * (gone / max(np.linalg.norm(way), 1e-12))
            return base.go_to(self, [*place.tolist(), *pose[3:]])

        return unlike(base, go_to=go_to)

    return made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("true", "stated", "is_sound"), [(0.3e-3, 0.3e-3, True), (0.02e-3, 0, True), (0.3e-3, 0, False)]
)
@pytest.mark.parametrize("jitter", [0.0, 2e-6])
def test_a_deadband_is_stated(mine, software, monkeypatch, true, stated, is_sound, jitter):
    monkeypatch.setattr(software, "JITTER", jitter)
    use(monkeypatch, software, with_deadband(true)(software.SoftwareArm))
    done = first_motion(mine[0].Arm(host="127.0.0.1", work=WORK, deadband=stated), software, RASTER)
    assert (not done.said) == is_sound, done.said
    if not is_sound:
        assert "are its lag and its deadband stated?" in done.said or "does not change in any digit" in done.said


@pytest.mark.parametrize(
    ("places", "digit"),
    [([[0.1, 0.25, -0.4]], 1e-5), ([[0.45, 0.0, 0.1], [0.45, 0.0, 0.100123]], 1e-6), ([[0.1, 0.2, 1 / 3]], 0.0)],
)
def test_the_digits_of_a_pose_are_those_of_all_of_them(places, digit):
    assert last_digit(np.array(places)) == pytest.approx(digit)


LINE = np.linspace(0.0, 0.5e-3, 200)[:, None] * np.array([0.0, 0.6, 0.8])
SENT = 2_000_000 * np.arange(200)


@pytest.mark.parametrize(
    ("places", "late"),
    [
        (LINE, 0),
        (np.vstack([LINE[:1].repeat(7, 0), LINE[:-7]]), 14_000_000),
        (np.round(LINE, 6), 0),
        (np.floor(1e6 * LINE) / 1e6, 0),
        (LINE + 1e-8 * np.sin(np.arange(200))[:, None], 0),  # by joints that an inverse kinematics has found
        (LINE + 1e-7 * np.sin(np.arange(200))[:, None], None),
        # What passes, by the safety case: a smoothed command, varying delays in digits above 1 um, digits above 10 um.
        (0.5 * (LINE + np.vstack([LINE[:1].repeat(5, 0), LINE[:-5]])), None),
        (np.round(LINE[np.maximum(np.arange(200) - np.arange(200) % 4, 0)], 5), None),
        (np.round(LINE, 4), None),
        (np.zeros((200, 3)), None),
    ],
)
def test_an_echo_is_a_command_in_every_sample(places, late):
    delay = echo_delay(LINE, SENT, places, SENT + 1_000_000, 60_000_000)
    assert (delay is None) if late is None else (abs(delay - late) <= 2_000_000)


@pytest.mark.parametrize(("rounding", "is_copy"), [(0.0, True), (1e-8, True), (1e-7, False)])
def test_a_motion_whose_poses_are_its_commands_is_stopped(rounding, is_copy):
    """Also where they have gone through the joints, which an inverse kinematics finds within 1e-8 m."""
    tracking, complaints = TrackingError(0.02), []
    tracking.begin(LINE[0])
    for k, command in enumerate(LINE):
        complaints.append(tracking.complaint(command, command + rounding * math.sin(k + 1) * Z, True))
    assert any("its command, in every digit" in text for text in complaints if text) == is_copy


STIFF = StatedArm(lag=0.02, deadband=0.0, gives_way=False)


def answered(answer, stated=STIFF):
    """What a handshake makes of an arm that stands at `answer(command)` [m] outwards."""
    path = outward_path(np.zeros(3), Z, RETREAT, own_law(RETREAT_SPEED, 0.5), stated)
    return shaken(lambda command: np.array([0.0, 0.0, answer(command[2])]), path, stated)


def answered_by(change, path):
    """What it makes of an arm that goes another way than is commanded, by a matrix (3, 3)."""
    return shaken(lambda command: change @ command, path, STIFF)


def shaken(answer, path, stated):
    """What it makes of an arm that stands at `answer(command)` (3,) [m]."""
    state = lambda place: ArmState(place, np.zeros(3), np.eye(3), [], True)  # noqa: E731
    handshake = Handshake(path, stated, state(np.zeros(3)))
    for number, command in enumerate(path.rows):
        handshake.note_command(command, command, 2_000_000 * number)
        place = answer(command) + 2e-6 * np.sin(7.0 * number + np.arange(3))
        if (text := handshake.fault(state(place), place, 2_000_000 * number + 1)) is not None:
            return text
    assert handshake.is_over
    return None


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda z: z, None),
        (lambda z: 0.7 * z, None),
        (lambda z: 0.5 * z, "are its commands in other units"),
        (lambda z: 1.5 * z, "are its commands in other units"),
        (lambda z: -z, "is the sign of an axis reversed"),
        (lambda z: 0.0, "does it take commands"),
        (lambda z: 0.3e-3, "when it was commanded to stay"),
    ],
)
def test_an_answer_has_the_direction_and_the_size_of_the_command(answer, words):
    text = answered(answer)
    assert (text is None) if words is None else (words in text)


def turned_by(angle, axis):
    """A rotation matrix about an axis of the work frame, by an angle [deg]."""
    return matrix_of([0.0, 0.0, 0.0, *(math.radians(angle) * axis)])[:3, :3]


ACROSS = sideways_path(np.zeros(3), LEVEL, np.ones(3), own_law(RETREAT_SPEED, 0.5), STIFF)
OUTWARDS = outward_path(np.zeros(3), Z, RETREAT, own_law(RETREAT_SPEED, 0.5), STIFF)


@pytest.mark.parametrize(
    ("path", "change", "least", "most", "words"),
    [
        (OUTWARDS, lambda scale: scale * np.eye(3), 1.34, 1.36, "a scale of 0.62 to 1.35"),
        (OUTWARDS, lambda scale: scale * np.eye(3), 0.63, 0.61, "a scale of 0.62 to 1.35"),
        (OUTWARDS, lambda angle: turned_by(angle, X), 20.0, 21.0, "axes turned by less than 21 deg"),
        (ACROSS, lambda angle: turned_by(angle, Z), 25.0, 26.0, "lateral ones 26 deg"),
    ],
    ids=["larger", "smaller", "tilted", "turned"],
)
def test_what_passes_the_handshake_stands_in_the_safety_case(path, change, least, most, words):
    """An arm that goes so far, or in such a direction, in place of what is commanded."""
    assert [answered_by(change(amount), path) is None for amount in (least, most)] == [True, False]
    assert words in SAFETY_CASE.read_text()


@pytest.mark.parametrize(
    ("answer", "passes"),
    [(lambda z: 0.0, True), (lambda z: 0.5 * z, True), (lambda z: -z, False), (lambda z: 2 * z, False)],
)
def test_a_spring_may_stand_still_and_not_go_elsewhere(answer, passes):
    assert (answered(answer, replace(STIFF, gives_way=True)) is None) == passes


@pytest.mark.parametrize(
    ("target", "gap"), [((0, 0, 0.19e-3), None), ((0, 0, 0.21e-3), "0.21 mm"), ((4e-3, 0, 0), "4.00 mm")]
)
def test_a_target_is_compared_with_the_pose(target, gap):
    text = target_problem([*target, 0, 0, 0], [0.0] * 6, 0.0)
    assert (text is None) if gap is None else (gap in text)
    assert target_problem([*target, 0, 0, 0], [0.0] * 6, 5e-3) is None


def test_a_deadband_above_the_retreat_is_refused(palpate):
    done = palpate("check", str(PIPELINE), "--set", "device.arm.deadband=0.6 mm")
    assert done.returncode == 2
    assert "deadband" in done.stderr


def test_first_steps_take_at_most_two_seconds_more():
    for lag in (0.0, 0.0045, 0.02, 0.1, 0.5):
        stated, law = replace(STIFF, lag=lag), own_law(RETREAT_SPEED, 0.5)
        usual = straight_path(np.zeros(3), RETREAT * Z, law).times[-1]
        across = sideways_path(np.zeros(3), LEVEL, np.ones(3), law, stated).duration
        assert outward_path(np.zeros(3), Z, RETREAT, law, stated).duration + across - usual <= 2.0
