"""Salvage of an MCAP file behind damage: chunk by chunk, each by its own checksum."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from palpate_records.mcap import mcap_records as records, mcap_search as search
from palpate_records.mcap.mcap_definitions import Definitions
from palpate_records.mcap.mcap_pass import Pass
from palpate_records.mcap.mcap_records import Block, Damage

# Choices.
_MAX_EXTRA_SIZE = 1 << 26  # [bytes] of an attachment or metadata that is kept in memory
_BLOCK_SIZE = 1 << 22  # [bytes] of messages outside chunks that make a block
_MAX_WORK = 16  # bytes that are unpacked without result per byte of the file, before the search is given up
_MIN_WORK = 1 << 28  # [bytes] that are unpacked without result for any file
# Of the format (MCAP 1.0).
_INDEX_HEAD = 6  # [bytes] of a message index: channel 2, length 4
_SIZE_PLACE = 16  # [bytes] of a chunk's content before its unpacked size: two times


@dataclass
class DamagedPiece:
    """A piece of the file that was skipped."""

    begin: int  # [bytes]
    end: int
    why: str
    before: int | None = None  # [ns] the latest log time read before it
    after: int | None = None  # [ns] the first log time read behind it


class Salvage:
    """A pass through the rest of a file around damaged parts, from the damage on that another reader met."""

    def __init__(self, path: Path, definitions: Definitions, reader: Pass) -> None:
        """Go on from the damage that `reader` met, with the definitions of topics that it has read."""
        self._path = path
        self._definitions = definitions
        self._counts = reader.counts
        # Single messages are searched only in files without chunks; None: not known yet.
        self._has_chunks: bool | None = True if reader.chunked else None
        # The heads of the chunks that the reader met, by which a repeated one is known.
        heads = bytes(reader.heads)
        self._heads = {heads[begin : begin + records.CHUNK_HEAD] for begin in range(0, len(heads), records.CHUNK_HEAD)}
        self._latest = reader.latest  # [ns] log time of the messages before
        self._unpacker = records.Unpacker()
        self._next_chunk: int | None = None  # [bytes] offset of the next whole chunk, if it was searched
        self._useless_work = 0  # [bytes] that were unpacked without a result
        self.losses: list[DamagedPiece] = []
        self.unchecked = 0
        self.repeated = 0  # chunks that the file has twice

    def blocks(self, begin: int) -> Iterator[Block]:
        """Yield the blocks of messages from the offset `begin` [bytes] to the file's end, and note what is damaged."""
        latest = self._latest
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            position = begin
            while position < size and not self._is_at_end(file, position, size):
                block = None
                try:
                    next_position, block = self._read_record(file, position, size)
                except Damage as damage:
                    next_position = self._resume_position(file, position, size)
                    self._note_loss(DamagedPiece(position, next_position, str(damage), latest))
                if block is not None and len(block):
                    latest = self._note_block(block, latest)
                    yield block
                position = next_position

    def _is_at_end(self, file: IO[bytes], position: int, size: int) -> bool:
        """Return True if only the last bytes of a finished log follow."""
        if size - position != len(records.MAGIC):
            return False
        file.seek(position)
        return file.read() == records.MAGIC

    def _note_loss(self, loss: DamagedPiece) -> None:
        """Add a loss; one that follows the last loss directly makes it longer."""
        if self.losses and self.losses[-1].end == loss.begin:
            self.losses[-1].end = loss.end
        else:
            self.losses.append(loss)

    def _note_block(self, block: Block, latest: int | None) -> int:
        """Add the messages of a block to the counts, and its time to losses before it; return the latest log time."""
        logged = block.logged
        for loss in self.losses:
            if loss.after is None:
                loss.after = int(logged.min())
        self._counts.update({int(i): int(block.counts[i]) for i in np.flatnonzero(block.counts)})
        return max(int(logged.max()), latest if latest is not None else int(logged.max()))

    def _read_record(self, file: IO[bytes], position: int, size: int) -> tuple[int, Block | None]:
        """Return the position of the next record, and the messages of the one at a position; raises Damage."""
        file.seek(position)
        content_begin = position + records.RECORD_HEAD
        opcode, length = search.plausible_record(file.read(records.RECORD_HEAD), size - content_begin)
        next_position = content_begin + length
        if opcode == records.CHUNK:
            self._has_chunks = True
            return next_position, self._read_chunk(file, length)
        if opcode == records.MESSAGE:
            return self._read_loose_messages(file, position, next_position, size)
        if opcode == records.MESSAGE_INDEX:
            self._check_index(file.read(min(length, _INDEX_HEAD)), length)
        elif opcode in (records.SCHEMA, records.CHANNEL) and length <= records.LIMIT:
            self._definitions.offer(opcode, file.read(length))
        elif opcode in records.EXTRAS and self._definitions.extras is not None and length <= _MAX_EXTRA_SIZE:
            self._definitions.extras.append((opcode, file.read(length)))
        return next_position, None

    @staticmethod
    def _check_index(content: bytes, length: int) -> None:
        """Raise Damage for a message index whose length contradicts that of its record."""
        if length < _INDEX_HEAD or struct.unpack_from("<I", content, 2)[0] != length - _INDEX_HEAD:
            raise Damage("a message index is damaged")

    def _read_chunk(self, file: IO[bytes], length: int) -> Block | None:
        """Return the messages of the chunk whose content is next; None for one that was read before. Raises Damage.

        Of a damaged chunk the definitions are kept, for messages whose channel nothing else defines.
        """
        if length > records.LIMIT:
            raise Damage(f"a chunk has {length} bytes, more than {records.LIMIT}")
        piece = records.ChunkPiece(0, file.tell(), length)
        content = file.read(length)
        # The index of a chunk is not trusted here: the chunk is read record by record.
        try:
            chunk = records.open_chunk(content, self._unpacker)
            block, other_records = records.locate(chunk.data, [])
        except Damage:
            self._note_useless_work(content, length)
            self._definitions.spare += records.remains(content)
            raise
        agrees = True
        for opcode, begin, size in other_records:
            agrees &= self._definitions.offer(opcode, chunk.data[begin : begin + size])
        head = content[: records.CHUNK_HEAD]
        if chunk.checked and head in self._heads:
            self.repeated += 1
            return None
        self._heads.add(head)
        if not chunk.checked:
            self.unchecked += len(block)
        return block.made_of((piece,), other_records) if chunk.checked and agrees else block

    def _note_useless_work(self, content: bytes, length: int) -> None:
        """Add the length [bytes] of a chunk that could not be opened, and the size that it claims to unpack to."""
        padded_content = content.ljust(_SIZE_PLACE + 8, b"\0")
        (claimed_size,) = struct.unpack_from("<Q", padded_content, _SIZE_PLACE)
        self._useless_work += length + min(claimed_size, records.LIMIT)

    def _read_loose_messages(self, file: IO[bytes], position: int, next_position: int, size: int) -> tuple[int, Block]:
        """Return the position behind messages outside chunks, and these as a block; raises Damage.

        `next_position` is the end of the first one, `size` [bytes] that of the file. Nothing checks them: each must be
        followed by a plausible record.
        """
        offsets: list[int] = []
        data = bytearray()
        begin = position
        while True:
            file.seek(next_position)
            head = file.read(records.RECORD_HEAD)
            has_record = len(head) == records.RECORD_HEAD and head[: len(records.MAGIC)] != records.MAGIC
            opcode, length = records.RECORD.unpack(head) if has_record else (0, 0)
            if has_record and not search.likely(opcode, length):
                if not offsets:
                    raise Damage("a message is not followed by a record")
                break  # the last message is read again, as the first of its block
            file.seek(position)
            offsets.append(position - begin)
            data += file.read(next_position - position)
            position = next_position
            next_position = position + records.RECORD_HEAD + length
            if opcode != records.MESSAGE or next_position > size or len(data) > _BLOCK_SIZE:
                break
        block = Block.read(np.frombuffer(bytes(data), np.uint8), np.array(offsets, np.int64))
        self.unchecked += len(block)
        return position, block

    def _resume_position(self, file: IO[bytes], position: int, size: int) -> int:
        """Return the position of the next record behind a damaged one.

        The next record is the next whole chunk, or the end that the damaged record claims, if that comes first and
        records follow it; of a file without chunks the next plausible message, else the end of the data. `position` is
        that of the damaged record, `size` that of the file, both in bytes.
        """
        claimed_end = self._claimed_end(file, position, size)
        if self._next_chunk is None or self._next_chunk <= position:
            self._next_chunk = self._find_chunk(file, position + 1, size)
        if claimed_end is not None and claimed_end <= self._next_chunk:
            return claimed_end
        if self._next_chunk < size or self._useless_work > self._max_useless_work(size):
            return self._next_chunk
        message_position = None
        if not self._contains_chunks(file, size):
            message_position = next(search.loose_from(file, position + 1, size), None)
        return message_position or search.data_end_from(file, position + 1, size) or size

    def _contains_chunks(self, file: IO[bytes], size: int) -> bool:
        """Return True if the file has the head of a chunk: then messages outside chunks are not trusted."""
        if self._has_chunks is None:
            self._has_chunks = next(search.chunks_from(file, 0, size), None) is not None
        return self._has_chunks

    def _find_chunk(self, file: IO[bytes], begin: int, size: int) -> int:
        """Return the position of the next whole chunk; the size of the file without one."""
        for position in search.chunks_from(file, begin, size):
            if self._is_whole_chunk(file, position):
                return position
            if self._useless_work > self._max_useless_work(size):
                break
        return size

    @staticmethod
    def _max_useless_work(size: int) -> int:
        """Return the bytes that may be unpacked without a result, for a file of a size [bytes]."""
        return _MAX_WORK * size + _MIN_WORK

    def _claimed_end(self, file: IO[bytes], position: int, size: int) -> int | None:
        """Return the end that a record claims, if records follow it; else None."""
        file.seek(position)
        head = file.read(records.RECORD_HEAD)
        if len(head) < records.RECORD_HEAD:
            return None
        _, length = records.RECORD.unpack(head)
        claimed_end = position + records.RECORD_HEAD + int(length)
        return claimed_end if claimed_end < size and search.follows(file, claimed_end, size) else None

    def _is_whole_chunk(self, file: IO[bytes], position: int) -> bool:
        """Return True if the chunk at a position is whole."""
        file.seek(position)
        _, length = records.RECORD.unpack(file.read(records.RECORD_HEAD))
        content = file.read(length)
        try:
            records.open_chunk(content, self._unpacker)
        except Damage:
            self._note_useless_work(content, len(content))
            return False
        return True
