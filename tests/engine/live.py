"""A live rig for tests, and a sink that keeps all that it is told; a pipeline names them as "live" and "kept"."""

import builtins
import threading
import time
from contextlib import contextmanager

import numpy as np
from palpate import Batch, Channel, Device, Sink, Stream, plugin

ELASTICITY, RADIUS = 112.5e3, 5e-3  # [Pa], [m]
LINKS, LISTENERS, EVENTS = [], [], []

PIPELINE = """
[run]
plugins = ["{plugin}"]
[device.rig]
type = "live"
[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "0.1 ms" }}
position = "rig.tip.z"
velocity = {{ channel = "rig.tip.vz", uncertainty = "0.1 ms" }}
measuring = "rig.tip.measuring"
tip_mass = "140 g"
tare_duration = "0.15 s"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.ekf]
type = "ekf"
[trajectory.press]
type = "point"
bias = "4 mm"
amplitude = "1 mm"
frequency = "2 Hz"
duration = "1 s"
clearance = "3 mm"
standstill = "0 s"
[sink.kept]
type = "kept"
[safety]
low = ["-5 mm", "-5 mm", "-7 mm"]
high = ["5 mm", "5 mm", "20 mm"]
force = "20 N"
stop_force = "12 N"
stiffness = "3 N/mm"
latency = "60 ms"
standstill = "0.2 s"
sensor_timeout = "5 s"
"""


class LiveRig(Device):
    """An elastic half-space under a sphere; the tip is where it shall be."""

    pace: float = 1.0  # [s] of the record in one second
    rate: float = 500.0
    behind: float = 0.0  # [s] of its stamps, of the force alone where it is negative

    @property
    def live(self):
        return True

    @property
    def streams(self):
        wrench = tuple(Channel(axis, "N", (-500.0, 500.0)) for axis in "xyz")
        tip = (Channel("z", "m"), Channel("vz", "m/s"), Channel("measuring", "1"))
        return (Stream("wrench", wrench, self.rate, clock="host"), Stream("tip", tip, self.rate, clock="host"))

    @contextmanager
    def connect(self, seed):
        LINKS.append(LiveLink(self, seed))
        yield LINKS[-1]


class LiveLink:
    """The rig at work."""

    def __init__(self, device, seed):
        self.device, self.noise = device, np.random.default_rng(seed)
        self.trajectory, self.begin, self.ended = None, 0.0, threading.Event()
        self.stops = []  # when, and what

    def follow(self, trajectory):
        self.begin, self.trajectory = self.now, trajectory

    def stop(self):
        self.stops.append((time.monotonic(), "stop"))
        self.ended.set()

    def retract(self):
        self.stops.append((time.monotonic(), "retract"))
        self.ended.set()

    @property
    def now(self):
        return (time.monotonic() - self.origin) * self.device.pace

    def batches(self):
        self.origin, epoch, done = time.monotonic(), time.time_ns(), 0
        period = 1.0 / self.device.rate
        while not self.ended.is_set():
            time.sleep(0.004)
            count = int(self.now / period)
            if count == done:
                continue
            times = np.arange(done, count) * period
            done = count
            moving = self.trajectory is not None
            setpoint = self.trajectory.at(times - self.begin) if moving else None
            height = setpoint.position[:, 2] if moving else np.full(len(times), 0.005)
            speed = setpoint.velocity[:, 2] if moving else np.zeros(len(times))
            measuring = setpoint.measuring if moving else np.zeros(len(times), bool)
            force = 16 / 9 * ELASTICITY * RADIUS**0.5 * np.maximum(-height, 0.0) ** 1.5
            wrench = 0.02 * self.noise.standard_normal((len(times), 3))
            wrench[:, 2] += force
            stamps = epoch + np.rint(times * 1e9).astype(np.int64)
            received = np.full(len(times), time.time_ns())
            behind = round(1e9 * self.device.behind)
            yield Batch("wrench", stamps - abs(behind), received, wrench)
            yield Batch("tip", stamps - max(behind, 0), received, np.column_stack([height, speed, measuring]))
            if moving and times[-1] > self.begin + self.trajectory.total_duration:
                return


class EndingSensor(Device):
    """A force in free air, whose stream ends after a while."""

    lasts: float = 1.0  # [s]
    ending: str = "returns"  # or what it sends at last that it has not declared, or the name of an exception

    @property
    def live(self):
        return True

    @property
    def streams(self):
        return (Stream("wrench", tuple(Channel(axis, "N", (-500.0, 500.0)) for axis in "xyz"), 500.0, clock="host"),)

    @contextmanager
    def connect(self, seed):
        yield EndingLink(self, seed)


class EndingLink:
    """The sensor at work."""

    def __init__(self, device, seed):
        self.device, self.noise = device, np.random.default_rng(seed)

    def batches(self):
        began, epoch, done = time.monotonic(), time.time_ns(), 0
        while time.monotonic() - began < self.device.lasts:
            time.sleep(0.004)
            count = int((time.monotonic() - began) * 500)
            stamps = epoch + np.arange(done, count, dtype=np.int64) * 2_000_000
            done = count
            received = np.full(len(stamps), time.time_ns())
            yield Batch("wrench", stamps, received, 0.02 * self.noise.standard_normal((len(stamps), 3)))
        if self.device.ending == "stream":
            yield Batch("wrnch", stamps, received, np.zeros((len(stamps), 3)))
        elif self.device.ending == "columns":
            yield Batch("wrench", stamps, received, np.zeros((len(stamps), 2)))
        elif self.device.ending != "returns":
            raise getattr(builtins, self.device.ending)("by the driver")


def _heard(name):
    """A method that keeps what it is told."""
    return lambda self, *values: self.heard.append((name, *values))


class Listener:
    """A writer that keeps all that it is told."""

    def __init__(self):
        self.heard, self.run = [], None

    # Methods by name: from Python 3.12 on, what answers by __getattr__ alone is no instance of a protocol.
    batch, samples, estimates, health, flags, guard, result = map(
        _heard, ("batch", "samples", "estimates", "health", "flags", "guard", "result")
    )

    def of(self, name):
        return [values for kind, *values in self.heard if kind == name]


class Kept(Sink):
    """A sink that hands out a listener ."""

    @contextmanager
    def open(self, run):
        LISTENERS.append(listener := Listener())
        listener.run = run
        EVENTS.append("open")
        yield listener
        EVENTS.append("close")


@plugin
def palpate_devices():
    return {"live": LiveRig, "ending": EndingSensor}


@plugin
def palpate_sinks():
    return {"kept": Kept}
