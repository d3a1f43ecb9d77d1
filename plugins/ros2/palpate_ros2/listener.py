"""Listening to a domain: the process that does it, and its reports."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any

from palpate import DeviceError
from palpate_kit.acquisition.child import Child
from palpate_records.messages.definitions import short_name
from palpate_records.messages.standard_types import STANDARD_TYPES

from palpate_ros2.message_pipe import Inlet, ReceivedMessage, message_pipe
from palpate_ros2.network import Network
from palpate_ros2.topic_snapshot import TopicSnapshot

_MODULE = "palpate_ros2.worker"
_READY = 30.0  # [s]; a busy host takes seconds to start a process
_LOOK = 0.005  # [s]


@dataclass
class Listener:
    """The process that listens, and what it has found out."""

    child: Child
    inlet: Inlet
    network: Network
    scheduling: str
    topics: dict[int, str] = field(default_factory=dict)  # that are listened to, by number
    publications: dict[str, dict[str, Any]] = field(default_factory=dict)  # by key
    problems: dict[str, str] = field(default_factory=dict)  # by topic: why it cannot be read

    def news(self) -> list[dict[str, Any]]:
        """Writers that have come or gone since the last call; raises DeviceError where the process has failed."""
        found = [message for message in self.child.messages() if message["say"] == "publication"]
        for message in found:
            if message["alive"]:
                self.publications[message["key"]] = message
            else:
                self.publications.pop(message["key"], None)
            if message["number"] is not None:
                self.topics[message["number"]] = message["topic"]
            if message["problem"] is not None:
                self.problems[message["topic"]] = message["problem"]
        self.child.check()
        return found

    @property
    def types(self) -> Mapping[str, str]:
        """The types of published topics."""
        return {entry["topic"]: entry["type"] for entry in reversed(self.publications.values())}  # the first counts

    def unmatched(self, topic: str) -> str:
        """Return why a publisher of a topic is not heard, in words; empty where all are."""
        there = [entry for entry in self.publications.values() if entry["topic"] == topic]
        if self.network.reliable and not all(entry["reliable"] for entry in there):
            return 'is published best effort, and reliability = "reliable" requires more'
        return self.problems.get(topic, "")


@contextmanager
def listener(
    name: str,
    network: Network,
    topics: Sequence[str] | None,
    definitions: Mapping[str, str],
    alarm: str | None = None,
) -> Iterator[Listener]:
    """A process that listens to topics, or to all whose type is known, and publishes one alarm at most."""
    settings = {**asdict(network), "topics": None if topics is None else list(topics), "definitions": dict(definitions)}
    settings["alarm"] = alarm
    reading, writing = message_pipe()
    child = None
    try:
        child = Child(name, "sensor", _MODULE, settings, 1)
        child.hand_over("messages", writing)
        ready = child.wait_for("ready", _READY)
        yield Listener(child, Inlet(reading), network, ready["scheduling"])
    finally:
        if child is not None:
            child.close()
        os.close(reading)
        os.close(writing)


def hear(
    source: Listener, definitions: Mapping[str, str], seconds: float, enough: Callable[[TopicSnapshot], bool]
) -> TopicSnapshot:
    """What comes within so long [s], or until it is enough."""
    heard, waiting = TopicSnapshot(), list[ReceivedMessage]()
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        waiting += source.inlet.messages()
        source.news()
        for topic in source.topics.values():
            type_name = source.types.get(topic)
            if type_name is not None:
                heard.know(topic, type_name, definitions.get(type_name, ""))
        for message in waiting:
            if message.topic in source.topics and message.payload:
                heard.add(source.topics[message.topic], message)
        waiting = [message for message in waiting if message.topic not in source.topics]
        if enough(heard):
            break
        time.sleep(_LOOK)
    return heard


def refuse_missing(source: Listener, heard: TopicSnapshot, wanted: Sequence[str], name: str, seconds: float) -> None:
    """Raise DeviceError where a topic is missing, has an unknown type, or has sent nothing."""
    there = source.types
    for topic in wanted:
        if topic in heard.filled:
            continue
        if topic in source.problems:
            raise DeviceError(f"{name}: {_problem(topic, there.get(topic, ''), source.problems[topic])}")
        if topic in there:
            if why := source.unmatched(topic):
                raise DeviceError(f"{name}: {topic} {why}: nothing is received; leave reliability out")
            raise DeviceError(
                f"{name}: {topic} is published ({there[topic]}), but has sent nothing in {seconds:g} s; is the driver "
                "running?"
            )
        raise DeviceError(f"{name}: {topic} is not published within {seconds:g} s ({_topics(there, source.network)})")


def _problem(topic: str, type_name: str, why: str) -> str:
    if short_name(type_name) in STANDARD_TYPES:
        return why
    return f"{topic} is of type {type_name}, which is not a standard type: give its definition in types ({why})"


def _topics(there: Mapping[str, str], network: Network) -> str:
    if not there:
        return f"no topics at all: {network.nobody}"
    return "there are: " + ", ".join(f"{topic} of {kind}" for topic, kind in sorted(there.items()))
