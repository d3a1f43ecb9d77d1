"""The process that listens to a domain, as its parent sees it."""

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
_START_TIME = 30.0  # [s], a choice: a busy host takes seconds to start a process
_POLL_INTERVAL = 0.005  # [s], a choice: latency against load


@dataclass
class Listener:
    """Process that listens, and its reports on topics and publishers."""

    child: Child
    inlet: Inlet
    network: Network
    scheduling: str
    topics: dict[int, str] = field(default_factory=dict)  # subscribed ones, by number
    publications: dict[str, dict[str, Any]] = field(default_factory=dict)  # `Publication` as a table, by its key
    problems: dict[str, str] = field(default_factory=dict)  # clause on why a topic cannot be read, by topic

    def news(self) -> None:
        """Read the reports on publishers since the last call; raises DeviceError where the process has failed."""
        for report in self.child.messages():
            if report["say"] != "publication":
                continue
            if report["alive"]:
                self.publications[report["key"]] = report
            else:
                self.publications.pop(report["key"], None)
            if report["number"] is not None:
                self.topics[report["number"]] = report["topic"]
            if report["problem"] is not None:
                self.problems[report["topic"]] = report["problem"]
        self.child.check()

    @property
    def types(self) -> Mapping[str, str]:
        """The types of the published topics, by topic; that of the first of several publishers."""
        return {report["topic"]: report["type"] for report in reversed(self.publications.values())}

    def unmatched(self, topic: str) -> str:
        """Return a clause on why a publisher of a topic is not received; empty if all are."""
        publishers = [report for report in self.publications.values() if report["topic"] == topic]
        if self.network.reliable and not all(report["reliable"] for report in publishers):
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
    """Start a process that listens to topics, or with None to all whose type is known; end it with the context.

    `definitions` of custom types by name; `alarm`: topic of an alarm, which the process publishes on request.
    """
    settings = {
        **asdict(network),
        "topics": None if topics is None else list(topics),
        "definitions": dict(definitions),
        "alarm": alarm,
    }
    read_end, write_end = message_pipe()
    child = None
    try:
        child = Child(name, "sensor", _MODULE, settings, columns=1)
        child.hand_over("messages", write_end)
        ready = child.wait_for("ready", _START_TIME)
        yield Listener(child, Inlet(read_end), network, ready["scheduling"])
    finally:
        if child is not None:
            child.close()
        os.close(read_end)
        os.close(write_end)


def hear(
    source: Listener, definitions: Mapping[str, str], seconds: float, is_complete: Callable[[TopicSnapshot], bool]
) -> TopicSnapshot:
    """Return the messages that arrive within `seconds`, or until `is_complete` returns True for them."""
    snapshot = TopicSnapshot()
    unnamed: list[ReceivedMessage] = []  # messages of topics whose name has not been reported yet
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        unnamed += source.inlet.messages()
        source.news()
        for topic in source.topics.values():
            type_name = source.types.get(topic)
            if type_name is not None:
                snapshot.know(topic, type_name, definitions.get(type_name, ""))
        for message in unnamed:
            if message.topic in source.topics and message.payload:
                snapshot.add(source.topics[message.topic], message)
        unnamed = [message for message in unnamed if message.topic not in source.topics]
        if is_complete(snapshot):
            break
        time.sleep(_POLL_INTERVAL)
    return snapshot


def refuse_missing(source: Listener, snapshot: TopicSnapshot, topics: Sequence[str], name: str, seconds: float) -> None:
    """Raise DeviceError for the first of `topics` without a message in a snapshot of `seconds`, with the cause."""
    missing = next((topic for topic in topics if topic not in snapshot.filled), None)
    if missing is None:
        return
    types = source.types
    if missing in source.problems:
        raise DeviceError(f"{name}: {_type_problem(missing, types.get(missing, ''), source.problems[missing])}")
    if missing not in types:
        published = _published_topics(types, source.network)
        raise DeviceError(f"{name}: {missing} is not published within {seconds:g} s ({published})")
    if mismatch := source.unmatched(missing):
        raise DeviceError(f"{name}: {missing} {mismatch}: nothing is received; leave reliability out")
    raise DeviceError(
        f"{name}: {missing} is published ({types[missing]}), but has sent nothing in {seconds:g} s; is the driver "
        "running?"
    )


def _type_problem(topic: str, type_name: str, problem: str) -> str:
    """Return a clause on why a topic cannot be read, with what to do about a custom type."""
    if short_name(type_name) in STANDARD_TYPES:
        return problem
    return f"{topic} is of type {type_name}, which is not a standard type: give its definition in types ({problem})"


def _published_topics(types: Mapping[str, str], network: Network) -> str:
    """Return a clause that lists the published topics with their types; without any, what to check."""
    if not types:
        return f"no topics at all: {network.nobody}"
    return "there are: " + ", ".join(f"{topic} of {type_name}" for topic, type_name in sorted(types.items()))
