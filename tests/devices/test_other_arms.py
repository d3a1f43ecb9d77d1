"""Arms of other makers: what `palpate init --plugin arm` writes, its faults, and arms by their models on the twin."""

import importlib
import json
import re
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from palpate import ArmLimits, ConfigurationError, clock
from palpate_arms.arm_lag import LagMeter
from palpate_arms.arm_link import ArmLink
from palpate_arms.arm_states import low_rate
from palpate_engine import trust_plugin
from palpate_engine.cli import call
from palpate_simulation.rehearse import load_rehearsal
from palpate_simulation.twins.faults import apply_fault
from palpate_simulation.twins.simulated_computer import simulated
from palpate_testing import ArmTest, check_device, simulated_time
from palpate_testing.arm_checks import set_out
from palpate_trajectories.point import Point

from tests.devices.software_arms import NAME, WORK, listen, unlike

PRESS = Point(bias=0.003, amplitude=0.001, clearance=0.003, duration=0.5, standstill=0.0)


def arm_test(software):
    def cut():
        software.SoftwareArm.made[-1].plugged = False

    return ArmTest(tip=lambda: software.SoftwareArm.made[-1].place_now(), cut=cut)


def checked(device, software):
    with simulated_time():
        check_device(device, PRESS, listen=3.0, arm=arm_test(software))


@pytest.mark.gate
@pytest.mark.slow
def test_what_is_written_passes_the_checks(mine, software):
    checked(mine[0].Arm(host="127.0.0.1", work=WORK), software)


def no_stop(base):
    """It goes on down at 5 mm/s once it is stopped."""

    def stop(self):
        self.creeps = self.commanded > 0.0  # taken over, it stands

    def advance(self):
        if getattr(self, "creeps", False):
            pose, _ = self.model.tip(self.target.tolist(), self.tool)
            pose[2, 3] -= 0.005 * (clock().now() - self.now)
            self.target, self.commanded = self.model.joints_at(pose, self.tool, self.target), clock().now()
        base.advance(self)

    return unlike(base, stop=stop, advance=advance)


def no_setpoints(base):
    return unlike(base, go_to=lambda self, pose: True)


def no_way_up(base):
    """It does not go up once it was down."""

    def go_to(self, pose):
        self.lowest = min(getattr(self, "lowest", np.inf), pose[2])
        deep = self.lowest < 0.1005
        return base.go_to(self, [*pose[:2], self.lowest if deep else pose[2], *pose[3:]])

    return unlike(base, go_to=go_to)


def commands_for_poses(base):
    """What it reports is what it was commanded, also without a link."""

    def state(self):
        self.plugged_for_real, self.plugged = self.plugged, True
        found = base.state(self)
        self.plugged = self.plugged_for_real
        return found._replace(q=self.target.tolist())

    return unlike(base, state=state)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (no_stop, "does not obey: 1 s after `stop` its tip still moves"),
        (no_setpoints, "does not change in any digit|has moved by|does not follow"),
        (no_way_up, "does not retract|does not follow|has moved by"),
        (commands_for_poses, "is its command, in every digit"),
    ],
)
def test_a_driver_with_a_fault_fails_the_checks(mine, software, monkeypatch, fault, words):
    faulty = fault(software.SoftwareArm)
    monkeypatch.setattr(importlib.import_module(f"{NAME}.driver"), "SoftwareArm", faulty)
    monkeypatch.setattr(software, "SoftwareArm", faulty)
    with pytest.raises(AssertionError, match=words):
        checked(mine[0].Arm(host="127.0.0.1", work=WORK), software)


SHORT = "trajectory.press.duration=2 s"
VARIANTS = """
from palpate import plugin
from palpate_mine.arm import MODEL, Arm
from tests.kit.test_arm_model import panda


class Soft(Arm):
    @property
    def controller_stiffness(self):
        return 2500.0


class Late(Arm):
    @property
    def twin_settings(self):
        return {**super().twin_settings, "arm.lag": "0.15"}


class Ended(Arm):
    @property
    def arm_model(self):
        return MODEL.model_copy(update={"high": (*MODEL.high[:2], 0.46, *MODEL.high[3:])})


class Seven(Arm):
    maker = "panda"
    joint_names = panda().joints
    posture = (0.0, -0.35, 0.0, -2.3, 0.0, 1.95, 0.785)

    @property
    def arm_model(self):
        return panda()


@plugin
def palpate_devices():
    return {"mine": Arm, "soft": Soft, "late": Late, "ended": Ended, "seven": Seven}
"""


