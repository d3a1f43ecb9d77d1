"""Software twins for tests: each on a loopback address and a port of its own, gone when the test is over."""

import contextlib
import itertools
import json
import os
import subprocess
import threading
import time
from subprocess import PIPE

import numpy as np
import pytest
from palpate.errors import DeviceError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

from tests import processes
from tests.devices.simulated_bench import PIPELINE, SHORT, SimulatedBench, Twins, readings
from tests.devices.software_arms import mine, run_software_arm, software  # noqa: F401  (fixtures)

_ADDRESSES = itertools.count(2)
SOON = 60.0  # [s] to wait for what must come; how long it takes is measured in benchmarks/, not here


def limits_of_silence(seconds):
    """A machine with more work than cores keeps a process or a terminal waiting for 0.2 s: no test counts on less."""
    watched = ("device.sensor.sensor_timeout", "device.arm.controller_timeout", "safety.sensor_timeout")
    return (
        *(f"{limit}={seconds} s" for limit in watched),
        "safety.reading_age=50 ms",  # more, and the rule of overshoot would refuse the approach
        "device.arm.watchdog=1 Hz",
        f"device.arm.host_timeout={2 * seconds} s",
    )


PATIENT = limits_of_silence(5.0)
ALERT = limits_of_silence(0.6)  # where silence itself is the fault


class Bench(Twins):
    """Twins in a process of their own, by the wall clock."""

    look = 0.01  # [s] between looks at their state

    def __init__(self, folder, overrides=()):
        self.host = f"127.6.{os.getpid() % 250}.{next(_ADDRESSES)}"
        self.port = folder / f"sensor-{self.host}"
        self.folder = folder
        self._overrides = [f"twin.bench.host={self.host}", f"twin.bench.port={self.port}", *overrides]
        words = [word for override in self._overrides for word in ("--set", override)]
        self._errors = (folder / "twin.log").open("w")
        self.process = processes.start(
            processes.PALPATE, "twin", PIPELINE, *words, stdin=PIPE, stdout=PIPE, stderr=self._errors, text=True
        )
        self._lock = threading.Lock()
        self.at_fault = {}  # the state in which the last fault found the twins
        line = self.process.stdout.readline()
        assert line.startswith("ready"), (folder / "twin.log").read_text()
        with contextlib.suppress(OSError):  # not permitted; a real controller does not wait for a core
            os.sched_setscheduler(self.process.pid, os.SCHED_FIFO, os.sched_param(50))

    def say(self, words):
        """Tell the twin something; its answer."""
        with self._lock:
            self.process.stdin.write(words + "\n")
            self.process.stdin.flush()
            return self.process.stdout.readline().strip()

    def fault(self, words):
        """Make a fault; the monotonic time at which it was there."""
        with self._lock:
            self.process.stdin.write(f"state\n{words}\n")  # in one piece: nothing moves between the two
            self.process.stdin.flush()
            self.at_fault = json.loads(self.process.stdout.readline().removeprefix("state "))
            answer = self.process.stdout.readline().strip()
        assert answer.startswith("done"), answer
        return float(answer.split()[1])

    def pipeline(self, *overrides):
        sets = [f"device.arm.host={self.host}", f"device.sensor.port={self.port}", *self._overrides, *overrides]
        return load_pipeline(PIPELINE, sets)

    def run(self, *overrides, out="out", limits=PATIENT):
        need_arm()
        return run_pipeline(self.pipeline(*limits, *overrides), self.folder / out)

    def run_into(self, fault, when, *overrides, limits=PATIENT):
        """Run with a fault as soon as a condition holds: the error, result.json, the run folder."""
        times, over = [], threading.Event()

        def make():
            while not over.is_set():
                if when(self.state()):
                    times.append(self.fault(fault))
                    return
                time.sleep(self.look)

        thread, error = threading.Thread(target=make), "it came to its end"
        thread.start()
        try:
            self.run(*overrides, limits=limits)
        except DeviceError as caught:
            error = str(caught)
        finally:
            over.set()
            thread.join()
        table = json.loads((self.folder / "out" / "result.json").read_text())
        stop = table["run"].get("live", {}).get("stop")
        assert times, f"{fault!r} was never made: {error}"
        assert stop, error
        assert stop["monotonic"] > times[0], f"stopped before {fault!r}: {error}"
        return error, table, self.folder / "out"

    def start_job(self, when, overrides, out, **options):
        """`palpate run` in a process of its own, at the moment when a condition holds of the state and the folder."""
        need_arm()
        sets = [f"device.arm.host={self.host}", f"device.sensor.port={self.port}", *overrides]
        words = [word for override in sets for word in ("--set", override)]
        words += ["--out", out]
        job = processes.start(processes.PALPATE, "run", PIPELINE, *words, stdin=subprocess.DEVNULL, **options)
        while job.poll() is None:
            if when(self.state(), out):
                return job
            time.sleep(0.005)
        job.communicate()
        raise AssertionError(f"the run ended with {job.returncode} before it came into contact")

    def close(self):
        self.process.stdin.close()
        try:
            self.process.wait(SOON)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        self._errors.close()
        assert not self.port.exists()


