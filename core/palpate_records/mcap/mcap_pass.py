"""One way through the records of an MCAP file, with everything checked that can be."""

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
_BLOCK = 1 << 22  # [bytes] of chunks, or of messages outside chunks, that make a block


@dataclass(frozen=True)
class _Whole:
    """A chunk, and the offsets of its messages by its index."""

    chunk: records.Chunk
    index: list[Stamps]
    head: bytes  # of its record, which identifies it
    end: int = 0  # [bytes] where its record ends in the file
    pieces: tuple[records.ChunkPiece, ...] = ()


class Pass:
    """One way through the records of a file."""

    def __init__(self, path: Path, known: Definitions, summary: Definitions, whole: bool) -> None:
        self._path, self._known, self._summary, self._whole = path, known, summary, whole
        self.counts: Counter[int] = Counter()  # messages of each channel
        self._ended = False
        self._unpacker = records.Unpacker()
        self._latest: Block | None = None
        self.unchecked = 0
        self.heads = bytearray()  # of the chunks that were given, 28 bytes each
        self.chunked = bool(summary.chunks)
        self.done = len(records.MAGIC)  # [bytes] up to which all messages have been given

    @property
    def latest(self) -> int | None:
        """The latest log time [ns] of the last block."""
        return None if self._latest is None else int(self._latest.logged.max())

    def all(self) -> Iterator[Block]:
        """Yield every record of the data section; at the end, what was found is held against the summary."""
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            covered = self._whole and self._check_data(file)
            file.seek(len(records.MAGIC))
            yield from self._chunks(file, size)
            if covered:
                self.unchecked = 0
        if not self._ended:
            raise Damage("it ends before its data do")
        if self._whole and self._summary.counts is not None and self.counts != Counter(self._summary.counts):
            found, said = self.counts.total(), sum(self._summary.counts.values())
            raise Damage(f"it contains {found} messages where its statistics state {said}, or not the same ones")

    def _check_data(self, file: IO[bytes]) -> bool:
        """Return True if a checksum covers all data, and is right; raises Damage where it is wrong."""
        found = check_data_sum(file, self._summary)
        if found is False:
            raise Damage(DATA_WRONG)
        return found is True

    def some(self, offsets: list[int]) -> Iterator[Block]:
        """Yield the chunks that begin at the offsets."""
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            for offset in offsets:
                if offset >= size:
                    raise Damage(f"its summary places a chunk at {offset}, beyond its end")
                file.seek(offset)
                yield from self._chunks(file, size, one=True)

    def _chunks(self, file: IO[bytes], size: int, one: bool = False) -> Iterator[Block]:
        pending: list[_Whole] = []  # chunks, each with what its index says
        try:
            while True:
                opcode, length = self._head(file, size)
                if opcode == records.MESSAGE_INDEX and pending:
                    pending[-1].index.append(_indexed(file.read(length)))
                    continue
                if pending and (one or opcode != records.CHUNK or _enough(pending)):
                    ready, pending = pending, []
                    yield from self._opened(ready)
                    if one:
                        return
                if opcode in (records.DATA_END, records.FOOTER):
                    self._ended = True
                    return
                if opcode == records.MESSAGE:
                    file.seek(-9, 1)
                    yield from self._loose(file, size)
                elif opcode == records.CHUNK:
                    self.chunked = True
                    if length > records.LIMIT:
                        raise Damage(f"a chunk has {length} bytes, more than {records.LIMIT}")
                    piece = records.ChunkPiece(0, file.tell(), length)
                    content = file.read(length)
                    chunk, head = records.open_chunk(content, self._unpacker), content[: records.CHUNK_HEAD]
                    pending.append(_Whole(chunk, [], head, file.tell(), (piece,)))
                else:
                    self._other(file, opcode, length)
        except Damage:
            yield from self._opened(pending)  # what came before the damage is whole
            raise

    def _other(self, file: IO[bytes], opcode: int, length: int) -> None:
        """A record that is not a message, and contains none."""
        if opcode in (records.SCHEMA, records.CHANNEL) and length <= records.LIMIT:
            self._known.define(opcode, file.read(length))
        elif opcode == 0:
            raise Damage("a record has the unknown kind 0")
        elif opcode in records.EXTRAS and self._known.extras is not None and length <= records.LIMIT:
            self._known.extras.append((opcode, file.read(length)))
        else:
            file.seek(length, 1)

    def _head(self, file: IO[bytes], size: int) -> tuple[int, int]:
        raw = file.read(9)
        if len(raw) < 9:
            raise Damage("it ends within a record")
        opcode, length = records.RECORD.unpack(raw)
        if length > size - file.tell():
            raise Damage(f"a record claims {length} bytes, more than the file has")
        return opcode, length

    def _opened(self, pending: list[_Whole]) -> Iterator[Block]:
        """Yield the messages of chunks; of small ones together, since a block costs as much as a thousand messages."""
        if len(pending) > 1 and pending[-1].chunk.checked:
            try:
                block = self._located(_joined(pending))
            except Damage:  # some of them are sound
                block = None
            if block is not None:
                self.heads += b"".join(whole.head for whole in pending)
                yield self._given(block, pending[-1].end)
                return
        for whole in pending:
            block = self._located(whole)
            self.heads += whole.head
            yield self._given(block, whole.end)

    def _given(self, block: Block, end: int) -> Block:
        """Return a block whose messages end there."""
        self.done = end
        self._latest = block if len(block) else self._latest
        return block

    def _located(self, whole: _Whole) -> Block:
        chunk = whole.chunk
        block, others = records.locate(chunk.data, whole.index)
        for opcode, at, length in others:
            self._known.define(opcode, chunk.data[at : at + length])
        self._count(block)
        if not chunk.checked:
            self.unchecked += len(block.offsets)
        return block.made_of(whole.pieces, others) if chunk.checked else block

    def _count(self, block: Block) -> None:
        if len(block.offsets):
            self.counts.update({int(i): int(block.counts[i]) for i in np.flatnonzero(block.counts)})

    def _loose(self, file: IO[bytes], size: int) -> Iterator[Block]:
        """Messages outside chunks, a block at a time, until a record of another kind comes."""
        while True:
            begin = file.tell()
            data = file.read(_BLOCK)
            if len(data) >= 9:
                _, length = records.RECORD.unpack_from(data)
                if length > records.LIMIT or length > size - begin - 9:
                    raise Damage(f"a message claims {length} bytes")
                data += file.read(max(9 + length - len(data), 0))
            messages, others, end = records.scan(data)
            stop = min((at - 9 for _, at, _ in others), default=end)
            offsets = np.array([offset for offset in messages if offset < stop], np.int64)
            block = Block.read(np.frombuffer(data, np.uint8), offsets)
            self._count(block)
            self.unchecked += len(offsets)
            if len(offsets):
                yield self._given(block, begin + stop)
            file.seek(begin + stop)
            if others or not len(offsets):
                return


