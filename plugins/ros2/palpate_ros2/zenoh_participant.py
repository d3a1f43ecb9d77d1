"""Topics of rmw_zenoh, by eclipse-zenoh: a member of the network that needs no ROS installation."""

from __future__ import annotations

import json
import os
import time
from collections import defaultdict, deque
from collections.abc import Iterator
from dataclasses import replace
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

_CONFIGURATION_VARIABLE = "ZENOH_SESSION_CONFIG_URI"  # as in rmw_zenoh; its configuration takes precedence
_PORT = 7447  # of the router of rmw_zenoh
_ROUTER = f"tcp/localhost:{_PORT}"
_CONNECTION_TIME = 500  # [ms] that the start waits for peers, a choice; zenoh tries the others again later
_MAX_WAIT = 0.003  # [s] between two looks for messages, a choice: latency against load
_EMPTY_MESSAGE = b"\0"  # in place of an empty payload, which would say that the writer has left
_NODE_NAME = "palpate"


class ZenohParticipant:
    """Member of a zenoh network that listens."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self._session = open_session(network)
        self.talker = ZenohTalker(network, self._session)
        self._queues: dict[int, deque[tuple[int, Any]]] = {}  # by number of a topic: times of arrival [ns] and samples
        self._numbers: dict[str, int] = {}  # of the subscribed topics
        self._writers: defaultdict[str, set[int]] = defaultdict(set)  # by topic: numbers of those that have sent
        self._farewells: list[ReceivedMessage] = []  # of writers that have left
        self._token_samples: deque[Any] = deque()
        self._alive: dict[str, Publication] = {}  # publishers by token
        liveliness, tokens = self._session.liveliness(), tokens_of_publishers(network.domain)
        # Subscribers must live as long as the member.
        self._subscribers = [liveliness.declare_subscriber(tokens, self._token_samples.append, history=True)]

    def wait(self, seconds: float) -> None:
        """Wait up to `seconds`, at most `_MAX_WAIT`; messages get their time of arrival in zenoh's threads."""
        time.sleep(min(seconds, _MAX_WAIT))

    def news(self) -> Iterator[Publication]:
        """Yield the publishers that have appeared or left since the last call."""
        from zenoh import SampleKind

        while self._token_samples:
            sample = self._token_samples.popleft()
            token = str(sample.key_expr)
            publication = publication_of(token)
            if publication is None:
                continue
            if sample.kind == SampleKind.DELETE:
                if self._alive.pop(token, None) is not None:
                    self._say_farewell(publication.topic)
                    yield replace(publication, alive=False)
            elif token not in self._alive:
                self._alive[token] = publication
                yield publication

    def _say_farewell(self, topic: str) -> None:
        """Queue an empty message of each writer of a topic, once its last publisher has left.

        As long as others publish it nothing is queued, since a token does not state which writer it was.
        """
        if topic in self._numbers and all(publication.topic != topic for publication in self._alive.values()):
            writers = self._writers.pop(topic, set())
            now = time.monotonic_ns()
            number = self._numbers[topic]
            self._farewells += [ReceivedMessage(number, now, 0, writer, b"") for writer in sorted(writers)]

    def listen(self, number: int, topic: str, type_name: str, definition: str) -> None:
        """Subscribe to a topic, whatever the hash of its type; its messages get its number."""
        queue: deque[tuple[int, Any]] = deque(maxlen=self._network.history)

        def receive(sample: Any) -> None:  # called in a thread of zenoh
            queue.append((time.monotonic_ns(), sample))

        self._queues[number] = queue
        self._numbers[topic] = number
        key = data_key(self._network.domain, topic, type_name, "*")
        self._subscribers.append(self._session.declare_subscriber(key, receive))

    def messages(self) -> Iterator[ReceivedMessage]:
        """Yield the messages that have arrived since the last call."""
        for topic, number in self._numbers.items():
            queue = self._queues[number]
            for _ in range(len(queue)):
                arrival, sample = queue.popleft()
                origin = read_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
                source, writer = origin or (arrival + epoch_offset(), 0)  # without an attachment: time of arrival
                self._writers[topic].add(writer)
                yield ReceivedMessage(number, arrival, source, writer, sample.payload.to_bytes() or _EMPTY_MESSAGE)
        yield from self._farewells
        self._farewells.clear()


