"""DDS by Eclipse Cyclone: which topics there are, and their messages as they come."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any
from xml.sax.saxutils import quoteattr

from palpate import DeviceError, LogError

from palpate_ros2.dds_types import message_class
from palpate_ros2.message_pipe import ReceivedMessage
from palpate_ros2.names import dds_topic, ros_topic, ros_type
from palpate_ros2.network import Network, Publication

_TAKEN = 256  # messages at a time
_LAST = 0.5  # [s] that readers have for what was sent last, before its writer goes
_CONFIGURED = "CYCLONEDDS_URI"  # a configured Cyclone is not overruled


def configuration(network: Network) -> str:
    """What Cyclone is to do, as XML."""
    name = quoteattr(network.interface) if network.interface else ""
    interface = f"<Interfaces><NetworkInterface name={name}/></Interfaces>" if name else ""
    multicast = (
        "<AllowMulticast>spdp</AllowMulticast>" if not network.peers else "<AllowMulticast>false</AllowMulticast>"
    )
    general = f"<General>{interface}{multicast}</General>"
    peers = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in network.peers)
    found = f"<ParticipantIndex>auto</ParticipantIndex><Peers>{peers}</Peers>" if peers else ""
    quiet = "<Tracing><Verbosity>none</Verbosity></Tracing>"  # of each message that it drops it would write a line
    inside = f"{general}<Discovery>{found}</Discovery>{quiet}"
    return f'<CycloneDDS><Domain id="any">{inside}</Domain></CycloneDDS>'


@dataclass
class CycloneParticipant:
    """A member of a domain that only listens."""

    network: Network
    _readers: dict[int, Any] = field(default_factory=dict)
    _kept: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._participant = participant(self.network, self._kept)
        from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
        from cyclonedds.core import WaitSet

        self.talker = CycloneTalker(self.network, self._participant)
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._waiting = WaitSet(self._participant)
        self._known: dict[str, Publication] = {}

    def wait(self, seconds: float) -> None:
        """Wait until a message comes, for so long [s] at most."""
        if self._readers:
            self._waiting.wait(round(1e9 * seconds))
        else:
            time.sleep(seconds)

    def news(self) -> Iterator[Publication]:
        """Writers of ROS topics that have come or gone since the last call."""
        from cyclonedds.core import InstanceState
        from cyclonedds.qos import Policy

        for entry in self._publications.take(_TAKEN):
            info, key = entry.sample_info, str(entry.key)
            if info.instance_state != InstanceState.Alive:
                gone = self._known.pop(key, None)
                if gone is not None:
                    yield Publication(gone.topic, gone.type, key, gone.participant, gone.reliable, alive=False)
                continue
            topic = ros_topic(entry.topic_name or "")
            if topic is None or key in self._known:
                continue
            reliable = any(isinstance(policy, Policy.Reliability.Reliable) for policy in entry.qos)
            self._known[key] = Publication(topic, ros_type(entry.type_name), key, str(entry.participant_key), reliable)
            yield self._known[key]

    def listen(self, number: int, topic: str, type_name: str, definition: str) -> None:
        """Take messages of a topic; raises LogError where its type cannot be had."""
        from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        network = self.network
        reliability = Policy.Reliability.Reliable(0) if network.reliable else Policy.Reliability.BestEffort
        qos = Qos(reliability, Policy.History.KeepLast(network.history))
        try:
            made = Topic(self._participant, dds_topic(topic), message_class(type_name, definition))
            reader = DataReader(self._participant, made, qos=qos)
        except (DDSException, TypeError, NotImplementedError) as error:
            raise LogError(f"{topic}: DDS cannot read messages of type {type_name}: {error}") from error
        condition = ReadCondition(reader, ViewState.Any | SampleState.Any | InstanceState.Any)
        self._waiting.attach(condition)
        self._readers[number] = reader
        self._kept += [made, condition]

    def messages(self) -> Iterator[ReceivedMessage]:
        """What has come since the last call."""
        for number, reader in self._readers.items():
            for sample in reader.take(_TAKEN):
                info, now = sample.sample_info, time.monotonic_ns()
                payload = bytes(sample.data) if info.valid_data else b""
                yield ReceivedMessage(number, now, int(info.source_timestamp), int(info.publication_handle), payload)


class CycloneTalker:
    """A member of a domain that publishes messages: of estimates, flags and alarms, and of nothing that moves."""

    def __init__(self, network: Network, member: Any = None) -> None:
        self._kept: list[Any] = []
        self._participant = participant(network, self._kept) if member is None else member
        self._writers: dict[str, tuple[Any, Any]] = {}

    def announce(self, topic: str, type_name: str, latched: bool = False) -> None:
        """Announce a topic, so that it is found before it sends; `latched`: late subscribers get the last message."""
        self._writer(topic, type_name, latched)

    def _writer(self, topic: str, type_name: str, latched: bool) -> Any:
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.topic import Topic

        if topic not in self._writers:
            durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
            # A reader that does not keep up loses the oldest, and never holds up a run.
            qos = Qos(Policy.Reliability.Reliable(0), durability, Policy.History.KeepLast(1 if latched else 10))
            made = Topic(self._participant, dds_topic(topic), message_class(type_name, ""))
            self._writers[topic] = made, DataWriter(self._participant, made, qos=qos)
        return self._writers[topic][1]

    def send(self, topic: str, type_name: str, payload: bytes, latched: bool = False) -> None:
        """Publish a message."""
        kind = message_class(type_name, "")
        message = kind.__new__(kind)
        message.data = payload
        self._writer(topic, type_name, latched).write(message)

    def close(self) -> None:
        """Go, once who keeps up has the last messages."""
        from cyclonedds.core import DDSException

        until = time.monotonic() + _LAST
        for _, writer in self._writers.values():
            # Who does not keep up is not waited for; cyclonedds 11 stumbles over its own way to say so.
            with suppress(DDSException, AttributeError):
                writer.wait_for_acks(max(0, round(1e9 * (until - time.monotonic()))))
        self._writers.clear()


def participant(network: Network, kept: list[Any]) -> Any:
    """Return a member of a domain; what must live as long goes to `kept`. Raises DeviceError."""
    try:
        from cyclonedds.core import DDSException
        from cyclonedds.domain import Domain, DomainParticipant
    except ImportError as error:
        raise DeviceError("ROS 2 topics need Cyclone DDS: pip install 'palpate[ros2]'") from error
    try:
        if _CONFIGURED not in os.environ:
            kept.append(Domain(network.domain, configuration(network)))
        return DomainParticipant(network.domain)
    except DDSException as error:
        where = f" on interface {network.interface!r}: is it there" if network.interface else ""
        raise DeviceError(f"DDS does not come up in domain {network.domain}{where} ({error})") from error
