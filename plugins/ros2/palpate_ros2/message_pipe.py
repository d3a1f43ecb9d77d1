"""Messages on their way from the process that receives them: a pipe of frames."""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass

_HEAD = struct.Struct("<IIqqQ")  # bytes of the payload, topic, arrival [ns], source [ns], writer
_PIPE = 1 << 20  # [bytes]
_HELD = 64 << 20  # [bytes] that may wait for a reader
_PIECE = 1 << 18


@dataclass(frozen=True)
class ReceivedMessage:
    """A message as it came; without a payload: its writer has left."""

    topic: int
    arrival: int  # monotonic [ns]
    source: int  # [ns] when its writer wrote it, by the writer's clock
    writer: int
    payload: bytes


def message_pipe() -> tuple[int, int]:
    """Descriptors of the end that reads and the end that writes; neither ever waits."""
    reading, writing = os.pipe()
    for descriptor in (reading, writing):
        os.set_blocking(descriptor, False)
    with contextlib.suppress(OSError):  # the system's limit is lower; what does not fit waits with the writer
        fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, _PIPE)
    return reading, writing


class Outlet:
    """The end that writes; what does not fit into the pipe waits, and what does not fit here either is counted."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._held = bytearray()
        self.lost = 0

    def put(self, message: ReceivedMessage) -> None:
        """Send a message, now or later."""
        if len(self._held) > _HELD:
            self.lost += 1
            return
        head = (len(message.payload), message.topic, message.arrival, message.source, message.writer)
        self._held += _HEAD.pack(*head) + message.payload

    def flush(self) -> None:
        """Write as much as fits; raises BrokenPipeError where the reader is gone."""
        while self._held:
            try:
                written = os.write(self._descriptor, memoryview(self._held)[:_PIECE])
            except BlockingIOError:
                return
            del self._held[:written]


class Inlet:
    """The end that reads."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""

    def messages(self) -> Iterator[ReceivedMessage]:
        """What has come since the last call."""
        pieces = [self._rest]
        while True:
            try:
                data = os.read(self._descriptor, _PIECE)
            except BlockingIOError:
                break
            if not data:
                break
            pieces.append(data)
            if len(pieces) > 16:  # what comes faster than it is taken is not to keep the rest waiting
                break
        data, at = b"".join(pieces), 0
        while len(data) - at >= _HEAD.size:
            size, topic, arrival, source, writer = _HEAD.unpack_from(data, at)
            end = at + _HEAD.size + size
            if end > len(data):
                break
            yield ReceivedMessage(topic, arrival, source, writer, data[at + _HEAD.size : end])
            at = end
        self._rest = data[at:]