class ZenohTalker:
    """Member of a zenoh network that publishes."""

    def __init__(self, network: Network, session: Any = None) -> None:
        self._domain = network.domain
        self._session = open_session(network) if session is None else session
        self._held_tokens: list[Any] = []  # a token lives as long as its object
        self._writers: dict[str, tuple[bytes, list[Any]]] = {}  # by topic: identity, and publishers of zenoh
        self._sent: defaultdict[str, int] = defaultdict(int)  # messages by topic

    def announce(self, topic: str, type_name: str, latched: bool = False) -> None:
        """Announce a topic under two keys: by the hash of its type, and for subscribers from Humble without one."""
        from zenoh import ext

        if topic in self._writers:
            return
        session_id = str(self._session.zid())
        liveliness = self._session.liveliness()
        if not self._writers:
            self._held_tokens.append(liveliness.declare_token(node_token(self._domain, session_id, _NODE_NAME)))
        hash_of_type = type_hash(type_name)
        token = publisher_token(
            self._domain,
            session_id,
            entity=len(self._writers) + 1,
            node_name=_NODE_NAME,
            topic=topic,
            type_and_hash=f"{dds_type(type_name)}/{hash_of_type}",
            latched=latched,
        )
        cache = ext.CacheConfig(1) if latched else None
        keys = [data_key(self._domain, topic, type_name, text) for text in (hash_of_type, NO_HASH)]
        writers = [
            ext.declare_advanced_publisher(self._session, key, cache=cache, publisher_detection=latched) for key in keys
        ]
        # The token last, so that a subscriber that sees it finds the publishers.
        self._held_tokens.append(liveliness.declare_token(token))
        self._writers[topic] = identity(token), writers

    def send(self, topic: str, type_name: str, payload: bytes, latched: bool = False) -> None:
        """Publish a message; a subscriber that does not keep up loses it, and never delays a run."""
        self.announce(topic, type_name, latched)
        writer_identity, writers = self._writers[topic]
        self._sent[topic] += 1
        origin = attachment(self._sent[topic], time.time_ns(), writer_identity)
        for writer in writers:  # zenoh sends nothing where nobody subscribes
            writer.put(payload, attachment=origin)

    def close(self) -> None:
        """Close the session; zenoh sends what is queued first."""
        self._session.close()


def open_session(network: Network) -> Any:
    """Return a session of zenoh as rmw_zenoh opens it, a peer that knows the router; raises DeviceError."""
    try:
        import zenoh
    except ImportError as error:
        raise DeviceError("topics of rmw_zenoh need zenoh: pip install 'palpate[zenoh]'") from error
    try:
        return zenoh.open(_configuration(network))
    except (zenoh.ZError, OSError) as error:
        cause = str(error).partition(" at /")[0]  # without the place in zenoh's source
        where = ""
        if _CONFIGURATION_VARIABLE in os.environ:
            where = f" as {_CONFIGURATION_VARIABLE} says ({os.environ[_CONFIGURATION_VARIABLE]})"
        raise DeviceError(f"zenoh does not come up{where}: {cause}; peers are {_endpoints(network)}") from error


def _configuration(network: Network) -> Any:
    """Return the configuration of a session: the user's if there is one, else the network's peers or the router."""
    from zenoh import Config

    if _CONFIGURATION_VARIABLE in os.environ:
        return Config.from_file(os.environ[_CONFIGURATION_VARIABLE])
    config = Config()
    settings = {
        "mode": "peer",
        "connect/endpoints": _endpoints(network),
        "connect/timeout_ms": _CONNECTION_TIME,
        "connect/exit_on_failure": False,
        "listen/endpoints": ["tcp/localhost:0"],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,  # the cache of latched topics needs it
    }
    for key, setting in settings.items():
        config.insert_json5(key, json.dumps(setting))
    return config


def _endpoints(network: Network) -> list[str]:
    """Return the endpoints to connect to: the peers, else the router on this computer."""
    return [endpoint(peer) for peer in network.peers] or [_ROUTER]


def endpoint(peer: str) -> str:
    """Return the endpoint of a peer, with the protocol and the port that are left out.

    >>> endpoint("192.168.1.10"), endpoint("robot:7448"), endpoint("udp/robot:7447")
    ('tcp/192.168.1.10:7447', 'tcp/robot:7448', 'udp/robot:7447')
    """
    if "/" in peer:
        return peer
    return f"tcp/{peer}" if ":" in peer else f"tcp/{peer}:{_PORT}"
