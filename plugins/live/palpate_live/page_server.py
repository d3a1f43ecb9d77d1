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
from palpate_live.server_priority import attend

_MOST = 16  # browsers
_PATIENCE = 8 << 20  # bytes that wait for one browser, besides the history that it is given
_DRAIN = 1.0  # [s] for browsers to take what is left when the run has ended
_STOP = "stop"
_FILES = page_files("palpate_live", ("index.html", "main.js", "record.js", "map.js", "panels.js"))


class Viewers(Protocol):
    """Those who look on: who may, what they get, and whether the run is over."""

    over: asyncio.Event

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a refusal, or a page; None lets a WebSocket in."""
        ...

    async def serve(self, viewer: ServerConnection) -> None:
        """One of them, until it goes."""
        ...

    async def finish(self) -> None:
        """Let them know that nothing more comes."""
        ...


def listen(run: socket.socket, take: Callable[[bytes], None], over: asyncio.Event) -> None:
    """Take all that comes from the run; an empty datagram is its end."""
    run.setblocking(False)

    def read() -> None:
        while True:
            try:
                message = run.recv(2 * LARGEST)
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
    """Browsers, what they missed, and the run's end of the socket."""

    def __init__(self, run: socket.socket, token: str) -> None:
        self._run, self._token = run, token
        self._history = History()
        self._browsers: dict[ServerConnection, int] = {}  # bytes of history that each was given
        self._stale = False  # whether rows have changed that browsers have
        self.over = asyncio.Event()
        listen(run, self._take, self.over)

    def _take(self, message: bytes) -> None:
        kind = self._history.add(message)
        if kind == "later":  # rows that browsers have already now say more: once, when all of it is here
            self._stale = True
        elif self._stale:
            self._stale = False
            self._all_anew()
        else:
            self._hand_out(message)

    def _hand_out(self, message: bytes) -> None:
        for browser, given in list(self._browsers.items()):
            if browser.transport.get_write_buffer_size() > _PATIENCE + given:
                browser.transport.abort()  # it may come again, and gets the history
            else:
                self._write(browser, message)

    def _all_anew(self) -> None:
        for browser in list(self._browsers):
            for message in self._history.messages():
                self._write(browser, message)

    @staticmethod
    def _write(browser: ServerConnection, message: bytes) -> None:
        """Without waiting for the browser."""
        broadcast([browser], message.decode() if is_text(message) else message)

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page and its files, or a refusal; None lets a WebSocket in."""
        return answer_request(request, self._token, _FILES)

    async def serve(self, viewer: ServerConnection) -> None:
        """One browser: the history, then what comes; the only message it can send is `stop`."""
        if len(self._browsers) >= _MOST:
            await viewer.close(1013, "too many pages are open")
            return
        given = 0
        for message in self._history.messages():
            self._write(viewer, message)
            given += len(message)
        self._browsers[viewer] = given
        with suppress(ConnectionClosed):
            async for said in viewer:
                if said != _STOP:
                    await viewer.close(1008, "the only command here is stop")
                elif not self._history.recorded:
                    with suppress(OSError):
                        self._run.send(_STOP.encode())
        self._browsers.pop(viewer, None)

    async def finish(self) -> None:
        """Let browsers know that nothing more comes, and have it."""
        self._hand_out(pack({"kind": "over"}))
        await see_off(self._browsers)


async def see_off(viewers: Iterable[ServerConnection]) -> None:
    """Close connections, with a moment for what is on its way."""
    closing = [asyncio.ensure_future(viewer.close(1001, "the run is over")) for viewer in viewers]
    if closing:
        await asyncio.wait(closing, timeout=_DRAIN)


async def work(
    listener: socket.socket,
    run: socket.socket,
    token: str,
    made: Callable[[socket.socket, str], Viewers] = Server,
    subprotocols: Sequence[Subprotocol] | None = None,
    largest: int = 64,
) -> None:
    """Serve until the run ends; messages of viewers have at most `largest` bytes."""
    server = made(run, token)
    silent = logging.getLogger("palpate_live")  # foreign requests are not worth a note, and would fill a file
    silent.disabled = True
    async with serve(
        server.serve,
        sock=listener,
        process_request=server.admit,
        subprotocols=subprotocols,
        compression=None,
        logger=silent,
        max_size=largest,
        server_header=None,
        open_timeout=GREETING,
        close_timeout=_DRAIN,
        create_connection=GuardedConnection,
    ):
        if made is Server:  # once it serves; others have no stop that would have to be heard at once
            attend(asyncio.get_running_loop())
        await server.over.wait()
        await server.finish()


def process_arguments() -> tuple[socket.socket, socket.socket, str]:
    """Listener and socket of ``python -m MODULE LISTENER SOCKET``, and the token from standard input."""
    listener, run = (socket.socket(fileno=int(number)) for number in sys.argv[1:3])
    return listener, run, sys.stdin.readline().strip()


if __name__ == "__main__":
    asyncio.run(work(*process_arguments()))
