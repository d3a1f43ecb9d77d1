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

from palpate_live.page_server import close_viewers, listen, process_arguments, serve_run
from palpate_live.row_columns import COMMON, PER_TRACK

SUBPROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
# Choices.
_MAX_VIEWERS = 16
_MAX_WAITING = 8 << 20  # bytes for one viewer; 8 MB
_MAX_REQUEST = 1 << 16  # bytes of a request from a viewer
_KEPT_FLAGS = 2_000  # that a late viewer gets
_LATEST_KINDS = ("run", "health", "found", "guard", "result")  # messages of which a late viewer gets the latest

# Of the protocol: opcode 1, subscription and time [ns] before the bytes of a message, little-endian.
_MESSAGE_HEAD = struct.Struct("<BIQ")
_MESSAGE_OPCODE = 1
_MAX_SUBSCRIPTION = (1 << 32) - 1  # a uint32
_LEVELS = {"note": 2, "doubtful": 3, "invalid": 4}  # information, warning, error of foxglove.Log
_WARNING = 2  # level of a status for a viewer
_NANOSECONDS = 1_000_000_000  # of a second
_TIME_SCHEMA = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_LOG_SCHEMA = {
    "timestamp": _TIME_SCHEMA,
    **{name: {"type": "string"} for name in ("message", "name", "file")},
    **{name: {"type": "integer"} for name in ("level", "line")},
}

Entry = tuple[int, int, bytes]  # number of the channel, time [ns], message


def _json_bytes(value: Mapping[str, Any]) -> bytes:
    """Return JSON without blanks."""
    return json.dumps(value, separators=(",", ":")).encode()


class Channels:
    """The channels of a run, and the conversion of its messages to messages of channels."""

    def __init__(self) -> None:
        self.offered: list[dict[str, Any]] = []
        self._numbers: dict[str, int] = {}  # by topic
        self._tracks: list[tuple[str, int, list[str]]] = []  # topic, first column, names of the columns
        self._raised: dict[str | None, set[str]] = {}  # flags that were logged already, by track

    def begin(self, run: Header) -> None:
        """Offer the channels of a run."""
        self._tracks = []
        self._offer("/palpate/samples", "palpate.Samples", _number_schema(("time", *COMMON)))
        for track in run["tracks"]:
            parameters = [parameter["name"] for parameter in track["parameters"]]
            names = [*parameters, *(f"{name}_combined" for name in parameters), *PER_TRACK]
            topic = f"/palpate/estimates/{track['name']}"
            self._tracks.append((topic, track["begin"], names))
            self._offer(topic, "palpate.Estimates", _number_schema(("time", *names)))
        for kind in _LATEST_KINDS:
            self._offer(f"/palpate/{kind}", f"palpate.{kind.capitalize()}", {})
        self._offer("/palpate/flags", "foxglove.Log", _LOG_SCHEMA)

    @property
    def numbers(self) -> frozenset[int]:
        """Numbers of all channels."""
        return frozenset(self._numbers.values())

    def _offer(self, topic: str, schema_name: str, properties: Mapping[str, Any]) -> None:
        """Add a channel of JSON objects with these properties."""
        self._numbers[topic] = len(self.offered) + 1
        self.offered.append(
            {
                "id": self._numbers[topic],
                "topic": topic,
                "encoding": "json",
                "schemaName": schema_name,
                "schema": json.dumps({"type": "object", "properties": properties}),
                "schemaEncoding": "jsonschema",
            }
        )

    def entries(self, header: Header, rows: Rows | None, subscribed: set[int], now: int) -> Iterator[Entry]:
        """Yield the messages of channels for a message of the run at a time [ns]; of rows only subscribed ones."""
        kind = header["kind"]
        if kind == "rows" and rows is not None:
            yield from self._row_entries(header["stamp"] or now, rows, subscribed)
        elif kind == "flags":
            yield from self._flag_entries(header, now)
        elif kind in _LATEST_KINDS and self._numbers:
            yield self._numbers[f"/palpate/{kind}"], now, _json_bytes(header)

    def _row_entries(self, last_stamp: int, rows: Rows, subscribed: set[int]) -> Iterator[Entry]:
        """Yield rows by the channels of samples and tracks; `last_stamp` [ns] is that of the last row."""
        times, columns = rows
        stamps = [last_stamp - round(1e9 * (times[-1] - time)) for time in times]
        groups = [("/palpate/samples", 0, list(COMMON)), *self._tracks]
        for topic, first, names in groups:
            channel = self._numbers[topic]
            if channel not in subscribed:
                continue
            group_rows = columns[first : first + len(names)].T.tolist()
            for seconds, stamp, values in zip(times.tolist(), stamps, group_rows):
                finite = {name: value for name, value in zip(names, values) if math.isfinite(value)}
                yield channel, stamp, _json_bytes({"time": seconds, **finite})

    def _flag_entries(self, header: Header, now: int) -> Iterator[Entry]:
        """Yield each flag of a track once, when it rises, as a foxglove.Log at a time `now` [ns].

        `header` is the message with all current flags of the track, or of the record (None).
        """
        track = header["track"]
        flags = {flag["code"]: flag for flag in header["flags"]}
        previous, self._raised[track] = self._raised.get(track, set()), set(flags)
        seconds, nanoseconds = divmod(now, _NANOSECONDS)
        for code in flags.keys() - previous:
            flag = flags[code]
            log = {
                "timestamp": {"sec": seconds, "nsec": nanoseconds},
                "level": _LEVELS.get(flag["severity"], _LEVELS["doubtful"]),
                "name": track or "every track",
                "message": f"{code}: {flag['message']}",
                "file": "",
                "line": 0,
            }
            yield self._numbers["/palpate/flags"], now, _json_bytes(log)


