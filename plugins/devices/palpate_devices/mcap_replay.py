"""Replay of an MCAP log."""

from __future__ import annotations

import hashlib
import json
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Batch, Channel, Device, File, Link, LogError, Stream
from pydantic import Field

from palpate_devices.messages import UNITS, MessageType, known_type, unpack

_MAGIC = b"\x89MCAP0\r\n"
_BLOCK = 4000  # messages read before batches go out
_RECORD_LIMIT = 1 << 30  # [bytes]; a length beyond this is damage, not data


@dataclass(frozen=True)
class _Topic:
    stream: Stream
    kind: MessageType
    device: str | None  # the device that recorded it, where palpate did


class McapReplay(Device):
    """An MCAP log as a device: its topics are streams, with their time from the message headers.

    Of a log that palpate recorded, the raw streams come back under their names, to the last bit. Of other logs, topics
    with WrenchStamped, PoseStamped, TwistStamped, or a header followed by float64 numbers (all CDR) can be used;
    `topics` names them. CRCs are checked. A log without its end, as a crash leaves it, is refused unless `accept_cut`
    is set.
    """

    file: File = Field(description="the log, relative to the pipeline file")
    topics: dict[str, str] = Field(
        default={}, description='streams by name: { wrench = "/ft_sensor/wrench" }; left out: all'
    )
    recorded: str | None = Field(
        default=None, description="only the streams of the device that had this name in the recording"
    )
    accept_cut: bool = Field(
        default=False, description="read what is whole of a log that is cut or damaged, and say so"
    )

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The log's usable topics."""
        return tuple(topic.stream for topic in self._topics.values())

    @property
    def warnings(self) -> tuple[str, ...]:
        """Whether the log is cut."""
        return () if self._is_whole else (f"{self.file.name} is cut or damaged: only what is whole was read",)

    @property
    def provenance(self) -> Mapping[str, str]:
        """The file and its SHA-256."""
        with self.file.open("rb") as file:
            return {"file": str(self.file), "sha256": hashlib.file_digest(file, "sha256").hexdigest()}

    @property
    def duration(self) -> float | None:
        """From the first message to the last [s], where the log's own statistics say it."""
        from mcap.reader import make_reader

        if not self._is_whole:
            return None
        with self.file.open("rb") as file:
            summary = make_reader(file).get_summary()
        statistics = summary.statistics if summary is not None else None
        return (statistics.message_end_time - statistics.message_start_time) / 1e9 if statistics is not None else None

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """The open log."""
        return self._connected()

    @contextmanager
    def _connected(self) -> Iterator[Link]:
        yield _McapLink(self, self._topics)

    @cached_property
    def _is_whole(self) -> bool:
        """Whether the file ends as a finished log does."""
        with self.file.open("rb") as file:
            file.seek(0, 2)
            size = file.tell()
            file.seek(max(size - len(_MAGIC), 0))
            return size > 2 * len(_MAGIC) and file.read() == _MAGIC

    @cached_property
    def _topics(self) -> dict[str, _Topic]:
        """By topic, the usable streams that are wanted."""
        if not self.file.is_file():
            raise LogError(f"{self.file}: there is no such file")
        found: dict[str, _Topic] = {}
        seen: list[str] = []
        schemas: dict[int, Any] = {}
        for record in self.records(channels_only=True):
            if type(record).__name__ == "Schema":
                schemas[record.id] = record
            elif type(record).__name__ == "Channel" and record.topic not in seen:
                seen.append(record.topic)
                topic = _topic(record, schemas.get(record.schema_id))
                if topic is not None:
                    found[record.topic] = topic
        if not self._is_whole and not self.accept_cut:
            raise LogError(self._cut_message())
        return self._chosen(found, seen)

    def _cut_message(self) -> str:
        count, first, last = 0, None, None
        for record in self.records():
            if type(record).__name__ == "Message":
                first, last, count = record.log_time if first is None else first, record.log_time, count + 1
        if first is None or last is None:
            return f"{self.file}: the log is cut: it has no end, and nothing in it is whole"
        return (
            f"{self.file}: the log is cut: it has no end, but {count} messages over {(last - first) / 1e9:.3f} s are "
            "whole; set accept_cut = true to use them"
        )

    def _chosen(self, found: Mapping[str, _Topic], seen: list[str]) -> dict[str, _Topic]:
        if self.topics:
            for name, topic in self.topics.items():
                if topic not in found:
                    known = "has no numbers that can be used" if topic in seen else "is not in the log"
                    raise LogError(f"{self.file}: topic {topic!r} of {name!r} {known} (there are: {', '.join(found)})")
            return {topic: _renamed(found[topic], name) for name, topic in self.topics.items()}
        raw = {topic: entry for topic, entry in found.items() if not topic.startswith("/palpate/")}
        if self.recorded is not None:
            raw = {topic: entry for topic, entry in raw.items() if entry.device == self.recorded}
        if not raw:
            raise LogError(f"{self.file}: no topic can be used (there are: {', '.join(seen) or 'none'})")
        repeated = [name for name, count in Counter(e.stream.name for e in raw.values()).items() if count > 1]
        if repeated:
            rivals = ", ".join(topic for topic, entry in raw.items() if entry.stream.name == repeated[0])
            raise LogError(f"{self.file}: several topics could be {repeated[0]!r}: {rivals}; name them in topics")
        return raw

    def records(self, channels_only: bool = False) -> Iterator[Any]:
        """The log's records in file order, up to its end or, where it is cut, to the last whole one.

        Raises LogError where the file is no MCAP log, or damaged and `accept_cut` is not set.
        """
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
        from mcap.stream_reader import StreamReader

        with self.file.open("rb") as file:
            head = file.read(len(_MAGIC))
            if not head:
                raise LogError(f"{self.file}: the file is empty")
            if head != _MAGIC:
                raise LogError(f"{self.file}: is no MCAP log")
            file.seek(0)
            if channels_only and self._is_whole:
                try:
                    summary = make_reader(file).get_summary()
                except (McapError, ValueError, struct.error, EOFError) as error:
                    raise LogError(f"{self.file}: the log's summary is damaged: {error}") from error
                if summary is not None and summary.channels:
                    yield from summary.schemas.values()
                    yield from summary.channels.values()
                    return
            file.seek(0)
            try:
                yield from StreamReader(file, validate_crcs=True, record_size_limit=_RECORD_LIMIT).records
            except GeneratorExit:
                raise
            except (
                Exception
            ) as error:  # zstd, struct, CRC and mcap errors: all say that the bytes are not what they were
                if self._is_whole and not self.accept_cut:
                    reason = str(error) or type(error).__name__
                    raise LogError(
                        f"{self.file}: the log is damaged: {reason}; accept_cut = true reads up to there"
                    ) from error


