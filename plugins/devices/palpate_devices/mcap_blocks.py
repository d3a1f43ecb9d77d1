"""Messages of one size into a log that is being written, many at a time."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

# By the specification of MCAP: opcodes, and the layout of a record in front of a message's data.
_MESSAGE, _INDEX = 0x05, 0x07
_HEAD = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("logged", "<u8"), ("sent", "<u8")]
)
_UNCOUNTED = 9  # bytes of a record that its length does not count: opcode and length
_INDEX_FIELDS = 6  # bytes of a message index besides its entries: channel, and the size of the entries
_PRIVATE = ("chunk_builder", "chunk_size", "statistics", "maybe_finalize_chunk")  # attributes of the library's writer

Times = NDArray[np.int64]  # [ns]


class _BlockIndex:
    """Offsets of the messages of a channel in a chunk; to the library's writer, one of its records."""

    def __init__(self, channel: int) -> None:
        self._channel = channel
        self._entries: list[NDArray[np.uint64]] = []

    def add(self, logged: Times, offsets: NDArray[np.int64]) -> None:
        """Append messages by their times (n,) and offsets (n,) [bytes] in the chunk."""
        self._entries.append(np.column_stack([logged, offsets]).astype("<u8"))

    def write(self, stream: Any) -> None:
        """Append it to a record builder."""
        entries = b"".join(part.tobytes() for part in self._entries)
        stream.write(struct.pack("<BQHI", _INDEX, _INDEX_FIELDS + len(entries), self._channel, len(entries)) + entries)


def add_messages(writer: Any, channel: int, logged: Times, sent: Times, messages: NDArray[np.uint8]) -> None:
    """Add messages (n, size) to a channel of the library's writer: the bytes that `add_message` gives, only faster.

    Messages have times of logging and of sending (n,) [ns]. A channel is written to in this way or in the other, not in
    both. The library has no such call; where a version of it names its parts otherwise, messages are added one by one.
    """
    if not all(hasattr(writer, f"_Writer__{name}") for name in _PRIVATE) or writer._Writer__chunk_builder is None:
        # Of another version: one message after the other.
        for log_time, publish_time, data in zip(logged.tolist(), sent.tolist(), messages, strict=True):
            writer.add_message(channel, log_time=log_time, data=data.tobytes(), publish_time=publish_time)
        return
    records = _records(channel, logged, sent, messages)
    chunk, chunk_size = writer._Writer__chunk_builder, writer._Writer__chunk_size
    count, size = records.shape
    begin = 0
    while begin < count:
        # As many as fit: a chunk ends with the message that makes it longer than its size.
        room = max((chunk_size - chunk.count) // size + 1, 1)
        end = min(begin + room, count)
        part = slice(begin, end)
        begin = end
        # Their index, their bytes, and what the library counts.
        index = chunk.message_indices.setdefault(channel, _BlockIndex(channel))
        index.add(logged[part], chunk.count + size * np.arange(part.stop - part.start))
        chunk.record_writer.write(records[part].tobytes())
        _count(writer._Writer__statistics, chunk, channel, logged[part])
        writer._Writer__maybe_finalize_chunk()


def _records(channel: int, logged: Times, sent: Times, messages: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return whole records (n, size): the head of each, and its message."""
    count, size = messages.shape
    heads = np.zeros(count, _HEAD)
    heads["opcode"] = _MESSAGE
    heads["length"] = _HEAD.itemsize - _UNCOUNTED + size
    heads["channel"] = channel
    heads["logged"] = logged
    heads["sent"] = sent
    return np.concatenate([heads.view(np.uint8).reshape(count, _HEAD.itemsize), messages], axis=1)


def _count(statistics: Any, chunk: Any, channel: int, logged: Times) -> None:
    """Update the statistics of log and chunk as the library's writer does for every message."""
    first, last = int(logged.min()), int(logged.max())
    chunk.message_start_time = min(first, chunk.message_start_time) if chunk.num_messages else first
    chunk.message_end_time = max(last, chunk.message_end_time)
    is_first = statistics.message_count == 0
    statistics.message_start_time = first if is_first else min(first, statistics.message_start_time)
    statistics.message_end_time = max(last, statistics.message_end_time)
    chunk.num_messages += len(logged)
    statistics.channel_message_counts[channel] += len(logged)
    statistics.message_count += len(logged)
