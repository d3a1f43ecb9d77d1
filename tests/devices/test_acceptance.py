"""``palpate acceptance``: what a rig does when it is stopped, against what [safety] declares."""

import json
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pytest
from palpate import ConfigurationError, StopModes
from palpate_commands.acceptance.measurement import (
    BrakingTrace,
    MissedError,
    StandstillAfterEvent,
    first_beyond,
    measure_braking,
    measure_force_delay,
    measure_standstill,
)
from palpate_commands.acceptance.observer import RunRecord
from palpate_commands.acceptance.outcome import Allowed, Outcome
from palpate_commands.acceptance.page import Acceptance
from palpate_commands.acceptance.simulator import Simulator
from palpate_commands.acceptance.steps import all_visits
from palpate_commands.acceptance.strokes_run import FORCE, StrokesRun, row_type
from palpate_commands.acceptance.watched_arm import WatchedArm
from palpate_commands.acceptance.watched_run import WatchedRun
from palpate_devices.ur.device import UR
from palpate_engine import load_pipeline
from palpate_engine.cli import call
from palpate_engine.config import resolved_text
from palpate_simulation.twins.bench import VirtualBench

from tests.devices.simulated_bench import PIPELINE, SHORT
from tests.devices.simulated_job import go_through

STEP = 0.002  # [s] between the states of a robot


def stop(event, reaction, deceleration, *, speed=0.02, noise=0.0, seed=0):
    """A trace on the way in that is told to stop at an event [s], brakes after a reaction [s], and stands."""
    time = np.arange(0.0, 1.5, STEP)
    braking = np.clip(time - event - reaction, 0.0, speed / deceleration)
    way = speed * np.minimum(time, event + reaction) + speed * braking - 0.5 * deceleration * braking**2
    random = np.random.default_rng(seed).standard_normal(len(time))
    return BrakingTrace(time, 0.01 - way, -np.gradient(way, time) + noise * random)


@pytest.mark.parametrize("noise", [0.0, 0.67e-3])
@pytest.mark.parametrize(("reaction", "deceleration"), [(0.0, 1.0), (0.06, 1.0), (0.25, 0.3), (0.03, 4.0)])
def test_reaction_and_braking_are_measured(reaction, deceleration, noise):
    found = measure_braking(stop(0.5, reaction, deceleration, noise=noise), 0.5, 0.02, inwards=True)
    assert found.reaction == pytest.approx(reaction, abs=2.5 * STEP + 2 * noise / deceleration)
    assert found.way == pytest.approx(0.02 * reaction + 0.02**2 / (2 * deceleration), abs=2e-5)
    assert found.deceleration <= found.deceleration_most
    if deceleration <= 1.0:  # what takes some states
        assert found.deceleration == pytest.approx(deceleration, rel=0.25)
    assert found.deceleration_most > 0.95 * deceleration


@pytest.mark.parametrize(
    ("trace", "event", "planned", "words"),
    [
        (stop(0.4, 0.0, 0.1), 0.5, 0.02, r"the arm turned just then, at 11\.\d of 20.0 mm/s"),
        (stop(0.2, 0.0, 1.0), 0.5, 0.02, "the arm turned just then, at 0.0 of 20.0 mm/s"),
        (stop(0.5, 0.0, 1.0), 0.5, 0.04, "this computer is too busy to move .* at 20.0 of 40.0 mm/s"),
        (stop(9.0, 0.0, 1.0), 0.5, 0.02, "did not stop"),
        (stop(0.5, 0.0, 1.0), 1.49, 0.02, "are missing"),
        (
            BrakingTrace(np.arange(0, 1, STEP), np.arange(0, 1, STEP) * 0.02, np.full(500, 0.02)),
            0.5,
            0.02,
            "on its way up",
        ),
    ],
)
def test_a_stop_that_shows_nothing_is_missed(trace, event, planned, words):
    with pytest.raises(MissedError, match=words):
        measure_braking(trace, event, planned, inwards=True)


def test_a_force_that_is_never_reached_is_missed():
    assert first_beyond(np.arange(3.0), np.array([0.1, -4.0, 5.0]), 3.0) == 1.0
    with pytest.raises(MissedError, match=r"the force reached 0.20 N of 3.00 N"):
        first_beyond(np.arange(2.0), np.array([0.1, -0.2]), 3.0)


