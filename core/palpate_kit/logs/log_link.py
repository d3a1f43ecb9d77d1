"""The link that devices of logs share: messages become batches, all of a log or those in a window of time."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from palpate import Batch, Floats, LogError
from palpate_records.log_files import readable, regular
from palpate_records.messages.channel_mapping import Clock, MappedSignal
from palpate_records.messages.feeds import TopicFeed, mapped_feeds, name_the_log
from palpate_records.messages.readings import SECOND
from palpate_records.messages.topics import Container, Messages, Stamps
from palpate_records.messages.turning_frames import FrameOrientations
from palpate_records.prefetch import ahead

from palpate_kit.logs.joint_kinematics import Kinematics, joint_feeds

HostTime = Callable[[TopicFeed, Stamps, Stamps], Stamps]
_BATCHES_AHEAD = 4  # read before they are needed: a choice
_BLOCK_SIZE = 1 << 20  # [bytes] of a file that are hashed at once: a choice


class MessageReader:
    """Converter of messages of a log or a network to batches of the streams that they feed."""

    def __init__(self, feeds: Sequence[TopicFeed], log: str) -> None:
        self._log = log
        self._feeds: dict[str, list[TopicFeed]] = {}
        for feed in feeds:
            self._feeds.setdefault(feed.topic, []).append(feed)
        self._turned = [(feed, FrameOrientations()) for feed in feeds if feed.orientation is not None]
        self.topics = self._feeds.keys() | {feed.orientation.topic for feed, _ in self._turned if feed.orientation}

    def read(self, topic: str, messages: Messages, clock: HostTime | None = None) -> Iterator[Batch]:
        """Yield the batches that a block of one topic's messages completes; `clock` maps stamps [ns] by arrival."""
        for feed in self._feeds.get(topic, ()):
            stamps, received, values = self._read_numbers(feed, messages, clock)
            if feed.orientation is not None:
                next(turning for other, turning in self._turned if other is feed).add(stamps, received, values)
            elif len(stamps):
                yield Batch(feed.stream.name, stamps, received, values)
        for feed, turning in self._turned:
            if feed.orientation is not None and feed.orientation.topic == topic:
                stamps, _, quaternions = self._read_numbers(feed.orientation, messages, clock)
                turning.learn(stamps, quaternions)
        yield from self.turned()

    def turned(self, final: bool = False) -> Iterator[Batch]:
        """Yield the batches of vectors whose orientation has arrived; with `final`, all that wait for one."""
        for feed, turning in self._turned:
            for stamps, received, values, quaternions in turning.ready(final):
                if len(stamps):
                    yield Batch(feed.stream.name, stamps, received, feed.along(values, quaternions))

    def _read_numbers(
        self, feed: TopicFeed, messages: Messages, clock: HostTime | None
    ) -> tuple[Stamps, Stamps, Floats]:
        """Return stamps [ns], times of arrival [ns] and values (n, k) of a feed; raises LogError that names the log."""
        with name_the_log(self._log):
            stamps, received, values = feed.numbers(messages, self._log)
        return stamps if clock is None else clock(feed, stamps, received), received, values


class LogLink:
    """An open log, which yields its batches."""

    def __init__(
        self, container: Container, feeds: Sequence[TopicFeed], window: tuple[int | None, int | None], log: str
    ):
        self._container = container
        self._feeds = feeds
        self._window = window
        self._log = log

    def batches(self) -> Iterator[Batch]:
        """Return every block of the log, as a batch of each stream that it feeds; a thread reads ahead."""
        return ahead(self._read(), _BATCHES_AHEAD)

    def _read(self) -> Generator[Batch]:
        for feed in self._feeds:
            feed.left_out.clear()
        reader = MessageReader(self._feeds, self._log)
        for topic, messages in self._container.blocks(reader.topics, *self._window):
            yield from reader.read(topic, messages)
        yield from reader.turned(final=True)


def described_feeds(
    container: Container, signals: Mapping[str, MappedSignal], kinematics: Kinematics | None, clock: Clock, log: str
) -> list[TopicFeed]:
    """Return the feeds that signals and a robot's kinematics describe; raises LogError."""
    tip_feeds, orientation = ([], None) if kinematics is None else joint_feeds(container, kinematics, clock, log)
    return distinct([*mapped_feeds(container, signals, clock, log, orientation), *tip_feeds], log)


def distinct(feeds: list[TopicFeed], log: str) -> list[TopicFeed]:
    """Return the feeds; raises LogError if two of them make streams of one name."""
    names = [feed.stream.name for feed in feeds]
    for feed in feeds:
        if names.count(feed.stream.name) > 1:
            topics = " and ".join(other.topic for other in feeds if other.stream.name == feed.stream.name)
            raise LogError(
                f"{log}: two streams would be {feed.stream.name!r}: of {topics}; the kinematics make tip and "
                "twist: name others in topics"
            )
    return feeds


def window(container: Container, begin: float | None, end: float | None) -> tuple[int | None, int | None]:
    """Return the log times [ns] of a window in seconds since the first message; None for an open end."""
    if begin is None and end is None:
        return None, None
    span = container.span
    if span is None:
        return None, None
    first_stamp = span[0]
    return (
        None if begin is None else first_stamp + round(begin * SECOND),
        None if end is None else first_stamp + round(end * SECOND),
    )


def file_facts(path: Path, files: Sequence[Path]) -> Mapping[str, str]:
    """Return the path of a log and the SHA-256 of the bytes of its files, by which a run can be repeated."""
    digest = hashlib.sha256()
    for file in files:
        with readable(regular(file)) as opened:
            while block := opened.read(_BLOCK_SIZE):
                digest.update(block)
    return {"file": str(path), "sha256": digest.hexdigest()}


def join_batches(blocks: Sequence[Batch]) -> Batch:
    """Return several batches of a stream as one."""
    columns = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("time", "received", "values"))
    return Batch(blocks[0].stream, *columns)
