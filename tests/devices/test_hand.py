"""A hand at the twin: push, freedrive, red button, cable, slow stops; judged by what the arm truly did."""

import json

import numpy as np
import pytest
from palpate import clock


@pytest.fixture
def hand(rig):
    """The twin in simulated time, with nothing but a hand at it."""
    rig.fault("mark")
    return rig


def after(twin, seconds):
    """The twin's state after a while."""
    clock().sleep(seconds)
    return twin.state()


def place(state):
    return np.array(state["pose"][:3])


def test_an_arm_gives_way_to_a_push_in_freedrive_only(hand):
    before = hand.state()
    hand.fault("push 10 0 0")
    assert np.abs(place(after(hand, 0.5)) - place(before)).max() < 1e-9
    hand.fault("freedrive")
    held = hand.state()
    moved = place(after(hand, 0.5)) - place(held)
    assert moved == pytest.approx([0.05, 0.0, 0.0], abs=2e-3)  # 10 N through 100 N s/m for 0.5 s, from rest
    hand.fault("freedrive")
    there = after(hand, 0.05)
    assert np.abs(place(after(hand, 0.5)) - place(there)).max() < 1e-9


def test_a_hard_push_is_taken_for_a_collision(hand):
    hand.fault("push 0 0 149")
    assert hand.world.controller.is_sound
    hand.fault("push 0 0 151")
    clock().sleep(0.01)
    assert hand.world.controller.dashboard("safetystatus") == "Safetystatus: PROTECTIVE_STOP"
    assert "a safety stop holds the arm" in hand.say("freedrive")


@pytest.mark.gate
@pytest.mark.slow
def test_a_hand_leads_the_tip_to_a_place_and_turns_the_tool(hand):
    assert "not in freedrive" in hand.say("lead 0 0 20 0 0 0")
    hand.fault("freedrive")
    hand.fault("lead 3 -4 20 10 0 0")
    state = after(hand, 2.0)
    assert np.array(hand.world.position) == pytest.approx([3e-3, -4e-3, 20e-3], abs=1e-5)
    angle = np.degrees(np.arccos((np.trace(hand.world._axes) - 1) / 2))
    assert angle == pytest.approx(10.0, abs=0.05)
    assert state["fastest_joint"] < 0.21
    assert "cannot reach" in hand.say("lead 0 0 5000 0 0 0")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("push hard", "push needs three numbers, not 'hard'"),
        ("push 1 2", "push needs three numbers, not '1 2'"),
        ("push nan 0 0", "push needs three numbers"),
        ("lead 1 2 3", "lead needs six numbers"),
        ("slow-stop 0", "slow-stop needs a number, not '0'"),
        ("slow-stop nan", "slow-stop needs a number"),
        ("estopp", "did you mean 'estop'"),
    ],
)
def test_a_line_that_cannot_be_is_answered(hand, line, words):
    assert words in hand.say(line)
    assert hand.state()["fastest_joint"] == 0.0


@pytest.mark.gate
@pytest.mark.slow
def test_the_red_button_stops_a_motion_and_is_let_out_where_the_arm_stands(rig):
    error, table, _ = rig.run_into("estop", lambda state: state["height"] < -0.0005)
    assert "emergency stop" in error
    stopped = rig.wait_at_rest()
    assert stopped["height"] < 0.0  # it has no power to leave with
    assert table["run"]["live"]["stop"]["reason"].startswith("ur at")
    rig.fault("estop")
    assert rig.world.controller.dashboard("robotmode") == "Robotmode: RUNNING"
    assert place(rig.state()) == pytest.approx(place(stopped), abs=1e-5)


@pytest.mark.gate
@pytest.mark.slow
def test_a_push_beyond_the_limit_makes_the_arm_retract(rig):
    error, table, _ = rig.run_into("push 0 0 30", lambda state: state["height"] < -0.0005)
    assert "over the limit of 12 N" in error
    assert table["run"]["live"]["peak_force"] > 25.0
    rig.fault("push 0 0 0")
    assert rig.wait_at_rest()["height"] > 0.001


@pytest.mark.gate
@pytest.mark.slow
def test_a_slow_stop_goes_farther(rig):
    """The way after the red button, as hard as the arm can and at 0.05 rad/s^2, on the approach at 13 mm/s."""
    ways = []
    for line in ("slow-stop 20", "slow-stop 0.05"):
        rig.fault("restore")
        rig.fault(line)
        rig.run_into("estop", lambda state: state["height"] < -0.0005)
        ways.append(rig.at_fault["height"] - rig.wait_at_rest()["height"])
    assert 0.0 <= ways[0] < 0.0003
    assert 0.0015 < ways[1] < 0.02


def test_the_state_is_one_line_of_json(hand):
    hand.fault("freedrive")
    assert json.loads(hand.say("state").removeprefix("state "))["joint_speed"] == 0.0
