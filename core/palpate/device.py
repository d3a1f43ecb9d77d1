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
        """(n,) True where every channel is a finite number."""
        return finite_rows(self.values)


class Link(Protocol):
    """A connected device."""

    def batches(self) -> Iterator[Batch]:
        """Batches in the order of their arrival, until the device has no more."""
        ...


@runtime_checkable
class Arm(Protocol):
    """A connected device that moves the tip."""

    def batches(self) -> Iterator[Batch]:
        """Batches in the order of their arrival, until the motion is over."""
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
        """Times (n,) [s] and setpoints of the way that `follow` would take now; nothing moves for it.

        Raises DeviceError where the arm stands too far away.
        """
        ...


@runtime_checkable
class Retractable(Protocol):
    """An arm that can leave the material by itself."""

    def retract(self) -> None:
        """Stop and go back along the normal to where the motion began: from any thread, any number of times."""
        ...


@runtime_checkable
class SupportsForceControl(Protocol):
    """An arm that closes the loop of a `ForceLed` motion by itself, where its commands are sent."""

    def refuse_law(self, law: ForceLaw) -> None:
        """Raise ConfigurationError where it cannot be led like this; nothing moves for it."""
        ...


@runtime_checkable
class ReportsHealth(Protocol):
    """A link that keeps account of its own health."""

    @property
    def health(self) -> Mapping[str, Any]:
        """What a record should say: lateness, losses, scheduling, identity; numbers, texts and tables of them."""
        ...


@runtime_checkable
class SeparateReceiver(Protocol):
    """A link whose readings are received by another process than the one that takes its batches."""

    @property
    def attended(self) -> int:
        """When that process last looked for readings [ns], on the clock of `Batch.received`."""
        ...


class Device(Part, ABC):
    """Settings of a device; `connect` gives the link for as long as it is needed, and cleans up after it."""

    kind: ClassVar[str] = "device"

    @property
    @abstractmethod
    def streams(self) -> tuple[Stream, ...]:
        """What the device sends."""

    @abstractmethod
    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """A link that lives as long as the context; `seed` is for devices that draw random numbers."""

    @property
    def live(self) -> bool:
        """Whether it sends in real time, so that it must not be kept waiting; a log or a fast simulation does not.

        The batches of a live link come at least every 0.1 s, empty ones where there is nothing to say.
        """
        return False

    @property
    def provenance(self) -> Mapping[str, str]:
        """What a record must say of this device to be redone: file and hash, serial number, firmware."""
        return {}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know before trusting this device, such as a log that is cut."""
        return ()

    @property
    def simulated(self) -> bool:
        """Whether its readings are those of a simulation, computed by the formulas of a model."""
        return isinstance(self, KnowsTruth)

    @property
    def duration(self) -> float | None:
        """How long a recorded log is [s], for progress bars; None where that is not known."""
        return None


def address(device: str, stream: Stream, channel: Channel) -> str:
    """How a pipeline names a channel: ``rig.wrench.z``, or ``log.fz`` where the stream has no name."""
    return ".".join(part for part in (device, stream.name, channel.name) if part)


@runtime_checkable
class KnowsTruth(Protocol):
    """A device that knows what an estimator should find."""

    @property
    def truth(self) -> Mapping[str, float]:
        """By parameter name [SI]."""
        ...

    @property
    def outlines(self) -> tuple[Floats, ...]:
        """Closed outlines (k, 2) [m] of what is hidden below the skin, for pictures."""
        ...


@runtime_checkable
class KnowsGravity(Protocol):
    """A device that knows which way is down in the frame of its poses."""

    @property
    def gravity(self) -> tuple[float, ...]:
        """Direction of gravity (3,)."""
        ...


@runtime_checkable
class Turnable(Protocol):
    """A device whose tool can be turned without a person."""

    def turned(self, down: tuple[float, ...]) -> Device:
        """This device with its tool turned so that gravity points along `down` in the sensor's frame."""
        ...


@runtime_checkable
class SupportsOwnMotion(Protocol):
    """An arm that also moves on its own, besides the commanded motion."""

    @property
    def own_motion(self) -> OwnMotion:
        """How far, fast and sudden."""
        ...


@runtime_checkable
class Observable(Protocol):
    """A device that can be listened to without disturbing what it is doing."""

    def observe(self, seed: int) -> AbstractContextManager[Link]:
        """A link that only listens."""
        ...


@dataclass(frozen=True)
class StopModes:
    """Which values in a robot's states mean that its own safety system stopped it."""

    channel: str  # of one of its streams
    emergency: tuple[int, ...]  # its values at an emergency stop
    safeguard: tuple[int, ...] = ()  # at a safeguard stop; empty: the robot has none, or does not report it


@runtime_checkable
class ReportsStops(Protocol):
    """A robot that a second connection can watch while a run moves it, and whose states report its own stops."""

    @property
    def stop_modes(self) -> StopModes | None:
        """How; None where this one cannot be watched."""
        ...


@runtime_checkable
class SupportsReach(Protocol):
    """A device that does not go everywhere."""

    def refuse(self, setpoint: Setpoint) -> None:
        """Raise ConfigurationError where this device must not go; nothing moves for it."""
        ...


def is_live(devices: Mapping[str, Device]) -> bool:
    """Whether any of the devices sends in real time."""
    return any(device.live for device in devices.values())


def truth_of(devices: Mapping[str, Device]) -> dict[str, float]:
    """What the simulated ones among devices know, by parameter name [SI]."""
    simulated = [device for device in devices.values() if isinstance(device, KnowsTruth)]
    return {name: value for device in simulated for name, value in device.truth.items()}


def ask_devices(devices: Mapping[str, Device], setpoint: Setpoint) -> None:
    """Let every device refuse setpoints before anything moves; raises ConfigurationError."""
    for device in devices.values():
        if isinstance(device, SupportsReach):
            device.refuse(setpoint)


def own_motions(devices: Mapping[str, Device]) -> dict[str, OwnMotion]:
    """What arms among devices do by themselves, by name."""
    return {name: device.own_motion for name, device in devices.items() if isinstance(device, SupportsOwnMotion)}
