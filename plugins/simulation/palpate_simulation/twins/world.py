"""An arm and a sensor in one world: what moves the one is what the other feels."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from palpate import ArmTruth, DeviceError, clock
from palpate_kit.kinematics.rotations import matrix_of, rotation_matrix
from palpate_kit.kinematics.ur_arm import MODELS

from palpate_simulation.sensor_wrench import sensed_wrench
from palpate_simulation.skin_contact import SkinContact
from palpate_simulation.tool_axes import mounting_matrix
from palpate_simulation.twins.arm import TICK, SimulatedArm
from palpate_simulation.twins.arm_truth import Truth
from palpate_simulation.twins.console import Console
from palpate_simulation.twins.controller import Controller
from palpate_simulation.twins.hand import Hand
from palpate_simulation.twins.moving_skin import MovingSkin
from palpate_simulation.twins.ports import NetworkWiring, Wiring
from palpate_simulation.twins.rdt_box import COUNTS, VirtualBox
from palpate_simulation.twins.sensone import VirtualSensor
from palpate_simulation.twins.sensor_faults import Electronics
from palpate_simulation.twins.settings import BenchSettings

_START = np.array([0.0, -1.3, -1.9, -1.5, 1.5708, 0.0])  # a posture with the tool downwards
_TURN = 0.1  # [rad] between two postures, each found from the one before
_UPRIGHT = 1e-6  # of a cosine: a milliradian
_ROUNDING = 1e-6  # of a tick: a clock counts nanoseconds
_MOST_BEHIND = 0.5  # [s]; a longer stall of this process is not made up for


class World:
    """The twins at work, in one loop of 2 ms."""

    def __init__(self, settings: BenchSettings, seed: int, wiring: Wiring | None = None) -> None:
        self.settings, wiring = settings, wiring or NetworkWiring()
        noise = np.random.SeedSequence(seed).spawn(3)
        # Where the tool is, and where the controller assumes it: a client may set it.
        self._tool = matrix_of([*settings.tcp, *settings.tcp_rotation])
        self._model, own = MODELS[settings.robot], settings.arm
        if own is not None:
            self._model = own.model
        arm = SimulatedArm(self._start(), self._tool, model=self._model)
        if own is not None:
            arm.own_lag, arm.stiffness = own.lag, math.inf if own.stiffness is None else own.stiffness
        robot_seed, sensor_seed = (int(s.generate_state(1)[0]) for s in noise[:2])
        self.controller = Controller(arm, settings.position_std, settings.velocity_std, robot_seed)
        self.controller.load = settings.payload, settings.payload_centre
        self.hand = Hand(self.controller, settings.work, self._tool)
        line = wiring.serial(settings.port) if settings.sensor == "bota" else None  # first: it may be refused
        self.ports = wiring.ports(settings.host, self.controller)
        self.sensor: VirtualSensor | VirtualBox = (
            VirtualSensor(line, settings.line_time, settings.sensor_ppm, settings.clock_start, sensor_seed)
            if line is not None
            else VirtualBox(wiring.datagrams(settings.host), settings.sensor_rate, COUNTS[settings.sensor], sensor_seed)
        )
        self.electronics = Electronics(sensor_seed)
        self._rng = np.random.default_rng(noise[2])
        self._rotation = settings.work.matrix[:3, :3].T
        self._mounting = mounting_matrix(settings.mounting)
        self._nominal = self._rotation @ settings.work.tool @ self._mounting  # axes of the sensor in the work frame
        self._before = self._tip()
        self.truth = Truth()
        self._force = 0.0  # [N] on the skin, the latest
        self._past: deque[tuple[float, Any, Any, Any]] = deque(maxlen=int(settings.force_delay / TICK) + 4)
        self._upright = self.down = -settings.work.matrix[2, :3]  # direction of gravity in the work frame
        self.stalled_until = 0.0
        self.ticks_per_state = 1  # of the controller, which sends its state so seldom
        self.peak = 0.0
        self._contact, self.skin = SkinContact(), MovingSkin()
        self._done = False

    def _start(self) -> Any:
        settings = self.settings
        goal = settings.work.tool_pose(np.array([*settings.place, settings.height]))
        turn, q, level = np.array(settings.tool_rotation), self._posture(), goal[:3, :3].copy()
        for share in np.linspace(0.0, 1.0, math.ceil(math.hypot(*turn) / _TURN) + 1):  # the arm turns as it would go
            goal[:3, :3] = level @ rotation_matrix((share * turn).tolist())
            found = self._model.joints_at(goal, self._tool, q, steps=100)
            if found is None:
                raise DeviceError("the twin's arm cannot reach the work frame: move [twin.*] work")
            q = found
        return q

    def _posture(self) -> Any:
        """Joints from which the start is found."""
        if self.settings.arm is None:
            return _START
        return np.array(self.settings.arm.posture)

    def restore(self) -> None:
        """Make everything sound again."""
        self.hand.release()
        self.ticks_per_state = 1
        self.controller.restore(self._start())
        self.ports.restore()
        self.sensor.restore()
        self.electronics.restore()
        self._before, self.peak, self.down = self._tip(), 0.0, self._upright
        self._past.clear()
        self.skin = MovingSkin()
        self.truth.mark()

    def close(self) -> None:
        """Leave no port behind."""
        self.ports.close()
        self.sensor.unplug()

    def run(self, console: Console | None = None) -> None:
        """Tick by absolute time; what is late is caught up, and only the newest state is sent."""
        ports, controller = self.ports, self.controller
        ports.began = clock().now() - controller.now
        while not (self._done or (console is not None and console.ended)):
            wait = max(ports.began + controller.now + TICK - clock().now(), 0.0)
            ready = clock().wait([*(console.inputs if console else ()), *ports.sockets], wait)
            if console is not None:
                console.read(ready)
            if clock().now() < self.stalled_until:
                clock().sleep(self.stalled_until - clock().now())
                continue
            if clock().now() - ports.began - controller.now > _MOST_BEHIND:
                ports.began = clock().now() - controller.now
            ports.serve(ready)
            behind = clock().now() - ports.began - controller.now
            for _ in range(int(behind / TICK + _ROUNDING)):
                self._tick()
            if behind >= TICK * (1.0 - _ROUNDING) and round(controller.now / TICK) % self.ticks_per_state == 0:
                ports.broadcast()

    def end(self, *_: Any) -> None:
        """Let `run` return."""
        self._done = True

    def send_states_at(self, rate: float) -> None:
        """Let the controller send its state at a rate [Hz], a whole part of its own; raises ValueError."""
        if not 1.0 <= rate <= 1.0 / TICK:
            raise ValueError("states come at 1 to 500 Hz")
        self.ticks_per_state = round(1.0 / (rate * TICK))

    @property
    def position(self) -> Any:
        """The tip in the work frame (3,) [m]."""
        return self._before[0]

    @property
    def velocity(self) -> Any:
        """Its velocity (3,) [m/s]."""
        return self._before[1]

    @property
    def arm_truth(self) -> ArmTruth:
        """What the arm did since the extremes were forgotten."""
        facts, truth = self.truth.facts(), self.truth
        return ArmTruth(
            tuple(facts["low"]),
            tuple(facts["high"]),
            facts["fastest_tip"],
            truth.acceleration,
            facts["fastest_turn"],
            facts["fastest_joint"],
            truth.force,
            bool(np.abs(self.controller.arm.qd).max() > 1e-3),
        )

    def _tip(self) -> tuple[Any, Any]:
        arm = self.controller.arm
        pose, jacobian = arm.tip(self._tool)
        work = self.settings.work
        self._pose, spin = pose, jacobian[3:] @ arm.qd
        self._turning, self._spin = math.hypot(*spin.tolist()), self._rotation @ spin
        self._axes = self._rotation @ pose[:3, :3] @ self._mounting  # of the sensor in the work frame, as columns
        return self._rotation @ (pose[:3, 3] - work.matrix[:3, 3]), self._rotation @ (jacobian[:3] @ arm.qd)

    def _tick(self) -> None:
        began = self.controller.now
        self.hand.act()
        self.controller.tick()
        position, velocity = self._before
        self._before = self._tip()
        self.sensor.poll(self.controller.now)
        self._past.append((began, position, velocity, (self._before[1] - velocity) / TICK))
        instants = self.sensor.instants(self.controller.now)
        if len(instants):
            wrench, unloaded = self._feel(instants)
            self.sensor.send(instants, self.electronics.read(instants, wrench, unloaded))
        elif self.settings.arm is not None:  # no sensor is read: the controller estimates the force
            self._feel(np.array([self.controller.now]))
        joint = float(np.abs(self.controller.arm.qd).max())
        self.truth.add(clock().now(), *self._before, self._turning, joint, self._force, self.controller.read)

    def _feel(self, instants: Any) -> Any:
        """Return the wrench (n, 6) at times (n,) that the sensor felt `force_delay` before; what of it is offset and
        noise."""
        settings = self.settings
        places, speeds, accelerations = self._motion(instants - settings.force_delay)
        out = self._rotation @ self._pose[:3, :3]  # within a tick it hardly turns
        if abs(out[2, 2] + 1.0) > _UPRIGHT:
            away = np.tile(-out[:, 2], (len(instants), 1))
            places, speeds = settings.specimen.upright_place(places, speeds, away, np.cross(self._spin, away))
        if self.skin.moves:
            height, rate = self.skin.motion(instants - settings.force_delay)
            places[:, 2], speeds[:, 2] = places[:, 2] - height, speeds[:, 2] - rate
        contact = self._contact.force(settings.specimen, instants, places, speeds)
        self._force = float(contact[:, 2].max())
        self.controller.arm.push = self._rotation.T @ contact[-1]
        if settings.arm is not None:  # its controller knows the load, and estimates what else pushes
            noise_of_it = settings.force_std * self._rng.standard_normal(3)
            self.controller.force[:3] = self.controller.arm.push + noise_of_it
        self.peak = max(self.peak, self._force)
        noise = self._rng.standard_normal((len(instants), 6))
        offset = settings.bias + settings.drift * instants
        std = settings.force_std * self.sensor.noise_factor
        load = settings.tip_mass, offset, noise, std, settings.force_limit
        # The sensor turns with the tool.
        push, accelerations, down = (
            (contact + self.hand.force) @ self._axes,
            accelerations @ self._axes,
            self.down @ self._axes,
        )
        wrench = sensed_wrench(push, accelerations, *load, down.tolist(), settings.centre_of_mass)
        wrench[:, 3:] += self.hand.torque
        unloaded = std * noise
        unloaded[:, 2] += offset
        return wrench, unloaded

    def turn_gravity(self, down: Sequence[float]) -> None:
        """Let gravity point along `down` in the axes that the sensor has where the tool looks at the skin."""
        self.down = self._nominal @ np.array(down)

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
