"""A standstill is seen and never asserted: arms that do not stop, judged by what they truly did, in simulated time."""

import importlib
import json
import re
import signal

import numpy as np
import pytest
from palpate import UnstoppedArmError, clock
from palpate_engine import RestWindow
from palpate_simulation.twins.program import Program

from tests.command import signals_of_a_terminal
from tests.devices.software_arms import NAME, unlike

EMERGENCY = "PRESS THE EMERGENCY STOP"
DEEP, CREEP = -0.0025, 0.010  # m below which an arm obeys no more, m/s at which it goes on down
ALLOWED = 0.04 * 0.06 + 0.04**2 / 2 + 1e-3  # m after a stop, by the pipeline's speed, latency and deceleration


class Disobedient:
    """What a software arm does that obeys no more once it is 2.5 mm deep, until `after` calls of `stop`."""

    def __init__(self, base, after=10**9):
        self.stops, self.path, self.rest = [], [], None
        test = self

        def go_to(self, pose):
            self.advance()
            if getattr(self, "astray", False):
                return True
            self.astray = self.tip()[0][2] < DEEP
            return base.go_to(self, pose)

        def stop(self):
            if getattr(self, "astray", False):
                test.stops.append(clock().now())
                self.astray = len(test.stops) < after
            if not getattr(self, "astray", False):
                base.stop(self)

        def advance(self):
            if not getattr(self, "astray", False):
                base.advance(self)
            while self.now + 0.002 <= clock().now():
                self.now += 0.002
                pose, _ = self.model.tip(self.q.tolist(), self.tool)
                pose[2, 3] -= 0.002 * CREEP
                joints = self.model.joints_at(pose, self.tool, self.q)
                self.qd, self.q = (joints - self.q) / 0.002, joints
                self.feel()
            test.path.append((clock().now(), self.tip()[0][2], float(np.linalg.norm(self.force))))

        self.arm = unlike(base, go_to=go_to, stop=stop, advance=advance)


@pytest.mark.gate
@pytest.mark.slow
def test_a_driver_that_ignores_stop_is_called_out_while_it_moves(run_software_arm, software, tmp_path):
    test = Disobedient(software.SoftwareArm)
    error, calls = run_software_arm(test.arm)
    assert isinstance(error, UnstoppedArmError)
    assert error.exit_code == 3
    assert "stands" not in str(error)
    ((called, text),) = calls
    assert text.startswith(f"{EMERGENCY}: the tip moves at 10.0 mm/s")
    # The call comes when the tip has truly gone further than latency and deceleration allow, and with its true force.
    path = np.array(test.path)
    first = test.stops[0]
    at_stop, at_call = (path[np.searchsorted(path[:, 0], when)] for when in (first, called))
    assert ALLOWED - 0.1e-3 < at_stop[1] - at_call[1] < ALLOWED + 0.5e-3
    assert float(re.search(r"feels ([\d.]+) N", text)[1]) == pytest.approx(at_call[2], abs=0.3)
    # The stop is repeated for two seconds.
    assert len(test.stops) >= 19
    assert 1.7 < test.stops[-1] - first < 2.1
    reason = json.loads((tmp_path / "out" / "result.json").read_text())["run"]["live"]["stop"]["reason"]
    assert EMERGENCY in reason


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_arm_that_does_not_stand_has_its_exit_code_before_that_of_a_signal(run_software_arm, software, number):
    """The signal is what stops the run: it would be 130 or 143."""
    test, sent = Disobedient(software.SoftwareArm), []

    class Interrupted(test.arm):
        def advance(self):
            super().advance()
            if getattr(self, "astray", False) and not sent:
                sent.append(clock().now())
                signal.raise_signal(number)

    with signals_of_a_terminal():
        error, calls = run_software_arm(Interrupted)
    assert sent
    assert isinstance(error, UnstoppedArmError)
    assert error.exit_code == 3
    assert calls[0][1].startswith(EMERGENCY)


@pytest.mark.slow
@pytest.mark.parametrize("after", [2, 4])
def test_an_arm_that_obeys_a_repeated_stop_stands(run_software_arm, software, after):
    """It is said to stand only when it does: 0.1 s after it truly came to rest."""
    test = Disobedient(software.SoftwareArm, after)
    error, calls = run_software_arm(test.arm)
    assert calls == []
    assert error.exit_code == 1
    assert "The tip stands at a height of" in str(error)
    path = np.array(test.path)
    assert np.ptp(path[path[:, 0] > test.stops[-1] + 0.08, 1]) < 0.1e-3  # it truly stands
    assert path[-1, 0] > test.stops[-1] + 0.08


