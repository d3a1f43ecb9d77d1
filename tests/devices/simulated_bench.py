"""Twins in simulated time for tests: the whole live path in this process, the same on every machine."""

import contextlib
import itertools
import json
from pathlib import Path

from palpate import clock
from palpate.errors import DeviceError
from palpate_devices.mcap_replay import McapReplay
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_simulation.twins.faults import apply_fault
from palpate_simulation.twins.simulated_computer import simulated

PIPELINE = Path(__file__).parents[2] / "pipelines" / "point_ur3e.toml"
# A short motion with the same limits: standstill, approach, a second of sine, retraction.
SHORT = (
    "device.sensor.settle=0.1 s",
    "safety.standstill=0.2 s",
    "alignment.tare_duration=0.15 s",
    "trajectory.press.standstill=0 s",
    "trajectory.press.clearance=3 mm",
    "trajectory.press.duration=1 s",
    "twin.bench.height=4 mm",
)
_RUNS = itertools.count()


class Twins:
    """Twins at work, whichever clock they go by; `say` is how they are told something."""

    def state(self):
        return json.loads(self.say("state").removeprefix("state "))

    def wait(self, condition, timeout=60.0):
        """The first state of which a condition holds."""
        deadline = clock().now() + timeout
        while clock().now() < deadline:
            if condition(state := self.state()):
                return state
            clock().sleep(self.look)
        raise AssertionError(f"never came: {state}")

    def wait_at_rest(self):
        """The state once the arm stands; one that only turns round is not at rest."""
        before = [self.state()]

        def stands(state):
            clock().sleep(0.05)
            still = state["joint_speed"] < 1e-3 and abs(state["height"] - before[-1]["height"]) < 1e-5
            before.append(state)
            return still

        return self.wait(stands)

    def replay(self, log, out, *overrides):
        """Run the same pipeline on what was recorded."""
        return replayed(self.folder, log, out, self._overrides, overrides)


class SimulatedBench(Twins):
    """Twins in simulated time, which is that of this process until `close`."""

    look = 0.002  # [s] between looks at their state

    def __init__(self, folder, overrides=(), hold_ups=(), pipeline=PIPELINE):
        self.folder, self.file, self._overrides = folder, pipeline, tuple(overrides)
        settings = next(iter(load_pipeline(pipeline, list(overrides)).twins.values()))
        self.host, self.port = settings.host, settings.port
        self._stack = contextlib.ExitStack()
        self.world = self._stack.enter_context(simulated(settings, 0, hold_ups))
        self.at_fault = {}  # the state in which the last fault found the twins

    def close(self):
        self._stack.close()

    def say(self, words):
        """Tell the twin something; its answer."""
        return apply_fault(self.world, words.split())

    def fault(self, words):
        """Make a fault; the simulated time at which it is there."""
        self.at_fault = self.state()
        answer = self.say(words)
        assert answer.startswith("done"), answer
        return float(answer.split()[1])

    @property
    def truth(self):
        """What the arm did since the last `mark`."""
        return self.world.arm_truth

    def pipeline(self, *overrides):
        return load_pipeline(self.file, [*self._overrides, *overrides])

    def run(self, *overrides, out="out"):
        return run_pipeline(self.pipeline(*overrides), self.folder / out)

    def run_into(self, fault, when, *overrides):
        """Run with a fault as soon as a condition holds: the error, result.json, the run folder."""
        out, times, over = f"out{next(_RUNS)}", [], []

        def make():
            while not over:
                if when(self.state()):
                    times.append(self.fault(fault))
                    return
                clock().sleep(self.look)

        clock().thread(make, "fault").start()
        error = "it came to its end"
        try:
            self.run(*overrides, out=out)
        except DeviceError as caught:
            error = str(caught)
        over.append(True)
        assert times, f"{fault!r} was never made: {error}"
        return error, json.loads((self.folder / out / "result.json").read_text()), self.folder / out


def replayed(folder, log, out, rig, overrides):
    """A run of the example pipeline on what was recorded, with the overrides of its rig but those of devices."""
    pipeline = folder / "replay.toml"
    text = PIPELINE.read_text()
    begin, end = text.index("[device.arm]"), text.index("[safety]")
    devices = "".join(
        f'[device.{name}]\ntype = "mcap-replay"\nfile = "{log}"\nrecorded = "{name}"\n' for name in ("arm", "sensor")
    )
    pipeline.write_text(text[:begin] + devices + text[end:])
    sets = [override for override in rig if not override.startswith("device.")]
    return run_pipeline(load_pipeline(pipeline, [*sets, *overrides]), folder / out)


def readings(log, device, stream):
    """The batches of a stream in a log."""
    with McapReplay(file=log, recorded=device).connect(0) as link:
        return [batch for batch in link.batches() if batch.stream == stream]
