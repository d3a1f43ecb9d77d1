"""Sinks: destinations of raw batches, samples and estimates while a run goes on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

from palpate.contact import Parameter
from palpate.device import Batch, Stream
from palpate.estimation import Estimates, Samples
from palpate.flags import Flag
from palpate.parts import Part
from palpate.surface import Surface

Extent = tuple[tuple[float, ...], tuple[float, ...]]  # lowest and highest x, y, z


def _never(reason: str) -> None:
    """Do nothing: no run can be stopped."""


@dataclass(frozen=True)
class Run:
    """Facts of the run that a sink writes down, and the function that ends it."""

    folder: Path
    streams: Mapping[str, tuple[Stream, ...]]  # by device
    tracks: Mapping[str, tuple[Parameter, ...]]  # parameters by track
    facts: Mapping[str, str]  # versions, seed, hashes: all that is needed to redo the run
    documents: Mapping[str, str]  # files by name: the pipeline as run and as given
    name: str = ""
    duration: float | None = None  # [s] as planned, of the record; None where unknown
    extent: Extent | None = None  # [m] box of the planned motion; None where nothing moves
    surface: Surface | None = None  # along whose normals force and height are; None where they are along one axis
    # Ends the run with a reason, from any thread, at once: the guard lets the arm retract. It is not an emergency stop.
    stop: Callable[[str], None] = _never


class Writer(Protocol):
    """An open sink."""

    def batch(self, device: str, batch: Batch) -> None:
        """Take raw readings of one of a device's streams."""
        ...

    def samples(self, samples: Samples) -> None:
        """Take aligned samples."""
        ...

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Take the estimates of a track for the latest samples."""
        ...


class EstimatesWriter(Protocol):
    """An open table of estimates."""

    def write(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """Take the estimates of some samples, by track; those of offline tracks come once, for the whole record."""
        ...


@runtime_checkable
class TakesHealth(Protocol):
    """A writer that is informed of the health of a live run."""

    def health(self, health: Mapping[str, Any]) -> None:
        """Take the health of a run: time of the record and backlog [s], streams, devices, tare, and the results so far.

        Called once a second; once for each second of the record if `by_record` is true. `tracks` has for each track the
        result that it would have if the run ended now.
        """
        ...


@runtime_checkable
class TakesFlags(Protocol):
    """A writer that is informed of flags when they are raised and when they are cleared."""

    def flags(self, track: str | None, flags: tuple[Flag, ...]) -> None:
        """Take all flags of a track, or of the record as a whole, whenever they have changed."""
        ...


@dataclass(frozen=True)
class GuardState:
    """The state of a live run's guard."""

    phase: Literal["standstill", "motion", "tripped", "over"]
    reason: str | None = None  # of a trip
    peak_force: float = 0.0  # [N] largest tared reading until now
    calls_for_stop: bool = False  # a person has to press the emergency stop; `reason` says why


@runtime_checkable
class TakesGuard(Protocol):
    """A writer that is informed of the guard's state."""

    def guard(self, state: GuardState) -> None:
        """Take the guard's state, whenever it has changed."""
        ...


@runtime_checkable
class TakesResult(Protocol):
    """A writer that takes the result."""

    def result(self, table: Mapping[str, Any]) -> None:
        """Take the contents of ``result.json``; nothing comes after it."""
        ...


class Sink(Part, ABC):
    """Settings of a sink."""

    kind: ClassVar[str] = "sink"

    @abstractmethod
    def open(self, run: Run) -> AbstractContextManager[Writer]:
        """Return a writer that lives as long as the context; raises OutputError where it cannot write.

        Threads and processes of a sink are started here: what a run starts later, while a robot moves, inherits the
        real-time scheduling of the thread that starts it.
        """
