"""The process that serves a run to Foxglove: datagrams in, channels of JSON out; it accepts no other request.

Foxglove's WebSocket protocol, of which palpate implements what a viewer needs: serverInfo without any ability,
advertise, subscribe, unsubscribe, and message data (opcode 1, uint32 subscription, uint64 time [ns], the message).
"""

from __future__ import annotations

import asyncio
import json
import math
import socket
import struct
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from palpate_kit.page.datagrams import Header, Rows, unpack
from palpate_kit.page.gate import admit_viewer
from websockets.asyncio.server import ServerConnection, broadcast
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from palpate_live.page_server import listen, process_arguments, see_off, work
from palpate_live.row_columns import COMMON, PER_TRACK

SUBPROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
_MOST = 16  # viewers
_PATIENCE = 8 << 20  # bytes that wait for one viewer
_LARGEST = 1 << 16  # bytes of what a viewer may say
_DATA = struct.Struct("<BIQ")
_MESSAGE = 1  # opcode
_LEVELS = {"note": 2, "doubtful": 3, "invalid": 4}  # information, warning, error of foxglove.Log
_LATEST = ("run", "health", "found", "guard", "result")  # kinds of which a late viewer gets the latest
_LOGGED = 2_000  # flags that a late viewer gets
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_LOG = {
    "timestamp": _TIME,
    **{name: {"type": "string"} for name in ("message", "name", "file")},
    **{name: {"type": "integer"} for name in ("level", "line")},
}

Entry = tuple[int, int, bytes]  # number of the channel, time [ns], message


class Channels:
    """The available channels, and each message of the run as messages of channels."""

    def __init__(self) -> None:
        self.offered: list[dict[str, Any]] = []
        self._numbers: dict[str, int] = {}
        self._tracks: list[tuple[str, int, list[str]]] = []  # topic, first column, names of the columns
        self._up: dict[str | None, set[str]] = {}  # flags that were logged already, by track

    def begin(self, run: Header) -> None:
        """Offer the channels of a run."""
        self._tracks = []
        self._offer("/palpate/samples", "palpate.Samples", ("time", *COMMON))
        for track in run["tracks"]:
            parameters = [p["name"] for p in track["parameters"]]
            names = [*parameters, *(f"{name}_combined" for name in parameters), *PER_TRACK]
            topic = f"/palpate/estimates/{track['name']}"
            self._tracks.append((topic, track["begin"], names))
            self._offer(topic, "palpate.Estimates", ("time", *names))
        for kind in _LATEST:
            self._offer(f"/palpate/{kind}", f"palpate.{kind.capitalize()}", ())
        self._offer("/palpate/flags", "foxglove.Log", (), _LOG)

    @property
    def numbers(self) -> frozenset[int]:
        """Of all channels."""
        return frozenset(self._numbers.values())

    def _offer(self, topic: str, name: str, numbers: tuple[str, ...], keys: Mapping[str, Any] | None = None) -> None:
        schema = {"type": "object", "properties": keys or {name: {"type": "number"} for name in numbers}}
        self._numbers[topic] = len(self.offered) + 1
        self.offered.append(
            {
                "id": self._numbers[topic],
                "topic": topic,
                "encoding": "json",
                "schemaName": name,
                "schema": json.dumps(schema),
                "schemaEncoding": "jsonschema",
            }
        )

    def told(self, header: Header, rows: Rows | None, wanted: set[int], now: int) -> Iterator[Entry]:
        """Contents of a message of the run; of rows only what is subscribed to."""
        kind = header["kind"]
        if kind == "rows" and rows is not None:
            yield from self._rows(header["stamp"] or now, rows, wanted)
        elif kind == "flags":
            yield from self._flags(header, now)
        elif kind in _LATEST and self._numbers:
            yield self._numbers[f"/palpate/{kind}"], now, json.dumps(header, separators=(",", ":")).encode()

    def _rows(self, stamp: int, rows: Rows, wanted: set[int]) -> Iterator[Entry]:
        times, columns = rows
        stamps = [stamp - round(1e9 * (times[-1] - at)) for at in times]
        groups = [("/palpate/samples", 0, list(COMMON)), *self._tracks]
        for topic, first, names in groups:
            if (number := self._numbers[topic]) not in wanted:
                continue
            for at, when, values in zip(times.tolist(), stamps, columns[first : first + len(names)].T.tolist()):
                known = {name: value for name, value in zip(names, values) if math.isfinite(value)}
                yield number, when, json.dumps({"time": at, **known}, separators=(",", ":")).encode()

    def _flags(self, header: Header, now: int) -> Iterator[Entry]:
        """Yield each flag once, when it rises."""
        track, flags = header["track"], {flag["code"]: flag for flag in header["flags"]}
        before, self._up[track] = self._up.get(track, set()), set(flags)
        seconds, rest = divmod(now, 1_000_000_000)
        for code in flags.keys() - before:
            words = {"name": track or "every track", "message": f"{code}: {flags[code]['message']}"}
            level = _LEVELS.get(flags[code]["severity"], _LEVELS["doubtful"])
            log = {"timestamp": {"sec": seconds, "nsec": rest}, "level": level, **words, "file": "", "line": 0}
            yield self._numbers["/palpate/flags"], now, json.dumps(log, separators=(",", ":")).encode()


