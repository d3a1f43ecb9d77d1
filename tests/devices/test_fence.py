"""What the servo process lets through: the fence, the law that retracts, and which way the tool looks."""

from dataclasses import replace

import numpy as np
import pytest
from palpate_arms.arm_lag import deflection
from palpate_arms.arm_state import ArmState
from palpate_arms.fence import Fence
from palpate_arms.servo import Commander
from palpate_arms.servo_law import ServoLaw, straight_path
from palpate_arms.setpoint_buffer import PERIOD, Plan
from palpate_arms.station_plane import StationPlane, pressed_in_at_the_end
from palpate_devices.ur.controller_states import complaint, slowdown
from palpate_kit.acquisition.device_clock import ClockMap
from palpate_kit.kinematics.rotations import matrix_of, rotation_matrix
from palpate_kit.kinematics.ur_arm import MODELS, UR3E, distinguishable
from palpate_kit.kinematics.work_frame import WorkFrame, agreement

WORK = WorkFrame.model_construct(origin=(-0.3, -0.13, 0.1), rotation=(0.0, 0.0, 0.0), turn=0.0)
TOOL = matrix_of([0.0, 0.0, 0.12, 0.0, 0.0, 0.0])
POSTURE = np.array([0.0, -1.3, -1.9, -1.5, 1.5708, 0.0])
OWN = {"joint_speed": 1.5, "tracking": 0.01, "links_low": (-2.0, -2.0, 0.0), "links_high": (2.0, 2.0, 2.0)}
LIMITS = {
    "low": (-0.005, -0.005, -0.007),
    "high": (0.005, 0.005, 0.02),
    "speed": 0.04,
    "acceleration": 0.5,
    "orientation": np.radians(5.0),
    "angular_speed": np.radians(10.0),
}
LAW = ServoLaw("servo", 20.0, 0.5, 0.02, 0.04, 1.0, np.radians(10.0), 0.12)
STILL = np.zeros(3)


DEEP = {**LIMITS, "depth": 0.002}
NORMAL = np.array([0.0, np.sin(np.radians(15.0)), np.cos(np.radians(15.0))])
TILTED = WORK.axes_in_tool @ [-np.radians(15.0), 0.0, 0.0]
TURNING = TILTED + np.outer(np.arange(50) * 0.001 - 0.025, WORK.axes_in_tool[:, 0])
STATION = (0.0, 0.0, 0.0, *NORMAL)


def fence(limits=LIMITS, **own):
    made = Fence({**OWN, **own}, WORK, TOOL, UR3E, 1.0)
    made.limits = limits
    return made


def seen(position, velocity=STILL, turn=STILL, q=None, fresh=True):
    rotation = WORK.tool @ rotation_matrix(turn)
    if q is None:
        goal = WORK.tool_pose(np.array(position))
        goal[:3, :3] = rotation
        q = UR3E.joints_at(goal, TOOL, POSTURE, steps=100)
    return ArmState(np.array(position, float), np.array(velocity, float), rotation, list(q), fresh)


def table(position, velocity=None, turn=(0.0, 0.0, 0.0), plane=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)):
    position = np.array(position, float)
    velocity = np.gradient(position, PERIOD, axis=0) if velocity is None else velocity
    turn, plane = np.broadcast_to(turn, position.shape), np.tile(plane, (len(position), 1))
    return np.column_stack([position, velocity, np.zeros(len(position)), turn, plane])


def straight(speed, count=50, start=(0.0, 0.0, 0.003)):
    return np.array(start) + np.arange(count)[:, None] * PERIOD * np.array([0.0, 0.0, -speed])


