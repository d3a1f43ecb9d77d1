"""palpate, the real client and somebody else's controller: what MuJoCo's arm did, and what became of E.

By the wall clock, so limits and E are judged, never times.
"""

import dataclasses
import json
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import PALPATE, PATIENCE, PIPELINES, TRUTH
from palpate import DeviceError, to_si
from palpate_engine import load_pipeline
from palpate_testing import check_device
from palpate_testing.part_measures import short_motion

pytestmark = [pytest.mark.franka, pytest.mark.live]

AWAY = 0.5e-3  # [m] that an arm that brakes may go on
STANDS = 1e-3  # [m/s], as in `arm_record`
SWING = 1e-3  # [m], half of that of the motion
LONG = 120.0  # [s], on a machine of any speed


def finished(process):
    """Return exit code, and all that was printed, of a process that ends by itself."""
    out, errors = process.communicate(timeout=LONG)
    return process.returncode, " ".join((out + errors).split())


def keeps_limits(truth, pipeline):
    """Assert every limit of [safety] by what the simulator's arm did."""
    safety, arm = pipeline.safety, pipeline.devices["arm"]
    for low, least, high, most in zip(truth["low"], safety.low, truth["high"], safety.high, strict=True):
        assert least - AWAY <= low
        assert high <= most + AWAY
    assert truth["fastest"] <= 1.05 * safety.speed
    assert truth["force"] <= safety.force
    assert truth["askew"] <= safety.orientation
    assert truth["fastest_joint"] <= arm.joint_speed


def wait_for(rig, condition):
    """Return what the arm did, as soon as a condition of it holds."""
    deadline = time.monotonic() + LONG
    while time.monotonic() < deadline:
        if condition(truth := rig.ask()):
            return truth
        time.sleep(0.02)
    raise AssertionError(f"the arm did not come so far: {truth}")


def pressing(rig, *arguments):
    """Return a run whose tip is in the specimen."""
    process = rig.start("run", *arguments)
    wait_for(rig, lambda truth: truth["force"] > 2.0 or process.poll() is not None)
    assert process.poll() is None, finished(process)
    return process


def stands(rig):
    """Return what the arm did until it has come to rest, and stays there."""
    return wait_for(rig, lambda truth: truth["stands"] > 0.5)


def test_the_rig_sends_the_bytes_of_the_simulator():
    states = pytest.importorskip("franky_sim.franka_robot_state")
    from palpate_franka.simulator.light_server import packed, replaced

    numbers, plain = iter(range(1000)), states.FrankaRobotState()
    fields = {field.name: getattr(plain, field.name) for field in dataclasses.fields(plain)}
    values = {name: tuple(next(numbers) for _ in value) for name, value in fields.items() if isinstance(value, tuple)}
    values |= {name: tuple(number % 3 == 0 for number in values[name]) for name in ("errors", "reflex_reason")}
    values |= {"m_ee": 0.7, "m_load": 0.3, "robot_mode": states.RobotMode.kMove, "control_command_success_rate": 0.9}
    state = replaced(plain, **values)
    assert state == dataclasses.replace(plain, **values)
    assert packed(state) == state.pack_state()


@pytest.mark.parametrize(("file", "track"), [("point.toml", "dr/kinematic"), ("raster.toml", "dr/smoother")])
def test_elasticity_and_limits(rig_of, tmp_path, file, track):
    rig = rig_of(file)
    pipeline = load_pipeline(rig.file)
    code, text = finished(rig.start("run", "--out", tmp_path / "out"))
    assert code == 0, text
    keeps_limits(rig.ask(), pipeline)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    found = result["tracks"][track]["parameters"]["elasticity"]
    assert abs(found["value"] - to_si(TRUTH["elasticity"], "Pa")) < 2.0 * found["combined"], found
    assert result["run"]["live"]["devices"]["arm"]["controller_stiffness"] == pipeline.devices["arm"].stiffness


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_end_of_the_run_leaves_an_arm_that_stands(rig_of, number):
    rig = rig_of("point.toml")
    process = pressing(rig)
    process.send_signal(number)
    code, text = finished(process)
    assert code != 0
    truth = stands(rig)
    keeps_limits(truth, load_pipeline(rig.file))
    if number == signal.SIGINT:
        assert truth["place"][2] > 0.0, text  # it has left the material


