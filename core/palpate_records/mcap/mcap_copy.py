"""A new MCAP log of chunks that are there already: copied as they are, with an index of its own."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_extras import Attachment
from palpate_records.messages.topics import Stamps, Topic

_LIBRARY = "palpate recover"
_COPIED = 1 << 20  # [bytes] of the index that are copied at once


@dataclass(frozen=True)
class PackedChunk:
    """The data of a chunk as they stand in a file."""

    compression: str
    size: int  # [bytes] unpacked
    crc: int  # of what is unpacked
    data: bytes | memoryview

    @classmethod
    def of(cls, content: bytes) -> PackedChunk:
        """From a chunk record's content, which is whole."""
        _, _, size, crc, length = struct.unpack_from("<QQQII", content)
        return cls(content[32 : 32 + length].decode(), size, crc, memoryview(content)[40 + length :])


class NewLog:
    """A log that is being written; chunks keep the numbers that channels and schemas have in them."""

    def __init__(self, file: IO[bytes], index: IO[bytes]) -> None:
        from mcap.records import Header

        self._file, self._index = file, index  # the index of chunks waits on disk: a log of days has a million
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._extras: dict[str, list[Any]] = {"ATTACHMENT": [], "METADATA": []}
        self._chunks = 0
        self.counts: Counter[int] = Counter()  # messages of each channel
        self.span = (0, 0)  # [ns] first and last log time
        file.write(records.MAGIC)
        file.write(_bytes(Header("ros2", _LIBRARY)))

    def __contains__(self, channel: int) -> bool:
        return channel in self._channels

    def define(self, channel: int, topic: Topic, schema: int) -> None:
        """Write a channel, and its schema (0: none), ahead of the first chunk with messages of it."""
        from mcap.records import Channel, Schema

        if schema and schema not in self._schemas:
            self._schemas[schema] = Schema(schema, topic.schema, topic.schema_encoding, topic.type)
            self._file.write(_bytes(self._schemas[schema]))
        metadata = dict(topic.metadata)
        self._channels[channel] = Channel(channel, topic.name, topic.encoding, metadata, schema)
        self._file.write(_bytes(self._channels[channel]))

    def chunk(
        self, packed: PackedChunk, channel: NDArray[np.uint16], logged: NDArray[np.uint64], offsets: Stamps
    ) -> None:
        """Write a chunk and the index of its messages: whose each is, its log time [ns] and its place [bytes] (n,)."""
        from mcap.records import ChunkIndex

        first, last, name = int(logged.min()), int(logged.max()), packed.compression.encode()
        begin = self._file.tell()
        head = struct.pack("<QQQII", first, last, packed.size, packed.crc, len(name)) + name
        head += struct.pack("<Q", len(packed.data))
        self._file.write(records.RECORD.pack(records.CHUNK, len(head) + len(packed.data)) + head)
        self._file.write(packed.data)
        end = self._file.tell()
        places = self._index_messages(channel, np.column_stack([logged, offsets]).astype("<u8"))
        length, size = self._file.tell() - end, len(packed.data)
        entry = ChunkIndex(end - begin, begin, packed.compression, size, last, length, places, first, packed.size)
        self._index.write(_bytes(entry))
        self.span = (min(first, self.span[0]), max(last, self.span[1])) if self._chunks else (first, last)
        self._chunks += 1

    def _index_messages(self, channel: NDArray[np.uint16], entries: NDArray[np.uint64]) -> dict[int, int]:
        """Write where the messages of each channel are; returns where that stands."""
        places, counts = {}, np.bincount(channel)
        entries = entries[np.argsort(channel, kind="stable")]
        for identity, end in zip(np.flatnonzero(counts).tolist(), np.cumsum(counts[counts > 0]).tolist(), strict=True):
            content = entries[end - int(counts[identity]) : end].tobytes()
            places[identity] = self._file.tell()
            head = struct.pack("<HI", identity, len(content))
            self._file.write(records.RECORD.pack(records.MESSAGE_INDEX, len(head) + len(content)) + head + content)
            self.counts[identity] += int(counts[identity])
        return places

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write metadata."""
        from mcap.records import Metadata, MetadataIndex

        begin, data = self._file.tell(), _bytes(Metadata(name, entries))
        self._file.write(data)
        self._extras["METADATA"].append(MetadataIndex(begin, len(data), name))

    def attachment(self, file: Attachment) -> None:
        """Write an attachment."""
        from mcap.records import Attachment as Record, AttachmentIndex

        begin = self._file.tell()
        data = _bytes(Record(file.created, file.logged, file.name, file.kind, file.content))
        self._file.write(data)
        entry = AttachmentIndex(begin, len(data), file.logged, file.created, len(file.content), file.name, file.kind)
        self._extras["ATTACHMENT"].append(entry)

    def finish(self) -> None:
        """Write the summary."""
        from mcap.opcode import Opcode
        from mcap.records import DataEnd, Footer, Statistics, SummaryOffset

        self._file.write(_bytes(DataEnd(0)))
        summary = _LogSummary(self._file)
        statistics = Statistics(
            attachment_count=len(self._extras["ATTACHMENT"]),
            channel_count=len(self._channels),
            channel_message_counts=dict(self.counts),
            chunk_count=self._chunks,
            message_count=self.counts.total(),
            metadata_count=len(self._extras["METADATA"]),
            message_start_time=self.span[0],
            message_end_time=self.span[1],
            schema_count=len(self._schemas),
        )
        summary.group(Opcode.SCHEMA, self._schemas.values())
        summary.group(Opcode.CHANNEL, self._channels.values())
        summary.group(Opcode.STATISTICS, [statistics])
        summary.copied(Opcode.CHUNK_INDEX, self._index)
        summary.group(Opcode.ATTACHMENT_INDEX, self._extras["ATTACHMENT"])
        summary.group(Opcode.METADATA_INDEX, self._extras["METADATA"])
        offsets = self._file.tell()
        for place in summary.places:
            summary.write(_bytes(SummaryOffset(*place)))
        footer = _bytes(Footer(summary.begin, offsets, 0))[:-4]
        self._file.write(footer + struct.pack("<I", zlib.crc32(footer, summary.crc)) + records.MAGIC)


class _LogSummary:
    """The end of a log, with its checksum; nothing of it is held in memory as a whole."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.begin = file.tell()
        self.crc = 0
        self.places: list[tuple[int, int, int]] = []  # kind of record; begin and length [bytes] of all of it

    def write(self, data: bytes) -> None:
        self._file.write(data)
        self.crc = zlib.crc32(data, self.crc)

    def group(self, kind: int, entries: Iterable[Any]) -> None:
        begin = self._file.tell()
        for entry in entries:
            self.write(_bytes(entry))
        self._place(kind, begin)

    def copied(self, kind: int, file: IO[bytes]) -> None:
        begin = self._file.tell()
        file.seek(0)
        while data := file.read(_COPIED):
            self.write(data)
        self._place(kind, begin)

    def _place(self, kind: int, begin: int) -> None:
        if length := self._file.tell() - begin:
            self.places.append((kind, begin, length))


def _bytes(record: Any) -> bytes:
    """Return a record of the `mcap` library."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def compress_chunk(data: bytes) -> PackedChunk:
    """Return the data of a new chunk."""
    import zstandard

    return PackedChunk("zstd", len(data), zlib.crc32(data), zstandard.compress(data))
