"""Topics of rmw_zenoh, by eclipse-zenoh: a member of the network that needs no ROS installation."""

from __future__ import annotations

import json
import os
import time
from collections import defaultdict, deque
from collections.abc import Iterator
from typing import Any

from palpate import DeviceError, epoch_offset

from palpate_ros2.message_pipe import ReceivedMessage
from palpate_ros2.names import dds_type
from palpate_ros2.network import Network, Publication
from palpate_ros2.type_hash import type_hash
from palpate_ros2.zenoh_names import (
    NO_HASH,
    attachment,
    data_key,
    identity,
    node_token,
    publication_of,
    publisher_token,
    read_attachment,
    tokens_of_publishers,
)

_CONFIGURED = "ZENOH_SESSION_CONFIG_URI"  # as in rmw_zenoh; a configured zenoh is not overruled
_ROUTER = "tcp/localhost:7447"  # where rmw_zenoh has its router
_PORT = 7447
_CONNECTING = 500  # [ms] that others may take at once; later ones are tried on and on
_LOOK = 0.003  # [s]
_EMPTY = b"\0"  # a message of nothing, which is not counted, and no sign that its writer has gone
_NAME = "palpate"


class ZenohParticipant:
    """A member that only listens."""

    def __init__(self, network: Network) -> None:
        self._network, self._session = network, session(network)
        self.talker = ZenohTalker(network, self._session)
        self._queues: dict[int, deque[tuple[int, Any]]] = {}
        self._numbers: dict[str, int] = {}  # of topics that are listened to
        self._writers: defaultdict[str, set[int]] = defaultdict(set)
        self._left: list[ReceivedMessage] = []
        self._tokens: deque[Any] = deque()
        self._known: dict[str, Publication] = {}
        tokens = tokens_of_publishers(network.domain)
        self._kept = [self._session.liveliness().declare_subscriber(tokens, self._tokens.append, history=True)]

    def wait(self, seconds: float) -> None:
        """Wait for a moment; messages get their time in zenoh's own threads, so that to wake for each would be vain."""
        time.sleep(min(seconds, _LOOK))

    def news(self) -> Iterator[Publication]:
        """Writers of ROS topics that have come or gone since the last call."""
        from zenoh import SampleKind

        while self._tokens:
            sample = self._tokens.popleft()
            key = str(sample.key_expr)
            found = publication_of(key)
            if found is None:
                continue
            if sample.kind == SampleKind.DELETE:
                if self._known.pop(key, None) is not None:
                    self._leave(found.topic)
                    yield Publication(found.topic, found.type, key, found.participant, found.reliable, alive=False)
            elif key not in self._known:
                self._known[key] = found
                yield found

    def _leave(self, topic: str) -> None:
        """A publisher of a topic has gone, where none is left; which of several, a token does not state."""
        if topic in self._numbers and all(other.topic != topic for other in self._known.values()):
            gone = self._writers.pop(topic, set())
            now = time.monotonic_ns()
            self._left += [ReceivedMessage(self._numbers[topic], now, 0, writer, b"") for writer in sorted(gone)]

    def listen(self, number: int, topic: str, type_name: str, definition: str) -> None:
        """Take messages of a topic, whatever the hash of its type."""
        queue: deque[tuple[int, Any]] = deque(maxlen=self._network.history)

        def come(sample: Any) -> None:  # in a thread of zenoh's
            queue.append((time.monotonic_ns(), sample))

        self._queues[number], self._numbers[topic] = queue, number
        key = data_key(self._network.domain, topic, type_name, "*")
        self._kept.append(self._session.declare_subscriber(key, come))

    def messages(self) -> Iterator[ReceivedMessage]:
        """What has come since the last call."""
        for topic, number in self._numbers.items():
            queue = self._queues[number]
            for _ in range(len(queue)):
                arrival, sample = queue.popleft()
                said = read_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
                source, writer = said or (arrival + epoch_offset(), 0)
                self._writers[topic].add(writer)
                yield ReceivedMessage(number, arrival, source, writer, sample.payload.to_bytes() or _EMPTY)
        yield from self._left
        self._left.clear()


