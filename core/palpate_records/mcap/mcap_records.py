"""The records of an MCAP file: chunks opened, checked and cut into messages in whole arrays.

Nothing that the file claims is trusted: lengths are compared with the bytes of the file, checksums are computed, and
the index of a chunk only speeds up the check of the chunk itself: that its records fill it without a gap.
"""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate_records.decompression import largest
from palpate_records.messages.topics import Bytes, Messages, Stamps, column, gather

MAGIC = b"\x89MCAP0\r\n"
LIMIT = 1 << 28  # [bytes]; no chunk, and no single record, is larger: a choice
_REMAINS_SIZE = 1 << 20  # [bytes] at the beginning of a damaged chunk in which definitions are searched: a choice
_PIECE_SIZE = 1 << 10  # [bytes] of a damaged chunk that are decompressed at once: a choice
# Records of a chunk that are not messages, and one more for every kilobyte of it: a choice.
_MAX_OTHER_RECORDS, _OTHER_RECORD_BYTES = 1 << 18, 1024
_MAX_SHOWN = 20  # characters of a name in a message: a choice
# Of the format (MCAP 1.0).
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, STATISTICS, METADATA, DATA_END = 0x09, 0x0B, 0x0C, 0x0F
EXTRAS = (ATTACHMENT, METADATA)
RECORD = struct.Struct("<BQ")  # opcode, and length of the content that follows
RECORD_HEAD = RECORD.size  # [bytes]
CHUNK_HEAD = 28  # [bytes] that identify a chunk: its times, size and checksum
HEAD = 31  # [bytes] of a message record before its payload: record 9, channel 2, sequence 4, two times 16
_CHANNEL, _LOGGED, _PUBLISHED = 9, 15, 23  # [bytes] of a message record before its channel and its two times
_CHUNK_FIELDS = struct.Struct("<QQQII")  # first and last time, size and checksum of the data, length of a name
_LENGTH = struct.Struct("<Q")  # of the packed data, behind the name of the compression
_TEXT_LENGTH = struct.Struct("<I")

Other = tuple[int, int, int]  # opcode, offset and length of the content of a record that is not a message


class Damage(Exception):  # noqa: N818  (a signal: the container reports it as an error of the log)
    """Damage to a file since it was written."""


@dataclass(frozen=True)
class Chunk:
    """The decompressed data of a chunk."""

    data: bytes
    checked: bool  # True if it has a checksum, which is right


class Unpacker:
    """The decompressor of chunks, made once: its creation takes half as long as a chunk."""

    @cached_property
    def zstd(self) -> Any:
        """The decompressor of zstd."""
        import zstandard

        return zstandard.ZstdDecompressor()


def open_chunk(content: bytes, unpacker: Unpacker) -> Chunk:
    """Return a chunk record's content, decompressed and checked; raises Damage."""
    try:
        _, _, size, crc, name_length = _CHUNK_FIELDS.unpack_from(content)
        name_end = _CHUNK_FIELDS.size + name_length
        name = content[_CHUNK_FIELDS.size : name_end].decode()
        (length,) = _LENGTH.unpack_from(content, name_end)
    except (struct.error, UnicodeDecodeError) as error:
        raise Damage("a chunk's head is not whole") from error
    packed = memoryview(content)[name_end + _LENGTH.size :]  # no copy of a megabyte
    if length != len(packed):
        raise Damage(f"a chunk claims {length} bytes and has {len(packed)}")
    if size > LIMIT:
        raise Damage(f"a chunk claims {size} bytes, more than {LIMIT}")
    if size > largest(length):
        raise Damage(f"a chunk of {length} bytes claims to become {size}, more than {largest(length)}")
    data = _decompress(name, packed, size, unpacker)
    if len(data) != size:
        raise Damage(f"a chunk claims {size} bytes and contains {len(data)}")
    if crc and zlib.crc32(data) != crc:
        raise Damage("a chunk's checksum is wrong")
    return Chunk(data, crc != 0)


def _decompress(name: str, packed: memoryview, size: int, unpacker: Unpacker) -> bytes:
    """Return the data, at most one byte more than `size`, whatever the packed bytes claim; raises Damage."""
    if name == "":
        return bytes(packed)
    try:
        if name == "zstd":
            return _decompress_zstd(packed, size, unpacker.zstd)
        if name == "lz4":
            import lz4.frame  # type: ignore[import-untyped]

            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    except Exception as error:  # each library has errors of its own, and RuntimeError
        raise Damage(f"a chunk cannot be decompressed ({name}: {error})") from error
    raise Damage(f"a chunk's compression {name[:_MAX_SHOWN]!r} is not one of zstd, lz4 and none")


