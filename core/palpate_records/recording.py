"""Recordings: devices that are logs, which can be inspected before a pipeline maps their topics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Device, LogError

SWEEP_ANALYSIS = "sweep-analysis"  # template of a record along the skin, whose last table has the speed
ASSUMED = ("indenter.*", "model.*", "alignment.tip_mass", "alignment.tare", "alignment.*.delay")


@dataclass(frozen=True)
class FieldSurvey:
    """Statistics of one number of the messages of a topic over the record, in its recorded unit."""

    name: str
    low: float
    high: float
    std: float
    noise: float  # standard deviation of white noise on smooth movement
    odd: int = 0  # values that are not finite
    course: str = ""  # its course in a few characters


@dataclass(frozen=True)
class TopicSurvey:
    """Contents of one topic of a log."""

    name: str
    type: str
    encoding: str
    messages: int
    first: int  # [ns] log time
    last: int  # [ns]
    interval: tuple[float, float, float] | None = None  # [s] between messages: 1st percentile, median, 99th
    gaps: int = 0  # pauses of more than ten usual intervals
    longest: float = 0.0  # [s] the longest pause
    lateness: tuple[float, float] | None = None  # [s] log time minus stamp: median, 99th percentile
    fields: tuple[str, ...] = ()  # numbers that a mapping can name
    numbers: tuple[FieldSurvey, ...] = ()  # statistics of those
    note: str = ""  # on the reason for which it cannot be read, or on irregular stamps


@dataclass(frozen=True)
class Survey:
    """Contents of a log."""

    path: Path
    format: str
    topics: tuple[TopicSurvey, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Suggestion:
    """Tables of a pipeline that read a log, with the reasons for the roles of its numbers."""

    device: Mapping[str, Any]
    alignment: Mapping[str, Any]
    reasons: tuple[str, ...]
    doubts: tuple[str, ...] = ()  # guesses, with their alternatives
    blanks: tuple[str, ...] = ()  # facts in no file, which a person must fill in
    hints: tuple[str, ...] = ()  # other findings, such as a delay
    views: Mapping[str, Any] = field(default_factory=dict)  # by role: times [s], values as recorded, unit, sign
    template: str = "log-analysis"  # of tip, model and estimators
    sweep_speed: float | None = None  # [m/s] of the tip along the skin, NaN without a time; None of a point
    assumed: tuple[str, ...] = ASSUMED  # keys that nothing states
    guesses: Mapping[str, str] = field(default_factory=dict)  # by key of the device: the sentence on its guess
    rivals: Mapping[str, tuple[str, ...]] = field(
        default_factory=dict
    )  # by uncertain role: the columns that can have it
    has_time: bool = False  # in the log, so that a rate is of no use
    facts: tuple[tuple[int, str, str], ...] = ()  # line, name and value of what a log states of the experiment

    def rival_words(self, role: str) -> str:
        """Return a sentence on the columns that can have a role, among which a person must choose."""
        columns = self.rivals[role]
        if len(columns) == 1:
            return f"no name or unit states which column is the {role}; by its numbers it can be {columns[0]}"
        return f"the {role} can be {', '.join(columns)}"


@dataclass(frozen=True)
class LogAttachments:
    """Documents and facts in a log besides its messages: texts, never code."""

    documents: Mapping[str, str] = field(default_factory=dict)  # by name: the pipeline as run and as given
    facts: Mapping[str, str] = field(default_factory=dict)  # versions, seed, hashes


class SystemSurvey(Protocol):
    """A running system whose topics can be looked at as those of a log."""

    @property
    def name(self) -> str:
        """The name of the system in messages."""
        ...

    def survey(self) -> Survey:
        """Return a survey of the messages that are published during a while."""
        ...

    def suggest(self, choices: Mapping[str, str]) -> Suggestion:
        """Return a device that reads the published topics; raises LogError if no number can be force or position."""
        ...


@runtime_checkable
class SupportsSurvey(Protocol):
    """Ability of a type of device to look at a running system before a pipeline maps its topics."""

    @classmethod
    def system_at(cls, address: str) -> SystemSurvey | None:
        """Return the system at an address; None for an address of another kind. Raises ConfigurationError."""
        ...


class Recording(Device, ABC):
    """A log as a device; the class itself can open any log of its format."""

    @classmethod
    @abstractmethod
    def recognises(cls, path: Path) -> bool:
        """Return True if a file or folder looks like a log of this format."""

    @classmethod
    def is_last_resort(cls, path: Path) -> bool:
        """Return True for a recognised file that any other reader which recognises it reads better."""
        return False

    @classmethod
    @abstractmethod
    def survey(cls, path: Path) -> Survey:
        """Return the contents of a log; raises LogError if it cannot be read."""

    @classmethod
    @abstractmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """Return a suggestion with the roles of a log's numbers: force, position and velocity.

        `choices` states a role by ``topic`` or ``topic:field``. Raises LogError, with names, for a role without a
        candidate, or with several.
        """

    @classmethod
    def records(cls, path: Path, choices: Mapping[str, str]) -> tuple[str, ...]:
        """Return the names of the records of a log that holds several; none for a log that is one. Raises LogError."""
        return ()

    @classmethod
    def places(cls, path: Path) -> Mapping[str, tuple[float, float]]:
        """Return x and y [m] of the records of a log, by name, as far as it states them. Raises LogError."""
        return {}

    @classmethod
    @abstractmethod
    def tables(cls, path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """Yield every topic that contains numbers, in blocks: its name, the names of its columns, the recorded numbers.

        Sentences on the parts that are left out are added to the notes.
        """

    @classmethod
    def attached(cls, path: Path) -> LogAttachments:
        """Return the documents and facts in a log; none if the format, or this log, has none. Raises LogError."""
        return LogAttachments()

    @classmethod
    def playback(cls, path: Path, device: str) -> dict[str, Any]:
        """Return the table of a device that plays back the record of the device of that name in a log."""
        raise LogError(f"{path}: a log of this format cannot replace the devices of a pipeline")

    @classmethod
    def texts(cls, path: Path) -> Iterator[tuple[str, tuple[str, ...], NDArray[np.int64], list[tuple[str, ...]]]]:
        """Yield every topic that contains texts, in blocks: its name, names of the texts, stamps (n,) [ns], n rows."""
        return iter(())

    @classmethod
    def recover(cls, path: Path, out: Path, beside: Mapping[str, str] = {}) -> str:
        """Write the whole messages of a damaged log into a new one; return a sentence on these and on the loss.

        Documents of the run that the log has lost come from those `beside` it, by name.
        """
        raise LogError(f"{path}: logs of this format cannot be recovered")
