"""Readings of messages: a number for each reading, and a time-stamp."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from palpate import Floats, to_si

from palpate_records.messages.topics import Messages, Stamps

SECOND = 1_000_000_000  # [ns]
LATEST = 9e9  # [s]; a time beyond the year 2255 is invalid, and overflows 64 bits of nanoseconds
LARGEST = 1e100  # reading [SI] that an instrument gives; the square of a larger one may overflow: a choice
_UNITS = ("m", "m/s", "N", "s", "rad", "m/s^2", "Pa", "N*m", "rad/s", "rad/s^2")
_INDEX = re.compile(r"^(.*)\[(\d+)\]$")


@dataclass(frozen=True)
class FieldReading:
    """One number in a message."""

    path: str  # "wrench.force.z", "data"
    index: int | None = None  # of an element, if the field is an array
    select: str | None = None  # name of the joint or child frame that it belongs to, at any place in the message

    @classmethod
    def parse(cls, text: str, index: int | None = None, select: str | None = None) -> FieldReading:
        """Return the reading of a text such as ``data[5]``, or of a field and an index."""
        match = _INDEX.match(text)
        if index is None and match:
            return cls(match[1], int(match[2]), select)
        return cls(text, index, select)

    def __str__(self) -> str:
        return self.path if self.index is None else f"{self.path}[{self.index}]"


@dataclass(frozen=True)
class TopicTable:
    """Readings of a block of messages."""

    rows: Stamps  # (n,) of the messages in the block
    values: Floats  # (n, k) as recorded; NaN for a number that a message lacks
    stamps: Stamps | None  # (n,) [ns] in the messages; None for messages without one


class MessageDecoder(Protocol):
    """A decoder of the messages of one topic."""

    def fields(self, payload: bytes) -> Mapping[str, int | None]:
        """Return the paths of the numbers in one message, with the elements of an array; None for a single number."""
        ...

    def texts(self, payload: bytes) -> Mapping[str, str]:
        """Return the texts in one message by their paths, without names of frames and joints."""
        ...

    def names(self, payload: bytes) -> Collection[str]:
        """Return the joints or child frames of one message, which a reading can select."""
        ...

    def read(self, messages: Messages, readings: Sequence[FieldReading]) -> TopicTable:
        """Return the readings of a block, without messages that lack all selections; raises LogError."""
        ...


def sensible(values: Floats) -> Floats:
    """Return the values, with NaN for numbers that no instrument gives, and whose square may overflow."""
    magnitude = np.abs(values)
    if not magnitude.size or magnitude.max() < LARGEST:  # not so with NaN
        return values
    with np.errstate(invalid="ignore"):
        return np.where(magnitude < LARGEST, values, np.nan)


def nanoseconds(seconds: Floats) -> Stamps:
    """Return times (n,) [s] in whole nanoseconds; whole seconds are converted exactly, by themselves."""
    whole = np.floor(seconds)
    return whole.astype(np.int64) * SECOND + np.rint((seconds - whole) * SECOND).astype(np.int64)


@cache
def si_unit(unit: str) -> tuple[str, float]:
    """Return the SI unit of a unit's dimension, and the size of the unit in it; raises ValueError."""
    if unit == "1":
        return "1", 1.0
    for si in _UNITS:
        try:
            return si, to_si(f"1 {unit}", si)
        except ValueError:
            continue
    raise ValueError(f"{unit!r} is not one of length, speed, acceleration, force, torque, pressure, angle, time, or 1")
