"""Connection to a simulated rig: its motion along a trajectory, and the batches of its streams."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np
from palpate import (
    Batch,
    ConfigurationError,
    Floats,
    ForceControlled,
    ForceLaw,
    Setpoint,
    Trajectory,
    clock,
    duration_of,
    host_time_ns,
    setpoints_at,
)
from palpate_records.prefetch import ahead

from palpate_simulation.sensor_wrench import sensed_wrench
from palpate_simulation.series_compliance import motion_behind_spring
from palpate_simulation.simulated_arm import PositionLoop, TrackedMotion
from palpate_simulation.simulated_rig_settings import SimulatedRigSettings
from palpate_simulation.simulated_tool import SimulatedTool
from palpate_simulation.skin_contact import SkinContact
from palpate_simulation.skin_under_tip import SkinUnderTip

NS_PER_SECOND = 1_000_000_000
BATCHES_AHEAD = 8  # that a thread makes before they are taken (a choice: memory for time)
# Simulated time [s] in one round of batches, by pace (a choice): as short as a live device's, or long for speed.
ROUND_LENGTH = {"real-time": 0.05, "fast": 1.0}


@dataclass(frozen=True)
class TrackedPath:
    """Motion of arm and tool along a trajectory."""

    ticks: Floats  # (n,) [s] of the control loop
    setpoint: Setpoint  # (n,) at the ticks
    motion: TrackedMotion  # of the tip
    tool: SimulatedTool


class RigLink:
    """A simulated rig at work (an Arm)."""

    def __init__(self, settings: SimulatedRigSettings, seed: int) -> None:
        self._settings = settings
        generators = [np.random.default_rng(sequence) for sequence in np.random.SeedSequence(seed).spawn(5)]
        self._force_rng, self._position_rng, self._velocity_rng, self._control_rng, self._unrest_rng = generators
        self._stopped = clock().event()
        self._trajectory: Trajectory | None = None

    def refuse_law(self, law: ForceLaw) -> None:
        """Raise ConfigurationError for a force that cannot lead this rig; see `palpate.SupportsForceControl`."""
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
        """Stop the motion where it is."""
        self._stopped.set()

    def batches(self) -> Iterator[Batch]:
        """Return the batches of all streams during the motion; where no clock is kept, a thread makes them ahead."""
        return self._rounds() if self._settings.pace == "real-time" else ahead(self._rounds(), BATCHES_AHEAD)

    def _rounds(self) -> Generator[Batch]:
        """Yield the batches of the motion in rounds of equal length, at the pace of the settings."""
        if self._trajectory is None:
            return
        path = self._track(self._trajectory)
        is_live = self._settings.pace == "real-time"
        sensor_rate = self._settings.sensor_rate
        instants = np.arange(int(np.floor(path.ticks[-1] * sensor_rate)) + 1) / sensor_rate  # of the wrench [s]
        contact = self._contact(instants, path)
        origin = host_time_ns() if is_live else 0  # [ns]
        start_time = clock().now()
        length = ROUND_LENGTH[self._settings.pace]
        round_ends = np.arange(1, int(duration_of(self._trajectory) / length) + 2) * length  # [s]
        # Indexes of the first reading and the first tick after each round.
        reading_ends, tick_ends = np.searchsorted(instants, round_ends), np.searchsorted(path.ticks, round_ends)
        readings, ticks = slice(0, 0), slice(0, 0)
        for round_end, reading_end, tick_end in zip(round_ends, reading_ends, tick_ends, strict=True):
            if is_live:
                self._stopped.wait(max(round_end - (clock().now() - start_time), 0.0))
            if self._stopped.is_set():
                return
            readings, ticks = slice(readings.stop, int(reading_end)), slice(ticks.stop, int(tick_end))
            yield self._wrench_batch(path, instants[readings], contact[readings], origin)
            yield from self._motion_batches(path, ticks, origin)

    def _track(self, trajectory: Trajectory) -> TrackedPath:
        """Return the motion that the position loop makes of a trajectory; with a force law, the force leads it."""
        settings = self._settings
        ticks = np.arange(int(np.floor(duration_of(trajectory) * settings.rate)) + 1) / settings.rate
        setpoint = setpoints_at(trajectory, ticks)
        loop = PositionLoop(settings.gain, settings.damping, settings.lag, period=1.0 / settings.rate)
        if isinstance(trajectory, ForceControlled):
            from palpate_simulation.simulated_force_control import force_controlled_motion

            noise = self._control_rng.standard_normal(len(ticks)) * settings.force_std
            law = trajectory.force_law
            motion, setpoint = force_controlled_motion(settings.specimen, loop, ticks, setpoint, law, noise)
        else:
            motion = loop.track(setpoint.position, setpoint.velocity)
            if settings.unrest > 0:
                motion = motion.with_unrest(settings.unrest, self._unrest_rng)
        tool = SimulatedTool.of(settings.tool_rotation, settings.mounting, settings.down, loop, setpoint)
        return TrackedPath(ticks, setpoint, motion, tool)

    def _contact(self, instants: Floats, path: TrackedPath) -> Floats:
        """Return the contact force (n, 3) [N] at instants (n,) [s] of the whole motion, which a memory depends on."""
        specimen = self._settings.specimen
        position, velocity, _ = path.motion.at(instants)
        sliding_velocity = velocity  # of the tool, before the spring
        if (stiffness := self._settings.series_stiffness) is not None:
            position, velocity = motion_behind_spring(specimen, instants, position, velocity, stiffness)
        if not path.tool.is_upright:
            position, velocity = specimen.upright_place(position, velocity, *path.tool.out(instants))
        if specimen.form is not None:
            return SkinContact().force(specimen, instants, position, velocity)
        return specimen.with_friction(SkinUnderTip(specimen, position).push(instants, velocity), sliding_velocity)

    def _wrench_batch(self, path: TrackedPath, instants: Floats, contact: Floats, origin: int) -> Batch:
        """Return the readings of the sensor at true times (n,) [s], with a contact force (n, 3) [N] on the tip."""
        settings = self._settings
        acceleration = path.motion.mean_acceleration(instants, width=1.0 / settings.sensor_rate)
        force_in_sensor, acceleration_in_sensor, down = path.tool.in_sensor(instants, contact, acceleration)
        wrench = sensed_wrench(
            force_in_sensor,
            acceleration_in_sensor,
            tip_mass=settings.tip_mass,
            offset=settings.bias + settings.drift * instants,
            noise=self._force_rng.standard_normal((len(instants), 6)),
            noise_std=settings.force_std,
            limit=settings.force_limit,
            down=down,
            centre=settings.centre_of_mass,
        )
        return _stamped("wrench", instants, settings.force_delay, wrench, origin)

    def _motion_batches(self, path: TrackedPath, rows: slice, origin: int) -> Iterator[Batch]:
        """Yield measured pose and twist, and the setpoints, at some ticks."""
        ticks, setpoint, delay = path.ticks[rows], path.setpoint, self._settings.motion_delay
        n = len(ticks)
        # Noise is that of position and velocity; orientation and angular velocity are exact.
        pose, twist = np.zeros((n, 7)), np.zeros((n, 6))
        pose[:, 3:], twist[:, 3:] = path.tool.pose(ticks)
        position_error = self._position_rng.standard_normal((n, 3)) * self._settings.position_std
        velocity_error = self._velocity_rng.standard_normal((n, 3)) * self._settings.velocity_std
        pose[:, :3] = path.motion.position[rows] + position_error
        twist[:, :3] = path.motion.velocity[rows] + velocity_error
        yield _stamped("tip", ticks, delay, pose, origin)
        yield _stamped("twist", ticks, delay, twist, origin)
        commands = [setpoint.position[rows], setpoint.velocity[rows], setpoint.measuring[rows][:, None]]
        yield _stamped("setpoint", ticks, delay, np.hstack(commands), origin)


def _stamped(stream: str, instants: Floats, delay: float, values: Floats, origin: int) -> Batch:
    """Return a batch whose stamps are late by a delay [s]; `instants` (n,) [s] count from `origin` [ns]."""
    stamps = origin + np.rint((instants + delay) * NS_PER_SECOND).astype(np.int64)
    return Batch(stream, stamps, stamps, values)
