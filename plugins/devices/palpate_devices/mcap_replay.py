"""Replay of an MCAP log."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from palpate import Batch, Channel, File, Link, LogError, Stream, Time
from palpate_engine import registry, toml_tables
from palpate_kit.logs.joint_kinematics import Kinematics, joint_feeds
from palpate_kit.logs.log_link import LogLink, described_feeds, distinct, file_facts, window
from palpate_kit.logs.topic_suggestion import suggestion_for
from palpate_kit.runs.run_folder import pipeline_among
from palpate_kit.terminal.progress import report_progress
from palpate_records.log_tables import tables_of, texts_of
from palpate_records.mcap.mcap_attachments import attached_to
from palpate_records.mcap.mcap_file import McapFile
from palpate_records.mcap.mcap_recovery import count_messages, recover_mcap
from palpate_records.messages.channel_mapping import Clock, MappedSignal
from palpate_records.messages.feeds import TopicFeed, raw_feed, untimed_note
from palpate_records.messages.topics import Stamps, Topic
from palpate_records.recording import LogAttachments, Recording, Suggestion, Survey
from palpate_records.survey import survey_of
from pydantic import Field, model_validator

from palpate_devices.messages import JOINTS, LOG_SCHEMA, UNITS, MessageType, joint_type, message_type


@dataclass(frozen=True)
class _Usable:
    """A topic that needs no mapping."""

    feed: TopicFeed
    device: str | None  # the device that recorded it, where palpate did


class McapReplay(Recording):
    """An MCAP log as a device: its topics are streams, with their time from the message headers.

    Of a log that palpate recorded, the raw streams come back under their names, to the last bit. Of other logs,
    `signals` says which numbers of which topics are the channels (ROS 2 messages in CDR, JSON, protobuf); signals of
    one topic share a stream, named by the topic's last word: ``log.wrench.force``. Topics with WrenchStamped,
    PoseStamped, TwistStamped, or a header followed by float64 numbers can also be named whole, in `topics`. Checksums
    are checked. A log without its end, as a crash leaves it, is refused unless `accept_cut` is set.
    """

    file: File = Field(description="the log, relative to the pipeline file")
    signals: dict[str, MappedSignal] = Field(
        default={},
        description='channels by name: { force = { topic = "/wrench", field = "wrench.force.z", unit = "N" } }',
    )
    topics: dict[str, str] = Field(
        default={}, description='whole topics as streams: { wrench = "/ft_sensor/wrench" }; neither: all that can be'
    )
    recorded: str | None = Field(
        default=None, description="only the streams of the device with this name in the recording"
    )
    kinematics: Kinematics | None = Field(
        default=None, description="the robot whose joints give the streams tip and twist, such as log.tip.z"
    )
    time: Clock = Field(
        default="stamp",
        description='of signals: "stamp" (of the header, else log), "log", "publish", or { field = "data", index = 0 }',
    )
    begin: Time | None = Field(
        default=None, ge=0, description="leave out what was logged earlier, counted from the first message"
    )
    end: Time | None = Field(default=None, gt=0, description="leave out what was logged later")
    accept_cut: bool = Field(
        default=False, description="read the undamaged part of a log that is cut or damaged, with a notice"
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.signals and (self.topics or self.recorded):
            raise ValueError("give either signals, or topics and recorded")
        return self

    @classmethod
    def attached(cls, path: Path) -> LogAttachments:
        """Return attachments that are texts, and the metadata that palpate writes; of a cut log, what is whole."""
        return attached_to(path)

    @classmethod
    def playback(cls, path: Path, device: str) -> dict[str, Any]:
        """Return a replay of one device's streams; a log that is cut is read as far as it is whole."""
        return {"type": "mcap-replay", "file": str(path), "recorded": device, "accept_cut": True}

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The log's usable topics, or those that are mapped."""
        return tuple(feed.stream for feed in self._feeds)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The log's trouble: that it is cut, carries no checksums, or has messages without a time."""
        trouble = (self._log.trouble,) if self._log.trouble else ()
        return (*trouble, *untimed_note(self._feeds, self.file.name))

    @property
    def provenance(self) -> Mapping[str, str]:
        """The file and its SHA-256."""
        return file_facts(self.file, [self.file])

    @property
    def simulated(self) -> bool:
        """True if the run that recorded it had a simulated device, by the pipeline that the log carries."""
        documents = self.attached(self.file).documents
        name = pipeline_among(documents)
        return name is not None and _has_simulation(documents[name])

    @property
    def duration(self) -> float | None:
        """From the first message to the last [s], where the log is whole."""
        span = self._log.span if self._log.complete else None
        return (span[1] - span[0]) / 1e9 if span else None

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """Yield the open log."""
        if (height := self.attached(self.file).facts.get("lifted")) is not None:
            raise LogError(f"{self.file}: was recorded {height} above the specimen (--lift): nothing was palpated")
        yield LogLink(self._log, self._feeds, window(self._log, self.begin, self.end), str(self.file))

    @cached_property
    def _log(self) -> McapFile:
        return McapFile(self.file, self.accept_cut)

    @cached_property
    def _feeds(self) -> list[TopicFeed]:
        """Return the feeds of topics: the stated signals or topics, else all that need no mapping; raises LogError."""
        topics = self._log.topics
        if not self._log.complete and not self.accept_cut:
            raise LogError(self._cut_message())
        if self.signals:
            return described_feeds(self._log, self.signals, self.kinematics, self.time, str(self.file))
        # Topics that need no mapping, and the tip by the joints.
        usable = dict[str, _Usable]()
        for name, topic in topics.items():
            entry = _usable(topic)
            if entry is not None:
                usable[name] = entry
        tip = joint_feeds(self._log, self.kinematics, self.time, str(self.file))[0] if self.kinematics else []
        if self.topics:
            return distinct([*self._named(usable), *tip], str(self.file))
        return tip if tip and not usable else distinct([*self._all(usable), *tip], str(self.file))

    def _cut_message(self) -> str:
        """Return the error of a log without its end, with how much of it is whole."""
        count, duration = count_messages(self.file)
        if not count:
            return f"{self.file}: the log is cut: it has no end, and nothing in it is undamaged"
        return (
            f"{self.file}: the log is cut: it has no end, but {count} messages over {duration:.3f} s are "
            "whole; set accept_cut = true to use them"
        )

    def _named(self, usable: Mapping[str, _Usable]) -> list[TopicFeed]:
        """Return the topics that are named, as streams of those names; raises LogError."""
        feeds = []
        for name, topic in self.topics.items():
            if topic not in usable:
                reason = "needs signals that map it" if topic in self._log.topics else "is not in the log"
                raise LogError(f"{self.file}: topic {topic!r} of {name!r} {reason} (there are: {', '.join(usable)})")
            feed = usable[topic].feed
            feeds.append(replace(feed, stream=replace(feed.stream, name=name)))
        return feeds

    def _all(self, usable: Mapping[str, _Usable]) -> list[TopicFeed]:
        """Return every usable topic that is a measurement, of one device where it is stated; raises LogError."""
        raw = {topic: entry for topic, entry in usable.items() if not topic.startswith("/palpate/")}
        if self.recorded is not None:
            raw = {topic: entry for topic, entry in raw.items() if entry.device == self.recorded}
        if not raw:
            topics = ", ".join(self._log.topics) or "none"
            raise LogError(f"{self.file}: no topic can be used without signals that map it (there are: {topics})")
        # Streams need distinct names.
        names = Counter(entry.feed.stream.name for entry in raw.values())
        for name, count in names.items():
            if count > 1:
                rivals = ", ".join(topic for topic, entry in raw.items() if entry.feed.stream.name == name)
                raise LogError(f"{self.file}: several topics could be {name!r}: {rivals}; name them in topics")
        return [entry.feed for entry in raw.values()]

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True for a file that is named like an MCAP log."""
        return path.is_file() and path.suffix.lower() == ".mcap"

    @classmethod
    def survey(cls, path: Path) -> Survey:
        """See `Recording`."""
        return survey_of(McapFile(path, accept_cut=True), path, "MCAP", report_progress)

    @classmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """See `Recording`."""
        return suggestion_for(McapFile(path, accept_cut=True), path, "mcap-replay", choices)

    @classmethod
    def tables(cls, path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """See `Recording`."""
        return tables_of(McapFile(path, accept_cut=True), notes)

    @classmethod
    def texts(cls, path: Path) -> Iterator[tuple[str, tuple[str, ...], Stamps, list[tuple[str, ...]]]]:
        """See `Recording`."""
        return texts_of(McapFile(path, accept_cut=True))

    @classmethod
    def recover(cls, path: Path, out: Path, beside: Mapping[str, str] = {}) -> str:
        """See `Recording`."""
        return recover_mcap(path, out, beside, report_progress)


def _usable(topic: Topic) -> _Usable | None:
    """Return a topic as a stream if it is a header, or nothing, followed by float64 numbers."""
    if (topic.encoding, topic.schema_encoding) != ("cdr", "ros2msg"):
        return None
    numbers = message_type(topic.type, topic.schema.decode(errors="replace"))
    if numbers is None:
        return None
    facts = _facts(topic)
    try:
        if numbers is JOINTS:  # of those that others recorded only a mapping knows which they are
            numbers = joint_type(facts["channels"])
        stream = _stream(topic, numbers, facts)
        return _Usable(raw_feed(topic, stream, numbers.paths or numbers.fields), facts.get("device"))
    except (LogError, KeyError, TypeError, ValueError):  # metadata that are not ours
        return None


def _facts(topic: Topic) -> dict[str, Any]:
    """Return the facts that palpate recorded of a topic, else none; raises LogError for those of a newer version."""
    try:
        facts = json.loads(topic.metadata.get("palpate", "{}"))
    except ValueError:
        return {}
    if not isinstance(facts, dict):
        return {}
    if facts.get("schema", LOG_SCHEMA) != LOG_SCHEMA:
        raise LogError(
            f"topic {topic.name} was recorded by a newer palpate, with schema {facts['schema']}; this one reads up to "
            f"{LOG_SCHEMA}: update it"
        )
    return facts


def _stream(topic: Topic, numbers: MessageType, facts: Mapping[str, Any]) -> Stream:
    """Return the stream of a topic by the facts that were recorded with it, else by the type of its messages."""
    fields = numbers.fields
    units = facts.get("units") or UNITS.get(numbers.name, ("1",) * len(fields))
    limits = facts.get("limits") or [None] * len(fields)
    channels = []
    for field, unit, limit in zip(fields, units, limits, strict=True):
        channels.append(Channel(field, unit, tuple(limit) if limit else None))
    name = facts.get("stream", topic.name.rsplit("/", 1)[-1])
    rate, layout, frame = facts.get("rate"), facts.get("layout", "columns"), facts.get("frame", "")
    return Stream(name=name, channels=tuple(channels), rate=rate, layout=layout, clock="log", frame=frame)


def _has_simulation(pipeline: str) -> bool:
    """Return True if a device of a pipeline, as TOML, knows the truth; False for a text that is not one."""
    try:
        tables = toml_tables(pipeline).get("device")
    except ValueError:
        return False
    devices = tables.values() if isinstance(tables, dict) else ()
    for table in devices:
        if not isinstance(table, dict):
            continue
        entry = registry.load().parts["device"].get(str(table.get("type")))
        if entry is not None and entry.problem is None and hasattr(entry.part, "truth"):
            return True
    return False
