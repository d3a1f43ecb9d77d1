"""The process that serves the page, as the run sees it: a socket that takes a datagram whole or not at all."""

from __future__ import annotations

import ctypes
import errno
import os
import secrets
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from palpate import OutputError, printable
from palpate_kit.page.listening_socket import listening_socket

_LIBC = ctypes.PyDLL(None, use_errno=True)  # its functions keep the interpreter's lock
_LIBC.send.argtypes = (ctypes.c_int, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_int)
_LIBC.send.restype = ctypes.c_ssize_t
_BUFFER = 1 << 20  # bytes that may wait for the process, where Linux permits
_GOES = 2.0  # [s] in which it has to end
_COMMAND = 256  # bytes


@dataclass(frozen=True)
class ServerKind:
    """What the process is."""

    name: str  # in messages
    module: str  # that is run
    scheme: str  # of its address


_PAGE = ServerKind("live page", "palpate_live.page_server", "http")


class PageServer:
    """A server of the page in a process of its own; nothing that it does or fails to do delays the sender."""

    def __init__(
        self, port: int, stop: Callable[[str], None] | None, patient: bool = False, served: ServerKind = _PAGE
    ) -> None:
        """Listen on 127.0.0.1, start the process; raises OutputError where the port is taken.

        `stop` is called from a thread on a request from the page; a `patient` sender waits for the process.
        """
        self.sent = self.dropped = 0
        self.lost: str | None = None  # why nothing goes there any more
        self._stop, self._patient, self.served = stop, patient, served
        self.token = secrets.token_urlsafe(16)
        with _listening(port, served.name) as listener:
            self.port: int = listener.getsockname()[1]
            self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
            self._errors = tempfile.TemporaryFile()  # noqa: SIM115  (closed when the process has ended)
            with theirs:
                self._process = self._started(listener, theirs)
        self._thread = threading.Thread(target=self._listen, daemon=True, name="live page")
        self._thread.start()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def address(self) -> str:
        """The page's address; anyone who knows it may look, and stop the run."""
        return f"{self.served.scheme}://127.0.0.1:{self.port}/{self.token}/"

    def _started(self, listener: socket.socket, theirs: socket.socket) -> subprocess.Popen[bytes]:
        """In a session of its own, so that Ctrl-C reaches the run only; it imports nothing from the current folder."""
        numbers = listener.fileno(), theirs.fileno()
        command = [sys.executable, "-P", "-m", self.served.module, *map(str, numbers)]
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                pass_fds=numbers,
                start_new_session=True,
            )
        except OSError as error:
            raise OutputError(f"{self.served.name}: its process cannot be started: {error.strerror}") from error
        assert process.stdin is not None
        with suppress(OSError), process.stdin as pipe:
            pipe.write(f"{self.token}\n".encode())  # arguments of a process are seen by everybody
        return process

    def send(self, message: bytes) -> bool:
        """Hand a message to the process; False where it was dropped, which is counted. Only one thread sends."""
        if self.lost is None:
            number = self._waiting(message) if self._patient else self._at_once(message)
            if number == 0:
                self.sent += 1
                return True
            if number not in (errno.EAGAIN, errno.EMSGSIZE):
                self.lost = os.strerror(number)
        self.dropped += 1
        return False

    def _waiting(self, message: bytes) -> int:
        """Send; the number of the error, or 0."""
        try:
            self._socket.send(message)
        except OSError as error:
            return error.errno or errno.EIO
        return 0

    def _at_once(self, message: bytes) -> int:
        """Send without waiting, and without the interpreter's lock being given away; the number of the error, or 0.

        A thread of ordinary priority that got the lock could keep it for long, on a busy computer.
        """
        flags = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
        if _LIBC.send(self._socket.fileno(), message, len(message), flags) < 0:
            return ctypes.get_errno()
        return 0

    def _listen(self) -> None:
        while True:
            try:
                said = self._socket.recv(_COMMAND)
            except OSError:
                return
            if not said:
                return
            if said == b"stop" and self._stop is not None:
                self._stop("on the live page")

    def wait(self) -> None:
        """Until the process ends."""
        self._process.wait()

    def close(self) -> str | None:
        """End the process; a sentence where something was not as it should be. Once more does nothing."""
        if self._errors.closed:
            return None
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
        try:
            code = self._process.wait(_GOES)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(_GOES)
        self._socket.close()
        with self._errors as file:
            file.seek(0)
            words = file.read().decode(errors="replace").strip().splitlines()
        if code > 0:
            return f"the {self.served.name} ended early: {printable(words[-1]) if words else f'exit code {code}'}"
        if self.lost is not None:
            return f"the {self.served.name} was ended from outside; the run did not wait for it"
        if self.dropped:
            lost = f"{self.dropped} of {self.sent + self.dropped} messages were not shown"
            return f"the {self.served.name} was too slow: {lost}"
        return None


def _listening(port: int, name: str) -> socket.socket:
    try:
        return listening_socket(port)
    except OSError as error:
        raise OutputError(
            f"{name}: port {port} of 127.0.0.1 cannot be used: {error.strerror}; port = 0 takes a free one"
        ) from error