def _decompress_zstd(packed: memoryview, size: int, unpacker: Any) -> bytes:
    """Return the data of one frame or several, at most one byte more than `size`."""
    import zstandard

    if zstandard.get_frame_parameters(packed).content_size == size:
        data: bytes = unpacker.decompress(packed, max_output_size=size)
        if len(data) == size:
            return data
    reader = unpacker.stream_reader(packed, read_across_frames=True)
    return bytes(reader.read(size + 1))


def remains(content: bytes) -> list[tuple[int, bytes]]:
    """Return opcode and content of the schemas and channels of a damaged chunk, as far as they can be read.

    `content` is that of the chunk's record: times, size, checksum, name of the compression, packed data.
    """
    longest_name = len(b"zstd") + 1  # one character more, so that a longer name is not taken for this
    try:
        (name_length,) = _TEXT_LENGTH.unpack_from(content, CHUNK_HEAD)
        name = content[_CHUNK_FIELDS.size : _CHUNK_FIELDS.size + min(name_length, longest_name)]
        data = _decompress_begin(name, content[_CHUNK_FIELDS.size + name_length + _LENGTH.size :])
        _, other_records, _ = scan(data)
    except (struct.error, Damage):
        return []
    definitions = []
    for opcode, begin, length in other_records:
        if opcode in (SCHEMA, CHANNEL):
            definitions.append((opcode, data[begin : begin + length]))
    return definitions


def _decompress_begin(name: bytes, packed: bytes) -> bytes:
    """Return the first bytes that can be decompressed, in small pieces up to the damage.

    `name` is that of the compression; without one, or with an unknown one, the bytes are taken as they are.
    """
    import lz4.frame
    import zstandard

    if name not in (b"zstd", b"lz4"):
        return packed[:_REMAINS_SIZE]
    unpacker = zstandard.ZstdDecompressor().decompressobj() if name == b"zstd" else lz4.frame.LZ4FrameDecompressor()
    data = bytearray()
    with suppress(Exception):  # each library has errors of its own
        for begin in range(0, len(packed), _PIECE_SIZE):
            data += unpacker.decompress(packed[begin : begin + _PIECE_SIZE])
            if len(data) >= _REMAINS_SIZE:
                break
    return bytes(data[:_REMAINS_SIZE])


def scan(data: bytes, begin: int = 0, end: int | None = None) -> tuple[list[int], list[Other], int]:
    """Return the offsets of the message records, the other records, and the end of the last whole record.

    Another record is opcode, offset and length of its content; `begin` and `end` are those of a part of the data.
    Raises Damage for a message that is too short, and for too many other records.
    """
    end = len(data) if end is None else end
    messages: list[int] = []
    other_records: list[Other] = []
    max_other_records = _MAX_OTHER_RECORDS + len(data) // _OTHER_RECORD_BYTES
    unpack = RECORD.unpack_from
    position = begin
    while position + RECORD_HEAD <= end:
        opcode, length = unpack(data, position)
        next_position = position + RECORD_HEAD + length
        if next_position > end:
            break
        if opcode != MESSAGE:
            other_records.append((opcode, position + RECORD_HEAD, length))
            if len(other_records) > max_other_records:
                raise Damage(
                    f"a chunk of {len(data)} bytes has more than {max_other_records} records that are not messages"
                )
        elif length >= HEAD - RECORD_HEAD:
            messages.append(position)
        else:
            raise Damage("a message is shorter than its head")
        position = next_position
    return messages, other_records, position


def locate(data: bytes, index: list[Stamps]) -> tuple[Block, list[Other]]:
    """Return a chunk's messages and its other records: by the index if it is right, else record by record.

    Raises Damage if the records do not fill the chunk.
    """
    if index:
        block_and_others = _confirm_index(data, np.sort(np.concatenate(index), kind="stable"))
        if block_and_others is not None:
            return block_and_others
    messages, other_records, end = scan(data)
    if end != len(data):
        raise Damage("a chunk's records do not fill it")
    return Block.read(np.frombuffer(data, np.uint8), np.array(messages, np.int64)), other_records