def stepped(late, early):
    """Heights (50) that change once."""
    return np.where(np.arange(50)[:, None] > 25, [0.0, 0.0, late], [0.0, 0.0, early])


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (table(straight(0.02)), None),
        (
            table(np.where(np.arange(50)[:, None] > 25, [0, 0, -0.005], [0.0, 0, 0.005]), np.zeros((50, 3))),
            "move at 5000",
        ),
        (table(straight(0.05)), "move at 50.0 mm/s, over the limit of 40 mm/s"),
        (table(straight(0.01), np.full((50, 3), 0.1)), "state that they move at 173.2 mm/s"),
        (table(straight(0.02, start=(0.006, 0, 0))), "x = 6.00 mm, above the limit of 5 mm"),
        (table(straight(0.02, start=(0, -0.006, 0))), "y = -6.00 mm, below the limit of -5 mm"),
        (table(straight(0.02, start=(0, 0, -0.006))), "below the limit of -7 mm"),
        (table(np.full((5, 3), np.nan)), "not a finite number"),
        (
            table(np.cumsum(np.where(np.arange(50)[:, None] > 25, [0, 0, -2e-5], [0.0, 0, 0]), axis=0)),
            "accelerate at 5",
        ),
    ],
)
def test_a_table_of_setpoints_is_judged_whole(rows, words):
    verdict = fence().table(rows)
    assert (verdict is None) if words is None else (words in verdict.text and verdict.trusted)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (table(straight(0.02), turn=TILTED, plane=STATION), None),
        (table(straight(0.02), turn=TILTED), "15.0 deg off its normal, over 5 deg"),
        (table(straight(0.02), plane=STATION), "15.0 deg off its normal, over 5 deg"),
        (table(straight(0.02), turn=TURNING, plane=STATION), "turn the tool at 28.6 deg/s, over the limit of 10 deg/s"),
        (
            table(straight(0.02), turn=TILTED, plane=[0, 0, 0.0082, *NORMAL]),
            "6.916 mm below the surface, over the limit",
        ),
        (table(straight(0.02), turn=TILTED, plane=[0, 0, 0, 0, 0, 2.0]), "not of length 1"),
        (table(straight(0.02), turn=np.full(3, np.nan), plane=STATION), "not a finite number"),
    ],
)
def test_turns_and_depths_are_judged_against_the_stations(rows, words):
    verdict = fence(DEEP).table(rows)
    assert (verdict is None) if words is None else (words in verdict.text and verdict.trusted)


def test_a_command_and_the_arm_itself_are_judged_against_the_plane_of_the_station():
    """A tool along the normal passes; one along the work frame's does not, nor a tip too deep below the plane."""
    guard = fence(DEEP)
    guard.plane = StationPlane(np.zeros(3), NORMAL)
    place, below = 0.003 * NORMAL, -0.0035 * NORMAL
    assert commanded(guard, [place] * 3, [TILTED] * 3) == (None, 3)
    said, _ = commanded(guard, [place] * 3)
    assert "15.0 deg off its station, over 5 deg" in said
    said, _ = commanded(guard, [below] * 3, [TILTED] * 3)
    assert "a command is 3.5 mm below the surface, over the limit of 2 mm" in said
    guard.begin(place)
    assert guard.in_motion(place, seen(place, turn=TILTED)) is None
    assert "the tip is 3.5 mm below the surface" in guard.in_motion(place, seen(below, turn=TILTED)).text
    assert "15.0 deg off the normal" in guard.in_motion(place, seen(place)).text


def test_a_tool_is_not_turned_beyond_its_limit():
    turned = np.array([1.2 * fence().limits["orientation"], 0.0, 0.0])
    said, _ = commanded(fence(), [np.zeros(3)] * 3, [turned] * 3)
    assert said is not None
    assert "deg off the work frame, over" in said


def test_a_long_motion_that_keeps_its_limits_passes():
    """Each instant counts by itself, and not all of them together: six tenths of the acceleration for two seconds."""
    guard, time = fence(), np.arange(1000) * 2e-3
    rate = 0.6 * guard.limits["acceleration"] / 0.03  # [rad/s] at 30 mm/s
    swing = np.column_stack([np.zeros((1000, 2)), 0.03 / rate * np.sin(rate * time)])
    assert guard.table(table(swing)) is None


def commanded(guard, commands, turns=None, look=None, leaving=False):
    """Command after command to an arm that is where it was told to be; the first verdict, and its number."""
    guard.begin(commands[0])
    turns = [STILL] * len(commands) if turns is None else turns
    for i in range(1, len(commands)):
        where = look or seen(commands[i - 1], turn=turns[i - 1])
        verdict = guard.command(commands[i], turns[i], (commands[i - 1], turns[i - 1]), where, leaving)
        if verdict is not None:
            return verdict.text, i
    return None, len(commands)


@pytest.mark.gate
@pytest.mark.slow
def test_a_lawful_motion_passes_with_the_noise_of_a_pd_law():
    rng = np.random.default_rng(0)
    motion = straight_path(np.array([0.0, 0.0, 0.005]), np.array([0.0, 0.0, -0.004]), LAW)
    noisy = motion.position + np.cumsum(rng.normal(0.0, 0.35e-3 * PERIOD, motion.position.shape), axis=0)
    assert commanded(fence(), noisy)[0] is None


