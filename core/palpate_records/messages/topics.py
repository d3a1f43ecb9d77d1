"""What a container gives: its topics, and their messages in blocks."""

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
    """One topic, and how its messages are to be read."""

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
    starts: Stamps  # (n,) where each payload begins
    lengths: Stamps  # (n,) [bytes]
    logged: Stamps  # (n,) [ns] when the recorder got them
    published: Stamps  # (n,) [ns]

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, rows: slice | NDArray[np.bool_] | Stamps) -> Messages:
        columns = (self.starts, self.lengths, self.logged, self.published)
        return Messages(self.buffer, *(column[rows] for column in columns))

    def payload(self, row: int) -> bytes:
        """One message as bytes."""
        start = int(self.starts[row])
        return self.buffer[start : start + int(self.lengths[row])].tobytes()

    @classmethod
    def joined(cls, payloads: Sequence[bytes], logged: Stamps, published: Stamps) -> Messages:
        """Messages that come one by one."""
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
        """What is wrong with the file as a whole, such as a missing end; None where nothing is."""
        ...

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns]; None where no message is."""
        ...

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Messages of the requested topics in the order of the file, within [begin, end) of log time [ns]."""
        ...


def gather(buffer: Bytes, starts: Stamps, width: int) -> Bytes:
    """(n, width) the bytes from each start on; every start must leave room for them."""
    if not len(starts):
        return np.zeros((0, width), np.uint8)
    # A view of overlapping records: indexing it copies one record for each start, without a loop.
    records = np.ndarray((len(buffer) - width + 1,), f"V{width}", buffer, strides=(1,))
    return records[starts].view(np.uint8).reshape(len(starts), width)


def column(block: Bytes, offset: int, code: str) -> NDArray[Any]:
    """One column of a block of records (n, width), as a view."""
    if not len(block):  # numpy makes no view of nothing
        return np.zeros(0, code)
    return np.ndarray((len(block),), code, block, offset, (block.shape[1],))
