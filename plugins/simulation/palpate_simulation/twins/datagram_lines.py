"""Networks to a sensor's twin: UDP, or, in simulated time, a pair of sockets for datagrams."""

from __future__ import annotations

import errno
import socket
from typing import Protocol

from palpate import DeviceError

MAX_REQUEST = 64  # bytes (a choice): a request of RDT has 8


class DatagramLine(Protocol):
    """Network from the sensor's end."""

    def plug_in(self) -> None:
        """Be on it."""

    def unplug(self) -> None:
        """Be off it."""

    def receive(self) -> bytes:
        """Return a datagram, whose sender `send` will answer; raises OSError without one."""
        ...

    def send(self, data: bytes) -> None:
        """Answer; raises OSError where nobody listens."""


class UdpLine:
    """UDP port of an address."""

    def __init__(self, address: str, port: int) -> None:
        self._address = address, port
        self._socket: socket.socket | None = None
        self._client: tuple[str, int] | None = None

    def plug_in(self) -> None:
        """Be on the net; raises DeviceError."""
        if self._socket is not None:
            return
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(self._address)
        except OSError as error:
            self._socket.close()
            self._socket = None
            raise DeviceError(f"{self._address[0]}:{self._address[1]} cannot be used: {error.strerror}") from error

    def unplug(self) -> None:
        """Be off the net."""
        if self._socket is not None:
            self._socket.close()
        self._socket = self._client = None

    def receive(self) -> bytes:
        """Do as `DatagramLine` says."""
        if self._socket is None:
            raise OSError("off the net")
        data, self._client = self._socket.recvfrom(MAX_REQUEST)
        return data

    def send(self, data: bytes) -> None:
        """Do as `DatagramLine` says."""
        if self._socket is None or self._client is None:
            raise OSError("off the net")
        self._socket.sendto(data, self._client)


class SocketDatagrams:
    """Pair of sockets for datagrams, in simulated time."""

    def __init__(self) -> None:
        self._plugged = True
        self._sensor_end: socket.socket | None = None

    def opened(self) -> socket.socket:
        """Return the device's end; raises OSError off the net."""
        if not self._plugged:
            raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
        if self._sensor_end is not None:
            self._sensor_end.close()
        self._sensor_end, device_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._sensor_end.setblocking(False)
        device_end.setblocking(False)
        return device_end

    def plug_in(self) -> None:
        """Be on the net."""
        self._plugged = True

    def unplug(self) -> None:
        """Be off the net: whoever listens receives nothing."""
        self._plugged = False

    def close(self) -> None:
        """Close the sensor's end."""
        if self._sensor_end is not None:
            self._sensor_end.close()

    def receive(self) -> bytes:
        """Do as `DatagramLine` says."""
        if self._sensor_end is None or not self._plugged:
            raise OSError("off the net")
        return self._sensor_end.recv(MAX_REQUEST)

    def send(self, data: bytes) -> None:
        """Do as `DatagramLine` says."""
        if self._sensor_end is None or not self._plugged:
            raise OSError("off the net")
        self._sensor_end.send(data)
