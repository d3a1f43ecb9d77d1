"""What the records of an MCAP file define: schemas, channels, and the summary of the data."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_records import Damage
from palpate_records.messages.topics import Topic


@dataclass
class Definitions:
    """Definitions from the records read so far."""

    schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)  # name, encoding, text
    channels: dict[int, Topic] = field(default_factory=dict)
    counts: dict[int, int] | None = None  # messages of each channel, by the statistics
    span: tuple[int, int] | None = None  # first and last log time [ns], by the statistics
    chunks: list[tuple[int, int, int]] = field(default_factory=list)  # first, last log time; offset
    data: tuple[int, int] | None = None  # where the data section ends, and its checksum
    extras: list[tuple[int, bytes]] | None = None  # attachments and metadata, if requested
    spare: list[tuple[int, bytes]] = field(default_factory=list)  # definitions in chunks that are damaged
    _refers: dict[int, int] = field(default_factory=dict)  # the schema of each channel

    def copy(self) -> Definitions:
        """With definitions of its own."""
        return Definitions(dict(self.schemas), dict(self.channels), _refers=dict(self._refers))

    def schema_of(self, channel: int) -> int | None:
        """Return the number of a channel's schema, 0 where it has none; None where that is not defined any more."""
        schema = self._refers.get(channel, 0)
        return schema if not schema or schema in self.schemas else None

    def take_extras(self) -> list[tuple[int, bytes]]:
        """Attachments and metadata read since the last time, each once: a damaged stretch is read twice."""
        taken, self.extras = list(dict.fromkeys(self.extras or ())), []
        return taken

    def offer(self, opcode: int, content: bytes) -> bool:
        """Take in a schema or channel, where it is one, and nothing has defined it otherwise; whether that is so."""
        try:
            self.define(opcode, content)
        except Damage:
            return False
        return True

    def settle(self, counts: Mapping[int, int]) -> list[str]:
        """Define what messages need from the remains of damaged chunks, too; returns the topics that needed it."""
        spare, self.spare = self.spare, []
        missing = {channel for channel in counts if channel not in self.channels}
        self._take(records.CHANNEL, missing, spare)
        lost = {schema for c, schema in self._refers.items() if c in counts and schema and schema not in self.schemas}
        self._take(records.SCHEMA, lost, spare)
        for channel, schema in self._refers.items():
            name, encoding, text = self.schemas.get(schema, ("", "", b""))
            topic = self.channels[channel]
            if not topic.schema and not topic.type:
                self.channels[channel] = replace(topic, type=name, schema_encoding=encoding, schema=text)
        doubtful = (missing & self.channels.keys()) | {
            c for c, s in self._refers.items() if s in lost & self.schemas.keys()
        }
        return sorted(self.channels[c].name for c in doubtful if c in counts)

    def _take(self, kind: int, wanted: set[int], spare: list[tuple[int, bytes]]) -> None:
        for opcode, content in spare:
            if opcode == kind and len(content) > 1 and struct.unpack_from("<H", content)[0] in wanted:
                self.offer(opcode, content)

    def define(self, opcode: int, content: bytes) -> None:
        """Take in a record that is not a message."""
        try:
            match opcode:
                case records.SCHEMA:
                    self._schema(content)
                case records.CHANNEL:
                    self._channel(content)
                case records.STATISTICS:
                    self._statistics(content)
                case records.CHUNK_INDEX:
                    self.chunks.append(struct.unpack_from("<QQQ", content))
        except struct.error as error:
            raise Damage("a record is shorter than its fields") from error

    def _schema(self, content: bytes) -> None:
        (identity,) = struct.unpack_from("<H", content)
        name, at = records.read_text(content, 2)
        encoding, at = records.read_text(content, at)
        text, _ = records.read_bytes(content, at)
        if self.schemas.setdefault(identity, (name, encoding, text)) != (name, encoding, text):
            raise Damage(f"schema {identity} is defined twice, differently")

    def _channel(self, content: bytes) -> None:
        identity, schema = struct.unpack_from("<HH", content)
        topic, at = records.read_text(content, 4)
        encoding, at = records.read_text(content, at)
        packed, _ = records.read_bytes(content, at)
        metadata, at = {}, 0
        while at < len(packed):
            key, at = records.read_text(packed, at)
            metadata[key], at = records.read_text(packed, at)
        name, schema_encoding, text = self.schemas.get(schema, ("", "", b""))
        found = Topic(topic, name, encoding, schema_encoding, text, metadata)
        self._refers.setdefault(identity, schema)
        if self.channels.setdefault(identity, found) != found:
            raise Damage(f"channel {identity} is defined twice, differently")

    def _statistics(self, content: bytes) -> None:
        first, last, length = struct.unpack_from("<QQI", content, 26)
        self.span = (first, last)
        self.counts = dict(struct.iter_unpack("<HQ", content[46 : 46 + length]))
