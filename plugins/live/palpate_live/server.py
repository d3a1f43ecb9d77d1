"""The process that serves the page: datagrams in, browsers out. Started by the run, ended with it."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import sys
from contextlib import suppress

from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from palpate_live.gate import answer
from palpate_live.history import History
from palpate_live.wire import LARGEST, is_text, pack

_NICE = 5  # once it serves: with more, a busy computer would not let it begin
_MOST = 16  # browsers
_PATIENCE = 8 << 20  # bytes that wait for one browser, besides the history that it is given
_DRAIN = 1.0  # [s] for browsers to take what is left when the run has ended
_STOP = "stop"


class Server:
    """Browsers, what they missed, and the run's end of the socket."""

    def __init__(self, run: socket.socket, token: str) -> None:
        self._run, self._token = run, token
        self._history = History()
        self._browsers: dict[ServerConnection, int] = {}  # bytes of history that each was given
        self._stale = False  # whether rows have changed that browsers have
        self.over = asyncio.Event()
        run.setblocking(False)
        asyncio.get_running_loop().add_reader(run, self._take)

    def _take(self) -> None:
        """All that has come; an empty datagram is the run's end."""
        while True:
            try:
                message = self._run.recv(2 * LARGEST)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                asyncio.get_running_loop().remove_reader(self._run)
                self.over.set()
                return
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
        """The page and its files, or a refusal; None lets a WebSocket in."""
        return answer(request, self._token)

    async def serve(self, browser: ServerConnection) -> None:
        """One browser: the history, then what comes; all that it can say is `stop`."""
        if len(self._browsers) >= _MOST:
            await browser.close(1013, "too many pages are open")
            return
        given = 0
        for message in self._history.messages():
            self._write(browser, message)
            given += len(message)
        self._browsers[browser] = given
        with suppress(ConnectionClosed):
            async for said in browser:
                if said != _STOP:
                    await browser.close(1008, "the only word here is stop")
                elif not self._history.recorded:
                    with suppress(OSError):
                        self._run.send(_STOP.encode())
        self._browsers.pop(browser, None)

    async def finish(self) -> None:
        """Let browsers know that nothing more comes, and have it."""
        self._hand_out(pack({"kind": "over"}))
        closing = [asyncio.ensure_future(browser.close(1001, "the run is over")) for browser in self._browsers]
        if closing:
            await asyncio.wait(closing, timeout=_DRAIN)


async def work(listener: socket.socket, run: socket.socket, token: str) -> None:
    """Serve until the run ends."""
    server = Server(run, token)
    silent = logging.getLogger("palpate_live")  # strangers' requests are no news, and would fill a file
    silent.disabled = True
    async with serve(
        server.serve,
        sock=listener,
        process_request=server.admit,
        compression=None,
        logger=silent,
        max_size=64,
        server_header=None,
        close_timeout=_DRAIN,
    ):
        os.nice(_NICE)
        await server.over.wait()
        await server.finish()


def main() -> None:
    """``python -m palpate_live.server LISTENER SOCKET``, with the token on standard input."""
    listener, run = (socket.socket(fileno=int(number)) for number in sys.argv[1:3])
    asyncio.run(work(listener, run, sys.stdin.readline().strip()))


if __name__ == "__main__":
    main()
