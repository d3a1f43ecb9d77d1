"""The sockets that the client library holds, set as commands of a robot need them."""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator

_NO_LINGER = struct.pack("ii", 1, 0)  # switched on, and 0 s (0213)


def send_at_once(port: int) -> int:
    """Let this process's connections to a port of another host send without waiting; return their number.

    The client library leaves Nagle's algorithm on: a command waits for the acknowledgement of the one before, which
    comes with a state, or after 40 ms; then several come at once, and the arm leaps.
    """
    return _set(port, socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def drop_unsent(port: int) -> int:
    """Let the end of this process, whatever its cause, reset its connections to a port; return their number.

    Else the system would go on delivering what lies on a lost link, and the arm would carry it out (0213).
    """
    return _set(port, socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)


def _set(port: int, level: int, option: int, value: int | bytes) -> int:
    """Set an option of every connection to a port; return their number."""
    count = 0
    for link in _links(port):
        link.setsockopt(level, option, value)
        count += 1
    return count


def _links(port: int) -> Iterator[socket.socket]:
    """Yield this process's connections to a port of another host, which the client library holds."""
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        try:
            link = socket.socket(fileno=descriptor)
        except OSError:  # no socket
            continue
        try:
            if (link.family, link.type) == (socket.AF_INET, socket.SOCK_STREAM) and link.getpeername()[1] == port:
                yield link
        except OSError:  # without a peer
            continue
        finally:
            link.detach()  # borrowed: a copy would hold open what its owner closes
