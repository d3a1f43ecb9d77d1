"""A fault is reported with its true cause, also where another one shows in the same way."""

import importlib
import os
import signal
import subprocess
import sys
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from subprocess import PIPE
from types import SimpleNamespace

import pytest
from palpate import ArmLimits, DeviceError, HoldUp, clock
from palpate.clocks import contention
from palpate_devices.bota.reader import clock_problem
from palpate_engine import ReadingAge
from palpate_kit.acquisition.child import Child
from palpate_kit.acquisition.computer import Activity, Computer, use_host
from palpate_testing import simulated_time
from palpate_trajectories.point import Point

from tests.devices.simulated_bench import SHORT
from tests.devices.software_arms import WORK, listen, unlike

LIMITS = ArmLimits((-0.02,) * 3, (0.02,) * 3, speed=0.04, acceleration=0.5, orientation=0.1, angular_speed=0.2)


def late_poses(base, by):
    """An arm whose poses are those of `by` seconds ago, with stamps of now; its force is that of now."""

    def state(self):
        now = base.state(self)
        past = self.__dict__.setdefault("past", deque())
        past.append(now)
        while len(past) > 1 and now.time - past[1].time >= by:
            past.popleft()
        return now._replace(q=past[0].q, qd=past[0].qd)

    return unlike(base, state=state)


@pytest.mark.slow
def test_poses_that_come_late_are_no_saturated_sensor(mine, software, run_software_arm, monkeypatch):
    """By 100 ms, of an arm whose lag is stated as what its poses show, so that nothing else is wrong with them."""
    monkeypatch.setattr(mine[0].Arm, "command_lag", property(lambda self: 0.12))
    error, _ = run_software_arm(late_poses(software.SoftwareArm, 0.1))
    assert "the poses come late" in str(error)
    assert "saturated" not in str(error)


def bad_field(field, value):
    """A driver's `read` that gives something else in a field."""
    return lambda read: lambda self: None if (reading := read(self)) is None else replace(reading, **{field: value})


def read(self):
    return self.arm.no_such_name


def send(self, pose):
    return list(zip(pose, (1.0,) * 9, strict=True))


def check(self, reading):
    return {}[reading.status[0]]