@pytest.mark.gate
@pytest.mark.slow
def test_a_sound_rig_passes(simulated, tmp_path):
    """Over 20 s, for four ways to stop: each needs strokes of its own."""
    names = ["free-air/estop", "free-air/safeguard", "free-air/cable", "foam/force"]
    found, said = go_through(simulated(*SHORT, "twin.bench.height=10 mm"), tmp_path / "a", names)
    assert {name: outcome.problems for name, outcome in found.items()} == dict.fromkeys(names, ())
    assert "safeguard stop" in found["free-air/safeguard"].report
    assert "over the limit of 3 N" in found["foam/force"].report
    assert found["free-air/estop"].braking.way < 0.2e-3
    assert 0.0 < found["foam/force"].braking.reaction < 0.03
    assert any("lay foam" in text for text in said)


@pytest.mark.slow
def test_a_rig_whose_stops_are_slow_fails(simulated, tmp_path):
    """0.05 rad/s^2 at a joint: the arm coasts for tenths of a second after the red button."""
    twin = simulated(*SHORT, "twin.bench.height=10 mm")
    found, _ = go_through(twin, tmp_path / "a", ["free-air/estop"], ("slow-stop 0.05",))
    outcome = found["free-air/estop"]
    assert {"it brakes too softly", "it goes too far"} <= set(outcome.problems)
    assert outcome.braking.deceleration < 0.1
    assert outcome.braking.way > 1e-3


@pytest.mark.slow
def test_a_rig_that_reacts_later_than_declared_fails(simulated, tmp_path):
    """An arm that follows its commands 30 ms late, of which 0.1 ms and the sensor's filter are declared."""
    twin = simulated(*SHORT, "twin.bench.height=10 mm")
    late = ("safety.latency=0.1 ms", "device.arm.lookahead=0.2 s")
    found, _ = go_through(twin, tmp_path / "a", ["foam/force"], (), late)
    outcome = found["foam/force"]
    assert "braking begins too late" in outcome.problems, outcome


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--step", "estp"), "did you mean 'estop'"),
        (("--stop-force", "30 N"), "up to \\[safety\\] stop_force = 12 N"),
        (("--stop-force", "3 mm"), "is not a force, such as 3 N"),
        (("--set", 'safety.high=["5 mm", "5 mm", "9 mm"]'), "need 6 mm over the skin"),
        (("--set", "safety.latency=0.3 s"), r"\[device.arm\]: the way to the start: .* could reach"),
        (("--set", "device.arm.type=sim"), "device.arm"),
    ],
)
def test_a_protocol_that_cannot_be_is_refused(root, tmp_path, monkeypatch, words, complaint):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigurationError, match=complaint):
        call(["acceptance", str(root / "pipelines" / "point_ur3e.toml"), *words])
    assert not list(tmp_path.iterdir())


def test_nothing_moves_without_limits(root):
    with pytest.raises(ConfigurationError, match=r"nothing moves without limits: a \[safety\] table is missing"):
        call(["acceptance", str(root / "pipelines" / "point.toml")])


def strokes_in_foam(delay, eta=0.0, noise=0.02, speeds=(3e-3, 3e-3, 12e-3, 12e-3)):
    """A trace of strokes from 5 mm to -4 mm, and the force of an elastic half-space with some viscosity, so late."""
    way, time, height = 9e-3, [np.arange(0.0, 1.0, STEP)], [np.full(round(1.0 / STEP), 5e-3)]
    for speed in speeds:
        t = np.arange(0.0, 2 * way / speed, STEP)
        time.append(time[-1][-1] + STEP + t)
        height.append(5e-3 - np.minimum(speed * t, 2 * way - speed * t))
    time, height = np.concatenate(time), np.concatenate(height)
    velocity = np.gradient(height, time)
    stamps = np.arange(0.0, time[-1], 1 / 800)
    at = lambda values: np.interp(stamps - delay, time, values)  # noqa: E731
    depth = np.maximum(-at(height), 0.0)
    force = 14e3 * depth**1.5 - eta * 14e3 * 1.5 * depth**0.5 * at(velocity)
    force = np.where(depth > 0, force, 0.0) + noise * np.random.default_rng(0).standard_normal(len(stamps))
    return BrakingTrace(time, height, velocity), stamps, force


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.1, 0.5])
@pytest.mark.parametrize("eta", [0.0, 5e-3])
def test_how_late_the_force_comes_is_measured(delay, eta):
    found = measure_force_delay(*strokes_in_foam(delay, eta))
    assert found.value == pytest.approx(delay, abs=0.008)
    assert found.std < 0.01


def test_strokes_at_one_speed_or_in_the_air_show_no_delay():
    with pytest.raises(MissedError, match="the force rose on 4 ways down"):
        measure_force_delay(*strokes_in_foam(0.1, speeds=(6e-3,) * 4))
    trace, time, force = strokes_in_foam(0.1)
    with pytest.raises(MissedError, match="ways down"):
        measure_force_delay(trace, time, force - force + 0.02 * np.random.default_rng(1).standard_normal(len(time)))


