"""Fixtures of the distribution's tests: the simulator with its specimen, and palpate with it."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PIPELINES = HERE.parent
TRUTH = {"elasticity": "112.5 kPa", "viscosity": "362 Pa*s"}  # of the specimen in [twin.bench]
ADDRESSES = (f"127.0.77.{number}" for number in range(1, 255))  # of the simulators, one after the other
PALPATE = "from palpate_engine.cli import main; main()"
# Simulator and client take one of two cores: what is late shows a busy machine, and is not a fault of palpate's. The
# force that could arise meanwhile is computed; what arises is judged by the example's own limit.
PATIENCE = ['device.arm.host_timeout="1 s"', 'device.arm.controller_timeout="1 s"', 'safety.reading_age="1 s"']
PATIENCE += ['safety.force="150 N"']
# As on a rig, the controller is a computer of its own: it has the last core, and palpate the others.
CORES = sorted(os.sched_getaffinity(0))
ABSENT = [name for name in ("franky", "franky_sim", "mujoco") if importlib.util.find_spec(name) is None]
sys.path.insert(0, str(PIPELINES.parents[1]))  # palpate's own tests, and how they find out that a machine is busy
pytest_plugins = ["tests.busy"]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Report the hold-up of a simulator that could not keep up with the wall clock: it held palpate up as well."""
    from tests.busy import HELD_UP

    try:
        return (yield)
    finally:
        for rig in item.funcargs["rig_of"].rigs if "rig_of" in item.funcargs else ():
            item.stash[HELD_UP] = max(rig.ask()["late"], item.stash.get(HELD_UP, 0.0))


class Rig:
    """The simulator's process, and what MuJoCo's arm did."""

    def __init__(self, folder, file, *more):
        self.folder, self.file = folder, file
        self.port, self.address = f'device.sensor.port="{folder / "sensor"}"', next(ADDRESSES)
        self.places = [f'twin.bench.port="{folder / "sensor"}"', f'twin.bench.host="{self.address}"']
        settings = [text for one in (*self.places, *more) for text in ("--set", one)]
        command = [sys.executable, "-c", PALPATE, "twin", file, *settings]
        os.sched_setaffinity(0, CORES)
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        os.sched_setaffinity(0, CORES[:-1] or CORES)
        words = self.process.stdout.readline().split()
        assert words[:2] == ["ready:", "robot"], "the simulator did not start"

    def ask(self, *words):
        """Return what the arm did since the last `mark`; the words may change something before."""
        self.process.stdin.write(" ".join(map(str, words or ("truth",))) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def start(self, command, *arguments, stdin=subprocess.DEVNULL):
        """Start palpate in a process of its own, and return it."""
        changes = [self.port, f'device.arm.host="{self.address}"', *self.places, *PATIENCE]
        changes = [text for change in changes for text in ("--set", change)]
        return subprocess.Popen(
            [sys.executable, "-c", PALPATE, *command.split(), self.file, *changes, *map(str, arguments)],
            stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=self.folder,
        )  # fmt: skip

    def end(self):
        """End the simulator."""
        self.process.stdin.close()
        self.process.wait(30)
        self.process.stdout.close()


@pytest.fixture
def rig_of(tmp_path):
    """Yield a function that starts a rig of a pipeline's file."""
    if ABSENT:
        pytest.skip(f"{', '.join(ABSENT)} not installed: pip install 'palpate-franka[test]'")

    def make(name, *more):
        make.rigs.append(Rig(tmp_path, PIPELINES / name, *more))
        return make.rigs[-1]

    make.rigs = []
    os.sched_setaffinity(0, CORES[:-1] or CORES)
    yield make
    os.sched_setaffinity(0, CORES)
    for rig in make.rigs:
        rig.end()
