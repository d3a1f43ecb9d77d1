"""Gate of a page: who gets in is a browser on this machine, or at the other end of a tunnel, that knows the token."""

from __future__ import annotations

import asyncio
import hmac
import re
from collections.abc import Iterable, Mapping
from http import HTTPStatus
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import ClassVar

from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.protocol import State

# As a browser names this machine, whatever the port: `ssh -L 9000:127.0.0.1:8000` makes it another one.
_HERE = re.compile(r"(?:localhost|127\.0\.0\.1)(?::\d{1,5})?")
_TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
_UPLOT = ("uplot/uPlot.iife.min.js", "uplot/uPlot.min.css")
_SHARED = ("page.css", "charts.js", "numbers.js", "skin.js", "icon.svg", *_UPLOT)
DATA = "data"
GREETING = 2.0  # [s] in which a connection must have sent its request: a choice
_STRANGERS = 64  # connections that have not been let in yet; a browser opens about ten for a moment
Files = Mapping[str, Traversable]  # by their path below the token


class GuardedConnection(ServerConnection):
    """A connection; where too many have not shown the token yet, the oldest of them goes."""

    _strangers: ClassVar[list[ServerConnection]] = []  # of the process, which serves one page at a time

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See `asyncio.Protocol`."""
        super().connection_made(transport)
        strangers = [other for other in self._strangers if other.state is State.CONNECTING]
        for other in strangers[: max(len(strangers) - _STRANGERS + 1, 0)]:
            other.transport.abort()
        self._strangers[:] = [*strangers[-_STRANGERS + 1 :], self]


def page_files(package: str, names: Iterable[str]) -> Files:
    """Return the files of a page: its own, in the folder `static` of a package, and those that all pages share."""
    page_folder, shared_folder = files(package) / "static", files("palpate_kit.page") / "static"
    paths = {name: page_folder / name for name in names} | {name: shared_folder / name for name in _SHARED}
    return {"": paths.pop("index.html"), **paths}


def host_of(request: Request) -> str | None:
    """Return the host that a request is for, where it is this machine; a name that only leads here (DNS rebinding)
    is not."""
    hosts = request.headers.get_all("Host")
    return hosts[0] if len(hosts) == 1 and _HERE.fullmatch(hosts[0]) else None


def _stranger(request: Request, token: str) -> str | None:
    """Return why the address is not the one that the run has printed; None where it is."""
    token_of_path = request.path.removeprefix("/").partition("/")[0]
    if hmac.compare_digest(token_of_path.encode(errors="replace"), token.encode()):
        return None
    return "the address lacks the token that the run printed, or has that of another run"


def admit_viewer(request: Request, token: str) -> Response | None:
    """Return a refusal of who may not look on from a program of their own, at whatever origin; None lets a WebSocket
    in."""
    why = _stranger(request, token)
    if host_of(request) is None:
        why = "the data are served to localhost and 127.0.0.1 only"
    return None if why is None else response(HTTPStatus.FORBIDDEN, f"403: {why}\n".encode(), "text/plain")


def refusal(request: Request, token: str) -> str | None:
    """Return why a request gets nothing; None where it may pass."""
    host = host_of(request)
    if host is None:
        return "this page is served to localhost and 127.0.0.1 only"
    origins = request.headers.get_all("Origin")
    if any(origin != f"http://{host}" for origin in origins) or len(origins) > 1:
        return "requests from other pages are refused"
    if (why := _stranger(request, token)) is not None:
        return why
    _, _, path = request.path.removeprefix("/").partition("/")
    if path == DATA and not origins:
        return "data are for the page only"
    return None


def answer_request(request: Request, token: str, files: Files) -> Response | None:
    """Return the response to a request for one of the `files`; None for the page's own WebSocket, which is accepted."""
    problem = refusal(request, token)
    if problem is not None:
        return response(HTTPStatus.FORBIDDEN, f"403: {problem}\n".encode(), "text/plain")
    name = request.path.removeprefix("/").partition("/")[2]
    if name == DATA:
        return None
    if name not in files:
        return response(HTTPStatus.NOT_FOUND, b"404: no such page\n", "text/plain")
    file = files[name]
    return response(HTTPStatus.OK, file.read_bytes(), _TYPES[file.name.rpartition(".")[2]], host_of(request) or "")


def response(status: int, body: bytes, media_type: str, host: str = "") -> Response:
    """Return a response that makes the browser trust nothing but this page."""
    policy = (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        f"connect-src 'self'{f' ws://{host}' if host else ''}; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    headers = Headers(
        {
            "Content-Type": f"{media_type}; charset=utf-8",
            "Content-Length": str(len(body)),
            "Content-Security-Policy": policy,
            "Referrer-Policy": "no-referrer",
            "X-Frame-Options": "DENY",
            "X-Content-Type-Options": "nosniff",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
    )
    answer = HTTPStatus(status)
    return Response(answer.value, answer.phrase, headers, body)
