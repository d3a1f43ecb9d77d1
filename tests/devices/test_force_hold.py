"""A tip that the force leads: the loop alone, on the simulated rig, and on the twin by what its arm truly did."""

import math
from dataclasses import replace

import numpy as np
import pytest
from palpate import ConfigurationError, DeviceError, ForceLaw, ForceWatch, Repeats
from palpate_arms.force_control import ForceLead, refusal
from palpate_arms.servo import Commander
from palpate_arms.servo_law import ServoLaw
from palpate_arms.setpoint_buffer import PERIOD, Plan
from palpate_devices.bota.device import BotaSensor
from palpate_devices.ur.device import UR
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_engine.safety import SafetySettings
from palpate_trajectories.force_hold import ForceHold

from tests.devices.simulated_bench import SHORT
from tests.simulated import pipeline, solid

LAW = ForceLaw(2.0, 0.1, 8.0, 0.005, 0.1, 1 / (0.4 * 2000.0))
HOLD = ForceHold(force=2.0, depth=0.005, stiffness=2000.0, duration=8.0, standstill=0.1)
LIMITS = SafetySettings(
    low=(-0.005, -0.005, -0.007),
    high=(0.005, 0.005, 0.02),
    speed=0.04,
    acceleration=0.5,
    force=20.0,
    stop_force=12.0,
    stiffness=3000.0,
)


def led(stiffness, *, skin=0.0, lag=0.05, sign=1.0, heard=lambda time: True, hold=HOLD):
    """Heights (n,), speeds and forces of a loop on a spring, the tip `lag` behind; and why it ended."""
    times = np.arange(0.0, hold.total_duration, PERIOD)
    floor = hold.at(times).position[:, 2]
    lead, tip, track = ForceLead.of(hold.force_law, floor, PERIOD), float(floor[0]), []
    for time, low in zip(times.tolist(), floor.tolist()):
        force = stiffness * max(skin - tip, 0.0)
        lead.hear(sign * force if heard(time) else None)
        height, speed = lead.next(time, low)
        tip += (height - tip) * PERIOD / lag
        track.append((tip, height, speed, force, low))
        if (text := lead.fault(time, tip)) is not None:
            return np.array(track), text
    return np.array(track), None


@pytest.mark.parametrize("stiffness", [500.0, 2000.0])
def test_the_force_is_reached_without_overshoot_and_held(stiffness):
    """In the stiffest material that is declared, and in a softer one; the speed and the acceleration are kept."""
    track, text = led(stiffness)
    assert text is None
    force = track[:, 3]
    assert force.max() < 2.0 * 1.05
    held = force[int(7.0 / PERIOD) : int(8.0 / PERIOD)]
    assert held == pytest.approx(2.0, abs=0.06)
    assert np.abs(track[:, 2]).max() <= HOLD.speed * (1 + 1e-9)
    assert np.abs(np.diff(track[:, 2])).max() / PERIOD <= HOLD.acceleration * 1.01
    assert (track[:, 1] >= track[:, 4] - 1e-12).all()  # never below the envelope
    assert track[-1, 1] == pytest.approx(HOLD.clearance, abs=2e-5)  # and it ends where it began


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stiffness": 100.0}, "at the end of its envelope"),
        ({"stiffness": 2000.0, "skin": -0.02}, "at the end of its envelope"),
        ({"stiffness": 2000.0, "sign": -1.0}, "the other way round"),
        ({"stiffness": 2000.0, "heard": lambda time: time < 3.0}, "no reading of the controlled force"),
    ],
    ids=["too soft", "no skin", "sign", "silent"],
)
def test_it_stops_where_it_must_and_never_leaves_the_envelope(changes, words):
    track, text = led(**changes)
    assert words in text
    assert track[:, 0].min() > -HOLD.depth - 1e-4
    if "the other way" in text:
        assert track[:, 3].max() < 3.0


