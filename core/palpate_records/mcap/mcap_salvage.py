"""What is whole of an MCAP file from a damaged place on: chunk by chunk, each by its own checksum."""

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

_EXTRAS = 1 << 26  # [bytes] of attachments and metadata that are kept in memory while they are read
_LOOSE = 1 << 22  # [bytes] of messages outside of chunks that make a block
_WORK = 16  # how much more than the file is unpacked without result before the search is given up


@dataclass
class DamagedPiece:
    """A piece of the file that was left out."""

    begin: int  # [bytes]
    end: int
    why: str
    before: int | None = None  # [ns] the latest log time read before it
    after: int | None = None  # [ns] the first log time read behind it


class Salvage:
    """One path through the rest of a file, around damaged parts, from where a reader met damage."""

    def __init__(self, path: Path, known: Definitions, reader: Pass) -> None:
        self._path, self._known, self._counts = path, known, reader.counts
        # Messages that stand by themselves are looked for only where nothing is a chunk; None: not known yet.
        self._chunked: bool | None = True if reader.chunked else None
        step, heads = records.CHUNK_HEAD, bytes(reader.heads)
        self._seen = {heads[at : at + step] for at in range(0, len(heads), step)}
        self._latest = reader.latest  # [ns] log time of what was read before
        self._unpacker = records.Unpacker()
        self._next: int | None = None  # where the next whole chunk is
        self._vain = 0  # [bytes] that were unpacked without a result
        self.losses: list[DamagedPiece] = []
        self.unchecked = 0
        self.repeated = 0  # chunks that are in the file twice

    def blocks(self, begin: int) -> Iterator[Block]:
        """Yield the blocks of messages from the offset `begin` [bytes] to the file's end, and note what is damaged."""
        latest = self._latest
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            position = begin
            while position < size and not self._at_end(file, position, size):
                try:
                    following, block = self._record(file, position, size)
                except Damage as damage:
                    following, block = self._resumed(file, position, size), None
                    self._lose(DamagedPiece(position, following, str(damage), latest))
                if block is not None and len(block):
                    latest = self._timed(block, latest)
                    yield block
                position = following

    def _at_end(self, file: IO[bytes], position: int, size: int) -> bool:
        if size - position != len(records.MAGIC):
            return False
        file.seek(position)
        return file.read() == records.MAGIC

    def _lose(self, loss: DamagedPiece) -> None:
        if self.losses and self.losses[-1].end == loss.begin:
            self.losses[-1].end = loss.end
        else:
            self.losses.append(loss)

    def _timed(self, block: Block, latest: int | None) -> int:
        logged = block.logged
        for loss in self.losses:
            if loss.after is None:
                loss.after = int(logged.min())
        self._counts.update({int(i): int(block.counts[i]) for i in np.flatnonzero(block.counts)})
        return max(int(logged.max()), latest if latest is not None else int(logged.max()))

    def _record(self, file: IO[bytes], position: int, size: int) -> tuple[int, Block | None]:
        """Where the next record begins, and the messages of this one; raises Damage."""
        file.seek(position)
        opcode, length = search.plausible_record(file.read(9), size - position - 9)
        following = position + 9 + length
        if opcode == records.CHUNK:
            self._chunked = True
            return following, self._chunk(file, length)
        if opcode == records.MESSAGE:
            return self._loose(file, position, following, size)
        if opcode == records.MESSAGE_INDEX:
            self._check_index(file.read(min(length, 6)), length)
        elif opcode in (records.SCHEMA, records.CHANNEL) and length <= records.LIMIT:
            self._known.offer(opcode, file.read(length))
        elif opcode in records.EXTRAS and self._known.extras is not None and length <= _EXTRAS:
            self._known.extras.append((opcode, file.read(length)))
        return following, None

    @staticmethod
    def _check_index(content: bytes, length: int) -> None:
        if length < 6 or struct.unpack_from("<I", content, 2)[0] != length - 6:
            raise Damage("a message index is damaged")

    def _chunk(self, file: IO[bytes], length: int) -> Block | None:
        if length > records.LIMIT:
            raise Damage(f"a chunk has {length} bytes, more than {records.LIMIT}")
        piece = records.ChunkPiece(0, file.tell(), length)
        content = file.read(length)
        try:
            chunk = records.open_chunk(content, self._unpacker)
            block, others = records.locate(chunk.data, [])
        except Damage:
            self._vain += length + min(struct.unpack_from("<Q", content.ljust(24, b"\0"), 16)[0], records.LIMIT)
            self._known.spare += records.remains(content)  # taken where nothing else defines what whole chunks need
            raise
        agreed = [self._known.offer(opcode, chunk.data[at : at + size]) for opcode, at, size in others]
        head = content[: records.CHUNK_HEAD]
        if chunk.checked and head in self._seen:
            self.repeated += 1
            return None
        self._seen.add(head)
        self.unchecked += 0 if chunk.checked else len(block)
        return block.made_of((piece,), others) if chunk.checked and all(agreed) else block

    def _loose(self, file: IO[bytes], position: int, following: int, size: int) -> tuple[int, Block]:
        """Messages outside of chunks, which nothing checks: each must be followed by a record that fits."""
        offsets: list[int] = []
        data, begin = bytearray(), position
        while True:
            file.seek(following)
            head = file.read(9)
            more = len(head) == 9 and head[: len(records.MAGIC)] != records.MAGIC
            opcode, length = records.RECORD.unpack(head) if more else (0, 0)
            if more and not search.likely(opcode, length):
                if not offsets:
                    raise Damage("a message is not followed by a record")
                break  # this message is looked at again, as the first of its block
            file.seek(position)
            offsets.append(position - begin)
            data += file.read(following - position)
            position, following = following, following + 9 + length
            if opcode != records.MESSAGE or following > size or len(data) > _LOOSE:
                break
        block = Block.read(np.frombuffer(bytes(data), np.uint8), np.array(offsets, np.int64))
        self.unchecked += len(block)
        return position, block

    def _resumed(self, file: IO[bytes], position: int, size: int) -> int:
        """Where to continue behind a damaged record: at the next chunk, else where the record states its end."""
        claimed = self._claimed(file, position, size)
        if self._next is None or self._next <= position:
            self._next = self._next_chunk(file, position + 1, size)
        if claimed is not None and claimed <= self._next:
            return claimed
        if self._next < size or self._vain > self._patience(size):
            return self._next
        loose = None if self._has_chunks(file, size) else next(search.loose_from(file, position + 1, size), None)
        return loose or search.data_end_from(file, position + 1, size) or size

    def _has_chunks(self, file: IO[bytes], size: int) -> bool:
        """Return True if the head of a chunk is anywhere: then no message outside of a chunk is trusted to be one."""
        if self._chunked is None:
            self._chunked = next(search.chunks_from(file, 0, size), None) is not None
        return self._chunked

    def _next_chunk(self, file: IO[bytes], begin: int, size: int) -> int:
        """Where the next chunk is that is whole; the size of the file if none is left."""
        for at in search.chunks_from(file, begin, size):
            if self._opens(file, at):
                return at
            if self._vain > self._patience(size):
                break
        return size

    @staticmethod
    def _patience(size: int) -> int:
        return _WORK * size + (1 << 28)

    def _claimed(self, file: IO[bytes], position: int, size: int) -> int | None:
        """Return the end that a record claims, where records follow it."""
        file.seek(position)
        head = file.read(9)
        if len(head) < 9:
            return None
        claimed = position + 9 + int(records.RECORD.unpack(head)[1])
        return claimed if claimed < size and search.follows(file, claimed, size) else None

    def _opens(self, file: IO[bytes], position: int) -> bool:
        """Return True if a chunk is whole."""
        file.seek(position)
        content = file.read(records.RECORD.unpack(file.read(9))[1])
        try:
            records.open_chunk(content, self._unpacker)
        except Damage:
            self._vain += len(content) + min(struct.unpack_from("<Q", content, 16)[0], records.LIMIT)
            return False
        return True