@pytest.mark.parametrize(
    ("command", "turn", "words"),
    [
        ((0.0, 0.0, 0.0025), STILL, "would move the tip at 250.0 mm/s"),
        ((np.nan, 0.0, 0.003), STILL, "not a finite number"),
        ((0.0, 0.0, 0.003), (0.002, 0.0, 0.0), "would turn the tool at 57.3 deg/s"),
        ((0.0, 0.0, 0.003), (0.12, 0.0, 0.0), "turn the tool"),
    ],
)
def test_a_command_that_jumps_is_not_sent(command, turn, words):
    """The last of many, by one jump: nothing of it may pass."""
    commands = [np.array([0.0, 0.0, 0.003])] * 30 + [np.array(command)]
    text, number = commanded(fence(), commands, [STILL] * 30 + [np.array(turn)])
    assert number == 30
    assert words in text


def test_speed_and_acceleration_of_commands():
    growing = 0.015 - np.cumsum(np.minimum(np.arange(200) * 0.4 * PERIOD, 0.047)) * PERIOD
    assert "would move the tip at 4" in commanded(fence(), growing[:, None] * np.array([0.0, 0.0, 1.0]))[0]
    sudden = np.concatenate([np.tile([[0, 0, 0.003]], (30, 1)), straight(0.039, 40)])
    assert "accelerate the tip" in commanded(fence(), sudden)[0]
    assert commanded(fence(), sudden, leaving=True)[0] is None
    outside = straight(0.02, 100, (0, 0, -0.0075))
    assert "below the limit of -7 mm" in commanded(fence(), outside)[0]
    assert commanded(fence(), outside, leaving=True)[0] is None  # braking may carry it there


def test_near_a_singular_posture_a_slow_tip_spins_the_wrist():
    q = np.array([0.0, -1.3, -1.9, -1.5, 0.02, 0.0])
    near = ArmState(np.zeros(3), STILL, UR3E.tip(q.tolist(), TOOL)[0][:3, :3], q.tolist(), True)
    guard = fence(limits=None)
    guard.begin(STILL)
    step = np.array([0.0, 0.0, -0.02 * PERIOD])
    aligned = WorkFrame.model_construct(origin=WORK.origin, rotation=(0.0, 0.0, 0.0), turn=0.0)
    aligned.__dict__["tool"] = near.rotation
    guard._work = aligned
    steps = 0.02 * PERIOD * np.eye(3)
    verdicts = [guard.command(along, STILL, (STILL, STILL), near) for along in steps]
    assert any(verdict is not None and "singular" in verdict.text for verdict in verdicts)
    assert fence(limits=None).command(step, STILL, (STILL, STILL), seen(STILL)) is None
    assert "elbow_joint" in fence(None, joint_speed=0.01).command(step, STILL, (STILL, STILL), seen(STILL)).text


def test_the_arm_is_where_its_command_is_and_its_links_in_their_box():
    far = fence(limits=None).command(STILL, STILL, (STILL, STILL), seen((0.0, 0.0, 0.012)))
    assert "does not follow: it is 12 mm" in far.text
    assert not far.trusted
    askew = fence().command(STILL, STILL, (STILL, STILL), seen(STILL, turn=(0.2, 0.0, 0.0)))
    assert "11.5 deg from its command" in askew.text
    low = fence(None, links_low=(-2.0, -2.0, 0.3)).command(STILL, STILL, (STILL, STILL), seen(STILL))
    assert "the elbow" in low.text
    assert "links_low" in low.text


