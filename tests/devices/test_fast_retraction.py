"""A retraction that is faster than the motion, where one is stated; and a skin that moves under the tip."""

from pathlib import Path

import numpy as np
import pytest
from palpate_arms.servo_law import ServoLaw
from palpate_arms.setpoint_buffer import PERIOD
from palpate_simulation.twins.moving_skin import MovingSkin

from tests.devices.simulated_bench import PIPELINE, SHORT
from tests.devices.test_fence import LIMITS, fence, seen

SAFETY_CASE = Path(__file__).parents[2] / "docs" / "safety-case.md"
# Room to reach a high speed within: the motion begins 45 mm above the skin.
HIGH = (
    *SHORT,
    'safety.high=["5 mm","5 mm","60 mm"]',
    "trajectory.press.clearance=45 mm",
    "twin.bench.height=46 mm",
    "device.arm.joint_speed=120 deg/s",
)
FAST = ("safety.retract_speed=250 mm/s", "device.arm.acceleration=5 m/s^2")


@pytest.mark.parametrize(
    ("stated", "own", "gives_way", "speed"),
    [
        (0.0, np.inf, False, 0.034),
        (0.0, 0.02, False, 0.02),
        (0.2, np.inf, False, 0.17),
        (0.2, 0.02, False, 0.02),
        (0.25, np.inf, True, 0.155),
    ],
)
def test_a_retraction_has_a_limit_of_its_own_only_where_it_is_stated(stated, own, gives_way, speed):
    law = ServoLaw("pd", 20.0, 0.5, 0.1, own, 1.0, gives_way=gives_way)
    law = law.within({**LIMITS, "retract_speed": stated})
    assert law.retract_speed == pytest.approx(speed, rel=0.01)
    assert law.approach_speed <= 0.034  # the way to the start keeps that of the motion
    assert law.max_speed == LIMITS["speed"]


@pytest.mark.parametrize(
    ("velocity", "leaving", "stated", "is_refused"),
    [
        ((0.0, 0.0, 0.2), True, 0.2, False),
        ((0.0, 0.0, 0.2), True, 0.0, True),
        ((0.0, 0.0, 0.2), False, 0.2, True),
        ((0.0, 0.0, -0.2), True, 0.2, True),
        ((0.1, 0.0, 0.1), True, 0.2, True),
        ((0.0, 0.0, 0.26), True, 0.2, True),
    ],
    ids=["outwards", "not stated", "in motion", "inwards", "across", "too fast"],
)
def test_only_the_way_out_along_the_normal_may_be_faster(velocity, leaving, stated, is_refused):
    """Commands before they are sent, and the tip as the robot reports it."""
    guard, before = fence({**LIMITS, "retract_speed": stated}), np.array([0.0, 0.0, 0.001])
    guard.begin(before)
    command = before + PERIOD * np.array(velocity)
    verdict = guard.command(command, np.zeros(3), (before, np.zeros(3)), seen(before), leaving)
    assert (verdict is not None) == is_refused
    if leaving and stated:
        told = [guard.in_retraction(seen(before, velocity)) for _ in range(20)]
        assert (told[-1] is not None) == is_refused


def test_a_command_may_lead_by_what_the_speed_of_the_retraction_makes_of_the_lag():
    state = seen((0.0, 0.0, 0.001))
    for stated, most in ((0.0, 1.98e-3), (0.15, 7.4e-3)):
        guard = fence({**LIMITS, "retract_speed": stated}, lag=0.0045)
        for away in (0.9 * most, 1.1 * most):
            command = state.position + np.array([0.0, 0.0, away])
            guard.begin(command)
            verdict = guard.command(command, np.zeros(3), (command, np.zeros(3)), state, True)
            assert (verdict is not None) == (away > most)


