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

_BLOCK = 4096  # readings in one batch


@dataclass(frozen=True, eq=False)
class NamedColumns:
    """Readings that share their instants; named by what they hold."""

    time: NDArray[np.int64]  # (n,) [ns]
    values: Floats  # (n, k) [SI]
    channels: tuple[tuple[str, str], ...]  # name and SI unit of each

    @property
    def digest(self) -> str:
        """SHA-256 of all that is in it."""
        found = hashlib.sha256(repr(self.channels).encode())
        found.update(np.ascontiguousarray(self.time, "<i8").tobytes())
        found.update(np.ascontiguousarray(self.values, "<f8").tobytes())
        return found.hexdigest()


# By digest, for as long as the record is in use: a pipeline names its readings by what is in them.
_HELD: WeakValueDictionary[str, NamedColumns] = WeakValueDictionary()


def register_readings(columns: NamedColumns) -> tuple[str, NamedColumns]:
    """Make readings known to this process; answers their digest, and those of the same contents that are to be kept."""
    digest = columns.digest
    return digest, _HELD.setdefault(digest, columns)


class MemoryRecord(Device):
    """Readings in the memory of this process, as `palpate.record` makes them from arrays; no other process has them."""

    sha256: str = Field(min_length=64, max_length=64, description="SHA-256 of the readings")

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One stream without a name: channels are addressed as ``device.channel``."""
        channels = tuple(Channel(name, unit) for name, unit in self._columns.channels)
        return (Stream("", channels, None, clock="record"),)

    @property
    def duration(self) -> float | None:
        """From the first reading to the last [s]."""
        time = self._columns.time
        return float(time[-1] - time[0]) * 1e-9

    @property
    def provenance(self) -> Mapping[str, str]:
        """The SHA-256 of the readings."""
        return {"sha256": self.sha256}

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """The readings."""
        yield _MemoryLink(self._columns)

    @property
    def _columns(self) -> NamedColumns:
        found = _HELD.get(self.sha256)
        if found is None:
            raise LogError(
                f"the record {self.sha256[:12]}... is not in the memory of this process: make it with palpate.record "
                "and keep it while it is used"
            )
        return found


@dataclass(frozen=True)
class _MemoryLink:
    columns: NamedColumns

    def batches(self) -> Iterator[Batch]:
        """Yield the readings in their order, some thousand at a time."""
        for begin in range(0, len(self.columns.time), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            stamps = self.columns.time[rows]
            yield Batch("", stamps, stamps, self.columns.values[rows])