@pytest.mark.parametrize(
    ("lag", "speed", "tracking", "lead"),
    [
        (0.0045, 0.04, 0.01, 1.98e-3),
        (0.055, 0.04, 0.01, 4e-3),  # a soft servo
        (0.0045, 0.25, 0.01, 10e-3),
        (0.0045, 0.04, 0.001, 1e-3),
        (0.0045, 0.001, 0.01, 0.2e-3),
    ],
)
def test_a_command_leads_by_what_the_speed_makes_of_the_lag(lag, speed, tracking, lead):
    """The law that integrates, on an arm that stands: no command goes further, and the arm is stopped there."""
    guard = fence({**LIMITS, "speed": speed}, lag=lag, tracking=tracking)
    assert guard.lead == pytest.approx(lead)
    pose, place, sent = seen((0.0, 0.0, 0.003)), np.array([0.0, 0.0, 0.003]), []
    law = ServoLaw("pd", 20.0, 0.5, 0.02, 0.04, 1.0, max_speed=speed)
    commander = Commander(law, place)
    commander.follow(Plan.of(table(straight(speed, 2000))))
    commander.mode = "follow"
    for _ in range(2000):
        before = commander.command, commander.turn
        verdict = guard.command(commander.next(place, STILL), STILL, before, pose, leaving=True)
        if verdict is not None:
            break
        sent.append(np.linalg.norm(commander.command - place))
    assert "the arm does not follow" in verdict.text
    assert not verdict.trusted
    assert lead - 1.5 * speed * PERIOD < max(sent) <= lead


@pytest.mark.parametrize(
    ("paces", "safety", "before", "words"),
    [
        ((1.0, 1.0), 1, 1, None),
        ((1.0, 1.0), 2, None, None),  # a rig may work in reduced mode
        ((1.0, 1.0), 2, 2, None),
        ((0.6, 1.0), 1, None, "the speed slider is at 60 %; set it to 100 % on the pendant"),
        ((0.99, 1.0), 1, 1, "the speed slider was moved to 99 %"),
        ((1.0, 0.8), 1, 1, "the controller slows the arm to 80 %"),
        ((1.0, 0.8), 2, 2, "it is in reduced mode: a safety plane or a safety input"),
        ((1.0, 1.0), 2, 1, "the robot has changed to reduced mode: a safety plane"),
        ((float("nan"), 1.0), 1, 1, "the speed slider"),
    ],
)
def test_a_slower_robot_is_named(paces, safety, before, words):
    text = slowdown(paces, safety, before)
    assert text is None if words is None else words in text


@pytest.mark.parametrize(("mode", "name"), [(3, "POWER_OFF"), (5, "IDLE"), (6, "BACKDRIVE"), (-1, "NO_CONTROLLER")])
def test_a_robot_that_is_not_running_is_named(mode, name):
    """Before its program, which ends because of that; after the emergency stop, which switches the power off."""
    assert complaint((mode, 1, 1)).startswith(f"the robot is {name}, not RUNNING; ")
    assert "emergency stop" in complaint((mode, 7, 1))


def test_a_pose_that_stands_still_while_commands_go_on():
    guard, pose = fence(), seen((0.0, 0.0, 0.003))
    commands = straight(0.02, 200)
    guard.begin(commands[0])
    told = [guard.in_motion(command, pose) for command in commands]
    first = next(i for i, verdict in enumerate(told) if verdict is not None)
    assert "does not change in any digit" in told[first].text
    assert not told[first].trusted
    assert np.linalg.norm(commands[first] - commands[0]) < 0.6e-3
    # Where nothing new was said, nothing stands still; nor where nothing was told.
    quiet = seen((0.0, 0.0, 0.003), fresh=False)
    assert all(guard.in_motion(command, quiet) is None for command in commands)
    guard.begin(commands[0])
    assert all(guard.in_motion(commands[0], pose) is None for _ in commands)


def test_an_arm_that_is_stuck_trembles_but_does_not_move():
    guard, rng = fence(), np.random.default_rng(0)
    commands = straight(0.02, 300, (0, 0, 0.006))
    guard.begin(commands[0])
    shown = (ArmState(commands[0] + rng.normal(0, 5e-6, 3), STILL, WORK.tool, [], True) for _ in commands)
    told = [guard.in_motion(command, look) for command, look in zip(commands, shown, strict=True)]
    assert any(verdict is not None and "has moved by" in verdict.text for verdict in told)


def on_a_spring(commands, way):
    """States of an arm that dry friction holds until its command is a way [m] off."""
    place, rng = commands[0], np.random.default_rng(0)
    for command in commands:
        place = np.clip(place, command - way, command + way)
        yield ArmState(place + rng.normal(0, 1e-7, 3), STILL, WORK.tool, [], True)


