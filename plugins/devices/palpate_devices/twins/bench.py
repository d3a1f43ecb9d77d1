"""A UR3e with a SensONE over a specimen, in software: both twins in one world."""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from palpate import DeviceError, File, Force, ForceDrift, Length, Mass, Speed, Time, Twin
from pydantic import Field, model_validator

from palpate_devices.process.child import real_time
from palpate_devices.sensing import sensed_wrench
from palpate_devices.specimen import Specimen
from palpate_devices.twins.arm import TICK, Arm
from palpate_devices.twins.controller import Controller
from palpate_devices.twins.faults import FAULTS, apply_fault
from palpate_devices.twins.sensone import VirtualSensor
from palpate_devices.twins.sockets import Ports
from palpate_devices.ur3e.frame import WorkFrame
from palpate_devices.ur3e.kinematics import joints_at, matrix_of, tip

_START = np.array([0.0, -1.3, -1.9, -1.5, 1.5708, 0.0])  # a posture with the tool downwards
_UPRIGHT = (0.0, 0.0, -1.0)
_MOST_BEHIND = 0.5  # [s]; a longer stall of this process is not made up for


class VirtualBench(Twin):
    """A UR3e (RTDE 30004, dashboard 29999, script 30003) and a serial SensONE, moved by one contact physics.

    The real drivers run against it unchanged. The arm hangs over the specimen at `height`, tool downwards; the sensor
    feels contact, weight and inertia of the tip at the exact motion of the arm. `palpate twin FILE` serves it and reads
    faults from its input, one to a line; `help` lists them. On a rig the table is ignored.
    """

    host: str = Field(default="127.0.0.1", pattern=r"^127\.", description="loopback address of the controller")
    port: File = Field(default=Path("/tmp/palpate-sensone"), description="where the sensor's port appears")
    specimen: Specimen = Field(description="what the tip presses on")
    work: WorkFrame = Field(description="where the specimen is: as for the robot")
    tcp: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.12), min_length=3, max_length=3, description="tip on the flange"
    )
    height: Length = Field(default=0.01, gt=0, description="height of the tip over the work frame at the start")
    tip_mass: Mass = Field(default=0.14, gt=0, description="mass of all that hangs behind the sensor")
    centre_of_mass: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="of that mass, in the sensor's frame"
    )
    force_delay: Time = Field(
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
        """Serve until SIGTERM, Ctrl-C or the end of the standard input."""
        world = World(self, seed)
        try:
            scheduling = real_time(50)
            ready({"robot": self.host, "sensor": str(self.port), "scheduling": scheduling})
            world.run()
        finally:
            world.close()


class World:
    """The twins at work, in one loop of 2 ms."""

    def __init__(self, settings: VirtualBench, seed: int) -> None:
        self._settings = settings
        noise = np.random.SeedSequence(seed).spawn(3)
        arm = Arm(self._start(), matrix_of([*settings.tcp, 0.0, 0.0, 0.0]))
        robot_seed, sensor_seed = (int(s.generate_state(1)[0]) for s in noise[:2])
        self.controller = Controller(arm, settings.position_std, settings.velocity_std, robot_seed)
        self.ports = Ports(settings.host, self.controller)
        self.sensor = VirtualSensor(
            settings.port, settings.line_time, settings.sensor_ppm, settings.clock_start, sensor_seed
        )
        self._rng = np.random.default_rng(noise[2])
        self._rotation = settings.work.matrix[:3, :3].T
        self._before = self._tip()
        self._past: deque[tuple[float, Any, Any, Any]] = deque(maxlen=int(settings.force_delay / TICK) + 4)
        self.down = _UPRIGHT  # direction of gravity in the sensor's frame
        self.stalled_until = 0.0
        self.peak = 0.0
        self._done = False
        self._typed = ""

    def _start(self) -> Any:
        goal = self._settings.work.tool_pose(np.array([0.0, 0.0, self._settings.height]))
        q = joints_at(goal, matrix_of([*self._settings.tcp, 0.0, 0.0, 0.0]), _START, steps=100)
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

    def close(self) -> None:
        """Leave no port behind."""
        self.ports.close()
        self.sensor.unplug()

    def run(self) -> None:
        """Tick by absolute time; what is late is caught up, and only the newest state is sent."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)
        began = time.monotonic() - self.controller.now
        while not self._done:
            wait = max(began + self.controller.now + TICK - time.monotonic(), 0.0)
            ready: list[Any] = select.select([sys.stdin, *self.ports.sockets], [], [], wait)[0]
            if sys.stdin in ready:
                self._listen()
            self.ports.serve(ready)
            behind = time.monotonic() - began - self.controller.now
            if time.monotonic() < self.stalled_until:
                time.sleep(self.stalled_until - time.monotonic())
                began += time.monotonic() - began - self.controller.now
                continue
            if behind > _MOST_BEHIND:
                began += behind
            ticks = min(int(behind / TICK), int(_MOST_BEHIND / TICK))
            for _ in range(ticks):
                self._tick()
            if ticks:
                self.ports.broadcast()

    def _end(self, *_: Any) -> None:
        self._done = True

    def _listen(self) -> None:
        """Commands from the standard input, read past its buffer, which `select` cannot see."""
        data = os.read(sys.stdin.fileno(), 4096)
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
        pose, jacobian = tip(arm.q.tolist(), arm.tcp)
        work = self._settings.work
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

    def _feel(self, instants: Any) -> Any:
        """The wrench (n, 6) that the sensor tells at times (n,): what it felt `force_delay` before."""
        settings = self._settings
        places, speeds, accelerations = self._motion(instants - settings.force_delay)
        contact = settings.specimen.push(instants, places, speeds)
        self.peak = max(self.peak, float(contact.max()))
        noise = self._rng.standard_normal((len(instants), 6))
        offset = settings.bias + settings.drift * instants
        std = settings.force_std * self.sensor.noise_factor
        push = settings.specimen.with_friction(contact, speeds)
        load = settings.tip_mass, offset, noise, std, settings.force_limit
        return sensed_wrench(push, accelerations, *load, self.down, settings.centre_of_mass)

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
