"""Mapping: which numbers of which topics are the channels of a device."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from palpate import Channel, LogError, Settings, Stream
from pydantic import Field, model_validator

from palpate_devices.logs.decoders import decoder_of
from palpate_devices.logs.readings import Decoder, Reading, nanoseconds, si_unit
from palpate_devices.logs.topics import Container, Messages, Stamps, Topic
from palpate_devices.logs.turning import rotated

_SHOWN = 12


class Orientation(Settings):
    """The pose whose quaternion turns the frame of a vector into the fixed frame."""

    topic: str = Field(min_length=1, description='topic, such as "/tcp_pose_broadcaster/pose"')
    field: str = Field(default="pose.orientation", min_length=1, description="path to the quaternion x, y, z, w")


class MappedSignal(Settings):
    """One channel: a number in the messages of one topic. Its sign and its delay belong into [alignment]."""

    topic: str = Field(min_length=1, description='topic, such as "/ft_sensor/wrench"')
    field: str = Field(min_length=1, description='path to the number, such as "wrench.force.z" or "data"')
    index: int | None = Field(default=None, ge=0, description="which element, where the field is an array")
    select: str | None = Field(
        default=None, description="joint (JointState) or child frame (TFMessage) whose number it is"
    )
    unit: str = Field(default="1", description='unit of the recorded number, such as "mm" or "N"')
    direction: tuple[float, float, float] | None = Field(
        default=None, description="field is a vector x, y, z, and the channel its component along this direction"
    )
    orientation: Orientation | None = Field(
        default=None, description="the pose that turns the vector's frame; direction is then in the pose's own frame"
    )
    scale: float = Field(default=1.0, description="factor on the recorded number, for readings in counts")

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        si_unit(self.unit)
        if not (np.isfinite(self.scale) and self.scale != 0.0):
            raise ValueError("scale must be a finite number other than 0")
        if self.direction is not None and not 0 < np.linalg.norm(self.direction) < np.inf:
            raise ValueError("direction must not be of length 0")
        if self.direction is not None and self.index is not None:
            raise ValueError("direction takes the whole vector: leave out index")
        if self.orientation is not None and self.direction is None:
            raise ValueError("orientation needs a direction")
        return self

    @property
    def readings(self) -> tuple[Reading, ...]:
        """What to read: one number, or the three of a vector."""
        if self.direction is not None:
            return tuple(Reading(f"{self.field}.{axis}") for axis in "xyz")
        return (Reading.parse(self.field, self.index),)

    @property
    def unit_vector(self) -> NDArray[np.float64] | None:
        """The direction with length 1; None where the field is a number."""
        return None if self.direction is None else np.array(self.direction) / np.linalg.norm(self.direction)


class TimeField(Settings):
    """The time as a number in the same messages."""

    field: str = Field(min_length=1, description="path to the number")
    index: int | None = Field(default=None, ge=0, description="which element, where the field is an array")
    unit: str = Field(default="s", description="its unit")

    @model_validator(mode="after")
    def _a_time(self) -> Self:
        if si_unit(self.unit)[0] != "s":
            raise ValueError(f"{self.unit!r} is no unit of time")
        return self


Clock = Literal["stamp", "log", "publish"] | TimeField


@dataclass(frozen=True)
class Feed:
    """One stream, and how it comes out of one topic's messages."""

    stream: Stream
    topic: str
    readings: tuple[Reading, ...]
    factors: NDArray[np.float64]  # (k,) SI per recorded unit
    select: str | None
    clock: Clock
    decoder: Decoder
    directions: tuple[NDArray[np.float64] | None, ...] = ()  # of each channel; None: a plain number
    orientation: Feed | None = None  # the quaternion that turns the vectors

    @property
    def scaled(self) -> bool:
        """Whether the recorded numbers are in other units than SI."""
        return bool((self.factors != 1.0).any())

    def numbers(self, messages: Messages, log: str) -> tuple[Stamps, Stamps, NDArray[np.float64]]:
        """Time-stamps [ns], log times [ns] and values [SI] of a block; raises LogError."""
        extra = (Reading.parse(self.clock.field, self.clock.index),) if isinstance(self.clock, TimeField) else ()
        table = self.decoder.read(messages, (*self.readings, *extra), self.select)
        logged = messages.logged[table.rows]
        if isinstance(self.clock, TimeField):
            seconds = table.values[:, -1] * si_unit(self.clock.unit)[1]
            usable = np.isfinite(seconds) & (np.abs(seconds) < 9e9)
            values, logged = table.values[usable, :-1], logged[usable]
            return nanoseconds(seconds[usable]), logged, self._channels(values)
        stamps = logged if self.clock == "log" else messages.published[table.rows]
        if self.clock == "stamp":
            stamps = table.stamps if table.stamps is not None else logged
            if len(stamps) > 10 and (stamps == stamps[0]).all():
                raise LogError(f'{log}: the stamps of {self.topic} do not move; set time = "log"')
        return stamps, logged, self._channels(table.values)

    def _channels(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """As recorded (n, readings), into the channels in SI (n, k); what must be turned first stays as it is."""
        if self.orientation is not None:
            return values
        if any(direction is not None for direction in self.directions):
            return self.along(values)
        return values * self.factors if self.scaled else values

    def along(self, values: NDArray[np.float64], quaternions: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Channels [SI] (n, k) of readings (n, readings): vectors, turned where told how, along their directions."""
        columns, at = [], 0
        for direction in self.directions:
            if direction is None:
                columns.append(values[:, at])
                at += 1
                continue
            vectors = values[:, at : at + 3]
            vectors = vectors if quaternions is None else rotated(quaternions, vectors)
            columns.append(sum(vectors[:, axis] * direction[axis] for axis in range(3)))
            at += 3
        return np.column_stack(columns) * self.factors


def mapped_feeds(container: Container, signals: Mapping[str, MappedSignal], clock: Clock, log: str) -> list[Feed]:
    """A stream for each topic that signals name, with a channel for each signal; raises LogError."""
    groups: dict[tuple[str, str | None, Orientation | None], dict[str, MappedSignal]] = {}
    for name, signal in signals.items():
        if signal.topic not in container.topics:
            raise LogError(f"{log}: topic {signal.topic!r} of {name!r} is not in the log ({_some(container.topics)})")
        groups.setdefault((signal.topic, signal.select, signal.orientation), {})[name] = signal
    names = stream_names([topic if select is None else f"{topic}/{select}" for topic, select, _ in groups])
    feeds = []
    for stream, ((topic, select, orientation), group) in zip(names, groups.items(), strict=True):
        decoder = _decoder(container, topic, log)
        units = [si_unit(signal.unit) for signal in group.values()]
        channels = tuple(Channel(name, unit) for name, (unit, _) in zip(group, units, strict=True))
        factors = np.array([factor * s.scale for (_, factor), s in zip(units, group.values(), strict=True)])
        readings = tuple(reading for signal in group.values() for reading in signal.readings)
        directions = tuple(signal.unit_vector for signal in group.values())
        turn = None if orientation is None else _orientation_feed(container, orientation, clock, log)
        feeds.append(
            Feed(
                Stream(stream, channels, None, clock="log"),
                topic,
                readings,
                factors,
                select,
                clock,
                decoder,
                directions,
                turn,
            )
        )
    check_fields(container, [*feeds, *(feed.orientation for feed in feeds if feed.orientation is not None)], log)
    return feeds


def _decoder(container: Container, topic: str, log: str) -> Decoder:
    if topic not in container.topics:
        raise LogError(f"{log}: topic {topic!r} is not in the log ({_some(container.topics)})")
    try:
        return decoder_of(container.topics[topic])
    except LogError as error:
        raise LogError(f"{log}: {error}") from error


def _orientation_feed(container: Container, orientation: Orientation, clock: Clock, log: str) -> Feed:
    readings = tuple(Reading(f"{orientation.field}.{axis}") for axis in "xyzw")
    decoder = _decoder(container, orientation.topic, log)
    clock = "stamp" if isinstance(clock, TimeField) else clock
    return Feed(Stream("", (), None), orientation.topic, readings, np.ones(4), None, clock, decoder)


def stream_names(topics: Sequence[str]) -> list[str]:
    """The last word of each topic, or all of them where two end alike."""
    short = [topic.strip("/").rsplit("/", 1)[-1] or "topic" for topic in topics]
    counts = Counter(short)
    names = [
        name if counts[name] == 1 else topic.strip("/").replace("/", "_")
        for name, topic in zip(short, topics, strict=True)
    ]
    return [name.replace(".", "_") for name in names]


def check_fields(container: Container, feeds: Sequence[Feed], log: str) -> None:
    """Refuse fields that the first message of their topic does not have."""
    waiting = {feed.topic: [f for f in feeds if f.topic == feed.topic] for feed in feeds}
    stream = container.blocks(set(waiting))
    for topic, messages in stream:
        for feed in waiting.pop(topic, []):
            fields = feed.decoder.fields(messages.payload(0))
            for reading in feed.readings if feed.select is None else ():
                _check_reading(reading, fields, topic, log)
        if not waiting:
            return
    if waiting:
        raise LogError(f"{log}: topic {next(iter(waiting))!r} has no messages")


def _check_reading(reading: Reading, fields: Mapping[str, int | None], topic: str, log: str) -> None:
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


def raw_feed(topic: Topic, stream: Stream, paths: Sequence[str]) -> Feed:
    """A stream of numbers at known paths, in SI already."""
    readings = tuple(Reading(path) for path in paths)
    return Feed(stream, topic.name, readings, np.ones(len(readings)), None, "stamp", decoder_of(topic))