class ForceLimit:
    """What is under the tip and was not expected, and what the pipeline's limits allow there."""

    stop, latency, deceleration, radius = 12.0, 0.06, 1.0, 0.005
    # Overrides of the twin, of the run, elasticity [Pa] of what is hit.
    cases = {  # noqa: RUF012
        "twenty times stiffer": (
            ("twin.bench.specimen.elasticity=2.25 MPa", "twin.bench.specimen.viscosity=7240 Pa*s"),
            ("safety.stiffness=30 N/mm", "safety.force=80 N"),  # else it stops sooner, for it is stiffer than stated
            2.25e6,
        ),
        "an obstacle 5 mm too high": (
            ("twin.bench.specimen.surface=5 mm", "twin.bench.height=10 mm"),
            ("trajectory.press.clearance=9 mm",),
            112.5e3,
        ),
    }

    @staticmethod
    def overrun(folder):
        """Speed [m/s] inwards at the reading that trips, way [m] from there to the deepest point, latency [s].

        The latency is what is left of that way when braking is taken off: x = v tau + v^2/2a.
        """
        table = json.loads((folder / "result.json").read_text())
        wrench = readings(folder / "log.mcap", "sensor", "wrench")
        stamps = np.concatenate([b.time for b in wrench])
        force = np.concatenate([b.values[:, 2] for b in wrench]) - table["run"]["live"]["standstill"]["force"]
        over = stamps[np.flatnonzero(np.abs(force) > ForceLimit.stop)[0]]
        tip, twist = (readings(folder / "log.mcap", "arm", stream) for stream in ("tip", "twist"))
        times = np.concatenate([b.time for b in tip])
        height = np.concatenate([b.values[:, 2] for b in tip])
        speed = -np.concatenate([b.values[:, 2] for b in twist])
        around = (times > over - 20e6) & (times < over + 4e6)  # the noise of one reading is a tenth of it
        v = float(speed[around].mean())
        way = float(np.interp(over, times, height) - height[times > over].min())
        return v, way, (way - v**2 / (2 * ForceLimit.deceleration)) / v

    @classmethod
    def bound(cls, elasticity, speed):
        """The largest force [N] that the declared latency explains, on an elastic half-space under the tip.

        F + (8/3) E sqrt(R d) x: the limit, and the tangent stiffness at the deepest point times the way allowed.
        """
        allowed = speed * cls.latency + speed**2 / (2 * cls.deceleration)
        depth = (9 * cls.stop / (16 * elasticity * cls.radius**0.5)) ** (2 / 3) + allowed
        return cls.stop + 8 / 3 * elasticity * (cls.radius * depth) ** 0.5 * allowed


@pytest.fixture
def force_limit():
    return ForceLimit


def need_arm():
    """Skip where the arm's client library is not installed, as on Python 3.13, for which it has no wheel."""
    pytest.importorskip("rtde_control", reason="ur-rtde is not installed")


def _need_sensor():
    pytest.importorskip("serial", reason="pyserial is not installed")


@pytest.fixture
def bench(tmp_path):
    """Start twins with overrides; they end with the test."""
    need_arm()
    _need_sensor()
    running = []

    def start(*overrides):
        running.append(Bench(tmp_path, overrides))
        return running[-1]

    yield start
    for twin in running:
        twin.close()


@pytest.fixture(scope="module")
def shared_bench(tmp_path_factory):
    """One twin for the tests of a module; `restored` is it, as new."""
    _need_sensor()
    twin = Bench(tmp_path_factory.mktemp("bench"), SHORT)
    yield twin
    twin.close()


@pytest.fixture
def restored(shared_bench, tmp_path):
    """The shared twin, as new."""
    shared_bench.folder = tmp_path
    shared_bench.fault("restore")
    return shared_bench


@pytest.fixture
def short():
    return SHORT


@pytest.fixture
def patient():
    return PATIENT


@pytest.fixture(scope="module")
def main_job(tmp_path_factory):
    """The example pipeline once, as it stands: twin, its state afterwards, result."""
    need_arm()
    _need_sensor()
    twin = Bench(tmp_path_factory.mktemp("main"))
    try:
        result = twin.run("device.sensor.settle=0.1 s")
        yield twin, twin.state(), result
    finally:
        twin.close()


@pytest.fixture
def alert():
    return ALERT


@pytest.fixture
def simulated(tmp_path):
    """Start twins in simulated time with overrides; they end with the test."""
    with contextlib.ExitStack() as stack:

        def start(*overrides, **options):
            twin = SimulatedBench(tmp_path, overrides, **options)
            stack.callback(twin.close)
            return twin

        yield start


@pytest.fixture
def rig(simulated):
    """Twins in simulated time, for a short motion."""
    return simulated(*SHORT)
