"""The records of an MCAP file: chunks opened, checked and cut into messages in whole arrays.

Nothing that the file claims is trusted: lengths are held against what is there, checksums are compared, and the index
of a chunk only speeds up what the chunk itself must confirm: that its records fill it without a gap.
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
_REMAINS = 1 << 20  # [bytes] at the beginning of a damaged chunk in which definitions are looked for
LIMIT = 1 << 28  # [bytes]; no chunk, and no single record, is larger
_OTHERS = 1 << 18  # records of a chunk that are not messages, and one in addition for every kilobyte
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, STATISTICS, METADATA, DATA_END = 0x09, 0x0B, 0x0C, 0x0F
EXTRAS = (ATTACHMENT, METADATA)
RECORD = struct.Struct("<BQ")
CHUNK_HEAD = 28  # bytes that identify a chunk: its times, size and checksum
HEAD = 31  # bytes of a message record before its payload: record 9, channel 2, sequence 4, two times 16

Other = tuple[int, int, int]  # opcode, offset and length of the content of a record that is not a message


class Damage(Exception):  # noqa: N818  (a signal: the container says it in the user's words)
    """The file is not what it was when it was written."""


@dataclass(frozen=True)
class Chunk:
    """A chunk, opened."""

    data: bytes
    checked: bool  # it has a checksum, and that is right


class Unpacker:
    """What chunks are decompressed with: made once, since making it costs half as much as a chunk."""

    @cached_property
    def zstd(self) -> Any:
        """The decompressor of zstd."""
        import zstandard

        return zstandard.ZstdDecompressor()


def open_chunk(content: bytes, unpacker: Unpacker) -> Chunk:
    """Return a chunk record's content, decompressed and checked; raises Damage."""
    try:
        _, _, size, crc, name_length = struct.unpack_from("<QQQII", content)
        name = content[32 : 32 + name_length].decode()
        (length,) = struct.unpack_from("<Q", content, 32 + name_length)
    except (struct.error, UnicodeDecodeError) as error:
        raise Damage("a chunk's head is not whole") from error
    packed = memoryview(content)[40 + name_length :]  # no copy of a megabyte
    if length != len(packed):
        raise Damage(f"a chunk claims {length} bytes and has {len(packed)}")
    if size > LIMIT:
        raise Damage(f"a chunk claims {size} bytes, more than {LIMIT}")
    if size > largest(length):
        raise Damage(f"a chunk of {length} bytes claims to become {size}, more than {largest(length)}")
    data = _decompressed(name, packed, size, unpacker)
    if len(data) != size:
        raise Damage(f"a chunk claims {size} bytes and contains {len(data)}")
    if crc and zlib.crc32(data) != crc:
        raise Damage("a chunk's checksum is wrong")
    return Chunk(data, crc != 0)


def _decompressed(name: str, packed: memoryview, size: int, unpacker: Unpacker) -> bytes:
    """At most one byte more than `size`, whatever the packed bytes claim."""
    if name == "":
        return bytes(packed)
    try:
        if name == "zstd":
            return _zstd(packed, size, unpacker.zstd)
        if name == "lz4":
            import lz4.frame  # type: ignore[import-untyped]

            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    except Exception as error:  # each library has errors of its own, and RuntimeError
        raise Damage(f"a chunk cannot be decompressed ({name}: {error})") from error
    raise Damage(f"a chunk's compression {name[:20]!r} is not one of zstd, lz4 and none")


def _zstd(packed: memoryview, size: int, unpacker: Any) -> bytes:
    import zstandard

    if zstandard.get_frame_parameters(packed).content_size == size:
        data: bytes = unpacker.decompress(packed, max_output_size=size)
        if len(data) == size:
            return data
    reader = unpacker.stream_reader(packed, read_across_frames=True)
    return bytes(reader.read(size + 1))


def remains(content: bytes) -> list[tuple[int, bytes]]:
    """Schemas and channels, as far as they can be read, of a chunk that is damaged."""
    try:
        (name_length,) = struct.unpack_from("<I", content, 28)
        data = _as_far_as_it_goes(content[32 : 32 + min(name_length, 5)], content[40 + name_length :])
        _, others, _ = scan(data)
    except (struct.error, Damage):
        return []
    return [(opcode, data[at : at + length]) for opcode, at, length in others if opcode in (SCHEMA, CHANNEL)]


def _as_far_as_it_goes(name: bytes, packed: bytes) -> bytes:
    """Return the first bytes that can be decompressed, a little at a time."""
    import lz4.frame
    import zstandard

    if name not in (b"zstd", b"lz4"):
        return packed[:_REMAINS]
    tool = zstandard.ZstdDecompressor().decompressobj() if name == b"zstd" else lz4.frame.LZ4FrameDecompressor()
    data = bytearray()
    with suppress(Exception):  # each library has errors of its own
        for at in range(0, len(packed), 1 << 10):
            data += tool.decompress(packed[at : at + (1 << 10)])
            if len(data) >= _REMAINS:
                break
    return bytes(data[:_REMAINS])