def _confirm_index(data: bytes, offsets: Stamps) -> tuple[Block, list[Other]] | None:
    """Return the messages at the offsets (n,) and the other records; None if the index is wrong.

    `data` are those of a chunk, unpacked. Its index is right if there is a message at each offset, and between them
    whole records of other kinds.
    """
    if not len(offsets) or offsets[0] < 0 or offsets[-1] + HEAD > len(data):
        return None
    block = Block.read(np.frombuffer(data, np.uint8), offsets)
    lengths = block.lengths
    if (block.opcodes != MESSAGE).any() or lengths.max() > len(data) or lengths.min() < 0:
        return None
    # The gaps between the end of one message and the begin of the next.
    ends = np.concatenate([[0], offsets + HEAD + lengths])
    begins = np.concatenate([offsets, [len(data)]])
    other_records: list[Other] = []
    for gap in np.flatnonzero(ends != begins):
        messages, records_in_gap, end = scan(data, int(ends[gap]), int(begins[gap]))
        if ends[gap] > begins[gap] or messages or end != begins[gap]:
            return None
        other_records += records_in_gap
    return block, other_records


@dataclass(frozen=True)
class ChunkPiece:
    """A chunk within a block."""

    begin: int  # [bytes] in the block's buffer
    place: int  # [bytes] of its record's content, in the file
    length: int  # [bytes]


@dataclass(frozen=True)
class Block:
    """Message records in one buffer, with their heads."""

    buffer: Bytes
    offsets: Stamps
    heads: Bytes  # (n, HEAD)
    pieces: tuple[ChunkPiece, ...] = ()  # its chunks, if each has a checksum and holds nothing but known definitions

    @classmethod
    def read(cls, buffer: Bytes, offsets: Stamps) -> Block:
        """Return the records at some offsets (n,) of a buffer."""
        return cls(buffer, offsets, gather(buffer, offsets, HEAD))

    def made_of(self, pieces: tuple[ChunkPiece, ...], other_records: list[Other]) -> Block:
        """Return the block with its chunks, if their other records are schemas and channels alone."""
        opcodes = {opcode for opcode, _, _ in other_records}
        return replace(self, pieces=pieces) if opcodes <= {SCHEMA, CHANNEL} else self

    def __len__(self) -> int:
        return len(self.offsets)

    @cached_property
    def channel(self) -> NDArray[np.uint16]:
        """Channels of the messages (n,); contiguous, since they are compared once for each topic."""
        return np.ascontiguousarray(column(self.heads, _CHANNEL, "<u2"))

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Numbers of messages, by channel."""
        return np.bincount(self.channel)

    @property
    def logged(self) -> Stamps:
        """Log times (n,) [ns]."""
        return np.asarray(column(self.heads, _LOGGED, "<i8"))

    @property
    def opcodes(self) -> Bytes:
        """Opcodes of the records (n,)."""
        return self.heads[:, 0]

    @property
    def lengths(self) -> Stamps:
        """Lengths [bytes] of the payloads (n,); one beyond 2^63 is negative, and damage."""
        return np.asarray(column(self.heads, 1, "<i8") - (HEAD - RECORD_HEAD))

    def of(self, channel: int) -> Messages:
        """Return the messages of one channel, as views of their heads: what is not read is not copied."""
        if self.counts[channel] == len(self):
            offsets = self.offsets
            heads = self.heads
        else:
            rows = np.flatnonzero(self.channel == channel)
            offsets = self.offsets[rows]
            heads = gather(self.heads.reshape(-1), rows * HEAD, HEAD)
        lengths = column(heads, 1, "<i8") - (HEAD - RECORD_HEAD)
        logged, published = (column(heads, offset, "<i8") for offset in (_LOGGED, _PUBLISHED))
        return Messages(self.buffer, offsets + HEAD, lengths, logged, published)


def read_text(content: bytes, begin: int) -> tuple[str, int]:
    """Return the text that begins with its length, and its end; raises Damage."""
    raw, end = read_bytes(content, begin)
    return raw.decode(errors="replace"), end


def read_bytes(content: bytes, begin: int) -> tuple[bytes, int]:
    """Return the bytes that begin with their length, and their end; raises Damage if they are cut."""
    try:
        (length,) = _TEXT_LENGTH.unpack_from(content, begin)
    except struct.error as error:
        raise Damage("a record is shorter than its fields") from error
    first = begin + _TEXT_LENGTH.size
    if first + length > len(content):
        raise Damage("a record is shorter than its fields")
    return content[first : first + length], first + length


def read_entries(packed: bytes) -> dict[str, str]:
    """Return pairs of texts, key and value one after the other; raises Damage."""
    entries = {}
    end = 0
    while end < len(packed):
        key, end = read_text(packed, end)
        entries[key], end = read_text(packed, end)
    return entries
