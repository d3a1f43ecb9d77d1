"""World of the twins: the sensor feels the motion of the arm and its contact with the specimen."""

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
from palpate_simulation.twins.sensor_lines import SerialLine
from palpate_simulation.twins.settings import BenchSettings

START_POSTURE = np.array([0.0, -1.3, -1.9, -1.5, 1.5708, 0.0])  # [rad] with the tool downwards (a choice)
MAX_TURN_STEP = 0.1  # [rad] between two postures, each solved from the one before (a choice)
START_STEPS = 100  # of the inverse kinematics of a posture (a choice): it may be far from the one before
UPRIGHT_COSINE = 1e-6  # that a cosine may differ from 1: a milliradian
TICK_ROUNDING = 1e-6  # of a tick: a clock counts nanoseconds
MAX_BEHIND = 0.5  # [s] (a choice): a longer stall of this process is not made up for
MOVING_SPEED = 1e-3  # [rad/s] of the fastest joint, above which the arm moves (a choice)
SPARE_TICKS = 4  # of past motion, beyond the sensor's delay (a choice)


class World:
    """Twins at work, in one loop of 2 ms."""

    def __init__(self, settings: BenchSettings, seed: int, wiring: Wiring | None = None) -> None:
        """Put arm, controller and sensor at their start; without a wiring they listen on the network.

        The seeds of robot, sensor and world are independent.
        """
        self.settings, wiring = settings, wiring or NetworkWiring()
        robot_sequence, sensor_sequence, noise_sequence = np.random.SeedSequence(seed).spawn(3)
        robot_seed, sensor_seed = (int(s.generate_state(1)[0]) for s in (robot_sequence, sensor_sequence))
        self._rng = np.random.default_rng(noise_sequence)
        # Pose of the true tool, and the one that the controller assumes at first: a client may set another.
        self._tool = matrix_of([*settings.tcp, *settings.tcp_rotation])
        self._model = MODELS[settings.robot] if settings.arm is None else settings.arm.model
        self.controller = Controller(self._make_arm(), settings.position_std, settings.velocity_std, robot_seed)
        self.controller.load = settings.payload, settings.payload_centre
        self.hand = Hand(self.controller, settings.work, self._tool)
        line = wiring.serial(settings.port) if settings.sensor == "bota" else None  # first: it may be refused
        self.ports = wiring.ports(settings.host, self.controller)
        self.sensor = self._make_sensor(line, wiring, sensor_seed)
        self.electronics = Electronics(sensor_seed)
        self._rotation = settings.work.matrix[:3, :3].T  # from the base to the work frame
        self._mounting = mounting_matrix(settings.mounting)
        self._nominal = self._rotation @ settings.work.tool @ self._mounting  # axes of the sensor in the work frame
        self._before = self._tip()  # position and velocity of the tip at the latest tick
        self.truth = Truth()
        self._force = 0.0  # [N] on the skin, the latest
        # Start [s], position, velocity and acceleration of the latest ticks.
        self._past: deque[tuple[float, Any, Any, Any]] = deque(maxlen=int(settings.force_delay / TICK) + SPARE_TICKS)
        self._upright = self.down = -settings.work.matrix[2, :3]  # direction of gravity in the work frame
        self.stalled_until = 0.0
        self.ticks_per_state = 1  # of the controller, which sends its state so seldom
        self.peak = 0.0  # [N] on the skin
        self._contact, self.skin = SkinContact(), MovingSkin()
        self._done = False

    def _make_arm(self) -> SimulatedArm:
        """Return the arm at its start; another maker's has a lag and a stiffness of its own."""
        arm = SimulatedArm(self._start(), self._tool, model=self._model)
        if self.settings.arm is not None:
            arm.own_lag = self.settings.arm.lag
            stiffness = self.settings.arm.stiffness
            arm.stiffness = math.inf if stiffness is None else stiffness
        return arm

    def _make_sensor(self, line: SerialLine | None, wiring: Wiring, seed: int) -> VirtualSensor | VirtualBox:
        """Return a SensONE on a serial line, or a box on the net without a line."""
        settings = self.settings
        if line is not None:
            return VirtualSensor(line, settings.line_time, settings.sensor_ppm, settings.clock_start, seed)
        scale = COUNTS[settings.sensor]
        return VirtualBox(wiring.datagrams(settings.host), settings.sensor_rate, scale, seed)

    def _start(self) -> Any:
        """Return the joint angles (n,) [rad] at the start; raises DeviceError where the pose is out of reach.

        The tool is turned from the work frame's orientation step by step, as the arm would turn it.
        """
        settings = self.settings
        goal = settings.work.tool_pose(np.array([*settings.place, settings.height]))
        level, rotation = goal[:3, :3].copy(), np.array(settings.tool_rotation)
        q: Any = START_POSTURE if settings.arm is None else np.array(settings.arm.posture)
        steps = math.ceil(math.hypot(*rotation) / MAX_TURN_STEP)
        for share in np.linspace(0.0, 1.0, steps + 1):
            goal[:3, :3] = level @ rotation_matrix((share * rotation).tolist())
            q = self._model.joints_at(goal, self._tool, q, steps=START_STEPS)
            if q is None:
                raise DeviceError("the twin's arm cannot reach the work frame: move [twin.*] work")
        return q

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
        """Advance the twins in step with the clock until the end; late ticks are caught up, and the last state sent."""
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
            # After a long stall the controller's time goes on from here.
            if clock().now() - ports.began - controller.now > MAX_BEHIND:
                ports.began = clock().now() - controller.now
            ports.serve(ready)
            behind = clock().now() - ports.began - controller.now
            for _ in range(int(behind / TICK + TICK_ROUNDING)):
                self._tick()
            has_ticked = behind >= TICK * (1.0 - TICK_ROUNDING)
            if has_ticked and round(controller.now / TICK) % self.ticks_per_state == 0:
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
        """Position of the tip in the work frame (3,) [m]."""
        return self._before[0]

    @property
    def velocity(self) -> Any:
        """Velocity of the tip in the work frame (3,) [m/s]."""
        return self._before[1]

    @property
    def arm_truth(self) -> ArmTruth:
        """Extremes of the arm's true motion since the last mark."""
        facts, truth = self.truth.facts(), self.truth
        return ArmTruth(
            low=tuple(facts["low"]),
            high=tuple(facts["high"]),
            speed=facts["fastest_tip"],
            acceleration=truth.acceleration,
            turning=facts["fastest_turn"],
            joint_speed=facts["fastest_joint"],
            force=truth.force,
            moving=bool(np.abs(self.controller.arm.qd).max() > MOVING_SPEED),
        )

    def _tip(self) -> tuple[Any, Any]:
        """Return position [m] and velocity [m/s] (3,) of the tip in the work frame, and keep its orientation."""
        arm = self.controller.arm
        pose, jacobian = arm.tip(self._tool)
        angular_velocity = jacobian[3:] @ arm.qd
        self._pose = pose  # (4, 4) in the base
        self._turning = math.hypot(*angular_velocity.tolist())  # [rad/s]
        self._spin = self._rotation @ angular_velocity  # (3,) [rad/s] in the work frame
        self._axes = self._rotation @ pose[:3, :3] @ self._mounting  # of the sensor in the work frame, as columns
        position = self._rotation @ (pose[:3, 3] - self.settings.work.matrix[:3, 3])
        return position, self._rotation @ (jacobian[:3] @ arm.qd)

    def _tick(self) -> None:
        """Advance hand, controller and arm by a tick, then the sensor by its readings in it."""
        start = self.controller.now
        position, velocity = self._before
        self.hand.act()
        self.controller.tick()
        self._before = self._tip()
        acceleration = (self._before[1] - velocity) / TICK
        self._past.append((start, position, velocity, acceleration))
        self.sensor.poll(self.controller.now)
        instants = self.sensor.instants(self.controller.now)
        if len(instants):
            wrench, unloaded = self._feel(instants)
            self.sensor.send(instants, self.electronics.read(instants, wrench, unloaded))
        elif self.settings.arm is not None:  # no sensor is read: the controller estimates the force
            self._feel(np.array([self.controller.now]))
        joint_speed = float(np.abs(self.controller.arm.qd).max())
        self.truth.add(clock().now(), *self._before, self._turning, joint_speed, self._force, self.controller.read)

    def _feel(self, instants: Any) -> tuple[Any, Any]:
        """Return the wrench (n, 6) that the sensor felt `force_delay` before instants (n,) [s], and its unloaded part.

        The unloaded part (n, 6) is offset and noise. The arm is pushed by the force.
        """
        settings = self.settings
        contact, acceleration = self._contact_force(instants)
        self._force = float(contact[:, 2].max())
        self.peak = max(self.peak, self._force)
        self._push_arm(contact[-1])
        noise = self._rng.standard_normal((len(instants), 6))
        noise_std = settings.force_std * self.sensor.noise_factor
        offset = settings.bias + settings.drift * instants
        wrench = sensed_wrench(
            (contact + self.hand.force) @ self._axes,
            acceleration @ self._axes,
            tip_mass=settings.tip_mass,
            offset=offset,
            noise=noise,
            noise_std=noise_std,
            limit=settings.force_limit,
            down=(self.down @ self._axes).tolist(),
            centre=settings.centre_of_mass,
        )
        wrench[:, 3:] += self.hand.torque
        unloaded = noise_std * noise
        unloaded[:, 2] += offset
        return wrench, unloaded

    def _contact_force(self, instants: Any) -> tuple[Any, Any]:
        """Return contact force (n, 3) [N] and acceleration (n, 3) of the tip, in the work frame, late by the delay."""
        specimen = self.settings.specimen
        true_times = instants - self.settings.force_delay
        position, velocity, acceleration = self._motion(true_times)
        tool_axes = self._rotation @ self._pose[:3, :3]  # within a tick it hardly turns
        if abs(tool_axes[2, 2] + 1.0) > UPRIGHT_COSINE:
            out = np.tile(-tool_axes[:, 2], (len(instants), 1))
            position, velocity = specimen.upright_place(position, velocity, out, np.cross(self._spin, out))
        # A skin that has risen is that of a tip that is deeper.
        if self.skin.moves:
            height, rate = self.skin.motion(true_times)
            position[:, 2], velocity[:, 2] = position[:, 2] - height, velocity[:, 2] - rate
        return self._contact.force(specimen, instants, position, velocity), acceleration

    def _push_arm(self, force: Any) -> None:
        """Let a force (3,) [N] in the work frame push the arm; another maker's controller estimates it, with noise."""
        self.controller.arm.push = self._rotation.T @ force
        if self.settings.arm is not None:
            error = self.settings.force_std * self._rng.standard_normal(3)
            self.controller.force[:3] = self.controller.arm.push + error

    def turn_gravity(self, down: Sequence[float]) -> None:
        """Let gravity point along `down` in the axes that the sensor has where the tool looks at the skin."""
        self.down = self._nominal @ np.array(down)

    def _motion(self, instants: Any) -> tuple[Any, Any, Any]:
        """Return positions, velocities and accelerations (n, 3) at past instants (n,) [s].

        The acceleration is constant within a tick.
        """
        rows = []
        for instant in instants:
            earlier_ticks = (tick for tick in reversed(self._past) if tick[0] <= instant)
            start, position, velocity, acceleration = next(earlier_ticks, self._past[0])
            elapsed = instant - start
            position_now = position + velocity * elapsed + 0.5 * acceleration * elapsed**2
            rows.append((position_now, velocity + acceleration * elapsed, acceleration))
        positions, velocities, accelerations = (np.array(column) for column in zip(*rows, strict=True))
        return positions, velocities, accelerations
