"""Topics at work: messages to batches, by whom and by which clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from palpate import Batch, DeviceError, Flag, LogError, epoch_offset
from palpate_kit.logs.log_link import MessageReader
from palpate_records.messages.feeds import TopicFeed
from palpate_records.messages.topics import Messages, Stamps

from palpate_ros2.limits import Limit
from palpate_ros2.listener import Listener
from palpate_ros2.message_pipe import ReceivedMessage
from palpate_ros2.publisher_statistics import CommonClock, Publisher, StampClock, TopicAccount
from palpate_ros2.topic_snapshot import block_of
from palpate_ros2.worker import LOST

_POLL = 0.004  # [s]
_MOST_QUIET = 0.01  # [s]; at least so often there is a batch, if an empty one
_NEWS = 0.1  # [s] between two looks at what the process says
_ONE_CLOCK = 0.05  # [s] between the topics of one clock, at most
_BEAT = 2.0  # [s]; a process that is silent for longer has died, whatever else keeps the machine busy


class Ros2Link:
    """A domain that is listened to."""

    def __init__(
        self,
        source: Listener,
        feeds: Sequence[TopicFeed],
        name: str,
        duration: float | None,
        limits: Sequence[Limit] = (),
        common: CommonClock | None = None,
    ) -> None:
        self._limits, self._alarmed, self._common = limits, False, common
        self._source, self._feeds, self._name, self._duration = source, feeds, name, duration
        self._reader = MessageReader(feeds, name)
        self._clocks: dict[tuple[int, int], StampClock] = {}  # by feed and writer
        self._accounts = {topic: TopicAccount(Publisher(_selects(feeds, topic))) for topic in self._reader.topics}
        self._trouble = ""

    def batches(self) -> Iterator[Batch]:
        """What has come, every few milliseconds, until the time to listen is over; raises DeviceError."""
        began = quiet = looked = time.monotonic()
        for _ in self._source.inlet.messages():
            pass  # what came while other devices were connected
        while self._duration is None or time.monotonic() - began < self._duration:
            found = list(self._source.inlet.messages())
            now = time.monotonic()
            if found:
                for batch in self._batches(found):
                    self._watch(batch)
                    yield batch
                quiet = now
            elif now - quiet > _MOST_QUIET:
                yield from self._nothing()
                quiet = now
            if now - looked > _NEWS:
                self._source.news()
                self._source.child.check(_BEAT)
                looked = now
            if not found:
                time.sleep(_POLL)
            if lost := int(self._source.child.ring.head[LOST]):
                raise DeviceError(f"{self._name}: {lost} messages were lost: the host is too slow")
        yield from self._reader.turned(final=True)

    def _watch(self, batch: Batch) -> None:
        """Give the alarm, once, where a reading is beyond a limit."""
        beyond = [limit.check(batch) for limit in self._limits]
        if any(beyond) and not self._alarmed:
            self._alarmed = True
            self._source.child.tell("alarm")

    def _nothing(self) -> Iterator[Batch]:
        empty = np.zeros(0, np.int64)
        for feed in self._feeds:
            yield Batch(feed.stream.name, empty, empty, np.zeros((0, len(feed.stream.channels))))

    def _batches(self, found: list[ReceivedMessage]) -> Iterator[Batch]:
        found.sort(key=lambda message: message.topic)  # stable: each topic's stay in their order
        for number, group in groupby(found, lambda message: message.topic):
            topic = self._source.topics.get(number)
            account = self._accounts.get(topic or "")
            if topic is None or account is None:
                continue
            for writer, messages in groupby(group, lambda message: message.writer):
                yield from self._of_writer(topic, account, writer, list(messages))

    def _of_writer(
        self, topic: str, account: TopicAccount, writer: int, every: list[ReceivedMessage]
    ) -> Iterator[Batch]:
        changes = account.publisher.changes
        messages = [m for m in every if m.payload and account.publisher.takes(writer, m.arrival)]
        if len(messages) < len(every) and not every[-1].payload:
            account.publisher.left(writer)
        if account.publisher.changes > changes:
            account.losses.anew()
        if not messages:
            return
        account.counts["messages"] += len(messages)
        clock = partial(self._host_time, account, writer)
        try:
            yield from self._read(topic, block_of(messages), clock)
        except LogError:
            for message in messages:  # one that is damaged spoils its whole block
                try:
                    yield from self._read(topic, block_of([message]), clock)
                except LogError as error:
                    account.counts["damaged"] += 1
                    self._trouble = str(error)

    def _read(self, topic: str, block: Messages, clock: Any) -> list[Batch]:
        return list(self._reader.read(topic, block, clock))

    def _host_time(
        self, account: TopicAccount, writer: int, feed: TopicFeed, stamps: Stamps, received: Stamps
    ) -> Stamps:
        if not len(stamps) or stamps is received:  # arrival is the host's time already
            return stamps
        first = next((other for other in self._feeds if other.topic == feed.topic), feed)
        if feed is first:
            account.losses.add(stamps)
        if self._common is not None:
            return self._common.to_host(f"{feed.topic} {id(feed)}", stamps, received)
        clock = self._clocks.setdefault((id(feed), writer), StampClock())
        return clock.to_host(stamps, received)

    @property
    def attended(self) -> int:
        """When the process that listens last looked for messages [ns]."""
        return self._source.child.ring.last_beat() + epoch_offset()

    @property
    def health(self) -> Mapping[str, Any]:
        """What was seen of the topics and their publishers."""
        return {
            "scheduling": self._source.scheduling,
            "topics": {topic: account.table() for topic, account in sorted(self._accounts.items())},
            "types": dict(self._source.types),
            "clock_deviation": max((clock.deviation for clock in self._clocks.values()), default=0.0),
            "flags": {flag.code: flag.message for flag in self._flags()},
        }

    def _flags(self) -> Iterator[Flag]:
        """Flags on the readings, one of a kind."""
        accounts = sorted(self._accounts.items())

        def summary(what: Callable[[TopicAccount], int], words: str) -> str:
            return "; ".join(words.format(what(a), topic=topic) for topic, a in accounts if what(a))

        damaged = summary(lambda a: a.counts["damaged"], "{} messages of {topic} were damaged")
        leaps = [clock.restarts for clock in self._clocks.values()]
        restarts = max([*leaps, self._common.restarts if self._common is not None else 0])
        others = "{} messages of another publisher of {topic} were left out"
        found = (
            Flag("ros2-publishers", summary(lambda a: a.publisher.ignored, others)),
            Flag(
                "ros2-restarted", summary(lambda a: a.publisher.changes, "{topic} has changed its publisher {} times")
            ),
            Flag(
                "ros2-missing",
                summary(lambda a: a.losses.missing, "{} messages of {topic} are missing by their stamps"),
            ),
            Flag("ros2-damaged", f"{damaged} ({self._trouble})" if damaged else ""),
            Flag("ros2-unread", self._unread()),
            Flag("ros2-limit", "; ".join(str(limit) for limit in self._limits if limit.beyond)),
            Flag("ros2-clocks", self._apart()),
            Flag("ros2-clock", f"the clock of a publisher jumped {restarts} times" if restarts else ""),
        )
        return (flag for flag in found if flag.message)

    def _unread(self) -> str:
        """Topics published in a form that cannot be read; empty if all can be."""
        found = {topic: self._source.unmatched(topic) for topic in sorted(self._accounts)}
        return "; ".join(f"{topic} {why}" for topic, why in found.items() if why)

    def _apart(self) -> str:
        """Return True if two publishers' clocks are not one; empty where they are."""
        apart = self._common.apart if self._common is not None else None
        if apart is None or apart[2] <= _ONE_CLOCK:
            return ""
        ahead, behind = (name.split()[0] for name in apart[:2])
        return f"{behind} is by {apart[2]:.3g} s later than {ahead}: they do not share one clock"


def _selects(feeds: Sequence[TopicFeed], topic: str) -> bool:
    """Return True if all that is read of a topic is named in its messages, so that several may publish parts of it."""
    readings = [reading for feed in feeds if feed.topic == topic for reading in feed.readings]
    return bool(readings) and all(reading.select is not None for reading in readings)
