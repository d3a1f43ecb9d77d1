"""How to reach a ROS 2 system, who publishes in it, and which middleware its members speak."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from palpate_ros2.message_pipe import ReceivedMessage

Middleware = Literal["dds", "zenoh"]


@dataclass(frozen=True)
class Network:
    """How to reach the others."""

    domain: int = 0
    interface: str | None = None
    peers: tuple[str, ...] = ()
    reliable: bool = False
    history: int = 1000
    middleware: str = "dds"

    @property
    def nobody(self) -> str:
        """What to check where no publisher is found, in words."""
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
    """One writer of one topic."""

    topic: str
    type: str
    key: str
    participant: str
    reliable: bool
    alive: bool = True


class Talker(Protocol):
    """A member that publishes messages: of estimates, flags and alarms, and of nothing that moves."""

    def announce(self, topic: str, type_name: str, latched: bool = False) -> None:
        """Announce a topic, so that it is found before it sends; `latched`: late subscribers get the last message."""

    def send(self, topic: str, type_name: str, payload: bytes, latched: bool = False) -> None:
        """Publish a message."""

    def close(self) -> None:
        """Go."""


class Participant(Protocol):
    """A member that listens."""

    @property
    def talker(self) -> Talker:
        """The same member as one that publishes."""
        ...

    def wait(self, seconds: float) -> None:
        """Wait until a message comes, for so long [s] at most."""

    def news(self) -> Iterator[Publication]:
        """Writers of ROS topics that have come or gone since the last call."""
        ...

    def listen(self, number: int, topic: str, type_name: str, definition: str) -> None:
        """Take messages of a topic; raises LogError where its type cannot be had."""

    def messages(self) -> Iterator[ReceivedMessage]:
        """What has come since the last call."""
        ...


def demand_reachable(middleware: str, interface: str | None, peers: Sequence[str]) -> None:
    """Raise ValueError where addresses are not of the middleware."""
    if middleware == "zenoh" and interface is not None:
        raise ValueError('interface is of DDS; zenoh goes where peers say, such as "tcp/192.168.1.10:7447"')
    if middleware == "dds" and (wrong := next((peer for peer in peers if "/" in peer), None)):
        raise ValueError(f"peers of DDS are addresses without a protocol, such as 192.168.1.10, and not {wrong!r}")


def network_of(settings: Mapping[str, Any]) -> Network:
    """Return a network from plain settings."""
    peers: Sequence[str] = settings.get("peers", ())
    names = ("domain", "interface", "reliable", "history", "middleware")
    return Network(peers=tuple(peers), **{name: settings[name] for name in names})