def _topic(channel: Any, schema: Any) -> _Topic | None:
    if channel.message_encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
        return None
    kind = known_type(schema.name, schema.data.decode(errors="replace"))
    if kind is None:
        return None
    facts = json.loads(channel.metadata.get("palpate", "{}"))
    units = facts.get("units") or UNITS.get(kind.name, ("1",) * len(kind.fields))
    limits = facts.get("limits") or [None] * len(kind.fields)
    channels = tuple(
        Channel(name, unit, tuple(limit) if limit else None)
        for name, unit, limit in zip(kind.fields, units, limits, strict=True)
    )
    name = facts.get("stream", channel.topic.rsplit("/", 1)[-1])
    stream = Stream(name, channels, facts.get("rate"), facts.get("layout", "columns"), "log", facts.get("frame", ""))
    return _Topic(stream, kind, facts.get("device"))


def _renamed(topic: _Topic, name: str) -> _Topic:
    stream = topic.stream
    renamed = Stream(name, stream.channels, stream.rate, stream.layout, stream.clock, stream.frame)
    return _Topic(renamed, topic.kind, topic.device)


class _McapLink:
    def __init__(self, log: McapReplay, topics: Mapping[str, _Topic]) -> None:
        self._log = log
        self._topics = topics

    def batches(self) -> Iterator[Batch]:
        """The messages of the wanted topics, some thousand at a time."""
        channels: dict[int, _Topic] = {}
        waiting: dict[int, list[Any]] = {}
        count = 0
        for record in self._log.records():
            match type(record).__name__:
                case "Channel" if record.topic in self._topics:
                    channels[record.id] = self._topics[record.topic]
                case "Message" if record.channel_id in channels:
                    waiting.setdefault(record.channel_id, []).append(record)
                    count += 1
            if count >= _BLOCK:
                yield from self._unpacked(channels, waiting)
                waiting, count = {}, 0
        yield from self._unpacked(channels, waiting)

    def _unpacked(self, channels: Mapping[int, _Topic], waiting: Mapping[int, list[Any]]) -> Iterator[Batch]:
        for identity, messages in waiting.items():
            topic = channels[identity]
            try:
                stamps, values = unpack([message.data for message in messages], len(topic.kind.fields))
            except ValueError as error:
                raise LogError(f"{self._log.file}: a message of {topic.kind.name} is damaged: {error}") from error
            received = np.array([message.log_time for message in messages], np.int64)
            yield Batch(topic.stream.name, stamps, received, values)
