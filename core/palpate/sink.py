"""Sinks: where raw batches, samples and estimates go while a run goes on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

from palpate.contact import Parameter
from palpate.device import Batch, Stream
from palpate.estimation import Estimates, Samples
from palpate.parts import Part


@dataclass(frozen=True)
class Run:
    """What a sink knows of the run that it writes down."""

    folder: Path
    streams: Mapping[str, tuple[Stream, ...]]  # by device
    tracks: Mapping[str, tuple[Parameter, ...]]  # parameters by track
    facts: Mapping[str, str]  # versions, seed, hashes: what it takes to redo the run
    documents: Mapping[str, str]  # files by name: the pipeline as given and as resolved


class Writer(Protocol):
    """An open sink."""

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings of one of a device's streams."""
        ...

    def samples(self, samples: Samples) -> None:
        """Aligned samples."""
        ...

    def estimates(self, track: str, estimates: Estimates) -> None:
        """What a track made of the latest samples."""
        ...


class Sink(Part, ABC):
    """Settings of a sink."""

    kind: ClassVar[str] = "sink"

    @abstractmethod
    def open(self, run: Run) -> AbstractContextManager[Writer]:
        """A writer that lives as long as the context; raises OutputError where it cannot write."""