@pytest.mark.slow
def test_a_delay_from_the_start_is_measured_and_fails_a_rig_that_does_not_declare_it(simulated, tmp_path):
    """Over 20 s: a delay shows only by strokes of several speeds into foam, each by a whole run."""
    twin = simulated(*SHORT, "twin.bench.height=10 mm", "twin.bench.force_delay=100 ms")
    found, _ = go_through(twin, tmp_path / "a", ["foam/delay"])
    outcome = found["foam/delay"]
    assert outcome.problems == ("the force comes later than declared",)
    assert outcome.force_delay.value == pytest.approx(0.1 + 0.0019, abs=0.015)


@pytest.mark.slow
def test_the_checksum_of_the_safety_configuration_is_in_the_result(rig):
    live = rig.run("device.arm.safety_checksum=C0DE").run["live"]
    assert live["devices"]["arm"]["safety_checksum"] == "C0DE"


def test_a_checksum_that_no_pendant_shows_is_refused(root):
    with pytest.raises(ConfigurationError, match="safety_checksum"):
        call(["check", str(root / "pipelines" / "point_ur3e.toml"), "--set", "device.arm.safety_checksum=C0-DE"])


@pytest.mark.slow
def test_the_acceptance_of_a_rehearsal_is_rehearsed(palpate, tmp_path):
    """The twin does what a person would, and the page is nothing to sign."""
    rig = load_pipeline(PIPELINE, [*SHORT, 'run.rehearsal="bench"', "twin.bench.height=10 mm"])
    (tmp_path / "pipeline.toml").write_text(resolved_text(rig))
    done = palpate("acceptance", "pipeline.toml", "--step", "free-air/safeguard", "--out", "out")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out" / "acceptance.md").read_text()
    assert page.startswith("# Rehearsal of the acceptance of")
    assert "nothing real has moved" in page
    assert "place, date" not in page
    assert "the robot is in a safeguard stop" in page
    table = json.loads((tmp_path / "out" / "acceptance.json").read_text())
    assert (table["rehearsal"], table["verdict"], table["whole"]) == ("bench", "passed in part", False)
    refused = palpate("acceptance", "pipeline.toml", "--step", "ctrl-c", "--out", "other")
    assert refused.returncode == 2
    assert "--step ctrl-c: a signal needs the process of a run: it is not rehearsed" in refused.stderr


@pytest.fixture
def single_connection(monkeypatch):
    """Let the driver of a UR declare that its controller serves one program."""
    modes = StopModes("safety_mode", (6, 7, 8), (5,), single_connection=True)
    monkeypatch.setattr(UR, "stop_modes", modes)


@pytest.mark.slow
def test_the_record_of_a_run_shows_the_stop_that_a_second_connection_shows(simulated, tmp_path, request):
    """Over 20 s: each of two stops twice, once from outside the run and once from its own record."""
    names, outcomes = ["free-air/estop", "foam/force"], []
    for folder in ("outside", "record"):
        twin = simulated(*SHORT, "twin.bench.height=10 mm")
        outcomes.append(go_through(twin, tmp_path / folder, names)[0])
        request.getfixturevalue("single_connection")
    assert not list((tmp_path / "outside").rglob("tip.bin"))
    for name in names:
        outside, record = (each[name] for each in outcomes)
        assert record.problems == outside.problems == ()
        for key, tolerance in (("reaction", 3 * STEP), ("way", 5e-5), ("speed", 1e-3)):
            assert getattr(record.braking, key) == pytest.approx(getattr(outside.braking, key), abs=tolerance), (
                name,
                key,
            )


@pytest.mark.slow
def test_a_slow_stop_fails_by_the_record_of_the_run_as_well(simulated, single_connection, tmp_path):
    twin = simulated(*SHORT, "twin.bench.height=10 mm")
    outcome = go_through(twin, tmp_path / "a", ["free-air/estop"], ("slow-stop 0.05",))[0]["free-air/estop"]
    assert {"it brakes too softly", "it goes too far"} <= set(outcome.problems)