@pytest.mark.parametrize(
    ("changes", "stop", "words"),
    [
        ({}, 12.0, None),
        ({}, None, "does not share its readings"),
        ({"force": 10.0}, 12.0, "more than 0.8 of the 12 N"),
        ({"force": -1.0}, 12.0, "not above 0"),
        ({"gain": math.inf}, 12.0, "not finite"),
        ({"gain": math.nan}, 12.0, "not finite"),
        ({"speed": 0.05}, 12.0, "over the limit of 40 mm/s"),
        ({"acceleration": 1.0}, 12.0, "over the limit of 0.5 m/s^2"),
        ({"end": 30.0}, 12.0, "not those of the motion"),
    ],
)
def test_a_law_is_judged_before_anything_moves(changes, stop, words):
    found = refusal(replace(LAW, **changes), stop, LIMITS.speed, LIMITS.acceleration, 20.0)
    assert found is None if words is None else words in found


def test_an_arm_without_news_of_the_force_stays_where_it_is_and_then_leaves():
    """The servo's own law: the tip follows what the force wants, and a silence of 0.1 s is a fault."""
    times = np.arange(0.0, HOLD.total_duration, PERIOD)
    setpoint = HOLD.at(times)
    table = np.column_stack([setpoint.position, setpoint.velocity, setpoint.measuring])
    commander = Commander(ServoLaw("pd", 20.0, 0.5, 0.02, 0.05, 1.0), np.array([0.0, 0.0, 0.002]))
    commander.follow(Plan.of(table), HOLD.force_law)
    position = before = np.array([0.0, 0.0, 0.002])
    lowest, silent = 1.0, 0
    for _ in range(len(table) + 500):
        force = 1000.0 * max(-position[2], 0.0)
        if commander.mode == "follow":
            commander.lead.hear(force if lowest > -0.0019 else None)
            silent += lowest <= -0.0019
        if commander.led_astray(float(position[2])) is not None:
            break
        position, before = commander.next(position, (position - before) / PERIOD).copy(), position
        lowest = min(lowest, float(position[2]))
    assert silent * PERIOD == pytest.approx(0.1, abs=0.01)
    commander.retract()
    for _ in range(2000):
        if commander.mode == "done":
            break
        position, before = commander.next(position, (position - before) / PERIOD).copy(), position
    assert position[2] == pytest.approx(HOLD.clearance, abs=1e-4)
    assert lowest > -0.0025


MOTION = """
type = "force-hold"
force = "3 N"
depth = "6 mm"
speed = "10 mm/s"
stiffness = "1.5 N/mm"
duration = "8 s"
standstill = "0.5 s"
"""
CREEPING = pipeline(
    solid("80 kPa", "60 kPa", "1 s"),
    MOTION,
    'type = "casadi-fit"\nsegment = "contact"\nprofile = false',
    alignment='tare_duration = "0.4 s"',
)


@pytest.fixture
def creeping(tmp_path):
    """A function that loads the pipeline with overrides."""
    (tmp_path / "creep.toml").write_text(CREEPING)
    return lambda *overrides: load_pipeline(tmp_path / "creep.toml", list(overrides))


@pytest.mark.slow
def test_the_rig_holds_a_force_on_a_material_that_creeps(creeping, tmp_path):
    """The force stays while the tip sinks; the fit and J(t) find the material."""
    from palpate_spectra.recorded_oscillation import replay
    from palpate_spectra.transient.recorded_press import longest_press
    from palpate_spectra.transient.relaxation_modulus import modulus_curve

    result = run_pipeline(creeping(), tmp_path / "run")
    assert result.tracks["sls/fit"].parameters["relaxation_time"].value == pytest.approx(1.0, rel=0.1)
    recorded = replay(tmp_path / "creep.toml", None)
    samples = recorded.samples
    late = (samples.time > 4.0) & (samples.time < 8.4)
    assert samples.force[late].mean() == pytest.approx(3.0, abs=0.06)
    assert np.ptp(samples.position[late]) > 1e-4
    found = modulus_curve(longest_press(recorded, "run"))
    assert found.creeps
    instant, rest = 1 / 140e3, 1 / 80e3
    true = rest - (rest - instant) * np.exp(-found.time / (140 / 80))
    assert found.value == pytest.approx(true, rel=0.01)
    modulus, std = found.modulus
    assert modulus == pytest.approx(80e3 + 60e3 * np.exp(-found.time), rel=0.03)
    assert (std > 0).all()


