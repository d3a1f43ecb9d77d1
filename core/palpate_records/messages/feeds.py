"""Feeds: the streams of a device from the messages of a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from palpate import Channel, Floats, LogError, Stream

from palpate_records.messages.channel_mapping import Clock, MappedSignal, Orientation, TimeField
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.readings import LATEST, FieldReading, MessageDecoder, nanoseconds, sensible, si_unit
from palpate_records.messages.topics import Container, Messages, Stamps, Topic
from palpate_records.messages.turning_frames import rotate_vectors

# Choices.
_MAX_SHOWN = 12  # names in a message
_PROBE_MESSAGES = 50  # of a block, in which joints and child frames are searched
_MIN_STAMPS = 10  # of a block, beyond which equal stamps are an error


@dataclass(frozen=True)
class TopicFeed:
    """One stream, with the readings of one topic that it is made of."""

    stream: Stream
    topic: str
    readings: tuple[FieldReading, ...]
    factors: Floats  # (k,) SI per recorded unit
    clock: Clock
    decoder: MessageDecoder
    directions: tuple[Floats | None, ...] = ()  # of each channel; None for a plain number
    orientation: TopicFeed | None = None  # the quaternion that turns the vectors
    function: Callable[[Floats], Floats] | None = None  # from readings (n, j) to channels (n, k), such as kinematics
    left_out: Counter[str] = field(default_factory=Counter)  # messages by reason, of the latest pass

    @property
    def scaled(self) -> bool:
        """True if the recorded numbers are in other units than SI."""
        return bool((self.factors != 1.0).any())

    def numbers(self, messages: Messages, log: str) -> tuple[Stamps, Stamps, Floats]:
        """Return time-stamps (n,) [ns], log times (n,) [ns] and values (n, k) [SI] of a block; raises LogError.

        The stamps are a number in the messages, or the times of their "publish", header ("stamp") or log.
        """
        readings = self.readings
        if isinstance(self.clock, TimeField):  # the time is read as the last number
            readings = (*readings, FieldReading.parse(self.clock.field, self.clock.index))
        table = self.decoder.read(messages, readings)
        is_whole = len(table.rows) == len(messages)
        logged = np.ascontiguousarray(messages.logged) if is_whole else messages.logged[table.rows]
        if isinstance(self.clock, TimeField):
            seconds = table.values[:, -1] * si_unit(self.clock.unit)[1]
            has_time = np.isfinite(seconds) & (np.abs(seconds) < LATEST)
            self.left_out["no time"] += int(np.count_nonzero(~has_time))
            return nanoseconds(seconds[has_time]), logged[has_time], self._channels(table.values[has_time, :-1])
        stamps = logged
        if self.clock == "publish":
            stamps = messages.published[table.rows]
        elif self.clock == "stamp" and table.stamps is not None:
            stamps = table.stamps
        if self.clock == "stamp" and len(stamps) > _MIN_STAMPS and (stamps == stamps[0]).all():
            raise LogError(f'{log}: the stamps of {self.topic} do not move; set time = "log"')
        return stamps, logged, self._channels(table.values)

    def _channels(self, values: Floats) -> Floats:
        """Return the channels (n, k) [SI] of readings (n, j); vectors that wait for an orientation as recorded."""
        if self.function is not None:
            return self.function(values)
        if self.orientation is not None:
            return values
        if any(direction is not None for direction in self.directions):
            return self.along(values)
        with np.errstate(over="ignore"):
            return sensible(values * self.factors if self.scaled else values)

    def along(self, values: Floats, quaternions: Floats | None = None) -> Floats:
        """Return the channels (n, k) [SI] of readings (n, j): numbers, and components of vectors along a direction.

        Vectors take three columns x, y, z of the readings, and are turned by `quaternions` (n, 4) if there are any.
        """
        columns = []
        first = 0  # column of the readings
        for direction in self.directions:
            if direction is None:
                columns.append(values[:, first])
                first += 1
                continue
            vectors = values[:, first : first + 3]
            if quaternions is not None:
                vectors = rotate_vectors(quaternions, vectors)
            columns.append(sum(vectors[:, axis] * direction[axis] for axis in range(3)))
            first += 3
        with np.errstate(over="ignore", invalid="ignore"):
            return sensible(np.column_stack(columns) * self.factors)


@dataclass(frozen=True)
class MappedStream:
    """A stream with its signals: of one topic, one joint or frame of it, and turned by one orientation."""

    stream: Stream
    signals: tuple[MappedSignal, ...]


def mapped_streams(signals: Mapping[str, MappedSignal]) -> list[MappedStream]:
    """Return a stream for each topic that signals name, with a channel for each signal; no log is needed for that."""
    groups: dict[tuple[str, str | None, Orientation | str | None], dict[str, MappedSignal]] = {}
    for name, signal in signals.items():
        groups.setdefault((signal.topic, signal.select, signal.orientation), {})[name] = signal
    names = stream_names([topic if select is None else f"{topic}/{select}" for topic, select, _ in groups])
    streams = []
    for stream_name, group in zip(names, groups.values(), strict=True):
        channels = tuple(Channel(name, si_unit(signal.unit)[0]) for name, signal in group.items())
        streams.append(MappedStream(Stream(stream_name, channels, None, clock="log"), tuple(group.values())))
    return streams


def mapped_feeds(
    container: Container, signals: Mapping[str, MappedSignal], clock: Clock, log: str, turn: TopicFeed | None = None
) -> list[TopicFeed]:
    """Return a feed for each topic that signals name, with a channel for each signal; raises LogError.

    A feed is a stream with the numbers of the messages that it is made of. `clock` says where its times are from, and
    `log` is the file's name in errors. `turn` gives the quaternions of the kinematics, if there are any.
    """
    mapped = mapped_streams(signals)
    for signal in (signal for mapped_stream in mapped for signal in mapped_stream.signals):
        if signal.topic not in container.topics:
            name = next(name for name, other in signals.items() if other is signal)
            raise LogError(
                f"{log}: topic {signal.topic!r} of {name!r} is not in the log ({_list_names(container.topics)})"
            )
    feeds = [_mapped_feed(container, mapped_stream, clock, log, turn) for mapped_stream in mapped]
    check_fields(container, [*feeds, *(feed.orientation for feed in feeds if feed.orientation is not None)], log)
    return feeds


def _mapped_feed(
    container: Container, mapped: MappedStream, clock: Clock, log: str, turn: TopicFeed | None
) -> TopicFeed:
    """Return the feed of one stream, whose signals are of one topic; raises LogError.

    Vectors are turned by the quaternions of another topic, or by those of the kinematics (`turn`), where stated.
    """
    signals = mapped.signals
    topic = signals[0].topic
    decoder = _decoder(container, topic, log)
    orientation = signals[0].orientation
    orientation_feed = None
    if isinstance(orientation, Orientation):
        orientation_feed = _orientation_feed(container, orientation, clock, log)
    elif orientation == "kinematics":
        if turn is None:
            raise LogError(f'{log}: orientation = "kinematics" needs a table of kinematics')
        orientation_feed = turn
    return TopicFeed(
        mapped.stream,
        topic=topic,
        readings=tuple(reading for signal in signals for reading in signal.readings),
        factors=np.array([si_unit(signal.unit)[1] * signal.scale for signal in signals]),
        clock=clock,
        decoder=decoder,
        directions=tuple(signal.unit_vector for signal in signals),
        orientation=orientation_feed,
    )


def _decoder(container: Container, topic: str, log: str) -> MessageDecoder:
    """Return the decoder of a topic; raises LogError for an unknown topic or format."""
    if topic not in container.topics:
        raise LogError(f"{log}: topic {topic!r} is not in the log ({_list_names(container.topics)})")
    with name_the_log(log):
        return decoder_of(container.topics[topic])


def _orientation_feed(container: Container, orientation: Orientation, clock: Clock, log: str) -> TopicFeed:
    """Return the feed of the quaternions of an orientation, which have no time as a number."""
    return TopicFeed(
        Stream("", (), None),
        topic=orientation.topic,
        readings=tuple(FieldReading(f"{orientation.field}.{axis}") for axis in "xyzw"),
        factors=np.ones(4),
        clock="stamp" if isinstance(clock, TimeField) else clock,
        decoder=_decoder(container, orientation.topic, log),
    )


def stream_names(topics: Sequence[str]) -> list[str]:
    """Return the last part of each topic; all parts of topics that end alike."""
    last_parts = [topic.strip("/").rsplit("/", 1)[-1] or "topic" for topic in topics]
    counts = Counter(last_parts)
    names = []
    for last_part, topic in zip(last_parts, topics, strict=True):
        name = last_part if counts[last_part] == 1 else topic.strip("/").replace("/", "_")
        names.append(name.replace(".", "_"))
    return names


@contextmanager
def name_the_log(log: str) -> Iterator[None]:
    """Put the name of the log before the message of a LogError that lacks it."""
    try:
        yield
    except LogError as error:
        raise error if str(error).startswith(log) else LogError(f"{log}: {error}") from error


def check_fields(container: Container, feeds: Sequence[TopicFeed], log: str) -> None:
    """Raise LogError for fields that the first message of their topic does not have, and names that none has."""
    unchecked = {feed.topic: [other for other in feeds if other.topic == feed.topic] for feed in feeds}
    with name_the_log(log):
        for topic, messages in container.blocks(set(unchecked)):
            for feed in unchecked.pop(topic, []):
                fields = feed.decoder.fields(messages.payload(0))
                for reading in feed.readings:
                    if reading.select is None:
                        _check_reading(reading, fields, topic, log)
            if not unchecked:
                break
        if unchecked:
            raise LogError(f"{log}: topic {next(iter(unchecked))!r} has no messages")
        for feed in feeds:
            _check_names(container, feed, log)


def _check_names(container: Container, feed: TopicFeed, log: str) -> None:
    """Raise LogError for joints and child frames that no message of the topic names."""
    missing = {reading.select for reading in feed.readings if reading.select is not None}
    if not missing:
        return
    names: dict[str, None] = {}
    for _, messages in container.blocks({feed.topic}):
        for row in range(0, len(messages), max(len(messages) // _PROBE_MESSAGES, 1)):
            names |= dict.fromkeys(feed.decoder.names(messages.payload(row)))
        if missing <= names.keys():
            return
    name = min(missing - names.keys())
    raise LogError(f"{log}: no message of {feed.topic} names {name!r} ({_list_names(names)})")


def _check_reading(reading: FieldReading, fields: Mapping[str, int | None], topic: str, log: str) -> None:
    """Raise LogError for a reading without a field, of an array without an index, or with one beyond its elements."""
    if reading.path not in fields:
        raise LogError(f"{log}: the messages of {topic} have no number {reading.path!r} ({_list_names(fields)})")
    count = fields[reading.path]
    if count is None and reading.index is not None:
        raise LogError(f"{log}: {reading.path!r} of {topic} is one number: leave out index")
    if count is not None and reading.index is None:
        raise LogError(f"{log}: {reading.path!r} of {topic} is an array of {count}: give index, 0 to {count - 1}")
    if count is not None and reading.index is not None and reading.index >= count:
        raise LogError(f"{log}: {reading.path!r} of {topic} has {count} elements: index {reading.index} is beyond them")


def _list_names(names: Mapping[str, object]) -> str:
    """Return the first names, as in "there are: a, b, ..."."""
    first_names = list(names)[:_MAX_SHOWN]
    return f"there are: {', '.join(first_names) or 'none'}{', ...' if len(names) > _MAX_SHOWN else ''}"


def untimed_note(feeds: Sequence[TopicFeed], name: str) -> tuple[str, ...]:
    """Return a sentence on each topic with messages whose time is not finite, which are left out."""
    counts = {feed.topic: feed.left_out["no time"] for feed in feeds if feed.left_out["no time"]}
    return tuple(
        f"{name}: {count} messages of {topic} have no finite time, and were left out" for topic, count in counts.items()
    )


def raw_feed(topic: Topic, stream: Stream, paths: Sequence[str]) -> TopicFeed:
    """Return the feed of numbers at known paths, which are in SI."""
    readings = tuple(FieldReading.parse(path) for path in paths)
    return TopicFeed(
        stream,
        topic=topic.name,
        readings=readings,
        factors=np.ones(len(readings)),
        clock="stamp",
        decoder=decoder_of(topic),
    )