@pytest.mark.parametrize(
    ("commands", "way", "words"),
    [
        (np.sin(4 * np.pi * np.arange(1000) * PERIOD), 1.2e-3, None),  # the arm stands all the while
        (3 * np.sin(4 * np.pi * np.arange(1000) * PERIOD), 1.2e-3, None),
        (30.0 * np.arange(200) * PERIOD, 9.0, "was commanded to move by 4."),  # it is jammed
    ],
)
def test_an_arm_on_a_spring_stands_behind_its_command_by_the_force_that_stops_it(commands, way, words):
    guard = fence(lag=0.028)
    guard.give = deflection(12.0, 5000.0)
    commands = 1e-3 * commands[:, None] * np.array([0.0, 0.0, 1.0])
    guard.begin(commands[0])
    told = [guard.in_motion(*pair) for pair in zip(commands, on_a_spring(commands, way), strict=True)]
    said = [verdict.text for verdict in told if verdict is not None and "has moved by" in verdict.text]
    assert (not said) if words is None else (words in said[0])


@pytest.mark.parametrize(("gives_way", "most"), [(False, 0.034), (True, 0.0249)])
def test_what_an_arm_does_by_itself_leaves_room_for_its_overshoot(gives_way, most):
    law = replace(LAW, gives_way=gives_way).within(LIMITS)
    assert (law.approach_speed, law.retract_speed) == (0.02, pytest.approx(most, rel=0.01))


@pytest.mark.gate
@pytest.mark.slow
def test_a_swing_that_turns_round_has_moved():
    """At 5 Hz and 20 ms late, both ends of a window can be at one height."""
    guard, time = fence(), np.arange(1000) * 0.002
    height = 0.003 + 1e-3 * np.sin(2 * np.pi * 5 * time)
    late = 0.003 + 1e-3 * np.sin(2 * np.pi * 5 * (time - 0.02))
    guard.begin(np.array([0.0, 0.0, height[0]]))
    for commanded, shown in zip(height, late, strict=True):
        verdict = guard.in_motion(np.array([0.0, 0.0, commanded]), seen((0.0, 0.0, shown)))
        assert verdict is None or "has moved by" not in verdict.text


@pytest.mark.parametrize(
    ("position", "velocity", "words", "trusted"),
    [
        ((0.0065, 0.0, 0.0), STILL, "the tip is at x = 6.50 mm", True),
        ((0.0, -0.0065, 0.0), STILL, "the tip is at y = -6.50 mm", True),
        ((0.0, 0.0, 0.0), (0.0, 0.0, -0.06), "the tip moves at 60.0 mm/s", False),
    ],
)
def test_place_and_speed_are_watched_in_motion(position, velocity, words, trusted):
    guard = fence()
    guard.begin(STILL)
    rng = np.random.default_rng(0)
    for _ in range(20):
        look = ArmState(np.array(position) + rng.normal(0, 1e-6, 3), np.array(velocity), WORK.tool, [], True)
        verdict = guard.in_motion(STILL, look)
    assert words in verdict.text
    assert verdict.trusted == trusted


def test_a_command_that_is_taken_back_leaves_no_trace():
    commander = Commander(LAW, np.array([0.0, 0.0, 0.003]))
    rows = table(np.concatenate([straight(0.02, 40), [[0.0, 0.0, -0.004]], straight(0.02, 5, (0, 0, -0.004))]))
    commander.follow(Plan.of(rows))
    place = commander.command
    while True:
        before, place = place, commander.next(place, STILL)
        if np.linalg.norm(place - before) > 1e-3:
            break
    commander.take_back()
    np.testing.assert_array_equal(commander.command, before)
    commander.retract()
    lowest = min(float(commander.next(before, STILL)[2]) for _ in range(400))
    assert lowest > before[2] - 0.02**2 / 2 - 1e-4
    assert commander.mode == "done"


def test_a_trip_on_the_way_goes_back_to_where_the_way_began():
    """An obstacle between here and the start: the start lies behind it."""
    begin = np.array([0.0, 0.0, 0.01])
    commander = Commander(LAW, begin)
    commander.follow(Plan.of(table(straight(0.02, 50, (0, 0, 0.001)))))
    for _ in range(250):
        place = commander.next(begin, STILL)
    assert place[2] < 0.008
    commander.retract()
    for _ in range(1000):
        place = commander.next(begin, STILL)
    assert place[2] == pytest.approx(0.01, abs=1e-4)


