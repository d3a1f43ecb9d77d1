"""Connection of one client to a port of the software controller, served without ever waiting."""

from __future__ import annotations

import contextlib
import socket
import struct

from palpate import clock

from palpate_simulation.twins.controller import VERSION, Controller
from palpate_simulation.twins.rtde import ClientSession

_TIMESTAMP = getattr(socket, "SO_TIMESTAMPNS", 35)  # the number on Linux, which Python 3.11 has no name for
_TIMESPEC = struct.Struct("qq")  # seconds and nanoseconds
_NS_PER_SECOND = 10**9
_MAX_READ = 65536  # bytes at once (a choice)


class Client:
    """Connection of one client to one port."""

    def __init__(self, connection: socket.socket, port: int, controller: Controller) -> None:
        connection.setblocking(False)
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, _TIMESTAMP, 1)
        self.socket, self.port = connection, port
        self.received = bytearray()
        self.held: bytearray | None = None  # bytes that the network holds back, while it does
        self.over = False  # the peer has closed its end
        self.unsent = b""  # bytes that did not fit
        self.skipped = 0  # packets that a peer did not read
        self.session = ClientSession(
            VERSION, controller.claim, controller.write, controller.unknown_output, not controller.refuses_start
        )

    def read(self) -> tuple[bytes, float]:
        """Return the bytes that arrived, none from a peer that has gone, and the monotonic time [s] of their arrival.

        The time is the kernel's, who was awake when the last of them arrived.
        """
        data, notes, _, _ = self.socket.recvmsg(_MAX_READ, socket.CMSG_SPACE(_TIMESPEC.size))
        now = clock().epoch_ns()
        for _, note_type, note in notes:
            if note_type == _TIMESTAMP:
                seconds, nanoseconds = _TIMESPEC.unpack(note[: _TIMESPEC.size])
                age = max(now - seconds * _NS_PER_SECOND - nanoseconds, 0)  # [ns]
                return data, clock().now() - age / 1e9
        return data, clock().now()

    def send(self, data: bytes) -> bool:
        """Send, and keep the rest that did not fit; return False if the peer has gone.

        Nothing is queued for a peer that does not read: packets are skipped until the rest is sent.
        """
        if self.unsent and data:
            self.skipped += 1
        pending = self.unsent or data
        try:
            sent_count = self.socket.send(pending) if pending else 0
        except BlockingIOError:
            sent_count = 0
        except OSError:
            return False
        self.unsent = pending[sent_count:]
        return True
