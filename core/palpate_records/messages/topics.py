"""The interface of a container of messages: its topics, and their messages in blocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class Topic:
    """One topic, with the description of its messages."""

    name: str
    type: str = ""
    encoding: str = "cdr"  # of the messages
    schema_encoding: str = "ros2msg"
    schema: bytes = b""
    metadata: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Messages:
    """Messages of one topic within one buffer."""

    buffer: Bytes
    starts: Stamps  # (n,) [bytes] of each payload in the buffer
    lengths: Stamps  # (n,) [bytes]
    logged: Stamps  # (n,) [ns] times of arrival at the recorder
    published: Stamps  # (n,) [ns]

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, rows: slice | NDArray[np.bool_] | Stamps) -> Messages:
        columns = (self.starts, self.lengths, self.logged, self.published)
        return Messages(self.buffer, *(column[rows] for column in columns))

    def payload(self, row: int) -> bytes:
        """Return one message as bytes."""
        start = int(self.starts[row])
        return self.buffer[start : start + int(self.lengths[row])].tobytes()

    @classmethod
    def joined(cls, payloads: Sequence[bytes], logged: Stamps, published: Stamps) -> Messages:
        """Return single messages as a block."""
        lengths = np.fromiter(map(len, payloads), np.int64, len(payloads))
        starts = np.cumsum(lengths) - lengths
        return cls(np.frombuffer(b"".join(payloads), np.uint8), starts, lengths, logged, published)


class Container(Protocol):
    """An open log."""

    @property
    def topics(self) -> Mapping[str, Topic]:
        """Its topics by name."""
        ...

    @property
    def trouble(self) -> str | None:
        """A sentence on damage to the file as a whole, such as a missing end; None without any."""
        ...

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns]; None without messages."""
        ...

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Yield messages of the requested topics in the order of the file, within [begin, end) of log time [ns]."""
        ...


def gather(buffer: Bytes, starts: Stamps, width: int) -> Bytes:
    """Return the bytes (n, width) from each start on; every start must leave room for them."""
    if not len(starts):
        return np.zeros((0, width), np.uint8)
    # A view of overlapping records: indexing it copies one record for each start, without a loop.
    records = np.ndarray((len(buffer) - width + 1,), f"V{width}", buffer, strides=(1,))
    return records[starts].view(np.uint8).reshape(len(starts), width)


def column(block: Bytes, offset: int, code: str) -> NDArray[Any]:
    """Return a column (n,) of a block of records (n, width), as a view, by numpy's code."""
    if not len(block):  # numpy makes no view of an empty array
        return np.zeros(0, code)
    return np.ndarray((len(block),), code, block, offset, (block.shape[1],))
