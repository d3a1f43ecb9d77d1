"""A simulated rig: a robot that holds a force sensor that holds a tip that presses on a specimen."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Literal

import numpy as np
from palpate import (
    Angle,
    Batch,
    Channel,
    ConfigurationError,
    Delay,
    Device,
    Floats,
    Force,
    ForceControlled,
    ForceDrift,
    ForceLaw,
    Frequency,
    Length,
    Link,
    Setpoint,
    Speed,
    Stiffness,
    Stream,
    Time,
    TipMass,
    Trajectory,
    clock,
    duration_of,
    host_time_ns,
    setpoints_at,
)
from palpate_kit.kinematics.rotations import rotation_vector
from palpate_records.prefetch import ahead
from pydantic import Field

from palpate_simulation.sensor_wrench import sensed_wrench
from palpate_simulation.series_compliance import motion_behind_spring
from palpate_simulation.simulated_arm import PositionLoop, TrackedMotion
from palpate_simulation.simulated_tool import SimulatedTool
from palpate_simulation.skin_contact import SkinContact
from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen
from palpate_simulation.tool_axes import MOUNTING, TOOL, mounting_matrix, turn_between

_SECOND = 1_000_000_000  # [ns]
_AHEAD = 8  # batches that are made before they are asked for
_ROUND = {"real-time": 0.05, "fast": 1.0}  # [s] of simulated time in one round of batches, by pace


class SimulatedRig(Device):
    """A UR3e-like robot with a SensONE-like sensor on a soft specimen, in software.

    The robot tracks setpoints by a PD law on position at its own rate; its speed follows the command with a first-order
    lag, and contact does not move it (position control). The sensor sits between flange and tip and so feels contact
    force, weight and inertia of the tip: reading = F + m d'' - m g + bias + drift t + noise, compressive positive.
    Everything is sampled from the exact motion at the instants of each stream. Nothing downstream can distinguish the
    rig from hardware; pose and twist come at the robot's rate, the wrench at the sensor's.
    """

    specimen: Specimen = Field(description="what the tip presses on")
    tip_mass: TipMass = Field(default=0.14, gt=0, description="mass of everything mounted behind the sensor")
    centre_of_mass: tuple[Length, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="of that mass, in the sensor's frame"
    )
    down: tuple[float, ...] = Field(
        default=(0.0, 0.0, -1.0), min_length=3, max_length=3, description="direction of gravity in the work frame"
    )
    tool_rotation: tuple[Angle, ...] = Field(
        default=(0.0, 0.0, 0.0),
        min_length=3,
        max_length=3,
        description="rotation vector of the tool from one that looks along the normal, in the tool's frame",
    )
    mounting: tuple[Angle, ...] | None = Field(default=None, min_length=3, max_length=3, description=MOUNTING)
    rate: Frequency = Field(default=500.0, gt=0, description="control and sampling rate of the robot")
    gain: float = Field(
        default=20.0, gt=0, allow_inf_nan=False, description="proportional gain of the position loop, in 1/s"
    )
    damping: float = Field(default=0.5, ge=0, lt=10, description="derivative gain of the position loop")
    lag: Time = Field(default=0.01, gt=0, description="time constant of the robot's inner speed loop")
    unrest: Length = Field(
        default=0.0, ge=0, description="standard deviation of the arm's own motion up and down, 0.5 to 20 Hz"
    )
    position_std: Length = Field(default=5e-6, ge=0, description="noise of the measured position")
    velocity_std: Speed = Field(default=0.67e-3, ge=0, description="noise of the measured velocity")
    sensor_rate: Frequency = Field(default=800.0, gt=0, description="sampling rate of the sensor")
    force_std: Force = Field(default=0.05, ge=0, description="white noise of the sensor")
    bias: Force = Field(default=0.6, description="offset of the sensor")
    drift: ForceDrift = Field(default=1.5 / 3600, description="drift of the sensor's offset")
    series_stiffness: Stiffness | None = Field(
        default=None,
        gt=0,
        description="stiffness of robot and sensor, in series with the material; left out: rigid",
    )
    force_limit: Force = Field(default=500.0, gt=0, description="range of the sensor; readings are clipped there")
    force_delay: Delay = Field(
        default=0.0, description="delay of the wrench's stamps; has to be declared to an estimator"
    )
    motion_delay: Delay = Field(
        default=0.0, description="delay of the stamps of pose and twist; has to be declared to an estimator"
    )
    serial_number: str = Field(
        default="SIM-0001", min_length=1, description="serial number of the sensor, as a real one has"
    )
    seed: int | None = Field(default=None, ge=0, description="seed of the noise; left out: that of the run")
    pace: Literal["fast", "real-time"] = Field(
        default="fast", description="as fast as the machine can, or in real time"
    )

    @property
    def streams(self) -> tuple[Stream, ...]:
        """Wrench, tip pose, tip twist and setpoint."""
        limits = (-self.force_limit, self.force_limit)
        wrench = [Channel(axis, "N", limits) for axis in "xyz"] + [Channel(f"t{axis}", "N*m") for axis in "xyz"]
        pose = [Channel(axis, "m") for axis in "xyz"] + [Channel(f"q{axis}", "1") for axis in "xyzw"]
        twist = [Channel(axis, "m/s") for axis in "xyz"] + [Channel(f"w{axis}", "rad/s") for axis in "xyz"]
        setpoint = [Channel(axis, "m") for axis in "xyz"] + [Channel(f"v{axis}", "m/s") for axis in "xyz"]
        setpoint.append(Channel("measuring", "1"))
        return (
            Stream("wrench", tuple(wrench), self.sensor_rate, "wrench", frame="tip"),
            Stream("tip", tuple(pose), self.rate, "pose", frame="work"),
            Stream("twist", tuple(twist), self.rate, "twist", frame="work"),
            Stream("setpoint", tuple(setpoint), self.rate, "setpoint", frame="work", estimated=True),
        )

    @property
    def truth(self) -> Mapping[str, float]:
        """The specimen's parameters and the height of its surface."""
        return {**self.specimen.parameters, "surface": self.specimen.surface}

    def truth_at(self, places: Floats) -> Mapping[str, Floats]:
        """Return the specimen's parameters (n,) that a tip feels at places (n, 2) [m]."""
        skin = SkinUnderTip(self.specimen, np.column_stack([places, np.zeros(len(places))]))
        names = [parameter.name for parameter in self.specimen.model.parameters]
        return {name: np.broadcast_to(value, len(places)) for name, value in zip(names, skin.theta, strict=True)}

    @property
    def provenance(self) -> Mapping[str, str]:
        """The sensor's serial number."""
        return {"serial_number": self.serial_number}

    @property
    def outlines(self) -> tuple[Floats, ...]:
        """Outlines of the specimen's inclusions."""
        return tuple(inclusion.outline for inclusion in self.specimen.inclusions)

    @property
    def gravity(self) -> tuple[float, ...]:
        """In the work frame."""
        return self.down

    def turned(self, down: tuple[float, ...]) -> Device:
        """Return the rig with its tool turned, so that gravity points along `down` in the sensor's frame."""
        turn = turn_between(mounting_matrix(self.mounting) @ np.array(down), TOOL.T @ np.array(self.down))
        return self.model_copy(update={"tool_rotation": tuple(rotation_vector(turn).tolist())})

    def conditioned(self, earlier: Iterable[tuple[float, float]]) -> Device:
        """Return the rig whose specimen was palpated before, at distances [m] and ages [s]."""
        return self.model_copy(update={"specimen": self.specimen.conditioned(earlier)})

    def refuse(self, setpoint: Setpoint) -> None:
        """Not through the specimen, and not past it."""
        self.specimen.refuse(setpoint)

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """Return the rig at rest; `follow` sets it in motion."""
        return self._connected(self.seed if self.seed is not None else seed)

    @contextmanager
    def _connected(self, seed: int) -> Iterator[Link]:
        arm = _RigLink(self, seed)
        try:
            yield arm
        finally:
            arm.stop()


