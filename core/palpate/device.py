"""Devices: robots, sensors, simulated rigs and recorded logs, all as sources of batches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from palpate.parts import Part
from palpate.trajectory import ForceLaw, OwnMotion, Setpoint, Trajectory
from palpate.vectors import Floats, finite_rows


@dataclass(frozen=True)
class Channel:
    """One column of a stream: its name, its unit, and the limits of its range."""

    name: str
    unit: str  # SI
    limits: tuple[float, float] | None = None  # readings at or beyond these are saturated


@dataclass(frozen=True)
class Stream:
    """Channels that are sampled together and share one clock; known before anything is connected."""

    name: str
    channels: tuple[Channel, ...]
    rate: float | None  # [Hz] nominal; None where only the time-stamps know
    # How it is recorded; joints: the angle of each under its name, then as many speeds.
    layout: Literal["wrench", "pose", "twist", "joints", "setpoint", "columns"] = "columns"
    clock: str = "device"  # streams of one clock have comparable time-stamps
    frame: str = ""  # coordinate frame of the numbers
    estimated: bool = False  # computed by the device from something else, not measured
    delay: float = 0.0  # [s] by which the device's own filter holds a reading back, nominally


@dataclass(frozen=True)
class Batch:
    """Readings of one stream as they arrived; an invalid reading is NaN."""

    stream: str
    time: NDArray[np.int64]  # (n,) [ns] time-stamps of the stream's clock
    received: NDArray[np.int64]  # (n,) [ns] when the host got them
    values: Floats  # (n, channels) [SI]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True (n,) where every channel is a finite number."""
        return finite_rows(self.values)


class Link(Protocol):
    """A connected device."""

    def batches(self) -> Iterator[Batch]:
        """Yield batches in the order of their arrival, until the device has no more."""
        ...


@runtime_checkable
class Arm(Protocol):
    """A connected device that moves the tip."""

    def batches(self) -> Iterator[Batch]:
        """Yield batches in the order of their arrival, until the motion is over."""
        ...

    def follow(self, trajectory: Trajectory) -> None:
        """Start a motion and return at once."""
        ...

    def stop(self) -> None:
        """Stop the motion: from any thread, at any time, any number of times."""
        ...


@runtime_checkable
class SupportsApproach(Protocol):
    """An arm that moves on its own from its present position to the first setpoint."""

    def approach_path(self, trajectory: Trajectory) -> tuple[Floats, Setpoint]:
        """Return times (n,) [s] and setpoints of the way that `follow` would take now; nothing moves for it.

        Raises DeviceError where the arm stands too far away.
        """
        ...


@runtime_checkable
class Retractable(Protocol):
    """An arm that can leave the material by itself."""

    def retract(self) -> None:
        """Stop and move back along the normal to the start of the motion: from any thread, any number of times."""
        ...


@runtime_checkable
class SupportsForceControl(Protocol):
    """An arm that closes the loop of a `ForceLed` motion by itself, where its commands are sent."""

    def refuse_law(self, law: ForceLaw) -> None:
        """Raise ConfigurationError where the arm cannot follow a law; nothing moves for it."""
        ...


@runtime_checkable
class ReportsHealth(Protocol):
    """A link that keeps account of its own health."""

    @property
    def health(self) -> Mapping[str, Any]:
        """The health for the record: lateness, losses, scheduling, identity; numbers, texts and tables of them."""
        ...


@runtime_checkable
class SeparateReceiver(Protocol):
    """A link whose readings are received by another process than the one that takes its batches."""

    @property
    def attended(self) -> int:
        """The time at which that process last looked for readings [ns], on the clock of `Batch.received`."""
        ...