class Bridge:
    """Viewers with what each has subscribed to."""

    def __init__(self, run: socket.socket, token: str) -> None:
        self._token = token
        self._name, self._session = "", str(time.time_ns())
        self._channels = Channels()
        self._viewers: dict[ServerConnection, dict[int, int]] = {}  # numbers of subscriptions by channel
        self._latest: dict[tuple[str, str | None], Entry] = {}
        self._flags: deque[Entry] = deque(maxlen=_LOGGED)
        self.over = asyncio.Event()
        listen(run, self._take, self.over)

    def _take(self, message: bytes) -> None:
        header, rows = unpack(message)
        if header["kind"] == "run":
            self._name = header["name"]
            self._channels.begin(header)
            for viewer in self._viewers:
                self._advertise(viewer)
        wanted = {channel for subscribed in self._viewers.values() for channel in subscribed}
        for entry in self._channels.told(header, rows, wanted, time.time_ns()):
            if header["kind"] in _LATEST:
                self._latest[header["kind"], header.get("track")] = entry
            elif header["kind"] == "flags":
                self._flags.append(entry)
            for viewer in list(self._viewers):
                self._give(viewer, *entry)

    def _give(self, viewer: ServerConnection, channel: int, when: int, message: bytes) -> None:
        """Without waiting for the viewer; one that takes nothing for long is sent away, and may come again."""
        if (subscription := self._viewers[viewer].get(channel)) is None:
            return
        if viewer.transport.get_write_buffer_size() > _PATIENCE:
            viewer.transport.abort()
        else:
            broadcast([viewer], _DATA.pack(_MESSAGE, subscription, when) + message)

    def _advertise(self, viewer: ServerConnection) -> None:
        broadcast([viewer], json.dumps({"op": "advertise", "channels": self._channels.offered}))

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a refusal; None lets a WebSocket in."""
        return admit_viewer(request, self._token)

    async def serve(self, viewer: ServerConnection) -> None:
        """One viewer: what there is, then what it subscribes to."""
        if len(self._viewers) >= _MOST:
            await viewer.close(1013, "too many viewers are connected")
            return
        hello = {"op": "serverInfo", "name": f"palpate: {self._name}", "capabilities": [], "sessionId": self._session}
        broadcast([viewer], json.dumps(hello))
        self._viewers[viewer] = {}
        self._advertise(viewer)
        with suppress(ConnectionClosed):
            async for said in viewer:
                try:
                    self._heard(viewer, said)
                except (ValueError, LookupError, TypeError, RecursionError):
                    told = {"op": "status", "level": 2, "message": "only subscribe and unsubscribe are supported here"}
                    broadcast([viewer], json.dumps(told))
        self._viewers.pop(viewer, None)

    def _heard(self, viewer: ServerConnection, said: str | bytes) -> None:
        """Subscribe or unsubscribe; raises ValueError and the like for all else."""
        asked, own = json.loads(said), self._viewers[viewer]
        if asked["op"] == "subscribe":
            for wish in asked["subscriptions"]:
                number, channel = range(1 << 32)[wish["id"]], wish["channelId"]
                if channel not in self._channels.numbers:
                    raise ValueError("no such channel")
                own[channel] = number
                for entry in (*self._latest.values(), *self._flags):
                    if entry[0] == channel:
                        self._give(viewer, *entry)
        elif asked["op"] == "unsubscribe":
            gone = set(asked["subscriptionIds"])
            self._viewers[viewer] = {channel: number for channel, number in own.items() if number not in gone}
        else:
            raise ValueError("no other request is supported")

    async def finish(self) -> None:
        """Close all connections."""
        await see_off(self._viewers)


if __name__ == "__main__":
    asyncio.run(work(*process_arguments(), Bridge, SUBPROTOCOLS, _LARGEST))