@pytest.fixture
def rehearse(mine, tmp_path, palpate):
    """Rehearse the pipeline that is written, with another arm: what the command says, and result.json as a table."""
    plugin = tmp_path / "variants.py"
    plugin.write_text(VARIANTS)
    trust_plugin(plugin)

    def run(arm, *overrides, faults=()):
        text = (mine[1] / "point.toml").read_text().replace("seed = 1\n", f'seed = 1\nplugins = ["{plugin}"]\n')
        (tmp_path / "point.toml").write_text(text)
        words = ["--specimen", "elasticity=60 kPa", "--specimen", "viscosity=150 Pa*s"]
        words += [word for override in (f"device.arm.type={arm}", *overrides) for word in ("--set", override)]
        words += [word for fault in faults for word in ("--fault", fault)]
        done = palpate("rehearse", "point.toml", *words, "--out", "out")
        file = tmp_path / "out" / "result.json"
        return done, json.loads(file.read_text()) if file.exists() else None

    return run


def elasticity(table):
    (track,) = table["tracks"].values()
    found = track["parameters"]["elasticity"]
    return found["value"], found["combined"]


def left(text):
    """What was left of each limit, by the table of a rehearsal."""
    found = [float(x) for x in re.findall(r"\u2502\s+(-?[\d.]+) (?:mm|mm/s|deg/s|N) \u2502$", text, re.MULTILINE)]
    assert len(found) == 9
    return found


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["mine", "seven"])
def test_an_arm_isload_rehearsal_by_its_model(rehearse, arm):
    done, table = rehearse(arm, SHORT)
    assert done.returncode == 0, done.stderr
    value, uncertainty = elasticity(table)
    assert abs(value - 60e3) < 2.0 * uncertainty < 5e3
    assert min(left(done.stdout)) >= 0.0
    assert table["run"]["live"]["devices"]["arm"]["lag_seen"] == pytest.approx(0.022, abs=0.003)


@pytest.mark.slow
def test_its_acceptance_isload_rehearsal(rehearse, palpate):
    rehearse("mine", "trajectory.press.duration=1 s")
    done = palpate("acceptance", "out/pipeline.toml", "--step", "free-air/estop", "--out", "acceptance")
    assert done.returncode == 0, done.stderr
    assert re.search(r"free-air/estop .* passed", done.stdout)
    refused = palpate("acceptance", "out/pipeline.toml", "--step", "safeguard", "--out", "other")
    assert "--step safeguard: this robot does not report that stop" in refused.stderr


@pytest.mark.gate
@pytest.mark.slow
def test_an_arm_that_gives_way_is_judged_by_where_it_is(rehearse):
    """Its controller's 2.5 N/mm are on record, and no part of the specimen's stiffness."""
    done, table = rehearse("soft", SHORT, "device.arm.control=servo")
    assert done.returncode == 0, done.stderr
    value, uncertainty = elasticity(table)
    assert abs(value - 60e3) < 2.0 * uncertainty < 6e3
    assert table["run"]["live"]["devices"]["arm"]["controller_stiffness"] == 2500.0
    assert min(left(done.stdout)) >= 0.0
    # At F = 16/9 E sqrt(R) d^1.5 the depth that was commanded, 4 mm, would be that of another material.
    (deepest,) = re.findall(r"z, low\s+\u2502\s+(-[\d.]+) mm", done.stdout)
    assert 60e3 * (float(deepest) / -4.0) ** 1.5 < 50e3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "fault", "words"),
    [
        ("late", (), "the arm was commanded to move by .* and has moved by|does not follow"),
        ("ended", (), "elbow is at 25 deg, near its end at 26 deg: bring the arm into another posture"),
        ("mine", ("freeze@1.5 s",), "the controller is silent"),
        ("mine", ("protective-stop@1.5 s",), "the robot is in a protective stop"),
        ("mine", ("jam@1.5 s",), "has moved by|does not follow|does not change"),
        ("mine", ("close@1.5 s",), "the controller has closed the link"),
    ],
)
def test_what_is_wrong_with_an_arm_is_told_and_its_limits_are_kept(rehearse, arm, fault, words):
    done, _ = rehearse(arm, SHORT, faults=fault)
    assert done.returncode == (
        3 if fault and fault[0].startswith(("freeze", "close")) else 1
    )  # no states show that it stands
    assert re.search(words, done.stderr)
    assert min(left(done.stdout)) >= 0.0