@pytest.mark.parametrize(
    ("value", "overrides", "words"),
    [
        ("30 mm/s", (), ("[safety] retract_speed", "30 mm/s is below speed = 40 mm/s")),
        ("300 mm/s", (), ("[safety] retract_speed", "300 mm/s", "less than or equal to 0.25")),
        (
            "250 mm/s",
            ("device.arm.lookahead=0.2 s", "device.arm.servo_gain=500"),
            ("device arm", "[safety] retract_speed = 250 mm/s", "tracking", "167 mm/s"),
        ),
    ],
    ids=["below speed", "over 250 mm/s", "farther behind than tracking"],
)
def test_limits_that_contradict_each_other_are_refused(palpate, tmp_path, value, overrides, words):
    speed = 'speed = "40 mm/s"\n'
    text = PIPELINE.read_text()
    (tmp_path / "fast.toml").write_text(text.replace(speed, f'{speed}retract_speed = "{value}"\n'))
    sets = [word for override in overrides for word in ("--set", override)]
    done = palpate("check", "motion", "fast.toml", *sets, cwd=tmp_path)
    assert done.returncode == 2, done.stdout
    for word in ("fast.toml", *words):
        assert word in done.stderr, done.stderr


def test_a_joint_that_is_too_slow_for_it_is_named_before_anything_moves(simulated):
    twin = simulated(*HIGH, *FAST, "device.arm.joint_speed=40 deg/s")
    twin.fault("mark")
    with pytest.raises(Exception, match=r"retract_speed = 250 mm/s .* would turn at .* over joint_speed = 40 deg/s"):
        twin.run()
    assert twin.truth.speed < 1e-6


def leave(twin, fault, *overrides):
    """Run into a fault at a depth of 2 mm; the trace of the arm from then on, by columns, and why it was stopped."""
    error, _, _ = twin.run_into(fault, lambda state: state["height"] < -0.002, *overrides)
    file = twin.folder / "trace.npy"
    twin.say(f"trace {file}")
    time, _, _, z, vx, vy, vz, _, _, force, _ = np.load(file).T
    return {"time": time, "z": z, "across": np.hypot(vx, vy), "out": vz, "force": force}, error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "least", "most"), [((), 0.033, 0.04), (FAST, 0.2, 0.25)], ids=["as the motion", "stated"]
)
@pytest.mark.parametrize(
    ("skin", "forces"), [("cough 20 0.15", (44, 25)), ("rise 40 1", (54, 12))], ids=["a cough", "sitting up"]
)
def test_what_a_skin_that_rises_does(simulated, overrides, least, most, skin, forces):
    """By 20 mm within 0.15 s, or by 40 mm within 1 s: true speed, place and force of the twin's arm, as stated."""
    twin, force = simulated(*HIGH, *overrides), forces[bool(overrides)]
    trace, error = leave(twin, skin)
    assert "that stops the motion" in error
    assert least < trace["out"].max() <= most
    assert trace["out"].min() > -0.04
    assert trace["across"].max() < 0.01
    assert np.hypot(trace["out"], trace["across"]).max() <= most
    assert trace["z"].max() < 0.0466  # to where it began after its retreat, and no further
    assert trace["force"].max() == pytest.approx(force, abs=1.0)
    words = "(a cough) 44 N of `stop_force` 12 N, 40 mm within 1 s (sitting up) 54 N; 25 and 12 N with"
    assert words in SAFETY_CASE.read_text()


BREATHING = """type = "force-hold"
force = "4.5 N"
depth = "6 mm"
duration = "16 s"
stiffness = "1.5 N/mm"
speed = "10 mm/s"
acceleration = "0.5 m/s^2"
clearance = "6 mm"
standstill = "0 s"
"""