class Device(Part, ABC):
    """Settings of a device; `connect` gives the link for as long as it is needed, and cleans up after it."""

    kind: ClassVar[str] = "device"

    @property
    @abstractmethod
    def streams(self) -> tuple[Stream, ...]:
        """The streams that the device sends."""

    @abstractmethod
    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """Return a link that lives as long as the context; `seed` is for devices that draw random numbers."""

    @property
    def live(self) -> bool:
        """True if the device sends in real time, so that it must not wait; a log or a fast simulation does not.

        The batches of a live link come at least every 0.1 s, empty ones without new readings.
        """
        return False

    @property
    def provenance(self) -> Mapping[str, str]:
        """The facts by which a record can be redone: file and hash, serial number, firmware."""
        return {}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings before this device is trusted, such as a log that is cut."""
        return ()

    @property
    def simulated(self) -> bool:
        """True if the readings are those of a simulation, computed by the formulas of a model."""
        return isinstance(self, KnowsTruth)

    @property
    def duration(self) -> float | None:
        """The duration of a recorded log [s], for progress bars; None where it is not known."""
        return None


def address(device: str, stream: Stream, channel: Channel) -> str:
    """Return the name of a channel in a pipeline: ``rig.wrench.z``, or ``log.fz`` where the stream has no name."""
    return ".".join(part for part in (device, stream.name, channel.name) if part)


@runtime_checkable
class KnowsTruth(Protocol):
    """A device that knows the values that an estimator should find."""

    @property
    def truth(self) -> Mapping[str, float]:
        """The values by parameter name [SI]."""
        ...

    @property
    def outlines(self) -> tuple[Floats, ...]:
        """Closed outlines (k, 2) [m] of the objects below the skin, for pictures."""
        ...


@runtime_checkable
class KnowsGravity(Protocol):
    """A device that knows the direction of gravity in the frame of its poses."""

    @property
    def gravity(self) -> tuple[float, ...]:
        """The direction of gravity (3,)."""
        ...


@runtime_checkable
class Turnable(Protocol):
    """A device whose tool can be turned without a person."""

    def turned(self, down: tuple[float, ...]) -> Device:
        """Return this device with its tool turned so that gravity points along `down` in the sensor's frame."""
        ...


@runtime_checkable
class SupportsOwnMotion(Protocol):
    """An arm that also moves on its own, besides the commanded motion."""

    @property
    def own_motion(self) -> OwnMotion:
        """The motion's limits: distance, speed, deceleration."""
        ...


@runtime_checkable
class Observable(Protocol):
    """A device that a second connection can read without disturbing it."""

    def observe(self, seed: int) -> AbstractContextManager[Link]:
        """Return a link that only reads."""
        ...


@dataclass(frozen=True)
class StopModes:
    """The values in a robot's states that mean a stop by its own safety system."""

    channel: str  # of one of its streams
    emergency: tuple[int, ...]  # its values at an emergency stop
    safeguard: tuple[int, ...] = ()  # at a safeguard stop; empty: the robot has none, or does not report it
    reflex: tuple[int, ...] = ()  # at a stop by the controller's own threshold of force; empty: as above
    single_connection: bool = False  # True: the controller serves one program, so that a run records how it stops


@runtime_checkable
class ReportsStops(Protocol):
    """A robot whose states, watched by a second connection or recorded by the run, report its own stops."""

    @property
    def stop_modes(self) -> StopModes | None:
        """The values that mean a stop; None for a robot whose states do not report one."""
        ...


@runtime_checkable
class SupportsReach(Protocol):
    """A device with a limited reach."""

    def refuse(self, setpoint: Setpoint) -> None:
        """Raise ConfigurationError for setpoints that this device must not reach; nothing moves for it."""
        ...


def is_live(devices: Mapping[str, Device]) -> bool:
    """Return True if any of the devices sends in real time."""
    return any(device.live for device in devices.values())


def truth_of(devices: Mapping[str, Device]) -> dict[str, float]:
    """Return the true values that simulated devices know, by parameter name [SI]."""
    simulated = [device for device in devices.values() if isinstance(device, KnowsTruth)]
    return {name: value for device in simulated for name, value in device.truth.items()}


def ask_devices(devices: Mapping[str, Device], setpoint: Setpoint) -> None:
    """Let every device refuse setpoints before anything moves; raises ConfigurationError."""
    for device in devices.values():
        if isinstance(device, SupportsReach):
            device.refuse(setpoint)


def own_motions(devices: Mapping[str, Device]) -> dict[str, OwnMotion]:
    """Return the own motions of the arms among devices, by name."""
    return {name: device.own_motion for name, device in devices.items() if isinstance(device, SupportsOwnMotion)}