def followed(device, seconds):
    """What ends the batches of an arm that is stopped after some time [s] of a motion."""
    with device.connect(0) as link:
        said = listen(link)
        set_out(link, PRESS)
        clock().sleep(seconds)
        link.stop()
        clock().sleep(2.0)
    return said


def test_a_stop_that_does_nothing_is_told(mine, software, monkeypatch):
    monkeypatch.setattr(importlib.import_module(f"{NAME}.driver"), "SoftwareArm", no_stop(software.SoftwareArm))
    with simulated_time():
        (said,) = followed(mine[0].Arm(host="127.0.0.1", work=WORK), 0.1)
    assert said.endswith("the arm does not obey: it was stopped, and no states show that its tip stands")


def test_whatever_a_driver_raises_stops_the_arm_and_is_told(mine, software, monkeypatch):
    """A driver of a controller without a watchdog: palpate's process stops it before it goes."""
    stops = []

    def go_to(self, pose):
        if self.now - self.began > 0.5:
            raise KeyError("pose")
        return True

    faulty = unlike(software.SoftwareArm, go_to=go_to, stop=lambda self: stops.append(self.now))
    module = importlib.import_module(f"{NAME}.driver")
    monkeypatch.setattr(module, "SoftwareArm", faulty)
    monkeypatch.setattr(module.Driver, "has_watchdog", False)
    with simulated_time():
        (said,) = followed(mine[0].Arm(host="127.0.0.1", work=WORK), 1.0)
    assert "its driver's `send` failed: KeyError: 'pose'" in said or "does not" in said
    assert len(stops) > 1


def on_a_spring(base):
    """Its joints are masses on springs: their damping ratio is 0.3, and their lag that of the arm that is written."""

    def advance(self):
        stiffness = (0.6 / 0.02) ** 2  # [1/s^2]
        while self.now + 0.002 <= clock().now():
            self.now += 0.002
            self.qd = self.qd + 0.002 * stiffness * (self.target - self.q - 0.02 * self.qd)
            self.q = self.q + 0.002 * self.qd
            self.feel()

    return unlike(base, advance=advance)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("retract_speed", "least", "most"), [(0.0, 0.03, 0.04), (0.15, 0.11, 0.15), (0.25, 0.18, 0.25)]
)
def test_an_arm_on_a_spring_retracts_within_the_limit_of_speed(mine, software, monkeypatch, retract_speed, least, most):
    """By what it does, with its overshoot: a retraction is commanded more slowly than to an arm that gives no way."""
    made = on_a_spring(software.SoftwareArm)
    monkeypatch.setattr(importlib.import_module(f"{NAME}.driver"), "SoftwareArm", made)

    class Soft(mine[0].Arm):
        @property
        def controller_stiffness(self):
            return 2500.0

    device = Soft(host="127.0.0.1", work=WORK, control="servo", acceleration=5.0)
    limits = {"speed": 0.04, "acceleration": 0.5, "orientation": 0.1, "angular_speed": 0.2}
    limits = ArmLimits((-0.02,) * 3, (0.02,) * 3, **limits, retract_speed=retract_speed)
    with simulated_time(), device.connect(0) as link:
        clock().thread(lambda: list(link.batches()), "batches").start()
        clock().sleep(0.3)
        link.limit(limits, lambda reason: None)
        link.follow(Point(bias=0.003, amplitude=0.0001, clearance=0.018, duration=1.0, standstill=0.0))
        arm, speeds, way_to_start = made.made[-1], [], [0.0]
        while arm.place_now()[2] > -0.002:
            clock().sleep(0.002)
            way_to_start.append(np.linalg.norm(arm.tip()[1]))
        link.retract()
        while arm.place_now()[2] < 0.0179 or not speeds:
            clock().sleep(0.002)
            speeds.append(np.linalg.norm(arm.tip()[1]))
    assert max(way_to_start) <= limits.speed
    assert least < max(speeds) <= most


