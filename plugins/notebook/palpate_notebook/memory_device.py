"""A record in memory as a device: the same path from readings to estimates as for a log."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Channel, Device, Floats, Link, LogError, Stream
from pydantic import Field

_BATCH_SIZE = 4096  # readings in one batch: a choice
_NANOSECOND = 1e-9  # [s]


@dataclass(frozen=True, eq=False)
class NamedColumns:
    """Readings that share their time-stamps, identified by a digest of their contents."""

    time: NDArray[np.int64]  # (n,) [ns]
    values: Floats  # (n, k) [SI]
    channels: tuple[tuple[str, str], ...]  # name and SI unit of each

    @property
    def digest(self) -> str:
        """The SHA-256 of channels, time-stamps and values."""
        digest = hashlib.sha256(repr(self.channels).encode())
        digest.update(np.ascontiguousarray(self.time, "<i8").tobytes())
        digest.update(np.ascontiguousarray(self.values, "<f8").tobytes())
        return digest.hexdigest()


# By digest, for as long as a record refers to them: a pipeline names its readings by their digest.
_REGISTERED: WeakValueDictionary[str, NamedColumns] = WeakValueDictionary()


def register_readings(columns: NamedColumns) -> tuple[str, NamedColumns]:
    """Register readings in this process; return their digest, and the registered readings of the same contents.

    Readings stay registered as long as the caller keeps the returned ones.
    """
    digest = columns.digest
    return digest, _REGISTERED.setdefault(digest, columns)


class MemoryRecord(Device):
    """Readings in the memory of this process, as `palpate.record` makes them from arrays; no other process has them."""

    sha256: str = Field(min_length=64, max_length=64, description="SHA-256 of the readings")

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The stream, without a name: channels are addressed as ``device.channel``."""
        channels = tuple(Channel(name, unit) for name, unit in self._columns.channels)
        return (Stream("", channels, None, clock="record"),)

    @property
    def duration(self) -> float | None:
        """The time from the first reading to the last [s]."""
        time = self._columns.time
        return float(time[-1] - time[0]) * _NANOSECOND

    @property
    def provenance(self) -> Mapping[str, str]:
        """The SHA-256 of the readings."""
        return {"sha256": self.sha256}

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """Yield a link to the readings."""
        yield _MemoryLink(self._columns)

    @property
    def _columns(self) -> NamedColumns:
        """The registered readings; raises LogError where they are not in memory."""
        columns = _REGISTERED.get(self.sha256)
        if columns is None:
            raise LogError(
                f"the record {self.sha256[:12]}... is not in the memory of this process: make it with palpate.record "
                "and keep it while it is used"
            )
        return columns


@dataclass(frozen=True)
class _MemoryLink:
    """Link to readings in memory."""

    columns: NamedColumns

    def batches(self) -> Iterator[Batch]:
        """Yield the readings in their order, in batches."""
        for first in range(0, len(self.columns.time), _BATCH_SIZE):
            rows = slice(first, first + _BATCH_SIZE)
            stamps = self.columns.time[rows]
            yield Batch("", stamps, stamps, self.columns.values[rows])