def scan(data: bytes, begin: int = 0, end: int | None = None) -> tuple[list[int], list[Other], int]:
    """Offsets of the message records, the other records, and where the last whole record ends."""
    end = len(data) if end is None else end
    messages: list[int] = []
    others: list[Other] = []
    most = _OTHERS + len(data) // 1024
    unpack, position = RECORD.unpack_from, begin
    while position + 9 <= end:
        opcode, length = unpack(data, position)
        following = position + 9 + length
        if following > end:
            break
        if opcode != MESSAGE:
            others.append((opcode, position + 9, length))
            if len(others) > most:
                raise Damage(f"a chunk of {len(data)} bytes has more than {most} records that are not messages")
        elif length >= HEAD - 9:
            messages.append(position)
        else:
            raise Damage("a message is shorter than its head")
        position = following
    return messages, others, position


def locate(data: bytes, index: list[Stamps]) -> tuple[Block, list[Other]]:
    """Return a chunk's messages, and its other records: from the index if it is right, else record by record."""
    if index:
        found = _confirmed(data, np.sort(np.concatenate(index), kind="stable"))
        if found is not None:
            return found
    messages, others, end = scan(data)
    if end != len(data):
        raise Damage("a chunk's records do not fill it")
    return Block.read(np.frombuffer(data, np.uint8), np.array(messages, np.int64)), others


def _confirmed(data: bytes, offsets: Stamps) -> tuple[Block, list[Other]] | None:
    """Return the messages at the offsets, if all are messages and what lies between them is whole and no message."""
    if not len(offsets) or offsets[0] < 0 or offsets[-1] + HEAD > len(data):
        return None
    found = Block.read(np.frombuffer(data, np.uint8), offsets)
    lengths = found.lengths
    if (found.opcodes != MESSAGE).any() or lengths.max() > len(data) or lengths.min() < 0:
        return None
    ends = np.concatenate([[0], offsets + HEAD + lengths])
    begins = np.concatenate([offsets, [len(data)]])
    others: list[Other] = []
    for gap in np.flatnonzero(ends != begins):
        messages, between, end = scan(data, int(ends[gap]), int(begins[gap]))
        if ends[gap] > begins[gap] or messages or end != begins[gap]:
            return None
        others += between
    return found, others


@dataclass(frozen=True)
class ChunkPiece:
    """A chunk within a block."""

    begin: int  # [bytes] in the block's buffer
    place: int  # [bytes] in the file, of its record's content
    length: int  # [bytes]


@dataclass(frozen=True)
class Block:
    """Message records in one buffer, with their heads."""

    buffer: Bytes
    offsets: Stamps
    heads: Bytes  # (n, HEAD)
    pieces: tuple[ChunkPiece, ...] = ()  # of which it is made, where each has a checksum and only defines what is known

    @classmethod
    def read(cls, buffer: Bytes, offsets: Stamps) -> Block:
        """From the offsets of the records."""
        return cls(buffer, offsets, gather(buffer, offsets, HEAD))

    def made_of(self, pieces: tuple[ChunkPiece, ...], others: list[Other]) -> Block:
        """With the chunks that it is made of, if there is nothing in them but messages and what they need."""
        return replace(self, pieces=pieces) if {kind for kind, _, _ in others} <= {SCHEMA, CHANNEL} else self

    def __len__(self) -> int:
        return len(self.offsets)

    @cached_property
    def channel(self) -> NDArray[np.uint16]:
        """Whose message each is; in one piece, since it is looked at once for each topic."""
        return np.ascontiguousarray(column(self.heads, 9, "<u2"))

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """How many messages there are of each channel, by its number."""
        return np.bincount(self.channel)

    @property
    def logged(self) -> Stamps:
        """Log times [ns]."""
        return np.asarray(column(self.heads, 15, "<i8"))

    @property
    def opcodes(self) -> Bytes:
        """What kind of record each is."""
        return self.heads[:, 0]

    @property
    def lengths(self) -> Stamps:
        """Of the payloads; a number beyond 2^63 turns negative, and is damage."""
        return np.asarray(column(self.heads, 1, "<i8") - (HEAD - 9))

    def of(self, channel: int) -> Messages:
        """Return the messages of one channel; views of their heads, so that what is not looked at is not copied."""
        if self.counts[channel] == len(self):
            offsets, heads = self.offsets, self.heads
        else:
            rows = np.flatnonzero(self.channel == channel)
            offsets, heads = self.offsets[rows], gather(self.heads.reshape(-1), rows * HEAD, HEAD)
        lengths = column(heads, 1, "<i8") - (HEAD - 9)
        return Messages(self.buffer, offsets + HEAD, lengths, column(heads, 15, "<i8"), column(heads, 23, "<i8"))


def read_text(content: bytes, at: int) -> tuple[str, int]:
    """Return a counted text, and where it ends."""
    raw, end = read_bytes(content, at)
    return raw.decode(errors="replace"), end


def read_bytes(content: bytes, at: int) -> tuple[bytes, int]:
    """Counted bytes, and where they end; raises Damage where they are not all there."""
    try:
        (length,) = struct.unpack_from("<I", content, at)
    except struct.error as error:
        raise Damage("a record is shorter than its fields") from error
    if at + 4 + length > len(content):
        raise Damage("a record is shorter than its fields")
    return content[at + 4 : at + 4 + length], at + 4 + length
