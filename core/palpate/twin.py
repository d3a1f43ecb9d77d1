"""Twins: devices in software that stand in for the real ones."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

from palpate.device import Device
from palpate.errors import ConfigurationError
from palpate.parts import Part


@dataclass(frozen=True)
class ArmTruth:
    """The true motion of a twin's arm, and the force under it; none of it comes from the sensors' reports."""

    low: tuple[float, ...]  # (3,) [m] corner of the box, in the work frame, that the tip was in
    high: tuple[float, ...]  # (3,) [m] the opposite corner
    speed: float  # [m/s] fastest tip
    acceleration: float  # [m/s^2] largest of the tip, mean over 20 ms
    turning: float  # [rad/s] fastest turn of the tool
    joint_speed: float  # [rad/s] fastest joint
    force: float  # [N] largest on the skin
    moving: bool  # True: a joint still moves


@dataclass(frozen=True)
class HoldUp:
    """A process that is kept waiting for a `duration` [s], `first` at a time [s], then `every` [s], if at all.

    The name "robot" stands for "robot 1", "robot 2" and so on, too.
    """

    process: str
    duration: float
    first: float = 0.0
    every: float | None = None

    def until(self, now: int) -> int:
        """Return the time [ns after the start] at which a thread that is due `now` may run."""
        begin, length = round(self.first * 1e9), round(self.duration * 1e9)
        if now < begin:
            return now
        if self.every is not None:
            begin += (now - begin) // round(self.every * 1e9) * round(self.every * 1e9)
        return max(now, begin + length) if now < begin + length else now


@runtime_checkable
class SupportsTwin(Protocol):
    """A device that names the twin that stands in for it."""

    @property
    def twin_settings(self) -> Mapping[str, str]:
        """The keys of the twin's table, in TOML; among them the device's role: the twin's robot or sensor."""
        ...


class SimulatedTwin(Protocol):
    """A twin at work in simulated time."""

    @property
    def faults(self) -> Mapping[str, str]:
        """The faults that it can simulate, each with its effect; words in capitals stand for numbers."""
        ...

    def fault(self, words: str) -> None:
        """Make a fault now; raises ConfigurationError for an unknown fault or wrong numbers."""

    @property
    def truth(self) -> ArmTruth:
        """The motion of its arm so far."""
        ...


class Twin(Part, ABC):
    """Settings of a twin; it stands in the pipeline file of the rig that it replaces, which does not look at it."""

    kind: ClassVar[str] = "twin"
    absent_stops: ClassVar[tuple[str, ...]] = ()  # fields of `StopModes`, such as "reflex", that `serve` does not have

    @abstractmethod
    def serve(self, seed: int, ready: Callable[[Mapping[str, str]], None]) -> None:
        """Serve in this process until SIGTERM, Ctrl-C or the end of the standard input.

        `ready` is called once the twin can be reached, with its addresses by name. Raises
        DeviceError where an address cannot be had.
        """

    @classmethod
    def stand_in(cls, devices: Mapping[str, Device], tip_mass: float | None) -> Mapping[str, str] | None:
        """Return settings, in TOML, of a twin for the devices of a rig, all but its specimen; None for others' devices.

        `tip_mass` [kg] is that of everything behind the sensor, where it is known.
        """
        return None

    def replaces(self, device: Device) -> bool:
        """Return True if the settings of a device lead to this twin while it is served."""
        return False

    def simulated(self, seed: int, hold_ups: Sequence[HoldUp] = ()) -> AbstractContextManager[SimulatedTwin]:
        """Return a context of simulated time, in which the devices of the rig reach the twin without ports.

        Raises ConfigurationError where the twin cannot be simulated.
        """
        raise ConfigurationError(f"{type(self).__name__}: this twin has no simulated time; `palpate twin` serves it")
