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
from palpate.trajectory import OwnMotion, Setpoint, Trajectory


@dataclass(frozen=True)
class Channel:
    """One column of a stream: what it says, in which unit, and how far it can be believed."""

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


@dataclass(frozen=True)
class Batch:
    """Readings of one stream as they arrived; an invalid reading is NaN."""

    stream: str
    time: NDArray[np.int64]  # (n,) [ns] time-stamps of the stream's clock
    received: NDArray[np.int64]  # (n,) [ns] when the host got them
    values: NDArray[np.float64]  # (n, channels) [SI]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n,) True where every channel is a finite number."""
        return np.asarray(np.isfinite(self.values).all(axis=1))


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
class Approaching(Protocol):
    """An arm that goes by itself from where it stands to the first setpoint."""

    def way(self, trajectory: Trajectory) -> tuple[NDArray[np.float64], Setpoint]:
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
class Watched(Protocol):
    """A link that keeps account of its own health."""

    @property
    def health(self) -> Mapping[str, Any]:
        """What a record should say: lateness, losses, scheduling, identity; numbers, texts and tables of them."""
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
        """A link that lives as long as the context; `seed` is for devices that play dice."""

    @property
    def live(self) -> bool:
        """Whether it sends as time goes by, so that nobody may make it wait; a log or a fast simulation does not.

        The batches of a live link come at least every 0.1 s, empty ones where there is nothing to say.
        """
        return False

    @property
    def truth(self) -> Mapping[str, float]:
        """What a simulated device knows and an estimator should find, by parameter name [SI]; else empty."""
        return {}

    @property
    def outlines(self) -> tuple[NDArray[np.float64], ...]:
        """Closed outlines (k, 2) [m] of what a simulated device hides below the skin, for pictures; else none."""
        return ()

    def refuse(self, setpoint: Setpoint) -> None:
        """Raise ConfigurationError where this device must not go; nothing moves for it. By default it goes anywhere."""

    def turned(self, down: tuple[float, ...]) -> Device | None:
        """This device with the tool turned so that gravity points along `down` in the sensor's frame.

        None where a person has to turn it.
        """
        return None

    @property
    def own_motion(self) -> OwnMotion | None:
        """What it does by itself besides the motion that it is told; None where it does nothing."""
        return None

    @property
    def provenance(self) -> Mapping[str, str]:
        """What a record must say of this device to be redone: file and hash, serial number, firmware."""
        return {}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know before trusting this device, such as a log that is cut."""
        return ()

    @property
    def duration(self) -> float | None:
        """How long a recorded log is [s], for progress bars; None where that is not known."""
        return None


def address(device: str, stream: Stream, channel: Channel) -> str:
    """How a pipeline names a channel: ``rig.wrench.z``, or ``log.fz`` where the stream has no name."""
    return ".".join(part for part in (device, stream.name, channel.name) if part)
