"""A UR3e with a SensONE over a specimen, in software: both twins in one world."""

from __future__ import annotations

import os
import select
import signal
import stat
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from palpate import Angle, Delay, DeviceError, File, Force, ForceDrift, Frequency, Length, Speed, Time, TipMass, Twin
from pydantic import Field, model_validator

from palpate_devices.process.child import real_time
from palpate_devices.sensing import sensed_wrench
from palpate_devices.specimen import Specimen
from palpate_devices.twins.arm import TICK, SimulatedArm
from palpate_devices.twins.controller import Controller
from palpate_devices.twins.faults import FAULTS, apply_fault
from palpate_devices.twins.rdt_box import COUNTS, VirtualBox
from palpate_devices.twins.sensone import VirtualSensor
from palpate_devices.twins.sockets import ListeningPorts
from palpate_devices.twins.truth import Truth
from palpate_devices.ur3e.frame import WorkFrame
from palpate_devices.ur3e.kinematics import MODELS, joints_at, matrix_of, rotation_matrix, tip

_START = np.array([0.0, -1.3, -1.9, -1.5, 1.5708, 0.0])  # a posture with the tool downwards
_UPRIGHT = (0.0, 0.0, -1.0)
_OUT = np.diag([1.0, -1.0, -1.0])  # from a frame that looks at the skin to one that looks out of it
_MOST_BEHIND = 0.5  # [s]; a longer stall of this process is not made up for


# "127.evil.example.com" is a name that leads anywhere.
LOOPBACK = r"^127(\.(25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)){3}$"


class VirtualBench(Twin):
    """A UR3e (RTDE 30004, dashboard 29999, script 30003) and a serial SensONE, moved by one contact physics.

    The real drivers run against it unchanged. The arm hangs over the specimen at `height`, tool downwards; the sensor
    feels contact, weight and inertia of the tip at the exact motion of the arm. `palpate twin FILE` serves it and reads
    faults from its input, one to a line; `help` lists them. On a rig the table is ignored.
    """

    host: str = Field(default="127.0.0.1", pattern=LOOPBACK, description="loopback address of the controller")
    port: File = Field(default=Path("/tmp/palpate-sensone"), description="where the sensor's port appears")
    specimen: Specimen = Field(description="what the tip presses on")
    work: WorkFrame = Field(description="where the specimen is: as for the robot")
    tcp: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.12), min_length=3, max_length=3, description="tip on the flange"
    )
    sensor: Literal["bota", "ati", "onrobot"] = Field(
        default="bota", description="a SensONE, or a box that speaks RDT at the controller's address"
    )
    sensor_rate: Frequency = Field(default=1000.0, gt=0, le=2000, description="readings per second of such a box")
    robot: Literal["ur3e", "ur5e", "ur10e", "ur16e"] = Field(default="ur3e", description="which arm it is")
    height: Length = Field(default=0.01, description="height of the tip over the work frame at the start")
    place: tuple[Length, ...] = Field(
        default=(0.0, 0.0), min_length=2, max_length=2, description="where along the skin the tip is at the start"
    )
    tool_rotation: tuple[Angle, ...] = Field(
        default=(0.0, 0.0, 0.0),
        min_length=3,
        max_length=3,
        description="rotation vector of the tool at the start from where the work frame wants it, in the tool's frame",
    )
    tcp_rotation: tuple[Angle, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="rotation of the tool on the pendant"
    )
    tip_mass: TipMass = Field(default=0.14, gt=0, description="mass of all that hangs behind the sensor")
    centre_of_mass: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="of that mass, in the sensor's frame"
    )
    force_delay: Delay = Field(
        default=0.0, ge=0, le=0.1, description="how late the sensor tells what it felt; an estimator has to be told"
    )
    position_std: Length = Field(default=5e-6, ge=0, description="noise of the measured height")
    velocity_std: Speed = Field(default=0.67e-3, ge=0, description="noise of the measured velocity")
    force_std: Force = Field(default=0.05, ge=0, description="noise of the sensor at a sinc length of 64")
    bias: Force = Field(default=0.6, description="offset of the sensor")
    drift: ForceDrift = Field(default=1.5 / 3600, description="drift of the sensor's offset")
    force_limit: Force = Field(default=500.0, gt=0, description="range of the sensor")
    line_time: Time = Field(default=0.0, ge=0, description="what the serial line adds to the sensor's period")
    sensor_ppm: float = Field(default=20.0, description="how fast the sensor's clock runs, in parts per million")
    clock_start: int = Field(default=0, ge=0, description="the sensor's clock [us] at its start; it wraps at 2^32")

    @model_validator(mode="after")
    def _no_memory(self) -> Self:
        if self.specimen.model.memory:
            raise ValueError("a specimen that remembers (a model with internal states) is for the sim device only")
        return self

    def serve(self, seed: int, ready: Callable[[Mapping[str, str]], None]) -> None:
        """Serve until SIGTERM, Ctrl-C or the end of the standard input, where somebody is at it."""
        world = World(self, seed)
        try:
            scheduling = real_time(50)
            ready({"robot": self.host, "sensor": str(self.port), "scheduling": scheduling})
            world.run()
        finally:
            world.close()


