"""What is read from a message: one number for each reading, and a time-stamp."""

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
LATEST = 9e9  # [s]; a time beyond the year 2255 is invalid, and does not fit into nanoseconds
LARGEST = 1e100  # of a reading in SI
_UNITS = ("m", "m/s", "N", "s", "rad", "m/s^2", "Pa", "N*m", "rad/s", "rad/s^2")
_INDEX = re.compile(r"^(.*)\[(\d+)\]$")


@dataclass(frozen=True)
class FieldReading:
    """One number in a message."""

    path: str  # "wrench.force.z", "data"
    index: int | None = None  # of an element, where the field is an array
    select: str | None = None  # the joint or child frame that it is a number of, wherever that stands in the message

    @classmethod
    def parse(cls, text: str, index: int | None = None, select: str | None = None) -> FieldReading:
        """From ``data[5]``, or from a field and an index."""
        match = _INDEX.match(text)
        if index is None and match:
            return cls(match[1], int(match[2]), select)
        return cls(text, index, select)

    def __str__(self) -> str:
        return self.path if self.index is None else f"{self.path}[{self.index}]"


@dataclass(frozen=True)
class TopicTable:
    """Readings of a block of messages."""

    rows: Stamps  # which messages (n,)
    values: Floats  # (n, k) as recorded; NaN where a message lacks a number
    stamps: Stamps | None  # (n,) [ns] from the messages themselves; None where they carry none


class MessageDecoder(Protocol):
    """Reads the messages of one topic."""

    def fields(self, payload: bytes) -> Mapping[str, int | None]:
        """Paths of the numbers in one message, with the number of elements where one is an array."""
        ...

    def texts(self, payload: bytes) -> Mapping[str, str]:
        """Texts in one message by their paths, but for frames and the names of joints."""
        ...

    def names(self, payload: bytes) -> Collection[str]:
        """Return the joints or child frames of one message, which a reading can select."""
        ...

    def read(self, messages: Messages, readings: Sequence[FieldReading]) -> TopicTable:
        """Return the readings of a block, without the messages that have nothing of what is selected; raises
        LogError."""
        ...


def sensible(values: Floats) -> Floats:
    """Return the values, with NaN for numbers that no instrument gives, and whose square overflows."""
    size = np.abs(values)
    if not size.size or size.max() < LARGEST:  # NaN compares as False
        return values
    with np.errstate(invalid="ignore"):
        return np.where(size < LARGEST, values, np.nan)


def nanoseconds(seconds: Floats) -> Stamps:
    """Whole nanoseconds; whole seconds apart, since the product of both would lose a few hundred of them."""
    whole = np.floor(seconds)
    return whole.astype(np.int64) * SECOND + np.rint((seconds - whole) * SECOND).astype(np.int64)


@cache
@cache
def si_unit(unit: str) -> tuple[str, float]:
    """Return the SI unit of a unit's dimension, and how much of it one of the unit is; raises ValueError."""
    if unit == "1":
        return "1", 1.0
    for si in _UNITS:
        try:
            return si, to_si(f"1 {unit}", si)
        except ValueError:
            continue
    raise ValueError(f"{unit!r} is not one of length, speed, acceleration, force, torque, pressure, angle, time, or 1")
