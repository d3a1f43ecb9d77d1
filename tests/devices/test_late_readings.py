"""Readings and states that come late but regularly: judged by what the twin's arm did, in simulated time."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from palpate import ConfigurationError, DeviceError, clock
from palpate_arms.arm_watch import ArmWatch
from palpate_simulation.twins.delay_line import DelayLine

from tests.devices.simulated_bench import PIPELINE, SHORT
from tests.devices.test_force_watch import Line, readings

# Some 27 N/mm at the force that stops, declared as such, and 4 mm/s.
STIFF = (
    *(entry for entry in SHORT if not entry.startswith("trajectory.press")),
    "safety.stiffness=27 N/mm",
    "safety.latency=40 ms",
    "device.arm.approach_speed=4 mm/s",
    "twin.bench.specimen.elasticity=3.4 MPa",
    "twin.bench.specimen.viscosity=3400 Pa*s",
    "twin.bench.specimen.surface=0 mm",
    'run.tracks=["dr/ekf"]',
)
MOTION = 'type = "load-unload"\ndepth = "3 mm"\nspeeds = ["4 mm/s"]\nclearance = "3 mm"\nstandstill = "0 s"\n'
# A rig whose readings come half a second late from the start has to be let begin.
PATIENT = ("device.sensor.settle=1.5 s", "device.sensor.sensor_timeout=1 s", "safety.sensor_timeout=1 s")


@pytest.fixture
def stiff(simulated, tmp_path):
    """A rig that presses at 4 mm/s on what has some 27 N/mm."""
    text = PIPELINE.read_text()
    begin, end = text.index("[trajectory.press]"), text.index("[alignment]")
    file = tmp_path / "stiff.toml"
    file.write_text(f"{text[:begin]}[trajectory.press]\n{MOTION}\n{text[end:]}")
    return lambda *overrides: simulated(*STIFF, *overrides, pipeline=file)


def late_from_the_start(rig, seconds, *overrides):
    clock().sleep(0.1)
    rig.fault(f"late-readings {seconds}")
    clock().sleep(0.1)
    try:
        rig.run(*PATIENT, *overrides)
    except DeviceError as error:
        return str(error)
    return "it came to its end"


@pytest.mark.slow
def test_a_sound_rig_stops_within_its_force(stiff):
    rig = stiff()
    with pytest.raises(DeviceError, match=r"the force is 12\.\d N, over the limit of 12 N that stops the motion \("):
        rig.run()
    assert 12.0 < rig.truth.force < 14.0


@pytest.mark.slow
@pytest.mark.parametrize(("seconds", "height"), [(0.5, 1.5e-3), (0.1, -0.2e-3), (0.2, -0.2e-3), (0.5, -0.2e-3)])
def test_a_lateness_that_sets_in_stops_within_the_force(stiff, seconds, height):
    rig = stiff()
    error, table, _ = rig.run_into(f"late-readings {seconds}", lambda state: state["height"] < height)
    assert "readings of sensor.wrench.z come late: the newest is" in error
    assert "reading_age = 20 ms" in error
    assert rig.truth.force < 20.0
    assert rig.wait_at_rest()["height"] > 2e-3  # it has left the material
    assert table["run"]["live"]["peak_force"] < 20.0


@pytest.mark.slow
@pytest.mark.parametrize(("seconds", "most"), [(0.1, 22.0), (0.2, 33.0), (0.5, 75.0)])
def test_one_that_was_there_from_the_start_is_not_seen_and_what_it_did_is_reported(stiff, seconds, most):
    rig = stiff()
    error = late_from_the_start(rig, seconds)
    assert re.match(r"the force is 12\.\d N, over the limit of 12 N", error)
    assert 20.0 < rig.truth.force < most
    reached = float(error.split("; the force reached ")[1].split(" N")[0])
    assert reached == pytest.approx(rig.truth.force, abs=0.5)
    assert f"{reached - 20.0:.1f} N over [safety] force = 20 N" in error
    live = json.loads((rig.folder / "out" / "result.json").read_text())["run"]["live"]
    assert live["stop"]["reason"] in error


@pytest.mark.parametrize("seconds", [0.1, 0.2, 0.5])
def test_a_lateness_that_was_measured_is_refused_before_motion(stiff, seconds):
    """What `palpate acceptance` finds is the sensor's delay."""
    rig = stiff()
    with pytest.raises(ConfigurationError, match=r"4\.0 mm/s inwards the force could reach .* is the fastest approach"):
        rig.run(f"safety.sensor_delay={seconds} s")
    assert rig.truth.speed < 1e-4


@pytest.mark.slow
def test_states_that_come_late_stop_the_arm(stiff):
    rig = stiff()
    error, _, _ = rig.run_into("late-states 0.2", lambda state: state["height"] < -0.2e-3)
    assert re.match("(the controller's states|readings of arm.tip.z) come late: the newest is", error)
    assert rig.truth.force < 12.0
    assert rig.wait_at_rest()["height"] > 2e-3  # it has left the material


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.1, 0.2])
def test_states_that_are_late_before_the_connection_are_named(rig, seconds):
    """The watchdog ended the program meanwhile, which was all that was said before."""
    clock().sleep(0.1)
    rig.fault(f"late-states {seconds}")
    clock().sleep(0.6)
    pattern = (
        r"the controller's states come late: the one that answers a command came \d+ ms after it, and its watchdog"
    )
    with pytest.raises(DeviceError, match=pattern):
        rig.run()
    assert rig.world.truth.facts()["fastest_tip"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.03, 0.06, 0.09])