class _RigLink:
    """The rig at work (an Arm)."""

    def __init__(self, settings: SimulatedRig, seed: int) -> None:
        self._settings = settings
        streams = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(5))
        self._force_noise, self._position_noise, self._velocity_noise, self._led_noise, self._unrest = streams
        self._stopped = clock().event()
        self._trajectory: Trajectory | None = None

    def refuse_law(self, law: ForceLaw) -> None:
        """Whether a force may lead; see `palpate.SupportsForceControl`."""
        from palpate_arms.force_control import refusal

        settings = self._settings
        text = refusal(law, math.inf, math.inf, math.inf, law.end)
        if settings.specimen.unloading == "ting" or settings.series_stiffness is not None:
            text = 'force control is not possible with series_stiffness, nor on a specimen with unloading = "ting"'
        if text is not None:
            raise ConfigurationError(f"device sim: {text}")

    def follow(self, trajectory: Trajectory) -> None:
        """Start a motion."""
        self._trajectory = trajectory
        self._stopped.clear()

    def stop(self) -> None:
        """Stop where it is."""
        self._stopped.set()

    def batches(self) -> Iterator[Batch]:
        """Readings of the streams during the motion, round by round; a thread is ahead where no clock is kept."""
        return self._rounds() if self._settings.pace == "real-time" else ahead(self._rounds(), _AHEAD)

    def _rounds(self) -> Generator[Batch]:
        if self._trajectory is None:
            return
        settings = self._settings
        end = duration_of(self._trajectory)
        ticks = np.arange(int(np.floor(end * settings.rate)) + 1) / settings.rate
        setpoint = setpoints_at(self._trajectory, ticks)
        loop = PositionLoop(settings.gain, settings.damping, settings.lag, 1.0 / settings.rate)
        if isinstance(self._trajectory, ForceControlled):
            from palpate_simulation.simulated_force_control import force_controlled_motion

            noise = self._led_noise.standard_normal(len(ticks)) * settings.force_std
            law = self._trajectory.force_law
            motion, setpoint = force_controlled_motion(settings.specimen, loop, ticks, setpoint, law, noise)
        else:
            motion = loop.track(setpoint.position, setpoint.velocity)
            if settings.unrest > 0:
                motion = motion.with_unrest(settings.unrest, self._unrest)
        tool = SimulatedTool.of(settings.tool_rotation, settings.mounting, settings.down, loop, setpoint)
        readings = np.arange(int(np.floor(ticks[-1] * settings.sensor_rate)) + 1) / settings.sensor_rate
        contact = self._contact(readings, motion, tool)
        origin = host_time_ns() if settings.pace == "real-time" else 0
        began = clock().now()
        done_ticks = done_readings = 0
        length = _ROUND[settings.pace]
        for edge in np.arange(1, int(end / length) + 2) * length:
            if settings.pace == "real-time":
                self._stopped.wait(max(edge - (clock().now() - began), 0.0))
            if self._stopped.is_set():
                return
            felt = slice(done_readings, done_readings := int(np.searchsorted(readings, edge)))
            now = readings[felt]
            yield self._batch(
                "wrench", now, settings.force_delay, self._wrench(now, motion, contact[felt], tool), origin
            )
            rows = slice(done_ticks, done_ticks := int(np.searchsorted(ticks, edge)))
            pose, twist = self._kinematics(motion.position[rows], motion.velocity[rows], *tool.pose(ticks[rows]))
            yield self._batch("tip", ticks[rows], settings.motion_delay, pose, origin)
            yield self._batch("twist", ticks[rows], settings.motion_delay, twist, origin)
            commanded = [setpoint.position[rows], setpoint.velocity[rows], setpoint.measuring[rows][:, None]]
            yield self._batch("setpoint", ticks[rows], settings.motion_delay, np.hstack(commanded), origin)

    def _contact(self, instants: Floats, motion: TrackedMotion, tool: SimulatedTool) -> Floats:
        """Contact force (n, 3) [N] over the whole motion, which a material that remembers has to be asked for."""
        position, velocity, _ = motion.at(instants)
        settings, sliding = self._settings, velocity
        if (stiffness := settings.series_stiffness) is not None:
            position, velocity = motion_behind_spring(settings.specimen, instants, position, velocity, stiffness)
        if not tool.is_upright:
            out, rate = tool.out(instants)
            position, velocity = settings.specimen.upright_place(position, velocity, out, rate)
        if settings.specimen.form is not None:
            return SkinContact().force(settings.specimen, instants, position, velocity)
        return settings.specimen.with_friction(
            SkinUnderTip(settings.specimen, position).push(instants, velocity), sliding
        )

    def _wrench(self, instants: Floats, motion: TrackedMotion, contact: Floats, tool: SimulatedTool) -> Floats:
        """What the sensor reads (n, 6) at true times (n,) [s]."""
        settings = self._settings
        acceleration = motion.mean_acceleration(instants, 1.0 / settings.sensor_rate)
        contact, acceleration, down = tool.in_sensor(instants, contact, acceleration)
        offset = settings.bias + settings.drift * instants
        noise = self._force_noise.standard_normal((len(instants), 6))
        return sensed_wrench(
            contact,
            acceleration,
            settings.tip_mass,
            offset,
            noise,
            settings.force_std,
            settings.force_limit,
            down,
            settings.centre_of_mass,
        )

    def _kinematics(self, position: Floats, velocity: Floats, turned: Floats, spin: Floats) -> tuple[Floats, Floats]:
        """Measured pose (n, 7) and twist (n, 6), with the quaternions and angular velocities of the tool."""
        n = len(position)
        pose, twist = np.zeros((n, 7)), np.zeros((n, 6))
        pose[:, :3] = position + self._position_noise.standard_normal((n, 3)) * self._settings.position_std
        pose[:, 3:], twist[:, 3:] = turned, spin
        twist[:, :3] = velocity + self._velocity_noise.standard_normal((n, 3)) * self._settings.velocity_std
        return pose, twist

    def _batch(self, stream: str, instants: Floats, delay: float, values: Floats, origin: int) -> Batch:
        stamps = origin + np.rint((instants + delay) * _SECOND).astype(np.int64)
        return Batch(stream, stamps, stamps, values)
