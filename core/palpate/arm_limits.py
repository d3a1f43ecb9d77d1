"""Limits that an arm monitors itself, in the process that commands it: those of its motion, and the force."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from palpate.repeated_readings import Repeats
from palpate.sound_force import SoundForce
from palpate.vectors import Floats

RETREAT = 0.5e-3  # [m], a choice: distance of the retreat before a motion
RETREAT_SPEED = 2e-3  # [m/s], a choice: of that retreat
NO_DEPTH = 1e3  # [m], a choice: so deep that the box alone counts
NO_AGE = 1e3  # [s], a choice: so old that no reading or state is too old


@dataclass(frozen=True)
class ArmLimits:
    """Limits of every command of an arm, of any origin; positions in the work frame."""

    low: tuple[float, ...]  # (3,) [m]
    high: tuple[float, ...]  # (3,) [m]
    speed: float  # [m/s]
    acceleration: float  # [m/s^2]
    orientation: float  # [rad] between the tool and the normal of the work frame or of a station, at most
    angular_speed: float  # [rad/s]
    depth: float = NO_DEPTH  # [m] below the plane of a station, at most
    reading_age: float = NO_AGE  # [s] of its own states; see `ReadingAge`
    retract_speed: float = 0.0  # [m/s] outwards along the normal in a retraction; up to `speed`: as all else


@dataclass(frozen=True)
class SharedReadings:
    """Readings of a stream in shared memory, where another process reads them directly.

    The memory begins with `head` 64-bit whole numbers, the first of which counts the rows that were written; then
    come `rows` rows of `columns` 64-bit floats, row n in place n modulo `rows`. The stream's channels begin at column
    `first`; an invalid reading is NaN. Two columns hold whole numbers in place of floats: when a row arrived [ns], and
    the stamp of the device's clock, which counts in `tick`; without such a clock `tick` is 0.
    """

    descriptor: int
    head: int
    rows: int
    columns: int
    first: int
    arrival: int = 0
    stamp: int = 1
    tick: int = 0  # [ns]


@dataclass(frozen=True)
class ForceWatch:
    """The force at which an arm stops on its own, and the conditions under which its readings are believed."""

    readings: SharedReadings
    channels: tuple[int, ...]  # of the stream
    tare: tuple[float, ...]  # [N] of each
    stop: float  # [N]
    name: str
    normal: int = 0  # which of the channels is the force along the normal
    sign: float = 1.0  # of that channel, where the tip is pushed out
    ranges: tuple[tuple[float, float], ...] = ()  # [N] of each channel; readings at an end are invalid
    repeats: Repeats | None = None  # of a sound sensor; None: equal readings do not count
    torques: tuple[int, ...] = ()  # channels of the stream
    torque_tare: tuple[float, ...] = ()  # [N m] of each
    torque: float = math.inf  # [N m] at which it stops
    reading_age: float = NO_AGE  # [s]; see `ReadingAge`
    sound: SoundForce | None = None  # at standstill; None: whether the force rises on the way in does not count


def torque_fault(torques: Floats, tare: Floats, most: float) -> str | None:
    """Return why torques (n, axes) [N m] stop a motion: over `most` from their tare (axes,), or invalid; else None."""
    largest = float(np.abs(torques - tare).max(initial=0.0))
    if largest <= most:
        return None
    if not math.isfinite(largest):
        return "a reading of the torque is over range or invalid"
    return f"the torque is {largest:.2f} N*m, over the limit of {most:g} N*m that stops the motion ([safety] torque)"


@runtime_checkable
class SupportsLimits(Protocol):
    """An arm that checks its commands against limits itself, and stops itself at a force."""

    def limit(self, limits: ArmLimits, trip: Callable[[str], None]) -> None:
        """Keep these limits from now on; `trip` is called with the reason of a stop."""
        ...

    def watch_force(self, watch: ForceWatch) -> None:
        """Stop without the host where a channel is more than `stop` off its tare, or not credible."""
        ...


@runtime_checkable
class SupportsRetreat(Protocol):
    """An arm that can feel whether it touches: by a retreat, never by an advance."""

    def retreat(self, way: float, speed: float) -> float:
        """Go outwards along the normal by at most `way` [m] at `speed` [m/s] and hold; return the duration [s]."""
        ...


@runtime_checkable
class SupportsSharing(Protocol):
    """A link whose readings another process can look at."""

    def shared(self, stream: str) -> SharedReadings | None:
        """Return the shared memory of a stream's readings; None where they are not shared."""
        ...


@runtime_checkable
class Shareable(Protocol):
    """A device whose links share some of their streams."""

    @property
    def shared_streams(self) -> tuple[str, ...]:
        """The names of these streams."""
        ...