def test_states_that_are_late_from_the_start_are_shown_by_the_command_that_they_answer(rig, seconds):
    """No time-stamp shows it, and before the motion went on with a tip that was elsewhere by its speed times that."""
    clock().sleep(0.1)
    rig.fault(f"late-states {seconds}")
    clock().sleep(0.4)
    with pytest.raises(
        DeviceError, match=r"states, or its commands, come late from the start: a command shows"
    ) as said:
        rig.run()
    answer = float(re.search(r"shows (\d+) ms after it was sent", str(said.value))[1])
    assert 1e3 * seconds <= answer <= 1e3 * seconds + 6.0
    assert rig.world.truth.facts()["fastest_tip"] < 3e-3  # of the first retreat, outwards
    assert rig.truth.force < 0.01


@pytest.mark.slow
def test_the_lateness_of_states_that_stays_unseen_stands_in_the_safety_case(rig):
    """What [safety] reading_age admits: by 18 ms of 20 the arm is where its states have it within 0.7 mm at 40 mm/s."""
    clock().sleep(0.1)
    rig.fault("late-states 0.018")
    clock().sleep(0.4)
    assert rig.run().interrupted is None
    page = (Path(__file__).parents[2] / "docs" / "safety-case.md").read_text()
    assert "states late from the start by less than `reading_age`" in page


@pytest.mark.slow
@pytest.mark.parametrize(
    ("height", "seconds", "back"), [(2e-3, 0.2, "198"), (-0.5e-3, 0.2, "198"), (-0.5e-3, 0.01, "8"), (1e-3, 0.004, "2")]
)
def test_time_stamps_of_an_arm_that_go_back_are_named(rig, height, seconds, back):
    error, _, _ = rig.run_into(f"stamp-leap -{seconds}", lambda state: state["height"] < height)
    assert error.startswith(
        f"the controller's time-stamps go back by {back} ms while its states go on: they arrive out"
    )
    assert rig.truth.force < 3.0
    assert rig.wait_at_rest()["height"] > 2e-3  # it has left the material


@pytest.mark.parametrize(
    ("steps", "cause"),
    [
        ((-0.2,), "go back by 198 ms"),
        ((-0.005,), "go back by 3 ms"),
        ((-0.0024,), None),
        ((0.0,), "come late"),
        ((), None),
    ],
)
def test_a_late_state_and_an_older_one_are_distinguished(steps, cause):
    """States every 2 ms; from the 100th on their stamps are older by a step, or they come 0.2 s later."""
    arm = SimpleNamespace(stamp=0.0, seen=0, is_number=True, observed=True)
    watch = ArmWatch(arm, 0.1)
    for number in range(110):
        after = bool(steps) and number >= 100
        arm.stamp = 0.002 * number + (steps[0] if after else 0.0)
        arm.seen = 2_000_000 * number + (200_000_000 if after and not steps[0] else 0)
        watch.check_state()
    text = watch.lateness(0.02)
    assert (text is None) if cause is None else (cause in text)


def test_the_servo_process_sees_the_lateness_by_itself():
    line = Line(tick=1000, age=0.02)
    assert line.run(readings(800), stamped=True)[0] is None
    text, after = line.run(readings(800, seed=1), stamped=True, late=0.1)
    assert text.startswith("readings of s.z come late: the newest is 100 ms old")
    assert after < 0.01


def test_a_sensor_without_a_clock_has_no_age():
    line = Line(tick=0, age=0.02)
    assert line.run(readings(400, seed=1), stamped=True, late=0.5)[0] is None


def test_readings_that_arrive_late_are_no_fresh_ones_in_the_reaction():
    from tests.engine.test_safety import limits

    assert limits(reading_age=0.1, sensor_delay=0.2).reaction == pytest.approx(0.36)
    assert np.isclose(limits().reaction, 0.08)


def test_a_delay_line_thins_out_what_it_holds_and_keeps_its_order():
    line = DelayLine()
    line.set(0.1, 1.0)
    times, found = np.arange(0.9, 2.0, 0.002), {}
    for now in times.tolist():
        line.put(now, now)
        found |= dict.fromkeys(line.take(now), now)
    late = np.array([found[sent] - sent for sent in sorted(found)])
    assert list(found) == sorted(found)
    assert late[:50] == pytest.approx(0.0, abs=1e-9)  # before it was set
    assert late[-1] == pytest.approx(0.1, abs=3e-3)
    assert np.diff(sorted(found.values())).max() < 0.005  # it is never silent
    line.clear()
    line.put(3.0, 3.0)
    assert line.take(3.0) == [3.0]
