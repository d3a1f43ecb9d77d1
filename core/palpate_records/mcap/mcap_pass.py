"""One pass through the records of an MCAP file, with all checks that are possible."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_definitions import Definitions
from palpate_records.mcap.mcap_records import Block, Damage
from palpate_records.messages.topics import Stamps

DATA_WRONG = "the checksum of its data is wrong"
_BLOCK_SIZE = 1 << 22  # [bytes] of chunks, or of messages outside chunks, that make a block: a choice
_SUM_SIZE = 1 << 20  # [bytes] that are added to a checksum at once: a choice


@dataclass(frozen=True)
class _PendingChunk:
    """An undamaged chunk, and the offsets of its messages by its index."""

    chunk: records.Chunk
    index: list[Stamps]
    head: bytes  # of its record, which identifies it
    end: int = 0  # [bytes] of its record, in the file
    pieces: tuple[records.ChunkPiece, ...] = ()


class Pass:
    """A pass through the records of a file, which add to its definitions."""

    def __init__(self, path: Path, definitions: Definitions, summary: Definitions, whole: bool) -> None:
        self._path = path
        self._definitions = definitions
        self._summary = summary
        self._whole = whole  # True for a pass that reads all of a complete file
        self.counts: Counter[int] = Counter()  # messages of each channel
        self._ended = False
        self._unpacker = records.Unpacker()
        self._latest: Block | None = None
        self.unchecked = 0
        self.heads = bytearray()  # of the chunks in the blocks so far, CHUNK_HEAD bytes each
        self.chunked = bool(summary.chunks)
        self.done = len(records.MAGIC)  # [bytes] up to which the blocks so far have all messages

    @property
    def latest(self) -> int | None:
        """The latest log time [ns] of the last block."""
        return None if self._latest is None else int(self._latest.logged.max())

    def all(self) -> Iterator[Block]:
        """Yield all messages of the data section; raises Damage, also if their counts are not those of the summary."""
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            is_covered = self._whole and self._check_data(file)  # by a checksum over all data
            file.seek(len(records.MAGIC))
            yield from self._read_blocks(file, size)
            if is_covered:
                self.unchecked = 0
        if not self._ended:
            raise Damage("it ends before its data do")
        if self._whole and self._summary.counts is not None and self.counts != Counter(self._summary.counts):
            count = self.counts.total()
            stated_count = sum(self._summary.counts.values())
            raise Damage(
                f"it contains {count} messages where its statistics state {stated_count}, or not the same ones"
            )

    def _check_data(self, file: IO[bytes]) -> bool:
        """Return True if a checksum covers all data; raises Damage if it is wrong."""
        is_right = check_data_sum(file, self._summary)
        if is_right is False:
            raise Damage(DATA_WRONG)
        return is_right is True

    def some(self, offsets: list[int]) -> Iterator[Block]:
        """Yield the chunks that begin at the offsets."""
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            for offset in offsets:
                if offset >= size:
                    raise Damage(f"its summary places a chunk at {offset}, beyond its end")
                file.seek(offset)
                yield from self._read_blocks(file, size, is_single=True)

    def _read_blocks(self, file: IO[bytes], size: int, is_single: bool = False) -> Iterator[Block]:
        """Yield the messages from the file's position on, to the end of the data; of a single chunk if `is_single`.

        `size` [bytes] is that of the file. Small chunks wait, until they make a block together. Raises Damage, after
        all messages before it.
        """
        pending: list[_PendingChunk] = []  # chunks that will make the next block
        try:
            while True:
                opcode, length = self._read_head(file, size)
                if opcode == records.MESSAGE_INDEX and pending:
                    pending[-1].index.append(_indexed_offsets(file.read(length)))
                    continue
                # The index of a chunk follows it: any other record ends its chunk.
                if pending and (is_single or opcode != records.CHUNK or _are_enough(pending)):
                    complete_chunks = pending
                    pending = []
                    yield from self._blocks_of_chunks(complete_chunks)
                    if is_single:
                        return
                if opcode in (records.DATA_END, records.FOOTER):
                    self._ended = True
                    return
                if opcode == records.MESSAGE:
                    file.seek(-records.RECORD_HEAD, 1)
                    yield from self._loose_blocks(file, size)
                elif opcode == records.CHUNK:
                    pending.append(self._read_chunk(file, length))
                else:
                    self._read_other(file, opcode, length)
        except Damage:
            yield from self._blocks_of_chunks(pending)  # they are whole
            raise

    def _read_chunk(self, file: IO[bytes], length: int) -> _PendingChunk:
        """Return the chunk whose content of a length [bytes] is next; raises Damage."""
        self.chunked = True
        if length > records.LIMIT:
            raise Damage(f"a chunk has {length} bytes, more than {records.LIMIT}")
        piece = records.ChunkPiece(0, file.tell(), length)
        content = file.read(length)
        chunk = records.open_chunk(content, self._unpacker)
        return _PendingChunk(chunk, index=[], head=content[: records.CHUNK_HEAD], end=file.tell(), pieces=(piece,))

    def _read_other(self, file: IO[bytes], opcode: int, length: int) -> None:
        """Read or skip the content of a record without messages; raises Damage."""
        if opcode in (records.SCHEMA, records.CHANNEL) and length <= records.LIMIT:
            self._definitions.define(opcode, file.read(length))
        elif opcode == 0:
            raise Damage("a record has the unknown kind 0")
        elif opcode in records.EXTRAS and self._definitions.extras is not None and length <= records.LIMIT:
            self._definitions.extras.append((opcode, file.read(length)))
        else:
            file.seek(length, 1)

    def _read_head(self, file: IO[bytes], size: int) -> tuple[int, int]:
        """Return opcode and length [bytes] of the next record; raises Damage if it ends behind the file."""
        head = file.read(records.RECORD_HEAD)
        if len(head) < records.RECORD_HEAD:
            raise Damage("it ends within a record")
        opcode, length = records.RECORD.unpack(head)
        if length > size - file.tell():
            raise Damage(f"a record claims {length} bytes, more than the file has")
        return opcode, length

    def _blocks_of_chunks(self, pending: list[_PendingChunk]) -> Iterator[Block]:
        """Yield the messages of chunks; small ones together, since a block costs as much as a thousand messages.

        `pending` are undamaged chunks with the offsets of their messages.
        """
        if len(pending) > 1 and pending[-1].chunk.checked:
            try:
                block = self._block_of_chunk(_join_chunks(pending))
            except Damage:  # in one of them
                block = None
            if block is not None:
                self.heads += b"".join(pending_chunk.head for pending_chunk in pending)
                yield self._note_block(block, pending[-1].end)
                return
        for pending_chunk in pending:
            block = self._block_of_chunk(pending_chunk)
            self.heads += pending_chunk.head
            yield self._note_block(block, pending_chunk.end)

    def _note_block(self, block: Block, end: int) -> Block:
        """Note that all messages up to an end [bytes] are in blocks; return the block."""
        self.done = end
        self._latest = block if len(block) else self._latest
        return block

    def _block_of_chunk(self, pending_chunk: _PendingChunk) -> Block:
        """Return the messages of a chunk, and add its definitions; raises Damage."""
        chunk = pending_chunk.chunk
        block, other_records = records.locate(chunk.data, pending_chunk.index)
        for opcode, begin, length in other_records:
            self._definitions.define(opcode, chunk.data[begin : begin + length])
        self._count(block)
        if not chunk.checked:
            self.unchecked += len(block.offsets)
        return block.made_of(pending_chunk.pieces, other_records) if chunk.checked else block

    def _count(self, block: Block) -> None:
        """Add the messages of a block to the counts of their channels."""
        if len(block.offsets):
            self.counts.update({int(i): int(block.counts[i]) for i in np.flatnonzero(block.counts)})

    def _loose_blocks(self, file: IO[bytes], size: int) -> Iterator[Block]:
        """Yield messages outside chunks, a block at a time, up to a record of another kind; raises Damage."""
        while True:
            begin = file.tell()
            data = file.read(_BLOCK_SIZE)
            # A message that is larger than a block is read to its end.
            if len(data) >= records.RECORD_HEAD:
                _, length = records.RECORD.unpack_from(data)
                if length > records.LIMIT or length > size - begin - records.RECORD_HEAD:
                    raise Damage(f"a message claims {length} bytes")
                data += file.read(max(records.RECORD_HEAD + length - len(data), 0))
            messages, other_records, end = records.scan(data)
            stop = min((first - records.RECORD_HEAD for _, first, _ in other_records), default=end)
            offsets = np.array([offset for offset in messages if offset < stop], np.int64)
            block = Block.read(np.frombuffer(data, np.uint8), offsets)
            self._count(block)
            self.unchecked += len(offsets)
            if len(offsets):
                yield self._note_block(block, begin + stop)
            file.seek(begin + stop)
            if other_records or not len(offsets):
                return


def check_data_sum(file: IO[bytes], summary: Definitions) -> bool | None:
    """Return True if the checksum over all data is right; None if it has none."""
    if summary.data is None:
        return None
    remaining, expected_crc = summary.data
    crc = 0
    file.seek(0)
    while remaining > 0 and (block := file.read(min(remaining, _SUM_SIZE))):
        crc = zlib.crc32(block, crc)
        remaining -= len(block)
    return crc == expected_crc


def _are_enough(pending: list[_PendingChunk]) -> bool:
    """Return True if chunks are worth a block; a chunk without a checksum is never joined with later ones."""
    size = sum(len(pending_chunk.chunk.data) for pending_chunk in pending)
    return size >= _BLOCK_SIZE or not pending[-1].chunk.checked


def _join_chunks(pending: list[_PendingChunk]) -> _PendingChunk:
    """Return checked chunks as one, with the places of its pieces."""
    data = b"".join(pending_chunk.chunk.data for pending_chunk in pending)
    begins = np.cumsum([0, *(len(pending_chunk.chunk.data) for pending_chunk in pending)]).tolist()
    index: list[Stamps] = []
    pieces: list[records.ChunkPiece] = []
    for begin, pending_chunk in zip(begins, pending, strict=False):
        index += [offsets + begin for offsets in pending_chunk.index]
        pieces += [replace(piece, begin=begin) for piece in pending_chunk.pieces]
    return _PendingChunk(records.Chunk(data, checked=True), index, head=b"", pieces=tuple(pieces))


def _indexed_offsets(content: bytes) -> Stamps:
    """Return the offsets (n,) [bytes] in a message index; none of a damaged one: the chunk is read record by record.

    Channel and length, 6 bytes, are followed by pairs of log time and offset, 8 bytes each.
    """
    if len(content) < 6 or (len(content) - 6) % 16:
        return np.zeros(0, np.int64)
    entries = np.frombuffer(content[6:], "<u8").reshape(-1, 2)
    return entries[:, 1].astype(np.int64)