@pytest.mark.slow
@pytest.mark.parametrize(("watchdog", "repeats"), [(True, False), (False, True)])
def test_missing_states_call_for_the_emergency_stop_at_once(run_software_arm, software, monkeypatch, watchdog, repeats):
    """A lost link to a controller with a watchdog is left, so that nothing on it is carried out later."""
    stops, cut = [], []

    def go_to(self, pose):
        if self.tip()[0][2] < DEEP and not cut:
            cut.append(clock().now())
            self.plugged = False
        return software_arm.go_to(self, pose)

    def stop(self):
        stops.append(clock().now())
        software_arm.stop(self)

    software_arm = software.SoftwareArm
    monkeypatch.setattr(importlib.import_module(f"{NAME}.driver").Driver, "has_watchdog", watchdog)
    error, calls = run_software_arm(unlike(software_arm, go_to=go_to, stop=stop))
    assert error.exit_code == 3
    ((called, text),) = calls
    assert text.startswith(f"{EMERGENCY}: no states show that the tip stands; at last it was at a height of -2.5 mm")
    assert called - cut[0] < 0.05
    assert (len([when for when in stops if when > cut[0]]) > 10) == repeats


@pytest.mark.slow
def test_a_pose_that_froze_while_the_arm_moved_shows_no_standstill(run_software_arm, software):
    """Every state is that of the moment at which it froze: it looks like an arm that stands, and moves."""
    test, frozen = Disobedient(software.SoftwareArm), []

    def state(self):
        found = super(arm, self).state()
        if getattr(self, "astray", False) and found is not None:
            frozen.append(found)
            found = frozen[0]._replace(time=found.time)
        return found

    arm = unlike(test.arm, state=state)
    error, calls = run_software_arm(arm)
    assert error.exit_code == 3
    assert calls[0][1].startswith(f"{EMERGENCY}: no states show that the tip stands")
    assert calls[0][0] - test.stops[0] < 0.15


@pytest.mark.gate
@pytest.mark.slow
def test_a_deaf_robot_is_called_out_while_it_moves(rig, monkeypatch):
    """Its program goes on at the speed that it had, whatever is commanded: no watchdog, no stop."""
    step, deaf, calls = Program.step, [], []
    monkeypatch.setattr(
        "palpate_engine.pipeline.live.arm_stop.call_for_stop",
        lambda text: calls.append((clock().now(), text, rig.state())),
    )

    def drive_on(self, inputs, now):
        arm = self._arm
        if deaf:
            return True
        if rig.state()["height"] < -0.001 and rig.world.velocity[2] < -0.005:
            deaf.append((clock().now(), rig.state()))
            arm.run_at(arm.qd.copy())
            return True
        return step(self, inputs, now)

    monkeypatch.setattr(Program, "step", drive_on)
    with pytest.raises(UnstoppedArmError) as caught:
        rig.run()
    assert "stands" not in str(caught.value)
    called, text, state = calls[0]
    speed = float(re.search(r"the tip moves at ([\d.]+) mm/s", text)[1])
    assert speed == pytest.approx(1e3 * state["tip_speed"], rel=0.1)
    assert called - deaf[0][0] < 1.1
    assert rig.state()["tip_speed"] > 0.005  # it moves to the end, and nobody says otherwise


@pytest.mark.parametrize(
    ("speed", "noise", "rests"),
    [(0.0, 5e-6, True), (0.0, 0.0, True), (0.0002, 5e-6, True), (0.001, 5e-6, False), (0.01, 0.0, False)],
)
def test_states_show_a_standstill_by_their_places(speed, noise, rests):
    window, random = RestWindow(), np.random.default_rng(0)
    for tick in range(51):
        assert not window.shows_rest
        window.add(2_000_000 * tick, [0.0, 0.0, -speed * 0.002 * tick + noise * random.standard_normal()])
    assert window.shows_rest == rests
    assert window.speed == pytest.approx(speed, abs=2e-4)


def test_a_vibration_is_no_standstill():
    window = RestWindow()
    for tick in range(60):
        window.add(2_000_000 * tick, [0.1e-3 * np.sin(2 * np.pi * 40.0 * 0.002 * tick)])
    assert window.is_full
    assert not window.shows_rest