def test_an_end_of_the_process_that_commands_leaves_an_arm_that_stands(rig_of):
    rig = rig_of("point.toml")
    process = pressing(rig)
    os.kill(child_of(process.pid), signal.SIGKILL)
    code, text = finished(process)
    assert code == 3  # no state shows that the tip stands
    assert "franka at" in text
    keeps_limits(stands(rig), load_pipeline(rig.file))


def child_of(parent):
    """Return the process of the arm."""
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{pid}/stat") as stat, open(f"/proc/{pid}/cmdline") as command:
                if int(stat.read().rpartition(")")[2].split()[1]) == parent and "arm_worker" in command.read():
                    return int(pid)
        except OSError:
            continue
    raise AssertionError("the arm has no process")


def test_a_lost_connection_is_reported(rig_of):
    rig = rig_of("point.toml")
    process = pressing(rig)
    rig.ask("silent")
    code, text = finished(process)
    assert code == 3  # no state shows that the tip stands
    assert "is silent" in text or "come late" in text, text  # whichever watch sees it first
    keeps_limits(rig.ask(), load_pipeline(rig.file))


def test_a_reflex_is_named_and_only_a_person_recovers(rig_of):
    rig = rig_of("point.toml")
    process = pressing(rig)
    rig.ask("mode", "kReflex", "7")
    code, text = finished(process)
    assert code == 1
    assert "cartesian_reflex (the force on the tool was over collision_force)" in text
    assert "franka-recover" in text
    keeps_limits(stands(rig), load_pipeline(rig.file))
    code, text = finished(rig.start("run"))  # no run recovers it
    assert code == 1
    assert "cartesian_reflex" in text


def test_joints_that_are_locked_are_named(rig_of):
    rig = rig_of("point.toml")
    rig.ask("mode", "kOther")
    code, text = finished(rig.start("run"))
    assert code == 1
    assert "its joints are locked or it is not ready" in text
    assert rig.ask()["fastest"] < STANDS


def test_it_passes_the_checks_of_a_device_with_its_dry_friction_stated(rig_of):
    rig = rig_of("point.toml")
    settings = [f'device.arm.host="{rig.address}"', 'device.arm.deadband="0.4 mm"', *PATIENCE]
    arm = load_pipeline(rig.file, settings).devices["arm"]
    check_device(arm, short_motion(), listen=6.0)
    stands(rig)


def test_a_second_run_is_refused_while_the_first_goes_on(rig_of):
    rig = rig_of("point.toml")
    process = pressing(rig, "--set", f'trajectory.press.duration="{2 * LONG:g} s"')
    arm = load_pipeline(rig.file, [f'device.arm.host="{rig.address}"']).devices["arm"]
    with pytest.raises(DeviceError, match=":1337 is in use by"), arm.connect(0):
        pass  # the process of a second run that takes the arm; the others of two runs are more than a core can do
    with socket.create_connection((rig.address, 1337)):  # from another computer, where nobody knows of the first
        rig.ask("mark")
        wait_for(rig, lambda truth: truth["high"][2] - truth["low"][2] > SWING)
    assert process.poll() is None, finished(process)
    process.send_signal(signal.SIGINT)
    finished(process)
    stands(rig)


@pytest.mark.parametrize(("answer", "code", "words"), [("n", 2, "not recovered"), ("y", 0, "? [y/N]: recovered")])
def test_a_command_recovers_it(rig_of, answer, code, words):
    rig = rig_of("point.toml")
    rig.ask("mode", "kReflex", "7")
    command = [sys.executable, "-c", PALPATE, "franka-recover", rig.address, "--no-realtime"]
    done = subprocess.run(command, input=f"{answer}\n", capture_output=True, text=True, timeout=LONG)
    text = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == code, text
    assert "in a reflex" in text
    assert "cartesian_reflex" in text
    assert words in text


def test_the_doctor_moves_nothing(rig_of):
    rig = rig_of("point.toml")
    code, text = finished(rig.start("doctor", "-v"))
    assert code == 0, text
    assert "arm: is connected" in text
    truth = rig.ask()
    assert truth["mode"] == "kIdle"
    assert truth["fastest"] < STANDS


