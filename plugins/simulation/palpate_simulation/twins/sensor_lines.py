"""Serial lines to a sensor's twin: a pseudo-terminal, or, in simulated time, a pair of sockets."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import socket
import stat
import termios
from pathlib import Path
from typing import Protocol

from palpate import ConfigurationError, DeviceError

# Rate of a SensONE, as termios has it and in bauds.
_SPEED_CODE, _BAUD_RATE = termios.B460800, 460800
_MAX_READ = 64  # bytes at once (a choice): commands are shorter
# Indexes of the local flags and of the speed in what `tcgetattr` returns.
_LOCAL_FLAGS, _OUTPUT_SPEED = 3, 5


class SerialLine(Protocol):
    """Serial line from the sensor's end."""

    def plug_in(self) -> None:
        """Connect the cable."""

    def unplug(self) -> None:
        """Pull the cable out."""

    def look(self) -> tuple[bool, bytes]:
        """Return True if the port is open at the other end, and the bytes that were sent since the last call."""
        ...

    @property
    def misheard(self) -> bool:
        """True if the port is open at another baud rate."""
        ...

    def write(self, data: bytes) -> int:
        """Send, and return the number of bytes that were accepted; raises BlockingIOError for 0, OSError if shut."""
        ...


class PseudoTerminal:
    """Pseudo-terminal, to which a symbolic link points."""

    def __init__(self, path: Path) -> None:
        """Raise ConfigurationError for a folder in which everybody can write, and so put another port there."""
        if path.parent.is_dir() and path.parent.stat().st_mode & stat.S_IWOTH:
            raise ConfigurationError(
                f"port {path} of the twin: everybody can write in {path.parent}; choose a folder of your own, "
                f"such as ~/{path.name}"
            )
        self._path, self._master, self._open = path, -1, False

    def plug_in(self) -> None:
        """Make the port, and let the link point to it."""
        self._master, slave = pty.openpty()
        os.set_blocking(self._master, False)
        link = self._path.with_name(self._path.name + ".new")
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        link.replace(self._path)
        os.close(slave)  # from now on the terminal reports whether it is open
        self._open = False

    def unplug(self) -> None:
        """Remove the port and the link."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1
            with contextlib.suppress(OSError):
                self._path.unlink()

    def look(self) -> tuple[bool, bytes]:
        """Do as `SerialLine` says; a port is open once its program has switched the terminal's line editing off."""
        poller = select.poll()
        poller.register(self._master, select.POLLIN)
        events = dict(poller.poll(0)).get(self._master, 0)
        if events & select.POLLHUP:
            self._open = False
        elif not self._open:
            self._open = not termios.tcgetattr(self._master)[_LOCAL_FLAGS] & termios.ICANON
        data = b""
        if self._open and events & select.POLLIN:
            with contextlib.suppress(OSError):
                data = os.read(self._master, _MAX_READ)
        return self._open, data

    @property
    def misheard(self) -> bool:
        """True if the terminal has another baud rate; asked of it, since it may be closed and opened between looks."""
        return bool(termios.tcgetattr(self._master)[_OUTPUT_SPEED] != _SPEED_CODE)

    def write(self, data: bytes) -> int:
        """Do as `SerialLine` says."""
        return os.write(self._master, data)


class SocketLine:
    """Pair of sockets: unlike with a terminal, bytes that one end writes are at the other one at once."""

    def __init__(self) -> None:
        self._plugged, self._baud = True, 0
        self._reopened = False  # since the last look
        self._sensor_end: socket.socket | None = None

    def plug_in(self) -> None:
        """Let the port be opened from now on."""
        self._plugged = True

    def unplug(self) -> None:
        """Shut the port."""
        self._plugged = False
        if self._sensor_end is not None:
            self._sensor_end.close()
        self._sensor_end = None

    def opened(self, path: str, baud: int) -> SocketPort:
        """Return the device's end, opened at a baud rate; raises DeviceError where the cable is out."""
        if not self._plugged:
            raise DeviceError(f"{path} cannot be opened: No such file or directory")
        if self._sensor_end is not None:
            self._sensor_end.close()
            self._reopened = True
        self._sensor_end, device_end = socket.socketpair()
        self._sensor_end.setblocking(False)
        device_end.setblocking(False)
        self._baud = baud
        return SocketPort(device_end)

    def look(self) -> tuple[bool, bytes]:
        """Do as `SerialLine` says."""
        reopened, self._reopened = self._reopened, False
        if self._sensor_end is None or reopened:  # a sensor notices each opening, however soon it comes after a closing
            return False, b""
        try:
            data = self._sensor_end.recv(_MAX_READ)
        except BlockingIOError:
            return True, b""
        except OSError:
            data = b""
        if not data:
            self._sensor_end.close()
            self._sensor_end = None
        return self._sensor_end is not None, data

    @property
    def misheard(self) -> bool:
        """True if the port was opened at another baud rate."""
        return self._baud != _BAUD_RATE

    def write(self, data: bytes) -> int:
        """Do as `SerialLine` says."""
        if self._sensor_end is None:
            raise OSError("shut")
        return self._sensor_end.send(data)


class SocketPort:
    """End that a device's process opens, with the methods of `serial.Serial` that it uses."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link

    def fileno(self) -> int:
        """Return the descriptor to read from."""
        return self._link.fileno()

    def write(self, data: bytes) -> int:
        """Send."""
        return self._link.send(data)

    def close(self) -> None:
        """Shut the port."""
        self._link.close()
