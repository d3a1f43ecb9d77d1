"""Messages of a few moments, as a container like a log: a mapping is checked against it, and a survey shows it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set

import numpy as np
from palpate import epoch_offset
from palpate_records.messages.topics import Messages, Topic

from palpate_ros2.message_pipe import ReceivedMessage


def block_of(messages: list[ReceivedMessage]) -> Messages:
    """Return messages of one topic as a block; the log time is that of arrival, the publish time that of writing."""
    arrivals = np.array([message.arrival for message in messages], np.int64) + epoch_offset()
    sources = np.array([message.source for message in messages], np.int64)
    return Messages.joined([message.payload for message in messages], arrivals, sources)


class TopicSnapshot:
    """Container of topics with their types, and of the messages of each."""

    def __init__(self) -> None:
        self._topics: dict[str, Topic] = {}
        self._messages: dict[str, list[ReceivedMessage]] = {}

    def know(self, topic: str, type_name: str, definition: str) -> None:
        """Add a topic, unless it is there already."""
        self._topics.setdefault(topic, Topic(topic, type_name, schema=definition.encode()))

    def add(self, topic: str, message: ReceivedMessage) -> None:
        """Add a message of a topic."""
        self._messages.setdefault(topic, []).append(message)

    @property
    def filled(self) -> Set[str]:
        """The topics that have messages."""
        return self._messages.keys()

    @property
    def topics(self) -> Mapping[str, Topic]:
        """The topics by name."""
        return self._topics

    @property
    def trouble(self) -> str | None:
        """None: nothing is damaged."""
        return None

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last time of arrival [ns since 1970]; None without messages."""
        arrivals = [message.arrival for messages in self._messages.values() for message in messages]
        return (min(arrivals) + epoch_offset(), max(arrivals) + epoch_offset()) if arrivals else None

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Yield the messages of each requested topic as one block; begin and end are without effect."""
        for topic in sorted(wanted & self.filled):
            yield topic, block_of(self._messages[topic])
