"""A calibration on a busy computer: the arm hesitates, and what it finds is right all the same."""

import numpy as np
import pytest
from palpate import LogError
from palpate_calibration.calibration_record import CalibrationRecorder
from palpate_calibration.protocol import calibrate
from palpate_calibration.settings import CalibrationSettings
from palpate_calibration.steps import evaluate_step
from palpate_engine.alignment import AlignmentSettings, Ports, hesitations
from palpate_models import DimensionalityReduction, Flat, Sphere
from palpate_simulation.simulated_rig import SimulatedRig
from palpate_trajectories.point import Point
from palpate_trajectories.shake import Shake

from tests.hesitating import HesitatingLink

MASS, DELAY, STD = 0.181, 0.0073, 0.67e-3
SOFT = {"model": DimensionalityReduction(indenter=Sphere(radius=0.005)), "elasticity": 112.5e3, "viscosity": 362.0}
PLATE = {"model": DimensionalityReduction(indenter=Flat(radius=0.005)), "elasticity": 3e6, "viscosity": 0.0}
SHAKE = Shake(amplitude=0.004, height=0.03, duration=4.0)
SLOW = Shake(frequencies=(1.0,), amplitude=0.004, height=0.03, duration=4.0)
PRESS = Point(bias=4e-4, amplitude=2e-4, frequency=2.0, duration=3.0)
SELDOM, OFTEN, TOO_OFTEN = (0.008, 1.0), (0.008, 2.5), (0.020, 2.5)  # held up [s] and how often [1/s]
SETTINGS = CalibrationSettings()


def recorded(held_up, trajectory=SHAKE, seed=0, specimen=SOFT):
    rig = SimulatedRig.model_validate({"specimen": specimen, "tip_mass": MASS, "force_delay": DELAY})
    settings = AlignmentSettings.model_validate(
        {"force": "rig.wrench.z", "position": "rig.tip.z", "velocity": "rig.twist.z"}
    )
    recorder = CalibrationRecorder(settings, Ports.of(settings, {"rig": rig.streams}))
    link = HesitatingLink(rig, seed, *held_up)
    link.follow(trajectory)
    for batch in link.batches():
        recorder.feed("rig", batch)
    return recorder.record()


@pytest.mark.slow
@pytest.mark.parametrize("held_up", [SELDOM, OFTEN, (0.015, 1.0)])
def test_a_hesitation_is_no_contact_and_no_noise(held_up):
    """Mass, delay and what is left over are those of a quiet computer, the uncertainty is hardly larger."""
    quiet, busy = (calibrate([recorded(each, seed=s) for s in range(3)], SETTINGS) for each in ((0.0, 1.0), held_up))
    assert busy.residual < 1.1 * quiet.residual
    for name, truth in (("mass", MASS), ("delay", DELAY), ("velocity_delay", 0.0)):
        found = busy.values[name]
        assert abs(found.value - truth) < 3 * found.combined + {"mass": 1e-3}.get(name, 1e-4), name
        assert found.fit < 1.5 * quiet.values[name].fit or name == "velocity_delay"
    assert busy.values["paper_velocity_std"].value == pytest.approx(quiet.values["paper_velocity_std"].value, rel=0.05)
    (note,) = [note for note in busy.notes if note.startswith("hesitated")]
    count = sum(shake.planned.count for shake in busy.shakes)
    assert f"the arm hesitated {count} times" in note
    assert not [note for note in quiet.notes if note.startswith("hesitated")]


@pytest.mark.slow
def test_over_half_is_refused_by_its_name():
    with pytest.raises(LogError, match=r"the arm hesitated [0-9]+ times .*over half of the shake") as caught:
        calibrate([recorded(TOO_OFTEN)], SETTINGS)
    assert "contact" not in str(caught.value)
    with pytest.raises(LogError, match=r"the arm hesitated [0-9]+ times .*cannot be distinguished from noise"):
        evaluate_step("noise", [recorded(TOO_OFTEN, SLOW)], SETTINGS)


@pytest.mark.parametrize("held_up", [SELDOM, OFTEN, (0.020, 1.0)])
def test_the_noise_of_the_velocity_is_not_that_of_hesitations(held_up):
    values = evaluate_step("noise", [recorded(held_up, SLOW)], SETTINGS).values
    assert values["moving_velocity_std"].value == pytest.approx(STD, rel=0.06)
    assert values["paper_velocity_std"].value == pytest.approx(STD, rel=0.07)


@pytest.mark.parametrize("held_up", [OFTEN, TOO_OFTEN])
def test_tap_and_press_use_the_motion_as_it_was(held_up):
    """They take no form of it for granted, so that nothing has to be left out."""
    record = recorded(held_up, PRESS, specimen=PLATE)
    delay = evaluate_step("tap", [record], SETTINGS).values["tap_delay"]
    compliance = evaluate_step("press", [record], SETTINGS).values["compliance"]
    assert abs(delay.value - DELAY) < 3 * delay.combined + 5e-5
    assert compliance.value == pytest.approx((1 - 0.25) / (2 * 3e6 * 0.005), rel=0.01)


@pytest.mark.slow
def test_contact_is_still_refused_as_contact_where_the_arm_hesitates():
    low = Shake(amplitude=0.004, height=0.005, duration=4.0)
    touching = {**SOFT, "surface": 0.004}
    with pytest.raises(LogError, match="in contact"):
        calibrate([recorded(SELDOM, low, specimen=touching)], SETTINGS)


def test_readings_that_a_log_has_lost_are_no_reason_to_refuse():
    """One state in ten is missing, and the arm moves on: nothing is left out, and all is found."""
    record = recorded((0.0, 1.0))
    for trace in (record.position, record.velocity):
        kept = np.random.default_rng(1).random(len(trace.time)) > 0.1
        object.__setattr__(trace, "time", trace.time[kept])
        object.__setattr__(trace, "values", trace.values[kept])
    found = calibrate([record], SETTINGS).values["mass"]
    assert abs(found.value - MASS) < 3 * found.combined


def test_which_times_a_hesitation_holds():
    time = np.delete(np.arange(1000) * 0.002, [*range(100, 104), *range(500, 510), *range(512, 514)])
    found = hesitations(time)
    assert found.begin == pytest.approx([0.193, 0.993, 1.017])
    assert found.end == pytest.approx([0.208 + 0.04 + 0.08, 1.02 + 0.04 + 0.2, 1.26])
    instants = np.array([0.0, 0.192, 0.194, 0.327, 0.329, 1.0, 1.1, 1.259, 1.261, 5.0])
    assert found.hold(instants).tolist() == [False, False, True, True, False, True, True, True, False, False]
    assert (found.count(0.0, 1.0), found.count(1.0, 9.0)) == (2, 1)
    for even in (np.zeros(0), np.zeros(1), np.arange(50) * 0.002):
        assert not hesitations(even).hold(instants).any()


@pytest.mark.parametrize(("missing", "holds"), [(1, False), (3, True)])
def test_states_that_are_missing_between_two_commands_are_no_hesitation(missing, holds):
    """Of an arm that reports each millisecond and is commanded every second one."""
    time = np.delete(np.arange(2000) * 0.001, [k + i for k in range(40, 2000, 50) for i in range(missing)])
    assert hesitations(time).hold(time).any() == holds