def _somebody_speaks() -> bool:
    """Whether the standard input is a person or a program, not /dev/null, as in the background of a shell."""
    if sys.stdin is None or sys.stdin.closed:
        return False
    return sys.stdin.isatty() or not stat.S_ISCHR(os.fstat(sys.stdin.fileno()).st_mode)


class World:
    """The twins at work, in one loop of 2 ms."""

    def __init__(self, settings: VirtualBench, seed: int) -> None:
        self.settings = settings
        noise = np.random.SeedSequence(seed).spawn(3)
        # Where the tool is, and what the controller takes for it: a client may tell it otherwise.
        self._tool = matrix_of([*settings.tcp, *settings.tcp_rotation])
        arm = SimulatedArm(self._start(), self._tool, model=MODELS[settings.robot])
        robot_seed, sensor_seed = (int(s.generate_state(1)[0]) for s in noise[:2])
        self.controller = Controller(arm, settings.position_std, settings.velocity_std, robot_seed)
        self.ports = ListeningPorts(settings.host, self.controller)
        self.sensor: VirtualSensor | VirtualBox = (
            VirtualSensor(settings.port, settings.line_time, settings.sensor_ppm, settings.clock_start, sensor_seed)
            if settings.sensor == "bota"
            else VirtualBox(settings.host, settings.sensor_rate, COUNTS[settings.sensor], sensor_seed)
        )
        self._rng = np.random.default_rng(noise[2])
        self._rotation = settings.work.matrix[:3, :3].T
        self._before = self._tip()
        self.truth = Truth()
        self._force = 0.0  # [N] on the skin, the latest
        self._past: deque[tuple[float, Any, Any, Any]] = deque(maxlen=int(settings.force_delay / TICK) + 4)
        self.down = _UPRIGHT  # direction of gravity in the sensor's frame
        self.stalled_until = 0.0
        self.peak = 0.0
        self._done = False
        self._listening = _somebody_speaks()
        self._typed = ""

    def _start(self) -> Any:
        settings = self.settings
        goal = settings.work.tool_pose(np.array([*settings.place, settings.height]))
        goal[:3, :3] = goal[:3, :3] @ rotation_matrix(settings.tool_rotation)
        q = joints_at(goal, self._tool, _START, steps=100, model=MODELS[settings.robot])
        if q is None:
            raise DeviceError("the twin's arm cannot reach the work frame: move [twin.*] work")
        return q

    def restore(self) -> None:
        """Make everything sound again."""
        self.controller.restore(self._start())
        self.ports.restore()
        self.sensor.restore()
        self._before, self.peak, self.down = self._tip(), 0.0, _UPRIGHT
        self._past.clear()
        self.truth.mark()

    def close(self) -> None:
        """Leave no port behind."""
        self.ports.close()
        self.sensor.unplug()

    def run(self) -> None:
        """Tick by absolute time; what is late is caught up, and only the newest state is sent."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)
        ports, controller = self.ports, self.controller
        ports.began = time.monotonic() - controller.now
        while not self._done:
            wait = max(ports.began + controller.now + TICK - time.monotonic(), 0.0)
            inputs: list[Any] = [sys.stdin] if self._listening else []
            ready: list[Any] = select.select([*inputs, *ports.sockets], [], [], wait)[0]
            if sys.stdin in ready:
                self._listen()
            if time.monotonic() < self.stalled_until:
                time.sleep(self.stalled_until - time.monotonic())
                ports.began = time.monotonic() - controller.now
                continue
            if time.monotonic() - ports.began - controller.now > _MOST_BEHIND:
                ports.began = time.monotonic() - controller.now
            ports.serve(ready)
            behind = time.monotonic() - ports.began - controller.now
            for _ in range(int(behind / TICK)):
                self._tick()
            if behind >= TICK:
                ports.broadcast()

    def _end(self, *_: Any) -> None:
        self._done = True

    def _listen(self) -> None:
        """Commands from the standard input, read past its buffer, which `select` cannot see."""
        try:
            data = os.read(sys.stdin.fileno(), 4096)
        except OSError:  # its terminal has gone
            self._listening = False
            return
        self._done = self._done or not data
        *lines, self._typed = (self._typed + data.decode(errors="replace")).split("\n")
        for words in map(str.split, lines):
            if words[:1] == ["help"]:
                print("\n".join(f"{name}: {meaning}" for name, meaning in FAULTS.items()), flush=True)
            elif words:
                print(apply_fault(self, words), flush=True)
            self._done = self._done or words[:1] == ["quit"]

    @property
    def position(self) -> Any:
        """The tip in the work frame (3,) [m]."""
        return self._before[0]

    @property
    def velocity(self) -> Any:
        """Its velocity (3,) [m/s]."""
        return self._before[1]

    def _tip(self) -> tuple[Any, Any]:
        arm = self.controller.arm
        pose, jacobian = tip(arm.q.tolist(), self._tool, arm.model)
        work = self.settings.work
        self._turning = float(np.linalg.norm(jacobian[3:] @ arm.qd))
        self._askew = _OUT @ work.tool.T @ pose[:3, :3] @ _OUT
        return self._rotation @ (pose[:3, 3] - work.matrix[:3, 3]), self._rotation @ (jacobian[:3] @ arm.qd)

    def _tick(self) -> None:
        began = self.controller.now
        self.controller.tick()
        position, velocity = self._before
        self._before = self._tip()
        self.sensor.poll(self.controller.now)
        self._past.append((began, position, velocity, (self._before[1] - velocity) / TICK))
        instants = self.sensor.instants(self.controller.now)
        if len(instants):
            self.sensor.send(instants, self._feel(instants))
        joint = float(np.abs(self.controller.arm.qd).max())
        self.truth.add(time.monotonic(), *self._before, self._turning, joint, self._force, self.controller.read)

    def _feel(self, instants: Any) -> Any:
        """The wrench (n, 6) that the sensor tells at times (n,): what it felt `force_delay` before."""
        settings = self.settings
        places, speeds, accelerations = self._motion(instants - settings.force_delay)
        contact = settings.specimen.push(instants, places, speeds)
        self._force = float(contact.max())
        self.peak = max(self.peak, self._force)
        noise = self._rng.standard_normal((len(instants), 6))
        offset = settings.bias + settings.drift * instants
        std = settings.force_std * self.sensor.noise_factor
        push = settings.specimen.with_friction(contact, speeds)
        load = settings.tip_mass, offset, noise, std, settings.force_limit
        down = np.array(self.down) @ self._askew  # the sensor turns with the tool
        return sensed_wrench(push, accelerations, *load, down.tolist(), settings.centre_of_mass)

    def _motion(self, instants: Any) -> tuple[Any, Any, Any]:
        """Places, speeds and accelerations (n, 3) at past times; the acceleration is constant within a tick."""
        rows = []
        for instant in instants:
            began, position, velocity, acceleration = next(
                (t for t in reversed(self._past) if t[0] <= instant), self._past[0]
            )
            elapsed = instant - began
            place = position + velocity * elapsed + 0.5 * acceleration * elapsed**2
            rows.append((place, velocity + acceleration * elapsed, acceleration))
        places, speeds, accelerations = (np.array(column) for column in zip(*rows, strict=True))
        return places, speeds, accelerations