def go_through(rig, process):
    """Go through an acceptance as a person with the simulator's console.

    Return its exit code, what it printed, and what the arm did between the times at which a hand led it.
    """
    said, begin, truths = "", 0, []
    while data := os.read(process.stderr.fileno(), 4096):
        said += data.decode()
        if re.search(r"^  NOW$", said[begin:], re.MULTILINE):
            rig.ask("unplug")
            begin = len(said)
        elif "press Enter" in said[begin:]:
            truths.append(rig.ask())
            rig.ask("restore")
            wait_for(rig, lambda truth: truth["stands"] > 0.5)
            rig.ask("mark")
            process.stdin.write("\n")
            process.stdin.flush()
            begin = len(said)
    code, _ = finished(process)
    return code, said, [*truths, rig.ask()]


def test_an_acceptance_is_by_the_record_of_its_runs(rig_of, tmp_path):
    """How soon the arm stops is a matter of the machine; where it stands after a kill is what MuJoCo says."""
    rig = rig_of("point.toml")
    names = ["free-air/kill-all", "free-air/cable", "foam/force"]
    steps = [word for name in names for word in ("--step", name)]
    code, said, truths = go_through(
        rig, rig.start("acceptance", *steps, "--out", tmp_path / "a", stdin=subprocess.PIPE)
    )
    table = json.loads((tmp_path / "a" / "acceptance.json").read_text())
    found = {step["name"]: step for step in table["steps"]}
    assert list(found) == ["free-air/cable", "free-air/kill-all", "foam/force"], said
    problems = {problem for step in found.values() for problem in step["problems"]}
    assert problems <= {"braking begins too late", "it goes too far", "it brakes too softly"}, said
    assert code == bool(problems)
    page = (tmp_path / "a" / "acceptance.md").read_text()
    assert page.startswith("# Acceptance on a simulator of point palpation, FR3")
    assert "not in the simulator, and open until they are done on the rig: free-air/estop" in page
    for truth in truths:
        keeps_limits(truth, load_pipeline(rig.file))
    assert "robot_mode 1" in found["free-air/kill-all"]["told"]
    assert 0.0 < found["free-air/kill-all"]["measured"]["way"] < 15e-3


def prompted(process):
    """Return what a process prints until it waits for a person."""
    text = ""
    while not text.endswith("press Enter"):
        text += (read := process.stderr.read(1))
        assert read, text
    return text


def test_a_hand_that_leads_it_shows_where_surface_and_tip_are(rig_of, tmp_path):
    rig = rig_of("point.toml")
    rig.file = Path(shutil.copy(rig.file, tmp_path))
    process = rig.start("calibrate teach", stdin=subprocess.PIPE)
    across, up = 5.0 * math.sin(math.radians(10.0)), 10.0 - 5.0 * math.cos(math.radians(10.0))
    # The tool turns about the centre of its ball; then the tip touches a surface that rises by 1 mm in 40.
    places = [(0, 0, 5, 0, 0, 0), (0, across, up, 10, 0, 0), (0, -across, up, -10, 0, 0)]
    places += [(across, 0, up, 0, 10, 0), (-across, 0, up, 0, -10, 0)]
    places += [(-20, -20, 4.5, 0, 0, 0), (20, -20, 5.5, 0, 0, 0), (0, 20, 5.0, 0, 0, 0), (2, 1, 5.05, 0, 0, 0)]
    for place in places:
        assert "once more" not in prompted(process)
        rig.ask("lead", *place)
        wait_for(rig, lambda truth: truth["stands"] > 0.5)
        process.stdin.write("\n")
        process.stdin.flush()
    code, text = finished(process)
    assert code == 0, text
    taught, before = (load_pipeline(file).devices["arm"].work for file in (rig.file, PIPELINES / "point.toml"))
    axes = before.matrix[:3, :3].T
    assert axes @ (taught.matrix[:3, 3] - before.matrix[:3, 3]) == pytest.approx(rig.ask()["place"], abs=0.1e-3)
    assert axes @ taught.matrix[:3, 2] == pytest.approx(np.array([-1.0, 0.0, 40.0]) / math.hypot(1.0, 40.0), abs=2e-3)
