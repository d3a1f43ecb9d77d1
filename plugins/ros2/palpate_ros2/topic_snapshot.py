"""What was heard of topics in a few moments: a container like a log, to check a mapping against or to look into."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set

import numpy as np
from palpate import epoch_offset
from palpate_records.messages.topics import Messages, Topic

from palpate_ros2.message_pipe import ReceivedMessage


def block_of(messages: list[ReceivedMessage]) -> Messages:
    """Messages of one topic as a block; log time is arrival, publish time is the writer's."""
    arrivals = np.array([message.arrival for message in messages], np.int64) + epoch_offset()
    sources = np.array([message.source for message in messages], np.int64)
    return Messages.joined([message.payload for message in messages], arrivals, sources)


class TopicSnapshot:
    """Topics with their types, and the messages of each."""

    def __init__(self) -> None:
        self._topics: dict[str, Topic] = {}
        self._messages: dict[str, list[ReceivedMessage]] = {}

    def know(self, topic: str, type_name: str, definition: str) -> None:
        """Take note of a topic."""
        self._topics.setdefault(topic, Topic(topic, type_name, schema=definition.encode()))

    def add(self, topic: str, message: ReceivedMessage) -> None:
        """Take in a message."""
        self._messages.setdefault(topic, []).append(message)

    def writers(self, topic: str) -> set[int]:
        """Who has sent messages of a topic."""
        return {message.writer for message in self._messages.get(topic, ())}

    @property
    def filled(self) -> Set[str]:
        """Topics that have messages."""
        return self._messages.keys()

    @property
    def topics(self) -> Mapping[str, Topic]:
        """See `Container`."""
        return self._topics

    @property
    def trouble(self) -> str | None:
        """See `Container`."""
        return None

    @property
    def span(self) -> tuple[int, int] | None:
        """See `Container`."""
        times = [message.arrival for messages in self._messages.values() for message in messages]
        return (min(times) + epoch_offset(), max(times) + epoch_offset()) if times else None

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """See `Container`."""
        for topic in sorted(wanted & self.filled):
            yield topic, block_of(self._messages[topic])