def holding(simulated, tmp_path, motion):
    """A rig that holds a force."""
    text = PIPELINE.read_text()
    begin, end = text.index("[trajectory.press]"), text.index("[alignment]")
    file = tmp_path / "holding.toml"
    file.write_text(f"{text[:begin]}[trajectory.press]\n{motion}\n{text[end:]}")
    sets = [override for override in SHORT if "trajectory" not in override]
    return simulated(*sets, "twin.bench.height=7 mm", 'safety.low=["-5 mm","-5 mm","-12 mm"]', pipeline=file)


@pytest.mark.slow
@pytest.mark.parametrize("level", [3.0, 1.0])
def test_a_sensor_that_saturates_once_a_force_was_held_is_bounded_by_the_envelope(simulated, tmp_path, level):
    """A skin that recedes gives the same readings: nothing but the depth of the envelope stops it (0475)."""
    twin = holding(simulated, tmp_path, BREATHING)
    error, _, _ = twin.run_into(f"saturated-force {level} 0.05", lambda state: state["peak_force"] > 4.4)
    assert "at the end of its envelope, 12 mm below the start: deeper it may not go" in error
    assert 6.5 < twin.truth.force < 7.0  # what the material has at 6 mm
    assert twin.wait_at_rest()["height"] > 5e-3


@pytest.mark.slow
def test_a_sensor_that_stops_just_below_a_held_force_is_bounded_by_the_envelope_as_stated(simulated, tmp_path):
    """At 3.45 N and its offset, from the air on: nine tenths of the force count as reached; the tip goes on slowly."""
    twin = holding(simulated, tmp_path, BREATHING)
    error, _, _ = twin.run_into("saturated-force 3.45 0.05", lambda state: state["height"] < 1e-3)
    assert "the controlled force is 4.2" in error
    assert "at the end of its envelope" in error
    assert twin.truth.force == pytest.approx(7.0, abs=0.1)
    assert "(stuck at 4.2 N with noise: 7.0 N, goal 4.5 N, envelope 6 mm)" in SAFETY_CASE.read_text()


@pytest.mark.slow
@pytest.mark.parametrize(("response", "most"), [(None, 2.0), ("0.2 s", 1.3)], ids=["default", "fastest"])
def test_a_held_force_stays_within_2_newton_while_the_skin_breathes(simulated, tmp_path, response, most):
    """By 5 mm, 15 times a minute, in a material of 1.4 N/mm: the true force on the skin, from the first breath on."""
    twin = holding(simulated, tmp_path, BREATHING if response is None else f'{BREATHING}response = "{response}"\n')
    twin.say("breathe 0 0")
    error, _, _ = twin.run_into("breathe 5 0.25", lambda state: state["peak_force"] > 4.4)
    assert error == "it came to its end"
    twin.say(f"trace {tmp_path / 'trace.npy'}")
    time, *_, force, _ = np.load(tmp_path / "trace.npy").T
    began = time[np.flatnonzero(force > 4.4)[0]]
    held = force[(time > began) & (time < began + 12.0)]
    assert np.abs(held - 4.5).max() < most
    assert np.ptp(held) > 1.0  # it does breathe


def test_a_skin_moves_as_it_is_said():
    skin, times = MovingSkin(), np.arange(0.0, 4.0, 0.002)
    assert not skin.moves
    skin.breathe(5e-3, 0.25, 0.0)
    height, speed = skin.motion(times)
    assert (height.min(), height.max()) == (pytest.approx(0.0, abs=1e-9), pytest.approx(5e-3, rel=1e-6))
    assert speed.max() == pytest.approx(np.pi * 0.25 * 5e-3, rel=1e-3)
    np.testing.assert_allclose(np.diff(height) / 0.002, 0.5 * (speed[1:] + speed[:-1]), atol=1e-6)
    skin.breathe(0.0, 0.0, 0.0)
    skin.rise(0.04, 1.0, 1.0)
    skin.cough(0.02, 0.1, 3.0)
    height, _ = skin.motion(times)
    assert height[[0, 500, 1000, 1550, -1]] == pytest.approx([0.0, 0.0, 0.04, 0.06, 0.04])
