"""Settings of the connection to a ROS 2 system, its publishers, and the interfaces of a member."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from palpate_ros2.message_pipe import ReceivedMessage

Middleware = Literal["dds", "zenoh"]


@dataclass(frozen=True)
class Network:
    """Settings by which a member reaches the others of a ROS 2 system."""

    domain: int = 0
    interface: str | None = None  # name, such as "eth0"; None: chosen by the middleware
    peers: tuple[str, ...] = ()  # addresses
    reliable: bool = False
    history: int = 1000  # messages of a topic that may wait to be read, a choice: 1 s of a sensor of 1 kHz
    middleware: str = "dds"

    @property
    def nobody(self) -> str:
        """Sentence that says what to check where no publisher is found."""
        if self.middleware == "zenoh":
            return (
                "is the domain right, as in ROS_DOMAIN_ID, and does the router run where peers state (ros2 run "
                "rmw_zenoh_cpp rmw_zenohd; by default localhost:7447)?"
            )
        return (
            "is the domain right, as in ROS_DOMAIN_ID, and is there multicast? else name interface and peers; with "
            'RMW_IMPLEMENTATION=rmw_zenoh_cpp set middleware = "zenoh"'
        )


@dataclass(frozen=True)
class Publication:
    """One publisher of one topic."""

    topic: str
    type: str
    key: str  # identifies the publisher
    participant: str
    reliable: bool
    alive: bool = True  # False: the publisher has left


class Talker(Protocol):
    """A member that publishes messages: of estimates, flags and alarms, and of nothing that moves."""

    def announce(self, topic: str, type_name: str, latched: bool = False) -> None:
        """Announce a topic, so that it is found before it sends; `latched`: late subscribers get the last message."""

    def send(self, topic: str, type_name: str, payload: bytes, latched: bool = False) -> None:
        """Publish a message."""

    def close(self) -> None:
        """Leave the system."""


class Participant(Protocol):
    """A member that listens."""

    @property
    def talker(self) -> Talker:
        """The interface by which the same member publishes."""
        ...

    def wait(self, seconds: float) -> None:
        """Wait until a message arrives, up to `seconds`."""

    def news(self) -> Iterator[Publication]:
        """Yield the publishers that have appeared or left since the last call."""
        ...

    def listen(self, number: int, topic: str, type_name: str, definition: str) -> None:
        """Subscribe to a topic, whose messages get the topic's number; raises LogError for a type that DDS refuses."""

    def messages(self) -> Iterator[ReceivedMessage]:
        """Yield the messages that have arrived since the last call."""
        ...


def demand_reachable(middleware: str, interface: str | None, peers: Sequence[str]) -> None:
    """Raise ValueError where interface or peers have the form of another middleware."""
    if middleware == "zenoh" and interface is not None:
        raise ValueError('interface is of DDS; zenoh goes where peers say, such as "tcp/192.168.1.10:7447"')
    peers_with_protocol = [peer for peer in peers if "/" in peer]
    if middleware == "dds" and peers_with_protocol:
        raise ValueError(
            f"peers of DDS are addresses without a protocol, such as 192.168.1.10, and not {peers_with_protocol[0]!r}"
        )


def network_of(settings: Mapping[str, Any]) -> Network:
    """Return the network of settings that were sent as JSON."""
    peers: Sequence[str] = settings.get("peers", ())
    names = ("domain", "interface", "reliable", "history", "middleware")
    return Network(peers=tuple(peers), **{name: settings[name] for name in names})
