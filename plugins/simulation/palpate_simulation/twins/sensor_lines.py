"""How a sensor's twin is reached: over a pseudo-terminal or UDP, or, in simulated time, over a pair of sockets."""

from __future__ import annotations

import contextlib
import errno
import os
import pty
import select
import socket
import stat
import termios
from pathlib import Path
from typing import Protocol

from palpate import ConfigurationError, DeviceError

_BAUD, _RATE = termios.B460800, 460800


class SerialLine(Protocol):
    """A serial line, from the sensor's end."""

    def plug_in(self) -> None:
        """Connect the cable."""

    def unplug(self) -> None:
        """Pull it out."""

    def look(self) -> tuple[bool, bytes]:
        """Return True if the port is open at the other end, and what was sent."""
        ...

    @property
    def misheard(self) -> bool:
        """True if it is open at another baud rate."""
        ...

    def write(self, data: bytes) -> int:
        """Send, and return how many bytes were taken; raises BlockingIOError for none, OSError where it is shut."""
        ...


class PseudoTerminal:
    """A pseudo-terminal, to which a symbolic link points."""

    def __init__(self, path: Path) -> None:
        """Raise ConfigurationError for a folder in which everybody can write, and put a port of theirs."""
        if path.parent.is_dir() and path.parent.stat().st_mode & stat.S_IWOTH:
            raise ConfigurationError(
                f"port {path} of the twin: everybody can write in {path.parent}; choose a folder of your own, "
                f"such as ~/{path.name}"
            )
        self._path, self._master, self._open = path, -1, False

    def plug_in(self) -> None:
        """Make the port."""
        self._master, slave = pty.openpty()
        os.set_blocking(self._master, False)
        link = self._path.with_name(self._path.name + ".new")
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        link.replace(self._path)
        os.close(slave)  # from now on the terminal reports whether it is open
        self._open = False

    def unplug(self) -> None:
        """Remove it."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1
            with contextlib.suppress(OSError):
                self._path.unlink()

    def look(self) -> tuple[bool, bytes]:
        """See `SerialLine`; an opened port that still echoes is not ready."""
        poller = select.poll()
        poller.register(self._master, select.POLLIN)
        events = dict(poller.poll(0)).get(self._master, 0)
        if events & select.POLLHUP:
            self._open = False
        elif not self._open:
            self._open = not termios.tcgetattr(self._master)[3] & termios.ICANON
        data = b""
        if self._open and events & select.POLLIN:
            with contextlib.suppress(OSError):
                data = os.read(self._master, 64)
        return self._open, data

    @property
    def misheard(self) -> bool:
        """By the terminal's settings: it may have been closed and opened unseen."""
        return bool(termios.tcgetattr(self._master)[5] != _BAUD)

    def write(self, data: bytes) -> int:
        """See `SerialLine`."""
        return os.write(self._master, data)


class SocketLine:
    """A pair of sockets: unlike a terminal's, what one end writes is at the other one at once."""

    def __init__(self) -> None:
        self._plugged, self._baud = True, 0
        self._reopened = False  # since the last look
        self._ours: socket.socket | None = None

    def plug_in(self) -> None:
        """From now on it may be opened."""
        self._plugged = True

    def unplug(self) -> None:
        """Shut."""
        self._plugged = False
        if self._ours is not None:
            self._ours.close()
        self._ours = None

    def opened(self, path: str, baud: int) -> SocketPort:
        """Return the other end; raises DeviceError."""
        if not self._plugged:
            raise DeviceError(f"{path} cannot be opened: No such file or directory")
        if self._ours is not None:
            self._ours.close()
            self._reopened = True
        self._ours, theirs = socket.socketpair()
        self._ours.setblocking(False)
        theirs.setblocking(False)
        self._baud = baud
        return SocketPort(theirs)

    def look(self) -> tuple[bool, bytes]:
        """See `SerialLine`."""
        reopened, self._reopened = self._reopened, False
        if self._ours is None or reopened:  # a sensor notices each opening, however soon it comes after a closing
            return False, b""
        try:
            data = self._ours.recv(64)
        except BlockingIOError:
            return True, b""
        except OSError:
            data = b""
        if not data:
            self._ours.close()
            self._ours = None
        return self._ours is not None, data

    @property
    def misheard(self) -> bool:
        """True if it was opened at another baud rate."""
        return self._baud != _RATE

    def write(self, data: bytes) -> int:
        """See `SerialLine`."""
        if self._ours is None:
            raise OSError("shut")
        return self._ours.send(data)


class SocketPort:
    """The end that a device's process opens, with what it uses of `serial.Serial`."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link

    def fileno(self) -> int:
        """To read from."""
        return self._link.fileno()

    def write(self, data: bytes) -> int:
        """Send."""
        return self._link.send(data)

    def close(self) -> None:
        """Shut."""
        self._link.close()


class DatagramLine(Protocol):
    """A network, from the sensor's end."""

    def plug_in(self) -> None:
        """Be on it."""

    def unplug(self) -> None:
        """Be off it."""

    def receive(self) -> bytes:
        """Return a datagram, whose sender is the one to answer; raises OSError without one."""
        ...

    def send(self, data: bytes) -> None:
        """Answer; raises OSError where nobody listens."""


class UdpLine:
    """UDP at an address."""

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
        """See `DatagramLine`."""
        if self._socket is None:
            raise OSError("off the net")
        data, self._client = self._socket.recvfrom(64)
        return data

    def send(self, data: bytes) -> None:
        """See `DatagramLine`."""
        if self._socket is None or self._client is None:
            raise OSError("off the net")
        self._socket.sendto(data, self._client)


class SocketDatagrams:
    """A pair of sockets for datagrams."""

    def __init__(self) -> None:
        self._plugged = True
        self._ours: socket.socket | None = None

    def opened(self) -> socket.socket:
        """Return the other end; raises OSError."""
        if not self._plugged:
            raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
        if self._ours is not None:
            self._ours.close()
        self._ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._ours.setblocking(False)
        theirs.setblocking(False)
        return theirs

    def plug_in(self) -> None:
        """Be on the net."""
        self._plugged = True

    def unplug(self) -> None:
        """Be off the net: who listens hears nothing."""
        self._plugged = False

    def close(self) -> None:
        """End for ever."""
        if self._ours is not None:
            self._ours.close()

    def receive(self) -> bytes:
        """See `DatagramLine`."""
        if self._ours is None or not self._plugged:
            raise OSError("off the net")
        return self._ours.recv(64)

    def send(self, data: bytes) -> None:
        """See `DatagramLine`."""
        if self._ours is None or not self._plugged:
            raise OSError("off the net")
        self._ours.send(data)
