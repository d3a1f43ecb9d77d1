"""A new MCAP log of the chunks of another one: copied as they are, with a new index."""

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
_COPY_SIZE = 1 << 20  # [bytes] of the index that are copied at once: a choice
# Of the format: a chunk's content begins with two times, size, checksum and the length of the compression's name, then
# come that name and the length of the data.
_CHUNK_FIELDS = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")


@dataclass(frozen=True)
class PackedChunk:
    """The data of a chunk as they stand in a file."""

    compression: str
    size: int  # [bytes] unpacked
    crc: int  # of what is unpacked
    data: bytes | memoryview

    @classmethod
    def of(cls, content: bytes) -> PackedChunk:
        """Return the data of a chunk record by its content, which is whole."""
        _, _, size, crc, name_length = _CHUNK_FIELDS.unpack_from(content)
        name_end = _CHUNK_FIELDS.size + name_length
        compression = content[_CHUNK_FIELDS.size : name_end].decode()
        return cls(compression, size, crc, data=memoryview(content)[name_end + _LENGTH.size :])


class NewLog:
    """A log that is being written; channels and schemas keep the numbers that they have in its chunks."""

    def __init__(self, file: IO[bytes], index: IO[bytes]) -> None:
        from mcap.records import Header

        self._file = file
        self._index = index  # of chunks, on disk until the end: a log of days has a million
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._extras: dict[str, list[Any]] = {"ATTACHMENT": [], "METADATA": []}
        self._chunks = 0
        self.counts: Counter[int] = Counter()  # messages of each channel
        self.span = (0, 0)  # [ns] first and last log time
        file.write(records.MAGIC)
        file.write(_record_bytes(Header("ros2", _LIBRARY)))

    def __contains__(self, channel: int) -> bool:
        return channel in self._channels

    def define(self, channel: int, topic: Topic, schema: int) -> None:
        """Write a channel, and its schema (0: none), ahead of the first chunk with messages of it."""
        from mcap.records import Channel, Schema

        if schema and schema not in self._schemas:
            self._schemas[schema] = Schema(schema, topic.schema, topic.schema_encoding, topic.type)
            self._file.write(_record_bytes(self._schemas[schema]))
        metadata = dict(topic.metadata)
        self._channels[channel] = Channel(channel, topic.name, topic.encoding, metadata, schema)
        self._file.write(_record_bytes(self._channels[channel]))

    def chunk(
        self, packed: PackedChunk, channel: NDArray[np.uint16], logged: NDArray[np.uint64], offsets: Stamps
    ) -> None:
        """Write a chunk, and the index of its messages by their channels, log times [ns] and offsets [bytes] (n,).

        `packed` has the compressed data with size and checksum of what they unpack to.
        """
        from mcap.records import ChunkIndex

        first = int(logged.min())
        last = int(logged.max())
        # The chunk record.
        begin = self._file.tell()
        name = packed.compression.encode()
        head = _CHUNK_FIELDS.pack(first, last, packed.size, packed.crc, len(name)) + name
        head += _LENGTH.pack(len(packed.data))
        self._file.write(records.RECORD.pack(records.CHUNK, len(head) + len(packed.data)) + head)
        self._file.write(packed.data)
        end = self._file.tell()
        # The index of its messages, and its entry in the index of chunks.
        index_offsets = self._index_messages(channel, np.column_stack([logged, offsets]).astype("<u8"))
        entry = ChunkIndex(
            chunk_length=end - begin,
            chunk_start_offset=begin,
            compression=packed.compression,
            compressed_size=len(packed.data),
            message_end_time=last,
            message_index_length=self._file.tell() - end,
            message_index_offsets=index_offsets,
            message_start_time=first,
            uncompressed_size=packed.size,
        )
        self._index.write(_record_bytes(entry))
        self.span = (min(first, self.span[0]), max(last, self.span[1])) if self._chunks else (first, last)
        self._chunks += 1

    def _index_messages(self, channel: NDArray[np.uint16], entries: NDArray[np.uint64]) -> dict[int, int]:
        """Write the index of each channel's messages; return the place [bytes] of each in the file.

        `entries` (n, 2) are log times [ns] and offsets [bytes] of messages of the channels (n,).
        """
        index_offsets = {}
        counts = np.bincount(channel)
        entries = entries[np.argsort(channel, kind="stable")]
        ends = np.cumsum(counts[counts > 0])
        for identity, end in zip(np.flatnonzero(counts).tolist(), ends.tolist(), strict=True):
            content = entries[end - int(counts[identity]) : end].tobytes()
            index_offsets[identity] = self._file.tell()
            head = struct.pack("<HI", identity, len(content))
            self._file.write(records.RECORD.pack(records.MESSAGE_INDEX, len(head) + len(content)) + head + content)
            self.counts[identity] += int(counts[identity])
        return index_offsets

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write metadata."""
        from mcap.records import Metadata, MetadataIndex

        begin = self._file.tell()
        data = _record_bytes(Metadata(name, entries))
        self._file.write(data)
        self._extras["METADATA"].append(MetadataIndex(begin, len(data), name))

    def attachment(self, file: Attachment) -> None:
        """Write an attachment; `finish` writes its entry in the index."""
        from mcap.records import Attachment as AttachmentRecord, AttachmentIndex

        begin = self._file.tell()
        record = AttachmentRecord(
            create_time=file.created,
            log_time=file.logged,
            name=file.name,
            media_type=file.kind,
            data=file.content,
        )
        data = _record_bytes(record)
        self._file.write(data)
        # Its entry in the index of the summary.
        entry = AttachmentIndex(
            offset=begin,
            length=len(data),
            log_time=file.logged,
            create_time=file.created,
            data_size=len(file.content),
            name=file.name,
            media_type=file.kind,
        )
        self._extras["ATTACHMENT"].append(entry)

    def finish(self) -> None:
        """Write the summary."""
        from mcap.opcode import Opcode
        from mcap.records import DataEnd, Footer, Statistics, SummaryOffset

        self._file.write(_record_bytes(DataEnd(0)))
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
        summary.write_group(Opcode.SCHEMA, self._schemas.values())
        summary.write_group(Opcode.CHANNEL, self._channels.values())
        summary.write_group(Opcode.STATISTICS, [statistics])
        summary.copy_group(Opcode.CHUNK_INDEX, self._index)
        summary.write_group(Opcode.ATTACHMENT_INDEX, self._extras["ATTACHMENT"])
        summary.write_group(Opcode.METADATA_INDEX, self._extras["METADATA"])
        offsets = self._file.tell()
        for group in summary.groups:
            summary.write(_record_bytes(SummaryOffset(*group)))
        # The checksum of the summary covers the footer as well, but for the checksum itself, its last 4 bytes.
        footer = _record_bytes(Footer(summary.begin, offsets, 0))[:-4]
        self._file.write(footer + struct.pack("<I", zlib.crc32(footer, summary.crc)) + records.MAGIC)


class _LogSummary:
    """The summary at the end of a log, with its checksum; it is written in pieces, and never whole in memory."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.begin = file.tell()
        self.crc = 0
        self.groups: list[tuple[int, int, int]] = []  # opcode, begin [bytes] and length [bytes] of records of a kind

    def write(self, data: bytes) -> None:
        """Write a piece of the summary, and continue its checksum."""
        self._file.write(data)
        self.crc = zlib.crc32(data, self.crc)

    def write_group(self, opcode: int, entries: Iterable[Any]) -> None:
        """Write records of one kind."""
        begin = self._file.tell()
        for entry in entries:
            self.write(_record_bytes(entry))
        self._note_group(opcode, begin)

    def copy_group(self, opcode: int, file: IO[bytes]) -> None:
        """Copy records of one kind from a file."""
        begin = self._file.tell()
        file.seek(0)
        while data := file.read(_COPY_SIZE):
            self.write(data)
        self._note_group(opcode, begin)

    def _note_group(self, opcode: int, begin: int) -> None:
        """Note the place of the records of one kind, if the file has any."""
        if length := self._file.tell() - begin:
            self.groups.append((opcode, begin, length))


def _record_bytes(record: Any) -> bytes:
    """Return a record of the `mcap` library as bytes."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def compress_chunk(data: bytes) -> PackedChunk:
    """Return records as the data of a new chunk, compressed by zstd."""
    import zstandard

    return PackedChunk("zstd", len(data), zlib.crc32(data), zstandard.compress(data))
