"""A member of a DDS domain, by Eclipse Cyclone: its publishers, and their messages as received bytes."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any
from xml.sax.saxutils import quoteattr

from palpate import DeviceError, LogError

from palpate_ros2.dds_types import message_class
from palpate_ros2.message_pipe import ReceivedMessage
from palpate_ros2.names import dds_topic, ros_topic, ros_type
from palpate_ros2.network import Network, Publication

_MAX_TAKEN = 256  # messages of a topic in one call, a choice: none waits long for those of another topic
_ACKNOWLEDGEMENT_TIME = 0.5  # [s], a choice: readers have so long for the last messages before their writer closes
_CACHE_DEPTH = 10  # messages that a writer keeps for slow readers: the default of ROS 2
_CONFIGURATION_VARIABLE = "CYCLONEDDS_URI"  # its configuration takes precedence
_SECOND = 1e9  # [ns]


def configuration(network: Network) -> str:
    """Return the configuration of Cyclone as XML: interface, peers in place of multicast, and no log."""
    interface = ""
    if network.interface:
        interface = f"<Interfaces><NetworkInterface name={quoteattr(network.interface)}/></Interfaces>"
    discovery, multicast = "", "spdp"  # spdp: multicast for discovery alone
    if network.peers:
        multicast = "false"
        peers = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in network.peers)
        discovery = f"<ParticipantIndex>auto</ParticipantIndex><Peers>{peers}</Peers>"
    general = f"<General>{interface}<AllowMulticast>{multicast}</AllowMulticast></General>"
    tracing = "<Tracing><Verbosity>none</Verbosity></Tracing>"  # else there is a line for each dropped message
    settings = f"{general}<Discovery>{discovery}</Discovery>{tracing}"
    return f'<CycloneDDS><Domain id="any">{settings}</Domain></CycloneDDS>'


@dataclass
class CycloneParticipant:
    """Member of a domain that listens."""

    network: Network
    _readers: dict[int, Any] = field(default_factory=dict)
    _keepalive: list[Any] = field(default_factory=list)  # objects that must live as long as the member

    def __post_init__(self) -> None:
        self._participant = open_participant(self.network, self._keepalive)
        from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
        from cyclonedds.core import WaitSet

        self.talker = CycloneTalker(self.network, self._participant)
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._wait_set = WaitSet(self._participant)
        self._alive: dict[str, Publication] = {}  # publishers by key

    def wait(self, seconds: float) -> None:
        """Wait until a message arrives, up to `seconds`."""
        if self._readers:
            self._wait_set.wait(round(_SECOND * seconds))
        else:
            time.sleep(seconds)

    def news(self) -> Iterator[Publication]:
        """Yield the publishers of ROS topics that have appeared or left since the last call."""
        from cyclonedds.core import InstanceState

        for entry in self._publications.take(_MAX_TAKEN):
            key = str(entry.key)
            if entry.sample_info.instance_state != InstanceState.Alive:
                publication = self._alive.pop(key, None)
                if publication is not None:
                    yield replace(publication, alive=False)
            elif key not in self._alive:
                publication = _publication_of(entry)
                if publication is not None:
                    self._alive[key] = publication
                    yield publication

    def listen(self, number: int, topic: str, type_name: str, definition: str) -> None:
        """Subscribe to a topic, whose messages get the topic's number; raises LogError for a type that DDS refuses."""
        from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        reliability = (
            Policy.Reliability.Reliable(max_blocking_time=0) if self.network.reliable else Policy.Reliability.BestEffort
        )
        qos = Qos(reliability, Policy.History.KeepLast(self.network.history))
        try:
            topic_entity = Topic(self._participant, dds_topic(topic), message_class(type_name, definition))
            reader = DataReader(self._participant, topic_entity, qos=qos)
        except (DDSException, TypeError, NotImplementedError) as error:
            raise LogError(f"{topic}: DDS cannot read messages of type {type_name}: {error}") from error
        condition = ReadCondition(reader, ViewState.Any | SampleState.Any | InstanceState.Any)
        self._wait_set.attach(condition)
        self._readers[number] = reader
        self._keepalive += [topic_entity, condition]

    def messages(self) -> Iterator[ReceivedMessage]:
        """Yield the messages that have arrived since the last call."""
        for number, reader in self._readers.items():
            for sample in reader.take(_MAX_TAKEN):
                arrival = time.monotonic_ns()
                yield ReceivedMessage(
                    topic=number,
                    arrival=arrival,
                    source=int(sample.sample_info.source_timestamp),
                    writer=int(sample.sample_info.publication_handle),
                    payload=bytes(sample.data) if sample.sample_info.valid_data else b"",
                )