def test_the_tool_turns_only_on_the_way_and_about_its_tip():
    turn, begin = np.array([0.06, -0.03, 0.02]), np.array([0.0, 0.0, 0.004])
    commander = Commander(LAW, begin, turn)
    commander.retreat(0.5e-3, 2e-3)
    while commander.mode == "retreat":
        commander.next(begin, STILL)
        np.testing.assert_array_equal(commander.turn, turn)
    assert commander.command[2] == pytest.approx(0.0045)
    commander.follow(Plan.of(table(straight(0.02, 5))))
    turns, places = [commander.turn], [commander.command]
    while commander.mode == "approach":
        places.append(commander.next(begin, STILL))
        turns.append(commander.turn)
    rate = np.linalg.norm(np.diff(turns, axis=0), axis=1) / PERIOD
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / PERIOD
    assert rate.max() <= LAW.angular_speed * (1 + 1e-6)
    assert (speed + rate * LAW.lever).max() <= LAW.approach_speed * (1 + 1e-6)
    np.testing.assert_allclose(turns[-1], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("vector", "degrees", "words"),
    [
        ((0.0, 0.0, np.pi / 2), 90.0, 'work.turn = "90.0 deg" it would be off by 0.0 deg'),
        ((np.radians(8.0), 0.0, 0.0), 8.0, "turn the tool by hand"),
        ((0.0, 0.0, 0.0), 0.0, "by hand"),
    ],
)
def test_how_far_off_a_tool_is_and_which_turn_would_agree(vector, degrees, words):
    angle, advice = agreement(WORK, WORK.tool @ rotation_matrix(vector))
    assert np.degrees(angle) == pytest.approx(degrees, abs=1e-6)
    assert words in advice


@pytest.mark.parametrize("name", MODELS)
def test_models_are_told_apart_by_where_the_tip_is(name):
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = (POSTURE + rng.normal(0, 0.3, 6)).tolist()
        place = MODELS[name].tip(q, TOOL)[0][:3, 3] + rng.normal(0, 1e-3, 3)  # a real arm is off by so much
        found, apart = distinguishable(q, TOOL, place)
        assert found.name == name
        assert apart < 5e-3


def test_the_maker_s_places_of_all_joints_at_zero():
    """As UR's calculator has them."""
    places = {name: model.tip([0.0] * 6, np.eye(4))[0][:3, 3] for name, model in MODELS.items()}
    np.testing.assert_allclose(places["ur3e"], [-0.45675, -0.22315, 0.0665], atol=1e-9)
    np.testing.assert_allclose(places["ur5e"], [-0.8172, -0.2329, 0.0628], atol=1e-9)
    np.testing.assert_allclose(places["ur10e"], [-1.18425, -0.2907, 0.06085], atol=1e-9)
    np.testing.assert_allclose(places["ur16e"], [-0.8384, -0.2907, 0.06085], atol=1e-9)


def test_a_stop_says_how_to_go_on():
    text = complaint((7, 3, 4))
    assert "protective stop" in text
    assert "unlock it on the pendant" in text
    assert complaint((7, 1, 2)) is complaint((7, 2, 2)) is None
    assert "stopped" in complaint((7, 1, 1))


def test_an_even_clock_does_not_wander_however_fast_it_is():
    rng = np.random.default_rng(0)
    stamps = np.arange(0, 20_000_000_000, 2_000_000)
    for pace, jump, low, high in ((1.0001, 0, 0.0, 0.1e-3), (1.0, 2_000_000, 0.4e-3, 3e-3)):
        clock = ClockMap()
        arrivals = (stamps * pace).astype(np.int64) + rng.integers(200_000, 260_000, len(stamps))
        arrivals[len(stamps) // 2 :] += jump
        clock.to_host(stamps, arrivals)
        assert low <= clock.deviation < high


@pytest.mark.parametrize(
    ("heights", "plane", "refused"),
    [
        ((0.003, 0.003), (0.0, 0.0, 0.0), False),
        ((0.003, -0.002), (0.0, 0.0, 0.0), True),
        ((-0.001, -0.001), (0.0, 0.0, 0.0), False),  # as low as it began, where it was free
        ((0.003, 0.002), (0.0, 0.0, 0.0025), True),  # over a surface that is higher
    ],
)
def test_a_plan_that_ends_pressed_in_is_refused_where_it_is_carried_out(heights, plane, refused):
    rows = table(np.column_stack([np.zeros((3000, 2)), np.linspace(*heights, 3000)]), plane=(*plane, 0.0, 0.0, 1.0))
    text = pressed_in_at_the_end(Plan.of(rows).ends)
    assert (text is not None and "below the skin, where it would stay" in text) == refused
