"""DDS by Eclipse Cyclone: which topics there are, and their messages as they come."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.sax.saxutils import quoteattr

from palpate import DeviceError, LogError

from palpate_devices.ros2.frames import Arrived
from palpate_devices.ros2.idl import message_class
from palpate_devices.ros2.names import dds_topic, ros_topic, ros_type

_TAKEN = 256  # messages at a time
_CONFIGURED = "CYCLONEDDS_URI"  # whoever has configured Cyclone is not overruled


@dataclass(frozen=True)
class Network:
    """How to reach the others."""

    domain: int = 0
    interface: str | None = None
    peers: tuple[str, ...] = ()
    reliable: bool = False
    history: int = 1000

    @property
    def configuration(self) -> str:
        """What Cyclone is to do, as XML."""
        name = quoteattr(self.interface) if self.interface else ""
        interface = f"<Interfaces><NetworkInterface name={name}/></Interfaces>" if name else ""
        multicast = (
            "<AllowMulticast>spdp</AllowMulticast>" if not self.peers else "<AllowMulticast>false</AllowMulticast>"
        )
        general = f"<General>{interface}{multicast}</General>"
        peers = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in self.peers)
        found = f"<ParticipantIndex>auto</ParticipantIndex><Peers>{peers}</Peers>" if peers else ""
        return f'<CycloneDDS><Domain id="any">{general}<Discovery>{found}</Discovery></Domain></CycloneDDS>'


@dataclass(frozen=True)
class Publication:
    """One writer of one topic."""

    topic: str
    type: str
    key: str
    participant: str
    reliable: bool
    alive: bool = True


@dataclass
class Participant:
    """A member of a domain that only listens."""

    network: Network
    _readers: dict[int, Any] = field(default_factory=dict)
    _kept: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        try:
            from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
            from cyclonedds.core import DDSException, WaitSet
            from cyclonedds.domain import Domain, DomainParticipant
        except ImportError as error:
            raise DeviceError("ROS 2 topics need Cyclone DDS: pip install 'palpate[ros2]'") from error
        try:
            if _CONFIGURED not in os.environ:
                self._kept.append(Domain(self.network.domain, self.network.configuration))
            self._participant = DomainParticipant(self.network.domain)
        except DDSException as error:
            where = f" on interface {self.network.interface}" if self.network.interface else ""
            raise DeviceError(f"DDS does not come up in domain {self.network.domain}{where}: {error}") from error
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
            reliable = any(type(policy).__name__ == "Reliable" for policy in entry.qos)
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

    def messages(self) -> Iterator[Arrived]:
        """What has come since the last call."""
        for number, reader in self._readers.items():
            for sample in reader.take(_TAKEN):
                info, now = sample.sample_info, time.monotonic_ns()
                payload = bytes(sample.data) if info.valid_data else b""
                yield Arrived(number, now, int(info.source_timestamp), int(info.publication_handle), payload)


def network_of(settings: Mapping[str, Any]) -> Network:
    """A network from plain settings."""
    peers: Sequence[str] = settings.get("peers", ())
    return Network(
        settings["domain"], settings.get("interface"), tuple(peers), settings["reliable"], settings["history"]
    )