class ZenohTalker:
    """A member that publishes."""

    def __init__(self, network: Network, opened: Any = None) -> None:
        self._domain = network.domain
        self._session = session(network) if opened is None else opened
        self._kept: list[Any] = []
        self._writers: dict[str, tuple[bytes, list[Any]]] = {}
        self._sent: defaultdict[str, int] = defaultdict(int)

    def announce(self, topic: str, type_name: str, latched: bool = False) -> None:
        """Announce a topic; subscribers from Humble, where types have no hash, are served, too."""
        from zenoh import ext

        if topic in self._writers:
            return
        zid, alive = str(self._session.zid()), self._session.liveliness()
        if not self._writers:
            self._kept.append(alive.declare_token(node_token(self._domain, zid, _NAME)))
        hashes = type_hash(type_name), NO_HASH
        entity, kind = len(self._writers) + 1, f"{dds_type(type_name)}/{hashes[0]}"
        token = publisher_token(self._domain, zid, entity, _NAME, topic, kind, latched)
        cache = ext.CacheConfig(1) if latched else None
        keys = [data_key(self._domain, topic, type_name, text) for text in hashes]
        writers = [
            ext.declare_advanced_publisher(self._session, key, cache=cache, publisher_detection=latched) for key in keys
        ]
        self._kept.append(alive.declare_token(token))
        self._writers[topic] = identity(token), writers

    def send(self, topic: str, type_name: str, payload: bytes, latched: bool = False) -> None:
        """Publish a message; a subscriber that does not keep up loses it, and never delays a run."""
        self.announce(topic, type_name, latched)
        who, writers = self._writers[topic]
        self._sent[topic] += 1
        extra = attachment(self._sent[topic], time.time_ns(), who)
        for writer in writers:  # no listener, nothing sent
            writer.put(payload, attachment=extra)

    def close(self) -> None:
        """Go, once everything is on its way."""
        self._session.close()


def session(network: Network) -> Any:
    """Return a session of zenoh's, as rmw_zenoh opens it: a peer that knows the router; raises DeviceError."""
    try:
        import zenoh
    except ImportError as error:
        raise DeviceError("topics of rmw_zenoh need zenoh: pip install 'palpate[zenoh]'") from error
    try:
        return zenoh.open(_configuration(network))
    except (zenoh.ZError, OSError) as error:
        why = str(error).partition(" at /")[0]  # and where in zenoh's source
        where = f" as {_CONFIGURED} says ({os.environ[_CONFIGURED]})" if _CONFIGURED in os.environ else ""
        raise DeviceError(f"zenoh does not come up{where}: {why}; peers are {_peers(network)}") from error


def _configuration(network: Network) -> Any:
    from zenoh import Config

    if _CONFIGURED in os.environ:
        return Config.from_file(os.environ[_CONFIGURED])
    config = Config()
    settings = {
        "mode": "peer",
        "connect/endpoints": _peers(network),
        "connect/timeout_ms": _CONNECTING,
        "connect/exit_on_failure": False,
        "listen/endpoints": ["tcp/localhost:0"],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,  # for the latched ones
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _peers(network: Network) -> list[str]:
    return [endpoint(peer) for peer in network.peers] or [_ROUTER]


def endpoint(peer: str) -> str:
    """Where zenoh finds a peer.

    >>> endpoint("192.168.1.10"), endpoint("robot:7448"), endpoint("udp/robot:7447")
    ('tcp/192.168.1.10:7447', 'tcp/robot:7448', 'udp/robot:7447')
    """
    if "/" in peer:
        return peer
    return f"tcp/{peer}" if ":" in peer else f"tcp/{peer}:{_PORT}"
