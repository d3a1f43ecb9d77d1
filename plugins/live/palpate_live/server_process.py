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
# Choices.
_SEND_BUFFER = 1 << 20  # bytes that may wait for the process, where Linux permits
_END_TIMEOUT = 2.0  # [s] in which it has to end
_TOKEN_SIZE = 16  # random bytes in the address: nobody guesses 128 bits
_MAX_REQUEST = 256  # bytes of a request from the page


@dataclass(frozen=True)
class ServerKind:
    """A kind of server: its name, its program and its address."""

    name: str  # in messages
    module: str  # that is executed
    scheme: str  # of the address


_PAGE = ServerKind("live page", "palpate_live.page_server", "http")


class PageServer:
    """A server of the page in a process of its own; nothing that it does or fails to do delays the sender."""

    def __init__(
        self, port: int, stop: Callable[[str], None] | None, patient: bool = False, served: ServerKind = _PAGE
    ) -> None:
        """Listen on 127.0.0.1, start the process; raises OutputError where the port is taken.

        `stop` is called from a thread with a request from the page; a `patient` sender waits for the process, any other
        one drops messages. `served` is the kind of server.
        """
        self.sent = self.dropped = 0
        self.lost: str | None = None  # the reason why nothing is sent any more
        self._stop, self._patient, self.served = stop, patient, served
        self.token = secrets.token_urlsafe(_TOKEN_SIZE)
        with _open_listener(port, served.name) as listener:
            self.port: int = listener.getsockname()[1]
            self._socket, child_socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            self._errors = tempfile.TemporaryFile()  # noqa: SIM115  (closed when the process has ended)
            with child_socket:
                self._process = self._start_process(listener, child_socket)
        self._thread = threading.Thread(target=self._listen, daemon=True, name="live page")
        self._thread.start()

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    @property
    def address(self) -> str:
        """The page's address; anyone who knows it may look, and stop the run."""
        return f"{self.served.scheme}://127.0.0.1:{self.port}/{self.token}/"

    def _start_process(self, listener: socket.socket, child_socket: socket.socket) -> subprocess.Popen[bytes]:
        """Start the process with both sockets, and give it the token; raises OutputError where it cannot be started.

        In a session of its own, so that Ctrl-C reaches the run only; it imports nothing from the current folder.
        """
        descriptors = listener.fileno(), child_socket.fileno()
        command = [sys.executable, "-P", "-m", self.served.module, *map(str, descriptors)]
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                pass_fds=descriptors,
                start_new_session=True,
            )
        except OSError as error:
            raise OutputError(f"{self.served.name}: its process cannot be started: {error.strerror}") from error
        assert process.stdin is not None
        with suppress(OSError), process.stdin as pipe:
            pipe.write(f"{self.token}\n".encode())  # arguments of a process are seen by everybody
        return process

    def send(self, message: bytes) -> bool:
        """Send a message to the process; return False where it was dropped, which is counted. Only one thread sends."""
        if self.lost is None:
            error_number = self._send_waiting(message) if self._patient else self._send_at_once(message)
            if error_number == 0:
                self.sent += 1
                return True
            if error_number not in (errno.EAGAIN, errno.EMSGSIZE):  # a full buffer, or a message that is too long
                self.lost = os.strerror(error_number)
        self.dropped += 1
        return False

    def _send_waiting(self, message: bytes) -> int:
        """Send a message, waiting for the process; return the number of the error, or 0."""
        try:
            self._socket.send(message)
        except OSError as error:
            return error.errno or errno.EIO
        return 0

    def _send_at_once(self, message: bytes) -> int:
        """Send a message without waiting, and keep the interpreter's lock; return the number of the error, or 0.

        A thread of ordinary priority that got the lock could keep it for long, on a busy computer.
        """
        flags = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
        if _LIBC.send(self._socket.fileno(), message, len(message), flags) < 0:
            return ctypes.get_errno()
        return 0

    def _listen(self) -> None:
        """Call `stop` for each request from the page, until the socket is closed."""
        while True:
            try:
                request = self._socket.recv(_MAX_REQUEST)
            except OSError:
                return
            if not request:
                return
            if request == b"stop" and self._stop is not None:
                self._stop("on the live page")

    def wait(self) -> None:
        """Wait until the process ends."""
        self._process.wait()

    def close(self) -> str | None:
        """End the process; return a sentence if messages were lost or it ended early. A second call does nothing."""
        if self._errors.closed:
            return None
        # The end of the messages is the process's sign to finish; one that does not is killed.
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
        try:
            code = self._process.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            code = 0  # ended from here
        # The thread that listens ends with the socket.
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(_END_TIMEOUT)
        self._socket.close()
        with self._errors as file:
            file.seek(0)
            error_lines = file.read().decode(errors="replace").strip().splitlines()
        return self._loss_notice(code, error_lines)

    def _loss_notice(self, exit_code: int, error_lines: list[str]) -> str | None:
        """Return a sentence if the process ended early or messages were lost; `error_lines` are its standard error."""
        if exit_code > 0:
            reason = printable(error_lines[-1]) if error_lines else f"exit code {exit_code}"
            return f"the {self.served.name} ended early: {reason}"
        if self.lost is not None or exit_code < 0:  # by a signal
            return f"the {self.served.name} was ended from outside; the run did not wait for it"
        if self.dropped:
            share = f"{self.dropped} of {self.sent + self.dropped} messages were not shown"
            return f"the {self.served.name} was too slow: {share}"
        return None


def _open_listener(port: int, name: str) -> socket.socket:
    """Return a socket that listens on a port of 127.0.0.1; raises OutputError, with the server's name, if it cannot."""
    try:
        return listening_socket(port)
    except OSError as error:
        raise OutputError(
            f"{name}: port {port} of 127.0.0.1 cannot be used: {error.strerror}; port = 0 takes a free one"
        ) from error
