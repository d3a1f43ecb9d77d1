"""The process that serves the page: datagrams in, browsers out. Started by the run, ended with it."""

from __future__ import annotations

import asyncio
import logging
import socket
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Protocol

from palpate_kit.page.datagrams import LARGEST, is_text, pack
from palpate_kit.page.gate import GREETING, GuardedConnection, answer_request, page_files
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from palpate_live.history import History
from palpate_live.server_priority import raise_priority

# Choices.
_MAX_BROWSERS = 16
_MAX_WAITING = 8 << 20  # bytes for one browser, besides the history that it was sent; 8 MB
_CLOSING_TIME = 1.0  # [s] for browsers to take what is left when the run has ended
_MAX_REQUEST = 64  # bytes of a message from a browser, which is "stop"
_STOP = "stop"
_FILES = page_files("palpate_live", ("index.html", "main.js", "record.js", "map.js", "panels.js"))


class Viewers(Protocol):
    """A server of viewers: their admission, their messages, and the end of the run."""

    over: asyncio.Event

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a refusal, or a page; None lets a WebSocket in."""
        ...

    async def serve(self, viewer: ServerConnection) -> None:
        """Serve a viewer until it goes."""
        ...

    async def finish(self) -> None:
        """Close the connections at the end of the run."""
        ...


def listen(run: socket.socket, take: Callable[[bytes], None], over: asyncio.Event) -> None:
    """Call `take` with each datagram from the run; set `over` at an empty one, which is its end.

    `run` is a socket of datagrams, which the event loop watches.
    """
    run.setblocking(False)

    def read() -> None:
        """Read until no datagram waits."""
        while True:
            try:
                message = run.recv(2 * LARGEST)  # [bytes], more than any datagram of a run
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                asyncio.get_running_loop().remove_reader(run)
                over.set()
                return
            take(message)

    asyncio.get_running_loop().add_reader(run, read)


class Server:
    """The page's server: it sends the history and the messages of a run to browsers, and the run their `stop`."""

    def __init__(self, run: socket.socket, token: str) -> None:
        self._run, self._token = run, token
        self._history = History()
        self._browsers: dict[ServerConnection, int] = {}  # bytes of history that each was sent
        self._is_stale = False  # True while rows have changed that browsers have
        self.over = asyncio.Event()
        listen(run, self._take, self.over)

    def _take(self, message: bytes) -> None:
        """Remember a message of the run, and send it, or the whole history, to the browsers."""
        kind = self._history.add(message)
        if kind == "later":
            # Rows that browsers have already now have more columns: they are sent once, when all of them have come.
            self._is_stale = True
        elif self._is_stale:
            self._is_stale = False
            self._send_history()
        else:
            self._send_message(message)

    def _send_message(self, message: bytes) -> None:
        """Send a message to all browsers; one that takes nothing for long is cut off, and may come again."""
        for browser, history_size in list(self._browsers.items()):
            if browser.transport.get_write_buffer_size() > _MAX_WAITING + history_size:
                browser.transport.abort()
            else:
                self._write(browser, message)

    def _send_history(self) -> None:
        """Send the whole history to all browsers again."""
        for browser in list(self._browsers):
            for message in self._history.messages():
                self._write(browser, message)

    @staticmethod
    def _write(browser: ServerConnection, message: bytes) -> None:
        """Write a message without waiting for the browser."""
        broadcast([browser], message.decode() if is_text(message) else message)

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page and its files, or a refusal; None lets a WebSocket in."""
        return answer_request(request, self._token, _FILES)

    async def serve(self, viewer: ServerConnection) -> None:
        """Send the history to a browser, then the run's messages; the only message it can send is `stop`."""
        if len(self._browsers) >= _MAX_BROWSERS:
            await viewer.close(1013, "too many pages are open")  # 1013: try again later
            return
        history_size = 0
        for message in self._history.messages():
            self._write(viewer, message)
            history_size += len(message)
        self._browsers[viewer] = history_size
        with suppress(ConnectionClosed):
            async for request in viewer:
                if request != _STOP:
                    await viewer.close(1008, "the only command here is stop")  # 1008: policy violation (RFC 6455)
                elif not self._history.recorded:
                    with suppress(OSError):
                        self._run.send(_STOP.encode())
        self._browsers.pop(viewer, None)

    async def finish(self) -> None:
        """Let browsers know that the run is over, with a moment to take what is left."""
        self._send_message(pack({"kind": "over"}))
        await close_viewers(self._browsers)


async def close_viewers(viewers: Iterable[ServerConnection]) -> None:
    """Close connections, with a moment for what is on its way."""
    # 1001: the server goes away (RFC 6455).
    closing = [asyncio.ensure_future(viewer.close(1001, "the run is over")) for viewer in viewers]
    if closing:
        await asyncio.wait(closing, timeout=_CLOSING_TIME)


async def serve_run(
    listener: socket.socket,
    run: socket.socket,
    token: str,
    make_server: Callable[[socket.socket, str], Viewers] = Server,
    subprotocols: Sequence[Subprotocol] | None = None,
    max_request: int = _MAX_REQUEST,
) -> None:
    """Serve the viewers of a run until it ends; their messages have at most `max_request` bytes.

    Viewers connect to the `listener`; the run's messages come from the socket `run`. `token` is part of the address, by
    which a viewer is admitted. `make_server` returns the page's server, or another one.
    """
    server = make_server(run, token)
    silent = logging.getLogger("palpate_live")  # foreign requests are not worth a note, and would fill a file
    silent.disabled = True
    async with serve(
        server.serve,
        sock=listener,
        process_request=server.admit,
        subprotocols=subprotocols,
        compression=None,
        logger=silent,
        max_size=max_request,
        server_header=None,
        open_timeout=GREETING,
        close_timeout=_CLOSING_TIME,
        create_connection=GuardedConnection,
    ):
        if make_server is Server:  # once it serves; others have no stop that would have to be heard at once
            raise_priority(asyncio.get_running_loop())
        await server.over.wait()
        await server.finish()


def process_arguments() -> tuple[socket.socket, socket.socket, str]:
    """Return listener and socket of ``python -m MODULE LISTENER SOCKET``, and the token from standard input."""
    listener, run = (socket.socket(fileno=int(number)) for number in sys.argv[1:3])
    return listener, run, sys.stdin.readline().strip()


if __name__ == "__main__":
    asyncio.run(serve_run(*process_arguments()))