def test_the_rig_says_where_the_envelope_ends(creeping, tmp_path):
    with pytest.raises(DeviceError, match="at the end of its envelope"):
        run_pipeline(creeping("trajectory.press.depth=2 mm"), tmp_path / "run")
    with pytest.raises(ConfigurationError, match="is not possible with series_stiffness"):
        run_pipeline(creeping("device.rig.series_stiffness=30 N/mm"), tmp_path / "other")


QUICK = {"duration": 4.0, "speed": 0.008, "standstill": 0.0, "clearance": 0.003}


def held(twin, trajectory, *, watched=True, stop=12.0, fault=None):
    """What the twin's arm did under a force-hold, and why it was stopped; `fault`: of the sensor, from 0.5 mm on."""
    why = []
    arm = UR.model_validate({"host": twin.host, "work": {"origin": (-0.3, -0.13, 0.1)}})
    sensor = BotaSensor.model_validate({"port": str(twin.port), "settle": "0.1 s"})
    with sensor.connect(0) as force, arm.connect(0) as link:
        batches, seen = link.batches(), 0
        for batch in batches:
            seen += len(batch.time) * (batch.stream == "tip")
            if seen > 20:
                break
        rest = np.concatenate([b.values for b, _ in zip(force.batches(), range(60)) if b.stream == "wrench"])
        link.limit(LIMITS.of_an_arm, why.append)
        tare = tuple(rest[:, :3].mean(axis=0).tolist())
        if watched:
            shared = force.shared("wrench")
            usual = Repeats.of(rest, 800.0, {k: f"sensor.wrench.{k}" for k in range(6)}, (0, 1, 2), "sensor.wrench")
            link.watch_force(ForceWatch(shared, (0, 1, 2), tare, stop, "sensor.wrench.z", 2, 1.0, (), usual))
        twin.fault("mark")
        link.follow(trajectory)
        if fault is not None:
            twin.wait(lambda state: state["height"] < -0.0005)
            twin.fault(fault)
        for _ in batches:
            pass
    return " ".join(why), twin.state()


@pytest.mark.slow
def test_the_twins_arm_holds_a_force_within_its_envelope(simulated):
    twin = simulated(*SHORT)
    hold = ForceHold(force=2.0, depth=0.005, stiffness=2000.0, **QUICK)
    why, truth = held(twin, hold)
    assert why == ""
    assert truth["peak_force"] == pytest.approx(2.0, abs=0.3)
    assert truth["low"][2] > -0.005
    assert truth["fastest_tip"] < 1.3 * LIMITS.speed
    assert truth["height"] == pytest.approx(0.003, abs=2e-4)


@pytest.mark.slow
def test_the_twins_arm_leaves_where_the_force_is_not_found(simulated):
    """A force that the envelope's depth does not give: the tip goes no deeper, and comes back."""
    twin = simulated(*SHORT)
    hold = ForceHold(force=8.0, depth=0.001, stiffness=2000.0, **QUICK)
    why, truth = held(twin, hold)
    assert "at the end of its envelope" in why
    assert truth["low"][2] > -0.0013
    assert truth["height"] > 0.002


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("fault", ["stuck-force", pytest.param("clipped-force 0.8", marks=pytest.mark.slow)])
def test_a_force_that_is_not_true_leads_the_twins_arm_no_deeper(simulated, fault):
    """Toward 2 N, which a reading that stands still never reaches: nowhere near the envelope's end at 5 mm."""
    twin = simulated(*SHORT)
    hold = ForceHold(force=2.0, depth=0.005, stiffness=2000.0, **QUICK)
    why, truth = held(twin, hold, fault=fault)
    assert "repeats its reading in every digit" in why
    assert truth["low"][2] > -0.0025
    assert truth["height"] > 0.002


def test_a_force_that_nobody_tells_leads_nothing(simulated):
    twin = simulated(*SHORT)
    hold = ForceHold(force=2.0, depth=0.005, stiffness=2000.0, **QUICK)
    why, truth = held(twin, hold, watched=False)
    assert "does not share its readings" in why
    assert truth["fastest_tip"] < 2.1e-3  # of the first retreat, outwards
    assert truth["low"][2] > 0.0039
