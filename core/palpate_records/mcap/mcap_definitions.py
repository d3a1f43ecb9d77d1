"""The definitions of an MCAP file: schemas, channels, and the statistics of its data."""

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
    data: tuple[int, int] | None = None  # end [bytes] of the data section, and its checksum
    extras: list[tuple[int, bytes]] | None = None  # attachments and metadata, if requested
    spare: list[tuple[int, bytes]] = field(default_factory=list)  # definitions in damaged chunks
    _schema_numbers: dict[int, int] = field(default_factory=dict)  # of the schema of each channel

    def copy(self) -> Definitions:
        """Return a copy of schemas and channels, to which further ones can be added."""
        return Definitions(dict(self.schemas), dict(self.channels), _schema_numbers=dict(self._schema_numbers))

    def schema_of(self, channel: int) -> int | None:
        """Return the number of a channel's schema, 0 without one; None for a schema that is lost."""
        schema = self._schema_numbers.get(channel, 0)
        return schema if not schema or schema in self.schemas else None

    def take_extras(self) -> list[tuple[int, bytes]]:
        """Remove and return the attachments and metadata read so far, each once: a damaged stretch is read twice."""
        extras = list(dict.fromkeys(self.extras or ()))
        self.extras = []
        return extras

    def offer(self, opcode: int, content: bytes) -> bool:
        """Add a schema or channel; return False for a damaged one, or one that another definition contradicts."""
        try:
            self.define(opcode, content)
        except Damage:
            return False
        return True

    def settle(self, counts: Mapping[int, int]) -> list[str]:
        """Define channels and schemas that messages lack, from damaged chunks; return the topics that are so defined.

        `counts` are the messages of each channel.
        """
        spare = self.spare  # opcodes and contents of schemas and channels in damaged chunks
        self.spare = []
        # Channels first, since they refer to schemas.
        missing_channels = {channel for channel in counts if channel not in self.channels}
        self._define_missing(records.CHANNEL, missing_channels, spare)
        missing_schemas = self._missing_schemas(counts)
        self._define_missing(records.SCHEMA, missing_schemas, spare)
        # A topic that was defined before its schema gets that now.
        for channel, schema in self._schema_numbers.items():
            name, encoding, text = self.schemas.get(schema, ("", "", b""))
            topic = self.channels[channel]
            if not topic.schema and not topic.type:
                self.channels[channel] = replace(topic, type=name, schema_encoding=encoding, schema=text)
        doubtful_schemas = missing_schemas & self.schemas.keys()
        doubtful_channels = missing_channels & self.channels.keys()
        doubtful_channels |= {channel for channel, schema in self._schema_numbers.items() if schema in doubtful_schemas}
        return sorted(self.channels[channel].name for channel in doubtful_channels if channel in counts)

    def _missing_schemas(self, counts: Mapping[int, int]) -> set[int]:
        """Return the numbers of schemas that messages need, by the `counts` of their channels, and that are lost."""
        missing = set()
        for channel, schema in self._schema_numbers.items():
            if channel in counts and schema and schema not in self.schemas:
                missing.add(schema)
        return missing

    def _define_missing(self, kind: int, missing: set[int], spare: list[tuple[int, bytes]]) -> None:
        """Add the missing schemas or channels among records of damaged chunks."""
        for opcode, content in spare:
            if opcode == kind and len(content) > 1 and struct.unpack_from("<H", content)[0] in missing:
                self.offer(opcode, content)

    def define(self, opcode: int, content: bytes) -> None:
        """Add the definition in a record that is not a message; raises Damage."""
        try:
            match opcode:
                case records.SCHEMA:
                    self._define_schema(content)
                case records.CHANNEL:
                    self._define_channel(content)
                case records.STATISTICS:
                    self._read_statistics(content)
                case records.CHUNK_INDEX:
                    self.chunks.append(struct.unpack_from("<QQQ", content))
        except struct.error as error:
            raise Damage("a record is shorter than its fields") from error

    def _define_schema(self, content: bytes) -> None:
        """Add a schema: number, name, encoding and text."""
        (identity,) = struct.unpack_from("<H", content)
        name, end = records.read_text(content, 2)
        encoding, end = records.read_text(content, end)
        text, _ = records.read_bytes(content, end)
        if self.schemas.setdefault(identity, (name, encoding, text)) != (name, encoding, text):
            raise Damage(f"schema {identity} is defined twice, differently")

    def _define_channel(self, content: bytes) -> None:
        """Add a channel: number, number of its schema, topic, encoding and metadata."""
        identity, schema = struct.unpack_from("<HH", content)  # 4 bytes: the numbers of channel and schema
        topic_name, end = records.read_text(content, 4)
        encoding, end = records.read_text(content, end)
        packed_metadata, _ = records.read_bytes(content, end)
        type_name, schema_encoding, text = self.schemas.get(schema, ("", "", b""))
        topic = Topic(
            topic_name,
            type=type_name,
            encoding=encoding,
            schema_encoding=schema_encoding,
            schema=text,
            metadata=records.read_entries(packed_metadata),
        )
        self._schema_numbers.setdefault(identity, schema)
        if self.channels.setdefault(identity, topic) != topic:
            raise Damage(f"channel {identity} is defined twice, differently")

    def _read_statistics(self, content: bytes) -> None:
        """Take the span [ns] and the messages of each channel from the statistics.

        Both times stand behind five numbers of records, 26 bytes; then come the length of the counts, and these.
        """
        first, last, length = struct.unpack_from("<QQI", content, 26)
        self.span = (first, last)
        self.counts = dict(struct.iter_unpack("<HQ", content[46 : 46 + length]))