# What a driver does -> what is said of it.
MISTAKES = {
    "joints of another arm": (
        "read",
        bad_field("joints", (0.0,) * 7),
        "`read` gives 7 numbers in `joints`; expected 6",
    ),
    "speeds and joints that add up": (
        "read",
        lambda read: lambda self: replace(read(self), joints=(0.0,) * 7, joint_speeds=(0.0,) * 5),
        "`read` gives 7 numbers in `joints`; expected 6",
    ),
    "a quaternion": ("read", bad_field("pose", (0.0,) * 7), "`read` gives 7 numbers in `pose`; expected 6"),
    "words": ("read", bad_field("joint_speeds", ("0.1",) * 6), "`read` gives a tuple with '0.1' in `joint_speeds`"),
    "no status": ("read", bad_field("status", ()), "`read` gives 0 numbers in `status`; expected 1"),
    "no time": ("read", bad_field("stamp", None), "`read` gives None as `stamp`"),
    "a table": ("read", lambda read: lambda self: {"q": (0.0,) * 6}, "`read` returned a dict; expected an ArmReading"),
    "a field that is missing": (
        "read",
        lambda _: read,
        "`read` failed: AttributeError: 'SoftwareArm' object has no attribute 'no_such_name' (test_true_causes.py",
    ),
    "lists of two lengths": (
        "send",
        lambda _: send,
        "`send` failed: ValueError: zip() argument 2 is longer than argument 1 (test_true_causes.py, line",
    ),
    "nothing returned": ("send", lambda send: lambda self, pose: None, "`send` returned None; expected True"),
    "a mode without a name": (
        "check",
        lambda _: check,
        "`check` failed: KeyError: 1",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_of_a_driver_is_named_by_method_and_field(mine, software, monkeypatch, mistake):
    """Python's own words alone name neither."""
    method, change, words = MISTAKES[mistake]
    driver = importlib.import_module("palpate_mine.driver").Driver
    monkeypatch.setattr(driver, method, change(getattr(driver, method)))
    device = mine[0].Arm(host="127.0.0.1", work=WORK)
    with simulated_time():
        try:
            with device.connect(0) as link:
                said = listen(link)
                clock().sleep(0.3)
                link.limit(LIMITS, lambda reason: None)
                link.follow(Point(bias=0.003, amplitude=0.001, clearance=0.003, duration=0.5, standstill=0.0))
                clock().sleep(3.0)
        except DeviceError as error:
            said = [str(error)]
    assert f"its driver's {words}" in said[0]


def test_joints_that_the_model_does_not_have_are_named(mine, software, monkeypatch):
    monkeypatch.setattr(mine[0].Arm, "joint_names", (*mine[0].Arm.joint_names, "extra"))
    with (
        simulated_time(),
        pytest.raises(DeviceError, match="has 7 `joint_names`, and its `arm_model` 6 joints"),
        mine[0].Arm(host="127.0.0.1", work=WORK).connect(0),
    ):
        pass


def held_up(simulated, process, duration):
    """What a run says where the computer keeps a process waiting, 3 s after the start."""
    twin = simulated(*SHORT, hold_ups=[HoldUp(process, duration, 3.0)])
    with pytest.raises(DeviceError) as caught:
        twin.run()
    return str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("process", "duration", "sign"),
    [
        ("robot", 0.3, "its process gave no sign of life for 122 ms and was killed; the computer was late ("),
        ("sensor", 0.3, "its process gave no sign of life for 120 ms and was killed; the computer was late ("),
        ("twin", 0.3, "the controller is silent: its last state is 102 ms old; the computer was probably late ("),
        ("main", 0.6, "the main job gave no sign of life for 251 ms ([device.*] host_timeout); the computer was prob"),
    ],
)
def test_a_computer_that_is_too_busy_is_named_with_what_helps(simulated, process, duration, sign):
    said = held_up(simulated, process, duration)
    assert sign in said
    assert "give palpate real-time priority" in said
    assert "open the page on another computer" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words"), [("silent", "the sensor is silent"), ("freeze", "the controller is silent")]
)
def test_a_device_that_is_silent_is_not_the_computers_fault(rig, fault, words):
    error, _, _ = rig.run_into(fault, lambda state: state["height"] < -0.001)
    assert words in error
    assert "computer" not in error


def test_a_driver_that_hangs_is_not_the_computers_fault(mine, software, monkeypatch):
    driver = importlib.import_module("palpate_mine.driver").Driver
    read = driver.read

    def hang(self):
        if clock().now() > self.arm.began + 0.5:
            clock().sleep(5.0)
        return read(self)

    monkeypatch.setattr(driver, "read", hang)
    with simulated_time(), mine[0].Arm(host="127.0.0.1", work=WORK).connect(0) as link:
        said = listen(link)
        clock().sleep(2.0)
    assert "gave no sign of life for 12" in said[0]
    assert said[0].endswith("and was killed: its driver waits for something, and does not return")


def test_threads_that_compete_for_the_cores_are_counted(tmp_path):
    load, cores = tmp_path / "loadavg", os.cpu_count()
    for ready, is_busy in ((cores, False), (2 * cores, False), (2 * cores + 1, True)):
        load.write_text(f"21.21 19.32 15.68 {ready}/193 1328\n")
        assert (contention(load) is not None) == is_busy
    assert contention(load) == f"{2 * cores + 1} threads compete for its {cores} cores"
    assert contention(tmp_path / "none") is None  # another system


def test_readings_that_come_late_on_a_busy_computer_name_it(monkeypatch):
    age = ReadingAge()
    age.add([0], [0])
    for arrival in (300_000_000, 600_000_000):
        age.add([100_000_000], [arrival])
    for load, is_named in ((None, False), ("23 threads compete for its 2 cores", True)):
        monkeypatch.setattr("palpate.clocks.WallClock.contention", lambda self, load=load: load)
        text = age.complaint("readings of s.z", 0.02)
        assert text.startswith("readings of s.z come late: the newest is ")
        assert ("the computer was probably late (23 threads compete" in text) == is_named


def test_a_cause_that_is_known_is_not_a_guess():
    assert clock().late_computer("it slept").startswith("; the computer was late (it slept): give palpate real-time")


# What a process does -> its state, and whether it has a core. On a machine that others use a process that computes may
# wait for its core as well.
PROCESSES = {"time.sleep(60)": ("S",), "while True: pass": ("R",)}