def test_a_record_is_read_as_it_grows_and_never_half_a_row(root, single_connection, tmp_path):
    arm = WatchedArm.of(load_pipeline(root / "pipelines" / "point_ur3e.toml"))
    run = StrokesRun(tmp_path, None, None)
    record = RunRecord(arm, run)
    assert np.isnan(record.height)
    rows = {name: np.zeros(3, row_type(arm.columns(name))) for name in arm.streams}
    for name, table in rows.items():
        table["time"], table["values"][:, 2] = [0, 2_000_000, 4_000_000], [0.01, 0.02, 0.03]
        data = table.tobytes()
        run.record(name).write_bytes(data[: len(data) // 2])
    assert record.height == 0.01
    for name, table in rows.items():
        run.record(name).write_bytes(table.tobytes())
    assert record.height == 0.03
    trace = record.trace(0)
    assert trace.time.tolist() == [0.0, 0.002, 0.004]
    assert trace.height.tolist() == [0.01, 0.02, 0.03]


@pytest.mark.parametrize(
    ("stands_at", "movement", "problems"),
    [
        (-0.7e-3, 0.0, ()),
        (-3.0e-3, 0.0, ("it goes too far",)),
        (3.0e-3, 0.0, ("it goes too far",)),
        (-0.7e-3, 2e-4, ("it still moved once the run had ended",)),
    ],
)
def test_a_kill_is_judged_by_where_the_arm_stands_afterwards(stands_at, movement, problems):
    """The record ends 6 ms before the kill; `stands_at` is from the place of the tip at the kill."""
    trace, event, speed = stop(9.0, 0.0, 1.0), 0.5, 0.02
    last = trace.time <= event - 0.006
    cut = BrakingTrace(trace.time[last], trace.height[last], trace.velocity[last])
    height = 0.01 - speed * event + stands_at
    found = measure_standstill(cut, event, speed, height, movement)
    assert found.way == pytest.approx(abs(stands_at), abs=1e-5)
    assert found.resolution == pytest.approx(0.006 + STEP, abs=1e-9)
    (visit,) = (visit for visit in all_visits() if visit.name == "free-air/kill")
    assert Outcome(visit, Allowed(0.08, 0.5), None, "", standstill=found).problems == problems


def test_a_record_that_ends_long_before_the_kill_shows_nothing():
    trace = stop(9.0, 0.0, 1.0)
    with pytest.raises(MissedError, match=r"states around the stop at 1\.60 s are missing; they go to 1\.50 s"):
        measure_standstill(trace, 1.6, 0.02, 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "name"), [([], "bench"), (['device.arm.host="10.0.0.7"'], None), (['run.rehearsal="bench"'], None)]
)
def test_an_arm_at_the_address_of_a_twin_is_a_simulator(root, changes, name):
    simulator = Simulator.of(load_pipeline(root / "pipelines" / "point_ur3e.toml", changes))
    assert name == (None if simulator is None else simulator.name)


def test_a_stop_that_a_simulator_lacks_is_refused(root, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(VirtualBench, "absent_stops", ("emergency",))
    with pytest.raises(ConfigurationError, match="--step estop: the simulator bench has no such stop"):
        call(["acceptance", str(root / "pipelines" / "point_ur3e.toml"), "--step", "estop"])


def test_a_stop_that_a_simulator_lacks_stays_open_on_its_page():
    safety = load_pipeline(PIPELINE).safety
    simulator = Simulator("bench", ("emergency", "safeguard", "reflex"))
    standstill = StandstillAfterEvent(0.02, 1e-3, 4e-3, 0.0)
    outcomes = tuple(
        Outcome(visit, Allowed(0.08, 0.5), None, "", standstill=standstill)
        for visit in all_visits()
        if not simulator.lacks(visit)
    )
    began = datetime(2026, 1, 2, tzinfo=UTC)
    page = Acceptance("rig", "rig.toml", began, "1", {}, safety, outcomes, all_visits(), None, simulator)
    text = page.text()
    assert text.startswith("# Acceptance on a simulator of rig: passed in part")
    stops = "free-air/estop, free-air/safeguard, free-air/reflex, foam/estop, foam/safeguard"
    assert f"- not in the simulator, and open until they are done on the rig: {stops}\n" in text
    assert "- not done" not in text
    assert "signature: ___" in text
    assert (page.table()["simulator"], page.table()["whole"]) == ("bench", False)


def test_a_force_that_was_not_reached_is_reported_with_what_stopped_the_run(tmp_path):
    run = StrokesRun(tmp_path, None, 3.0)
    rows = np.zeros(3, row_type(1))
    rows["values"][:, 0] = 0.2
    run.record(FORCE).write_bytes(rows.tobytes())
    (tmp_path / "run").mkdir()
    live = {"standstill": {"force": 0.1}, "stop": {"reason": "the sensor is disconnected"}}
    (tmp_path / "run" / "result.json").write_text(json.dumps({"run": {"live": live}}))
    (visit,) = (visit for visit in all_visits() if visit.name == "foam/force")
    watched = WatchedRun(visit, None, None, 0.0, None, SimpleNamespace(run=run), 0)
    with pytest.raises(MissedError, match=r"the force reached 0\.10 N of 3\.00 N: the sensor is disconnected"):
        watched.event_time()
