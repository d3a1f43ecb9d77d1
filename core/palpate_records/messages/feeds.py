"""Feeds: how the streams of a device come out of the messages of a log."""

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

_SHOWN = 12
_LOOKED = 50  # messages of a block whose joints and child frames are looked at


@dataclass(frozen=True)
class TopicFeed:
    """One stream, and how it comes out of one topic's messages."""

    stream: Stream
    topic: str
    readings: tuple[FieldReading, ...]
    factors: Floats  # (k,) SI per recorded unit
    clock: Clock
    decoder: MessageDecoder
    directions: tuple[Floats | None, ...] = ()  # of each channel; None: a plain number
    orientation: TopicFeed | None = None  # the quaternion that turns the vectors
    function: Callable[[Floats], Floats] | None = (
        None  # readings (n, j) -> channels (n, k), such as a robot's kinematics
    )
    left_out: Counter[str] = field(default_factory=Counter)  # messages by reason, of the latest way through

    @property
    def scaled(self) -> bool:
        """True if the recorded numbers are in other units than SI."""
        return bool((self.factors != 1.0).any())

    def numbers(self, messages: Messages, log: str) -> tuple[Stamps, Stamps, Floats]:
        """Time-stamps [ns], log times [ns] and values [SI] of a block; raises LogError."""
        extra = (FieldReading.parse(self.clock.field, self.clock.index),) if isinstance(self.clock, TimeField) else ()
        table = self.decoder.read(messages, (*self.readings, *extra))
        every = len(table.rows) == len(messages)
        logged = np.ascontiguousarray(messages.logged) if every else messages.logged[table.rows]
        if isinstance(self.clock, TimeField):
            seconds = table.values[:, -1] * si_unit(self.clock.unit)[1]
            usable = np.isfinite(seconds) & (np.abs(seconds) < LATEST)
            self.left_out["no time"] += int(np.count_nonzero(~usable))
            values, logged = table.values[usable, :-1], logged[usable]
            return nanoseconds(seconds[usable]), logged, self._channels(values)
        stamps = logged
        if self.clock == "publish":
            stamps = messages.published[table.rows]
        elif self.clock == "stamp" and table.stamps is not None:
            stamps = table.stamps
        if self.clock == "stamp" and len(stamps) > 10 and (stamps == stamps[0]).all():
            raise LogError(f'{log}: the stamps of {self.topic} do not move; set time = "log"')
        return stamps, logged, self._channels(table.values)

    def _channels(self, values: Floats) -> Floats:
        """As recorded (n, readings), into the channels in SI (n, k); what must be turned first stays as it is."""
        if self.function is not None:
            return self.function(values)
        if self.orientation is not None:
            return values
        if any(direction is not None for direction in self.directions):
            return self.along(values)
        with np.errstate(over="ignore"):
            return sensible(values * self.factors if self.scaled else values)

    def along(self, values: Floats, quaternions: Floats | None = None) -> Floats:
        """Channels [SI] (n, k) of readings (n, readings): vectors, rotated where declared, along their directions."""
        columns, at = [], 0
        for direction in self.directions:
            if direction is None:
                columns.append(values[:, at])
                at += 1
                continue
            vectors = values[:, at : at + 3]
            vectors = vectors if quaternions is None else rotate_vectors(quaternions, vectors)
            columns.append(sum(vectors[:, axis] * direction[axis] for axis in range(3)))
            at += 3
        with np.errstate(over="ignore", invalid="ignore"):
            return sensible(np.column_stack(columns) * self.factors)


@dataclass(frozen=True)
class MappedStream:
    """A stream, and the signals that are its channels: of one topic, one part of it, and turned by one orientation."""

    stream: Stream
    signals: tuple[MappedSignal, ...]


def mapped_streams(signals: Mapping[str, MappedSignal]) -> list[MappedStream]:
    """Return a stream for each topic that signals name, with a channel for each signal; no log is needed for that."""
    groups: dict[tuple[str, str | None, Orientation | str | None], dict[str, MappedSignal]] = {}
    for name, signal in signals.items():
        groups.setdefault((signal.topic, signal.select, signal.orientation), {})[name] = signal
    names = stream_names([topic if select is None else f"{topic}/{select}" for topic, select, _ in groups])
    found = []
    for stream, group in zip(names, groups.values(), strict=True):
        channels = tuple(Channel(name, si_unit(signal.unit)[0]) for name, signal in group.items())
        found.append(MappedStream(Stream(stream, channels, None, clock="log"), tuple(group.values())))
    return found