def check_data_sum(file: IO[bytes], summary: Definitions) -> bool | None:
    """Return True if the checksum over all data is right; None if it has none."""
    if summary.data is None:
        return None
    left, expected = summary.data
    crc = 0
    file.seek(0)
    while left > 0 and (block := file.read(min(left, 1 << 20))):
        crc = zlib.crc32(block, crc)
        left -= len(block)
    return crc == expected


def _enough(pending: list[_Whole]) -> bool:
    """Return True if chunks are worth a block; one without a checksum ends it, and is kept apart from those with
    one."""
    size = sum(len(whole.chunk.data) for whole in pending)
    return size >= _BLOCK or not pending[-1].chunk.checked


def _joined(pending: list[_Whole]) -> _Whole:
    data = b"".join(whole.chunk.data for whole in pending)
    begins = np.cumsum([0, *(len(whole.chunk.data) for whole in pending)]).tolist()
    index = [stamps + begin for begin, whole in zip(begins, pending, strict=False) for stamps in whole.index]
    pieces = (
        replace(piece, begin=begin) for begin, whole in zip(begins, pending, strict=False) for piece in whole.pieces
    )
    return _Whole(records.Chunk(data, True), index, b"", pieces=tuple(pieces))


def _indexed(content: bytes) -> Stamps:
    """Offsets in a message index; none where it is damaged, and the chunk is read record by record."""
    if len(content) < 6 or (len(content) - 6) % 16:
        return np.zeros(0, np.int64)
    entries = np.frombuffer(content[6:], "<u8").reshape(-1, 2)
    return entries[:, 1].astype(np.int64)
