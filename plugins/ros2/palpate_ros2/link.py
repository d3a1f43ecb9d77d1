"""The link of the device: messages become batches, by publisher and clock, with the flags on them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from palpate import Batch, DeviceError, Flag, LogError, epoch_offset
from palpate_kit.logs.log_link import HostTime, MessageReader
from palpate_records.messages.feeds import TopicFeed
from palpate_records.messages.topics import Messages, Stamps

from palpate_ros2.limits import Limit
from palpate_ros2.listener import Listener
from palpate_ros2.message_pipe import ReceivedMessage
from palpate_ros2.publisher_statistics import CommonClock, Publisher, StampClock, TopicAccount
from palpate_ros2.topic_snapshot import block_of
from palpate_ros2.worker import LOST

_POLL_INTERVAL = 0.004  # [s], a choice: latency against load
_MAX_SILENCE = 0.01  # [s], a choice: after so long without a message there is an empty batch, so that time goes on
_REPORT_INTERVAL = 0.1  # [s] between two looks at the reports of the process: a choice
_MAX_DELAY_RANGE = 0.05  # [s] between topics of one clock, a choice: more than networks delay, less than clocks differ
_BEAT_LIMIT = 2.0  # [s], a choice: a process without a sign of life for longer has died, however busy the machine is


class Ros2Link:
    """Link to the topics of a domain."""

    def __init__(
        self,
        source: Listener,
        feeds: Sequence[TopicFeed],
        name: str,
        duration: float | None,
        limits: Sequence[Limit] = (),
        common: CommonClock | None = None,
    ) -> None:
        """Read the feeds from a process `source` for a duration [s], None: without end; `common`: clock of all topics.

        `name` is the system's in messages.
        """
        self._source, self._feeds, self._name, self._duration = source, feeds, name, duration
        self._limits = limits
        self._common_clock = common
        self._clocks: dict[tuple[int, int], StampClock] = {}  # by identity of the feed and number of the writer
        self._reader = MessageReader(feeds, name)
        self._accounts = {
            topic: TopicAccount(Publisher(accepts_all=_selects(feeds, topic))) for topic in self._reader.topics
        }
        self._alarmed = False
        self._last_damage = ""  # error of the latest message that could not be read

    def batches(self) -> Iterator[Batch]:
        """Yield the batches, every few milliseconds, until the time to listen is over; raises DeviceError."""
        start = last_batch = last_report = time.monotonic()
        for _ in self._source.inlet.messages():
            pass  # skip the messages that arrived while other devices were connected
        while self._duration is None or time.monotonic() - start < self._duration:
            messages = list(self._source.inlet.messages())
            now = time.monotonic()
            if messages:
                for batch in self._batches(messages):
                    self._check_limits(batch)
                    yield batch
                last_batch = now
            elif now - last_batch > _MAX_SILENCE:
                yield from self._empty_batches()
                last_batch = now
            if now - last_report > _REPORT_INTERVAL:
                self._source.news()
                self._source.child.check(_BEAT_LIMIT)
                last_report = now
            if not messages:
                time.sleep(_POLL_INTERVAL)
            if lost := int(self._source.child.ring.head[LOST]):
                raise DeviceError(f"{self._name}: {lost} messages were lost: the host is too slow")
        yield from self._reader.turned(final=True)

    def _check_limits(self, batch: Batch) -> None:
        """Count the readings of a batch beyond limits, and raise the alarm at the first of the run."""
        exceeded = [limit.check(batch) for limit in self._limits]
        if any(exceeded) and not self._alarmed:
            self._alarmed = True
            self._source.child.tell("alarm")

    def _empty_batches(self) -> Iterator[Batch]:
        """Yield a batch without readings of each stream."""
        no_times = np.zeros(0, np.int64)
        for feed in self._feeds:
            yield Batch(feed.stream.name, no_times, no_times, np.zeros((0, len(feed.stream.channels))))

    def _batches(self, messages: list[ReceivedMessage]) -> Iterator[Batch]:
        """Yield the batches of messages, topic by topic; those of other topics than of the feeds are left out."""
        by_topic = sorted(messages, key=lambda message: message.topic)  # stable: each topic keeps its order
        for number, topic_messages in groupby(by_topic, lambda message: message.topic):
            topic = self._source.topics.get(number)
            if topic is None or topic not in self._accounts:
                continue
            for writer, writer_messages in groupby(topic_messages, lambda message: message.writer):
                yield from self._batches_of_writer(topic, writer, list(writer_messages))

    def _batches_of_writer(self, topic: str, writer: int, messages: list[ReceivedMessage]) -> Iterator[Batch]:
        """Yield the batches of one writer's messages, if it is the followed publisher of the topic."""
        account = self._accounts[topic]
        changes = account.publisher.changes
        accepted = [m for m in messages if m.payload and account.publisher.accepts(writer, m.arrival)]
        # An empty message, the last of a writer, says that it has left.
        if not messages[-1].payload:
            account.publisher.note_departure(writer)
        if account.publisher.changes > changes:
            account.losses.restart()
        if not accepted:
            return
        account.messages += len(accepted)
        to_host = partial(self._host_time, account, writer)
        try:
            yield from self._read(topic, block_of(accepted), to_host)
        except LogError:
            for message in accepted:  # one damaged message spoils its block: read each by itself
                try:
                    yield from self._read(topic, block_of([message]), to_host)
                except LogError as error:
                    account.damaged += 1
                    self._last_damage = str(error)

    def _read(self, topic: str, block: Messages, to_host: HostTime) -> list[Batch]:
        """Return the batches of a block, all of them or none: a damaged one raises LogError."""
        return list(self._reader.read(topic, block, to_host))

    def _host_time(
        self, account: TopicAccount, writer: int, feed: TopicFeed, stamps: Stamps, received: Stamps
    ) -> Stamps:
        """Return stamps [ns] (n,) of a writer on the host's clock, by their arrivals [ns] (n,), and count losses."""
        if not len(stamps) or stamps is received:  # the time of arrival is the host's already
            return stamps
        # Feeds of one topic have the same messages: the first of them counts the losses.
        first_feed = next((candidate for candidate in self._feeds if candidate.topic == feed.topic), feed)
        if feed is first_feed:
            account.losses.add(stamps)
        if self._common_clock is not None:
            return self._common_clock.to_host(f"{feed.topic} {id(feed)}", stamps, received)
        clock = self._clocks.setdefault((id(feed), writer), StampClock())
        return clock.to_host(stamps, received)

    @property
    def attended(self) -> int:
        """The time [ns] at which the process last looked for messages."""
        return self._source.child.ring.last_beat() + epoch_offset()

    @property
    def health(self) -> Mapping[str, Any]:
        """State of the topics and their publishers."""
        return {
            "scheduling": self._source.scheduling,
            "topics": {topic: account.table() for topic, account in sorted(self._accounts.items())},
            "types": dict(self._source.types),
            "clock_deviation": max((clock.deviation for clock in self._clocks.values()), default=0.0),
            "flags": {flag.code: flag.message for flag in self._flags()},
        }

    def _flags(self) -> list[Flag]:
        """Return the flags on the readings, one for each code."""
        ignored = self._summary(
            lambda account: account.publisher.ignored, "{} messages of another publisher of {topic} were left out"
        )
        changes = self._summary(lambda account: account.publisher.changes, "{topic} has changed its publisher {} times")
        missing = self._summary(
            lambda account: account.losses.missing, "{} messages of {topic} are missing by their stamps"
        )
        damaged = self._summary(lambda account: account.damaged, "{} messages of {topic} were damaged")
        restarts = max([0, *(clock.restarts for clock in self._clocks.values())])
        if self._common_clock is not None:
            restarts = max(restarts, self._common_clock.restarts)
        flags = (
            Flag("ros2-publishers", ignored),
            Flag("ros2-restarted", changes),
            Flag("ros2-missing", missing),
            Flag("ros2-damaged", f"{damaged} ({self._last_damage})" if damaged else ""),
            Flag("ros2-unread", self._unread_topics()),
            Flag("ros2-limit", "; ".join(str(limit) for limit in self._limits if limit.beyond)),
            Flag("ros2-clocks", self._clock_difference()),
            Flag("ros2-clock", f"the clock of a publisher jumped {restarts} times" if restarts else ""),
        )
        return [flag for flag in flags if flag.message]

    def _summary(self, count_of: Callable[[TopicAccount], int], template: str) -> str:
        """Return the template, filled with count and topic, for each topic whose count is not 0."""
        counts = [(topic, count_of(account)) for topic, account in sorted(self._accounts.items())]
        return "; ".join(template.format(count, topic=topic) for topic, count in counts if count)

    def _unread_topics(self) -> str:
        """Return a clause on each topic that is published in a form that cannot be read; empty without any."""
        mismatches = [(topic, self._source.unmatched(topic)) for topic in sorted(self._accounts)]
        return "; ".join(f"{topic} {mismatch}" for topic, mismatch in mismatches if mismatch)

    def _clock_difference(self) -> str:
        """Return a sentence on topics of one clock whose delays differ too much to be of one; empty otherwise."""
        delay_range = self._common_clock.delay_range if self._common_clock is not None else None
        if delay_range is None or delay_range[2] <= _MAX_DELAY_RANGE:
            return ""
        earliest, latest = (name.split()[0] for name in delay_range[:2])
        return f"{latest} is by {delay_range[2]:.3g} s later than {earliest}: they do not share one clock"


def _selects(feeds: Sequence[TopicFeed], topic: str) -> bool:
    """Return True if every reading of a topic is selected by a name in its messages: publishers may share it."""
    readings = [reading for feed in feeds if feed.topic == topic for reading in feed.readings]
    return bool(readings) and all(reading.select is not None for reading in readings)