def mapped_feeds(
    container: Container, signals: Mapping[str, MappedSignal], clock: Clock, log: str, turn: TopicFeed | None = None
) -> list[TopicFeed]:
    """Return a stream for each topic that signals name, with a channel for each signal; raises LogError.

    `turn` gives the quaternions of the kinematics, where there are some.
    """
    feeds = []
    for signal in (signal for group in mapped_streams(signals) for signal in group.signals):
        if signal.topic not in container.topics:
            name = next(name for name, other in signals.items() if other is signal)
            raise LogError(f"{log}: topic {signal.topic!r} of {name!r} is not in the log ({_some(container.topics)})")
    for group in mapped_streams(signals):
        topic, orientation = group.signals[0].topic, group.signals[0].orientation
        decoder = _decoder(container, topic, log)
        factors = np.array([si_unit(signal.unit)[1] * signal.scale for signal in group.signals])
        readings = tuple(reading for signal in group.signals for reading in signal.readings)
        directions = tuple(signal.unit_vector for signal in group.signals)
        turning = (
            _orientation_feed(container, orientation, clock, log) if isinstance(orientation, Orientation) else turn
        )
        if orientation == "kinematics" and turn is None:
            raise LogError(f'{log}: orientation = "kinematics" needs a table of kinematics')
        feeds.append(
            TopicFeed(
                group.stream,
                topic,
                readings,
                factors,
                clock,
                decoder,
                directions,
                None if orientation is None else turning,
            )
        )
    check_fields(container, [*feeds, *(feed.orientation for feed in feeds if feed.orientation is not None)], log)
    return feeds


def _decoder(container: Container, topic: str, log: str) -> MessageDecoder:
    if topic not in container.topics:
        raise LogError(f"{log}: topic {topic!r} is not in the log ({_some(container.topics)})")
    with name_the_log(log):
        return decoder_of(container.topics[topic])


def _orientation_feed(container: Container, orientation: Orientation, clock: Clock, log: str) -> TopicFeed:
    readings = tuple(FieldReading(f"{orientation.field}.{axis}") for axis in "xyzw")
    decoder = _decoder(container, orientation.topic, log)
    clock = "stamp" if isinstance(clock, TimeField) else clock
    return TopicFeed(Stream("", (), None), orientation.topic, readings, np.ones(4), clock, decoder)


def stream_names(topics: Sequence[str]) -> list[str]:
    """Return the last word of each topic, or all of them where two end alike."""
    short = [topic.strip("/").rsplit("/", 1)[-1] or "topic" for topic in topics]
    counts = Counter(short)
    names = [
        name if counts[name] == 1 else topic.strip("/").replace("/", "_")
        for name, topic in zip(short, topics, strict=True)
    ]
    return [name.replace(".", "_") for name in names]


@contextmanager
def name_the_log(log: str) -> Iterator[None]:
    """Let a LogError name its log."""
    try:
        yield
    except LogError as error:
        raise error if str(error).startswith(log) else LogError(f"{log}: {error}") from error


def check_fields(container: Container, feeds: Sequence[TopicFeed], log: str) -> None:
    """Refuse fields that the first message of their topic does not have, and names that none has."""
    waiting = {feed.topic: [f for f in feeds if f.topic == feed.topic] for feed in feeds}
    with name_the_log(log):
        for topic, messages in container.blocks(set(waiting)):
            for feed in waiting.pop(topic, []):
                fields = feed.decoder.fields(messages.payload(0))
                for reading in feed.readings:
                    if reading.select is None:
                        _check_reading(reading, fields, topic, log)
            if not waiting:
                break
        if waiting:
            raise LogError(f"{log}: topic {next(iter(waiting))!r} has no messages")
        for feed in feeds:
            _check_names(container, feed, log)


def _check_names(container: Container, feed: TopicFeed, log: str) -> None:
    """Refuse joints and child frames that no message of the topic names."""
    missing = {reading.select for reading in feed.readings if reading.select is not None}
    if not missing:
        return
    there: dict[str, None] = {}
    for _, messages in container.blocks({feed.topic}):
        for row in range(0, len(messages), max(len(messages) // _LOOKED, 1)):
            there |= dict.fromkeys(feed.decoder.names(messages.payload(row)))
        if missing <= there.keys():
            return
    name = min(missing - there.keys())
    raise LogError(f"{log}: no message of {feed.topic} names {name!r} ({_some(there)})")


def _check_reading(reading: FieldReading, fields: Mapping[str, int | None], topic: str, log: str) -> None:
    if reading.path not in fields:
        raise LogError(f"{log}: the messages of {topic} have no number {reading.path!r} ({_some(fields)})")
    count = fields[reading.path]
    if count is None and reading.index is not None:
        raise LogError(f"{log}: {reading.path!r} of {topic} is one number: leave out index")
    if count is not None and reading.index is None:
        raise LogError(f"{log}: {reading.path!r} of {topic} is an array of {count}: give index, 0 to {count - 1}")
    if count is not None and reading.index is not None and reading.index >= count:
        raise LogError(f"{log}: {reading.path!r} of {topic} has {count} elements: index {reading.index} is beyond them")


def _some(names: Mapping[str, object]) -> str:
    shown = list(names)[:_SHOWN]
    return f"there are: {', '.join(shown) or 'none'}{', ...' if len(names) > _SHOWN else ''}"


def untimed_note(feeds: Sequence[TopicFeed], name: str) -> tuple[str, ...]:
    """Return how many messages were left out since the time in them is not finite, in words."""
    counts = {feed.topic: feed.left_out["no time"] for feed in feeds if feed.left_out["no time"]}
    return tuple(
        f"{name}: {n} messages of {topic} have no finite time, and were left out" for topic, n in counts.items()
    )


def raw_feed(topic: Topic, stream: Stream, paths: Sequence[str]) -> TopicFeed:
    """Return a stream of numbers at known paths, in SI already."""
    readings = tuple(FieldReading.parse(path) for path in paths)
    return TopicFeed(stream, topic.name, readings, np.ones(len(readings)), "stamp", decoder_of(topic))