@pytest.mark.parametrize(
    ("lag", "stiffness", "late"), [(0.06, None, False), (0.09, None, True), (0.09, 5e3, False), (0.15, 5e3, True)]
)
def test_a_lag_that_is_seen_is_compared_with_what_is_stated(mine, lag, stiffness, late):
    """Of an arm on a spring, friction adds to it."""

    class Soft(mine[0].Arm):
        @property
        def controller_stiffness(self):
            return stiffness

    child = SimpleNamespace(name="soft", ring=SimpleNamespace(head=np.zeros(64, np.int64)), tell=lambda *_, **__: None)
    device = Soft(host="127.0.0.1", work=WORK)
    link = ArmLink(device, child, {"tool": np.eye(4).ravel().tolist(), "arm_model": device.arm_model.model_dump()})
    link.limit(ArmLimits((-0.02,) * 3, (0.02,) * 3, 0.04, 0.5, 0.1, 0.2), lambda reason: None)
    link._stop_force, link._lag = 12.0, lag
    text = f"follows its commands {1e3 * lag:.0f} ms late, and 20 ms are stated"
    assert (text in link.health.get("flags", {}).get("device", "")) == late


@pytest.mark.parametrize(("rate", "words"), [(125.0, "at 125 Hz in place of 500 Hz"), (495.0, None), (1000.0, None)])
def test_only_a_slower_controller_is_recorded_more_coarsely(rate, words):
    said = low_rate(rate, 500.0)
    assert (said is None) if words is None else (words in said)


@pytest.mark.parametrize("turn", [None, (0.0, 0.0, -0.7)])
def test_a_twin_has_the_tool_that_is_stated(mine, turn):
    table = mine[0].Arm(host="127.0.0.1", work=WORK, tcp_rotation=turn).twin_settings
    assert table.get("tcp_rotation") == (None if turn is None else "[0.0, 0.0, -0.7]")


def test_the_lag_is_the_distance_to_the_command_by_its_speed():
    time = np.arange(0.0, 2.0, 0.002)
    command = 0.003 * np.sin(2 * np.pi * time)
    away = 0.015 * np.gradient(command, 0.002) + 0.0007  # a lag of 15 ms, and 0.7 mm that it gives way
    meter = LagMeter()
    assert meter.lag is None
    for now, before, behind in zip(command[1:], command, away[1:]):
        axis = np.array([0.0, 0.0, 1.0])
        meter.add(now * axis, before * axis, (now - behind) * axis)
    assert meter.lag == pytest.approx(0.015, rel=0.01)


@pytest.fixture
def bench(rehearse, tmp_path, mine):
    """The twin of the pipeline that is written, in simulated time; the pipeline file."""
    text = (mine[1] / "point.toml").read_text()
    file = tmp_path / "point.toml"
    file.write_text(text.replace("seed = 1\n", f'seed = 1\nplugins = ["{tmp_path / "variants.py"}"]\n'))
    specimen = ("twin.*.specimen.elasticity=60 kPa", "twin.*.specimen.viscosity=150 Pa*s", "twin.*.height=20 mm")
    (settings,) = load_rehearsal(file, specimen).twins.values()
    with simulated(settings, 0) as world:
        yield world, file


@pytest.mark.slow
def test_the_surface_is_taught_with_any_arm(bench, monkeypatch):
    world, file = bench
    places = iter(("-20 -20 0.3", "20 -20 0.3", "0 25 0.3", "2 1 0.3"))

    def prompt(text, **_):
        for words in ("freedrive", f"lead {next(places)} 0 0 0"):
            assert apply_fault(world, words.split()).startswith("done")
        while world.controller.arm.moving:
            clock().sleep(0.05)
        apply_fault(world, ["freedrive"])

    monkeypatch.setattr(typer, "prompt", prompt)
    with pytest.raises(ConfigurationError, match=r"\[device.arm\] has no sensor in its flange that could weigh it"):
        call(["calibrate", "teach", str(file), "--step", "payload"])
    call(["calibrate", "teach", str(file), "--step", "surface"])
    taught = tomllib.loads(file.read_text())["device"]["arm"]["work"]
    found = [float(text.removesuffix(" mm")) for text in taught["origin"]]
    np.testing.assert_allclose(found, (452.0, 1.0, 100.3), atol=0.02)
    assert world.truth.facts()["fastest_joint"] < 0.3  # it is led, and not commanded
