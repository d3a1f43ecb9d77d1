"""A simulated rig: a robot that holds a force sensor that holds a tip that presses on a specimen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager

import numpy as np
from palpate import (
    Channel,
    Device,
    Floats,
    Link,
    Setpoint,
    Stream,
)
from palpate_kit.kinematics.rotations import rotation_vector

from palpate_simulation.rig_link import RigLink
from palpate_simulation.simulated_rig_settings import SimulatedRigSettings
from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.tool_axes import TOOL, mounting_matrix, turn_between


class SimulatedRig(SimulatedRigSettings):
    """A UR3e-like robot with a SensONE-like sensor on a soft specimen, in software.

    The robot tracks setpoints by a PD law on position at its own rate; its speed follows the command with a first-order
    lag, and contact does not move it (position control). The sensor sits between flange and tip and so feels contact
    force, weight and inertia of the tip: reading = F + m d'' - m g + bias + drift t + noise, compressive positive.
    Everything is sampled from the exact motion at the instants of each stream. Nothing downstream can distinguish the
    rig from hardware; pose and twist come at the robot's rate, the wrench at the sensor's.
    """

    @property
    def streams(self) -> tuple[Stream, ...]:
        """Wrench of the sensor; pose, twist and setpoint of the tip."""
        limits = (-self.force_limit, self.force_limit)
        forces = tuple(Channel(axis, "N", limits) for axis in "xyz")
        torques = _channels("tx ty tz", "N*m")
        position, orientation = _channels("x y z", "m"), _channels("qx qy qz qw", "1")
        velocity, spin = _channels("x y z", "m/s"), _channels("wx wy wz", "rad/s")
        setpoint = position + _channels("vx vy vz", "m/s") + _channels("measuring", "1")
        return (
            Stream("wrench", forces + torques, self.sensor_rate, "wrench", frame="tip"),
            Stream("tip", position + orientation, self.rate, "pose", frame="work"),
            Stream("twist", velocity + spin, self.rate, "twist", frame="work"),
            Stream("setpoint", setpoint, self.rate, "setpoint", frame="work", estimated=True),
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
        """Outlines (k, 2) [m] of the specimen's inclusions."""
        return tuple(inclusion.outline for inclusion in self.specimen.inclusions)

    @property
    def gravity(self) -> tuple[float, ...]:
        """Direction of gravity (3,) in the work frame."""
        return self.down

    def turned(self, down: tuple[float, ...]) -> Device:
        """Return the rig with its tool turned, so that gravity points along `down` in the sensor's frame."""
        down_in_tool = mounting_matrix(self.mounting) @ np.array(down)
        rotation = turn_between(down_in_tool, TOOL.T @ np.array(self.down))
        return self.model_copy(update={"tool_rotation": tuple(rotation_vector(rotation).tolist())})

    def conditioned(self, earlier: Iterable[tuple[float, float]]) -> Device:
        """Return the rig whose specimen was palpated before, at distances [m] and ages [s]."""
        return self.model_copy(update={"specimen": self.specimen.conditioned(earlier)})

    def refuse(self, setpoint: Setpoint) -> None:
        """Raise ConfigurationError for setpoints through the specimen, or that touch outside of it."""
        self.specimen.refuse(setpoint)

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """Return the rig at rest; `follow` sets it in motion."""
        return self._connected(self.seed if self.seed is not None else seed)

    @contextmanager
    def _connected(self, seed: int) -> Iterator[Link]:
        """Yield the rig at rest, and stop it afterwards."""
        link = RigLink(self, seed)
        try:
            yield link
        finally:
            link.stop()


def _channels(names: str, unit: str) -> tuple[Channel, ...]:
    """Return a channel for each of some names."""
    return tuple(Channel(name, unit) for name in names.split())