def _publication_of(entry: Any) -> Publication | None:
    """Return the publisher that a sample of the built-in topic of publications announces; None if not of ROS."""
    from cyclonedds.qos import Policy

    topic = ros_topic(entry.topic_name or "")
    if topic is None:
        return None
    return Publication(
        topic=topic,
        type=ros_type(entry.type_name),
        key=str(entry.key),
        participant=str(entry.participant_key),
        reliable=any(isinstance(policy, Policy.Reliability.Reliable) for policy in entry.qos),
    )


class CycloneTalker:
    """Member of a domain that publishes estimates, flags and alarms, and nothing that moves a robot."""

    def __init__(self, network: Network, participant: Any = None) -> None:
        self._keepalive: list[Any] = []
        self._participant = open_participant(network, self._keepalive) if participant is None else participant
        self._writers: dict[str, tuple[Any, Any]] = {}  # topic of DDS and its writer, by ROS topic

    def announce(self, topic: str, type_name: str, latched: bool = False) -> None:
        """Announce a topic, so that it is found before it sends; `latched`: late subscribers get the last message."""
        self._writer(topic, type_name, latched)

    def _writer(self, topic: str, type_name: str, latched: bool) -> Any:
        """Return the writer of a topic, a new one at the first call."""
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.topic import Topic

        if topic not in self._writers:
            durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
            # A reader that does not keep up loses the oldest messages, and never holds up a run.
            history = Policy.History.KeepLast(1 if latched else _CACHE_DEPTH)
            qos = Qos(Policy.Reliability.Reliable(max_blocking_time=0), durability, history)
            topic_entity = Topic(self._participant, dds_topic(topic), message_class(type_name, ""))
            self._writers[topic] = topic_entity, DataWriter(self._participant, topic_entity, qos=qos)
        return self._writers[topic][1]

    def send(self, topic: str, type_name: str, payload: bytes, latched: bool = False) -> None:
        """Publish a message."""
        message_type = message_class(type_name, "")
        message = message_type.__new__(message_type)
        message.data = payload
        self._writer(topic, type_name, latched).write(message)

    def close(self) -> None:
        """Leave the system, once the readers that keep up have the last messages."""
        from cyclonedds.core import DDSException

        deadline = time.monotonic() + _ACKNOWLEDGEMENT_TIME
        for _, writer in self._writers.values():
            # A reader that does not keep up is not waited for; cyclonedds 11 reports that by an AttributeError.
            with suppress(DDSException, AttributeError):
                writer.wait_for_acks(max(0, round(_SECOND * (deadline - time.monotonic()))))
        self._writers.clear()


def open_participant(network: Network, keepalive: list[Any]) -> Any:
    """Return a new participant of a domain; raises DeviceError where DDS does not start.

    Objects that must live as long as the participant are added to `keepalive`.
    """
    try:
        from cyclonedds.core import DDSException
        from cyclonedds.domain import Domain, DomainParticipant
    except ImportError as error:
        raise DeviceError("ROS 2 topics need Cyclone DDS: pip install 'palpate[ros2]'") from error
    try:
        if _CONFIGURATION_VARIABLE not in os.environ:
            keepalive.append(Domain(network.domain, configuration(network)))
        return DomainParticipant(network.domain)
    except DDSException as error:
        where = f" on interface {network.interface!r}: is it there" if network.interface else ""
        raise DeviceError(f"DDS does not come up in domain {network.domain}{where} ({error})") from error
