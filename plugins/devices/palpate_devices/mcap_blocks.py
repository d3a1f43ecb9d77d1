"""Messages of one size into a log that is being written, many at a time."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MESSAGE, _INDEX = 0x05, 0x07
_HEAD = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("logged", "<u8"), ("sent", "<u8")]
)
_BEFORE = 9  # bytes of a record that its length does not count
_PRIVATE = ("chunk_builder", "chunk_size", "statistics", "maybe_finalize_chunk")

Times = NDArray[np.int64]  # [ns]


class _BlockIndex:
    """Where the messages of a channel lie in a chunk; to the library's writer, one of its records."""

    def __init__(self, channel: int) -> None:
        self._channel = channel
        self._entries: list[NDArray[np.uint64]] = []

    def add(self, logged: Times, offsets: NDArray[np.int64]) -> None:
        self._entries.append(np.column_stack([logged, offsets]).astype("<u8"))

    def write(self, stream: Any) -> None:
        """Append it to a record builder."""
        entries = b"".join(part.tobytes() for part in self._entries)
        stream.write(struct.pack("<BQHI", _INDEX, 6 + len(entries), self._channel, len(entries)) + entries)


def add_messages(writer: Any, channel: int, logged: Times, sent: Times, messages: NDArray[np.uint8]) -> None:
    """Add messages (n, size) to a channel of the library's writer: the bytes that `add_message` gives, only faster.

    A channel is written to in this way or in the other, not in both. The library has no such call; where a version of
    it names its parts otherwise, messages are added one by one.
    """
    if not all(hasattr(writer, f"_Writer__{name}") for name in _PRIVATE) or writer._Writer__chunk_builder is None:
        for log_time, publish_time, data in zip(logged.tolist(), sent.tolist(), messages, strict=True):
            writer.add_message(channel, log_time=log_time, data=data.tobytes(), publish_time=publish_time)
        return
    records = _records(channel, logged, sent, messages)
    chunk, most = writer._Writer__chunk_builder, writer._Writer__chunk_size
    size, done = records.shape[1], 0
    while done < len(records):
        room = max((most - chunk.count) // size + 1, 1)  # a chunk ends with the message that makes it longer than that
        part = slice(done, done := min(done + room, len(records)))
        index = chunk.message_indices.setdefault(channel, _BlockIndex(channel))
        index.add(logged[part], chunk.count + size * np.arange(part.stop - part.start))
        chunk.record_writer.write(records[part].tobytes())
        _count(writer._Writer__statistics, chunk, channel, logged[part])
        writer._Writer__maybe_finalize_chunk()


def _records(channel: int, logged: Times, sent: Times, messages: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Whole records (n, size)."""
    count, size = messages.shape
    heads = np.zeros(count, _HEAD)
    heads["opcode"], heads["length"], heads["channel"] = _MESSAGE, _HEAD.itemsize - _BEFORE + size, channel
    heads["logged"], heads["sent"] = logged, sent
    return np.concatenate([heads.view(np.uint8).reshape(count, _HEAD.itemsize), messages], axis=1)


def _count(statistics: Any, chunk: Any, channel: int, logged: Times) -> None:
    """What the library's writer notes of every message."""
    first, last = int(logged.min()), int(logged.max())
    chunk.message_start_time = min(first, chunk.message_start_time) if chunk.num_messages else first
    chunk.message_end_time = max(last, chunk.message_end_time)
    fresh = statistics.message_count == 0
    statistics.message_start_time = first if fresh else min(first, statistics.message_start_time)
    statistics.message_end_time = max(last, statistics.message_end_time)
    chunk.num_messages += len(logged)
    statistics.channel_message_counts[channel] += len(logged)
    statistics.message_count += len(logged)