def _number_schema(names: tuple[str, ...]) -> dict[str, Any]:
    """Return the properties of an object of numbers."""
    return {name: {"type": "number"} for name in names}


class Bridge:
    """The server of viewers, each with its subscriptions."""

    def __init__(self, run: socket.socket, token: str) -> None:
        self._token = token
        self._name, self._session = "", str(time.time_ns())
        self._channels = Channels()
        self._viewers: dict[ServerConnection, dict[int, int]] = {}  # numbers of subscriptions by channel
        self._latest: dict[tuple[str, str | None], Entry] = {}
        self._flags: deque[Entry] = deque(maxlen=_KEPT_FLAGS)
        self.over = asyncio.Event()
        listen(run, self._take, self.over)

    def _take(self, message: bytes) -> None:
        """Send a message of the run to the subscribed viewers, and keep it if a late viewer needs it.

        A message is a header, a JSON object of a kind, with or without rows of numbers. An entry is the number of a
        channel, the time [ns], and the JSON of the channel.
        """
        header, rows = unpack(message)
        if header["kind"] == "run":
            self._name = header["name"]
            self._channels.begin(header)
            for viewer in self._viewers:
                self._advertise(viewer)
        subscribed = {channel for subscriptions in self._viewers.values() for channel in subscriptions}
        for entry in self._channels.entries(header, rows, subscribed, time.time_ns()):
            if header["kind"] in _LATEST_KINDS:
                self._latest[header["kind"], header.get("track")] = entry
            elif header["kind"] == "flags":
                self._flags.append(entry)
            for viewer in list(self._viewers):
                self._send_entry(viewer, *entry)

    def _send_entry(self, viewer: ServerConnection, channel: int, stamp: int, message: bytes) -> None:
        """Send a message of a channel to a viewer that has subscribed, without waiting for it.

        A viewer that takes nothing for long is cut off, and may come again.
        """
        subscription = self._viewers[viewer].get(channel)
        if subscription is None:
            return
        if viewer.transport.get_write_buffer_size() > _MAX_WAITING:
            viewer.transport.abort()
        else:
            broadcast([viewer], _MESSAGE_HEAD.pack(_MESSAGE_OPCODE, subscription, stamp) + message)

    def _advertise(self, viewer: ServerConnection) -> None:
        """Send the list of channels to a viewer."""
        broadcast([viewer], json.dumps({"op": "advertise", "channels": self._channels.offered}))

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a refusal; None lets a WebSocket in."""
        return admit_viewer(request, self._token)

    async def serve(self, viewer: ServerConnection) -> None:
        """Send a viewer the channels, then the messages of those that it subscribes to."""
        if len(self._viewers) >= _MAX_VIEWERS:
            await viewer.close(1013, "too many viewers are connected")  # 1013: try again later
            return
        hello = {"op": "serverInfo", "name": f"palpate: {self._name}", "capabilities": [], "sessionId": self._session}
        broadcast([viewer], json.dumps(hello))
        self._viewers[viewer] = {}
        self._advertise(viewer)
        with suppress(ConnectionClosed):
            async for request in viewer:
                try:
                    self._answer(viewer, request)
                except (ValueError, LookupError, TypeError, RecursionError):
                    reason = "only subscribe and unsubscribe are supported here"
                    broadcast([viewer], json.dumps({"op": "status", "level": _WARNING, "message": reason}))
        self._viewers.pop(viewer, None)

    def _answer(self, viewer: ServerConnection, text: str | bytes) -> None:
        """Subscribe or unsubscribe a viewer; raises ValueError, LookupError or TypeError for any other request."""
        request, subscriptions = json.loads(text), self._viewers[viewer]
        if request["op"] == "subscribe":
            for subscription in request["subscriptions"]:
                self._subscribe(viewer, subscription["id"], subscription["channelId"])
        elif request["op"] == "unsubscribe":
            ended = set(request["subscriptionIds"])
            self._viewers[viewer] = {
                channel: number for channel, number in subscriptions.items() if number not in ended
            }
        else:
            raise ValueError("no other request is supported")

    def _subscribe(self, viewer: ServerConnection, subscription: Any, channel: Any) -> None:
        """Subscribe a viewer to a channel, and send it the messages that were kept.

        Raises IndexError or TypeError for a subscription that is not a uint32, ValueError for an unknown channel.
        """
        number = range(_MAX_SUBSCRIPTION + 1)[subscription]
        if channel not in self._channels.numbers:
            raise ValueError("no such channel")
        self._viewers[viewer][channel] = number
        for entry in (*self._latest.values(), *self._flags):
            if entry[0] == channel:
                self._send_entry(viewer, *entry)

    async def finish(self) -> None:
        """Close all connections."""
        await close_viewers(self._viewers)


if __name__ == "__main__":
    asyncio.run(serve_run(*process_arguments(), Bridge, SUBPROTOCOLS, _MAX_REQUEST))