@pytest.mark.parametrize("code", PROCESSES)
@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="the system does not say what a process does")
def test_what_a_process_does_is_read_from_the_system(code):
    with subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", f"import time\nprint(flush=True)\n{code}"], stdout=PIPE
    ) as process:
        process.stdout.readline()
        time.sleep(0.05)
        found = Computer().activity(process)
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.05)
        stopped = Computer().activity(process)
        process.kill()
    assert found.state in PROCESSES[code]
    assert stopped.state == "T"
    assert stopped.processor_time >= found.processor_time >= 0.0
    assert Computer().activity(process) is None  # it has gone


class Process:
    """A process of a device by what the system says of it."""

    pid = 1

    def __init__(self, code=None):
        self.code = code

    def poll(self):
        return self.code

    def wait(self, timeout=None):
        return self.code

    def kill(self):
        self.code = self.code or -9


def silent_child(process, hint=""):
    """A child whose process beat 0.1 s ago for the last time."""
    child = Child.__new__(Child)
    child.name, child.fault, child._hint, child._text, child._unread = "ur at 1.2.3.4", None, hint, b"", deque()
    child._suspected, child._process, child._socket = None, process, SimpleNamespace()
    began = clock().now_ns() - 100_000_000
    child.ring, child._receive = SimpleNamespace(last_beat=lambda: began), lambda timeout=0.0: None
    return child


@pytest.mark.parametrize(
    ("state", "computed", "words"),
    [
        ("R", 0.0, "the computer was late (the process was ready and got no core for"),
        ("R", 1.0, "it computes without a pause"),
        ("D", 0.0, "it waits within the system, as where memory is swapped out or a disk or a port is busy"),
        ("T", 0.0, "another program has stopped it (SIGSTOP)"),
        ("S", 0.0, "its driver waits for something, and does not return"),
    ],
)
def test_a_process_without_a_sign_of_life_is_killed_with_what_it_did(state, computed, words):
    times = iter([Activity(state, 0.0), Activity(state, computed)])

    class Host(Computer):
        def activity(self, process):
            return next(times)

    child = silent_child(Process())
    with use_host(Host()):
        child.check(0.19)  # it is suspected from 95 ms on
        with pytest.raises(DeviceError, match=r"gave no sign of life for 1\d\d ms and was killed") as caught:
            child.check(0.05)
    assert words in str(caught.value)


HINT = ": the client library does that when it loses the link to the controller"


@pytest.mark.parametrize(
    ("code", "words", "is_library"),
    [
        (-9, "killed by SIGKILL: the system does so where memory is short", False),
        (-15, "killed by SIGTERM: another program, or a person, has ended it", False),
        (-24, "killed by SIGXCPU: it computed for 3 s at real-time priority without a pause", False),
        (-11, "killed by SIGSEGV", True),
        (-6, "killed by SIGABRT", True),
        (1, "exit code 1", True),
    ],
)
def test_a_process_that_the_system_killed_is_not_the_client_librarys_doing(code, words, is_library):
    with pytest.raises(DeviceError, match="its process ended") as caught:
        silent_child(Process(code), HINT).check()
    assert f"({words}" in str(caught.value)
    assert ("client library" in str(caught.value)) == is_library


@pytest.mark.slow
def test_stamps_that_go_back_are_no_reboot(rig):
    """By 0.2 s, in frames that go on: of a counter, and of frames that another one has overtaken."""

    def turn_back():
        rig.wait(lambda state: state["height"] < -0.001)
        rig.world.sensor._booted += 0.2

    clock().thread(turn_back, "fault").start()
    with pytest.raises(
        DeviceError, match=r"the sensor's time-stamps go back by 19.* ms while its frames go on"
    ) as caught:
        rig.run()
    assert "reboot" not in str(caught.value)
    assert "out of order" in str(caught.value)


@pytest.mark.parametrize(
    ("backwards", "pause", "words"),
    [
        (0.2, 0.001, "go back by 200 ms while its frames go on: they arrive out of order"),
        (0.00125, 0.001, "go back by 1.25 ms"),
        (3.0, 2.5, "the sensor rebooted: its clock restarted"),
        (4000.0, 0.001, "the sensor's time-stamps leap"),
    ],
)
def test_a_reboot_takes_its_time(backwards, pause, words):
    assert words in clock_problem(backwards, pause)
