"""Messages on their way from the process that receives them: a pipe of frames.

A frame is a head of 32 bytes, little-endian, and a payload. The head: size of the payload [bytes] (uint32), number of
the topic (uint32), time of arrival [ns] (int64), time of writing [ns] (int64), number of the writer (uint64).
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass

_HEAD = struct.Struct("<IIqqQ")
_PIPE_CAPACITY = 1 << 20  # [bytes], a choice: the most that Linux grants without privileges
_MAX_WAITING = 64 << 20  # [bytes] that wait for a reader, a choice: memory that a stalled reader may cost
_WRITE_SIZE = 1 << 18  # [bytes] written at once: a choice
_MAX_READS = 16  # of the pipe in one call, a choice: messages that arrive faster do not hold up the caller


@dataclass(frozen=True)
class ReceivedMessage:
    """A message as received; an empty payload says that the writer has left."""

    topic: int  # number of the topic
    arrival: int  # monotonic [ns]
    source: int  # [ns] at which it was written, by the writer's clock
    writer: int  # number that identifies the publisher
    payload: bytes


def message_pipe() -> tuple[int, int]:
    """Return the descriptors of the end that reads and the end that writes; neither blocks."""
    read_end, write_end = os.pipe()
    for descriptor in (read_end, write_end):
        os.set_blocking(descriptor, False)
    with contextlib.suppress(OSError):  # the system's limit is lower; more waits in the outlet then
        fcntl.fcntl(write_end, fcntl.F_SETPIPE_SZ, _PIPE_CAPACITY)
    return read_end, write_end


class Outlet:
    """Writing end of the pipe: frames that the pipe has no room for wait, and those beyond `_MAX_WAITING` are lost."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting = bytearray()
        self.lost = 0  # messages

    def put(self, message: ReceivedMessage) -> None:
        """Queue a message for `flush`, or count it as lost."""
        if len(self._waiting) > _MAX_WAITING:
            self.lost += 1
            return
        head = (len(message.payload), message.topic, message.arrival, message.source, message.writer)
        self._waiting += _HEAD.pack(*head) + message.payload

    def flush(self) -> None:
        """Write as much as the pipe has room for; raises BrokenPipeError where the reader is gone."""
        while self._waiting:
            try:
                written = os.write(self._descriptor, memoryview(self._waiting)[:_WRITE_SIZE])
            except BlockingIOError:
                return
            del self._waiting[:written]


class Inlet:
    """Reading end of the pipe."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._incomplete = b""  # begin of a frame whose end has not arrived

    def messages(self) -> Iterator[ReceivedMessage]:
        """Yield the messages that have arrived since the last call."""
        data = self._incomplete + self._read_pipe()
        start = 0  # [bytes] of the frame
        while len(data) - start >= _HEAD.size:
            size, topic, arrival, source, writer = _HEAD.unpack_from(data, start)
            end = start + _HEAD.size + size
            if end > len(data):
                break
            yield ReceivedMessage(topic, arrival, source, writer, data[start + _HEAD.size : end])
            start = end
        self._incomplete = data[start:]

    def _read_pipe(self) -> bytes:
        """Return the bytes that are in the pipe, up to `_MAX_READS` reads."""
        pieces: list[bytes] = []
        while len(pieces) < _MAX_READS:
            try:
                piece = os.read(self._descriptor, _PIPE_CAPACITY)
            except BlockingIOError:
                break
            if not piece:  # the writing end is closed
                break
            pieces.append(piece)
        return b"".join(pieces)
