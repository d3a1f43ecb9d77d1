"""Recordings: devices that are logs, which can be looked into before a pipeline says what their topics mean."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.device import Batch, Device
from palpate.errors import LogError


@dataclass(frozen=True)
class TopicSurvey:
    """What one topic of a log holds."""

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
    note: str = ""  # why it cannot be read, or what is odd about it


@dataclass(frozen=True)
class Survey:
    """What a log holds."""

    path: Path
    format: str
    topics: tuple[TopicSurvey, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Suggestion:
    """Tables of a pipeline that read a log: which topic serves as what, and why."""

    device: Mapping[str, Any]
    alignment: Mapping[str, Any]
    reasons: tuple[str, ...]


class Recording(Device, ABC):
    """A log as a device; the class itself can open any log of its format."""

    @classmethod
    @abstractmethod
    def recognises(cls, path: Path) -> bool:
        """Whether a file or folder looks like a log of this format."""

    @classmethod
    @abstractmethod
    def survey(cls, path: Path) -> Survey:
        """What a log holds; raises LogError where it cannot be read."""

    @classmethod
    @abstractmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """Which of a log's numbers are force, position and velocity.

        `choices` settles a role by ``topic`` or ``topic:field``. Raises LogError where a role has no candidate, or
        several: with their names.
        """

    @classmethod
    @abstractmethod
    def tables(cls, path: Path) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """Every topic that holds numbers, in blocks: its name, the names of its columns, the numbers as recorded."""

    @classmethod
    def recover(cls, path: Path, out: Path) -> str:
        """Write what is whole of a damaged log into a new one; what was saved and what is missing, in words."""
        raise LogError(f"{path}: there is nothing that recovers logs of this format")
