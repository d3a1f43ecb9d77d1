"""An MCAP file as a container of topics."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray
from palpate import LogError

from palpate_devices.logs import mcap_records as records
from palpate_devices.logs.mcap_records import Block, Damage
from palpate_devices.logs.topics import Messages, Stamps, Topic

_BLOCK = 1 << 22  # [bytes] of messages outside chunks read at once


@dataclass
class Known:
    """What the records read so far have defined."""

    schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)  # name, encoding, text
    channels: dict[int, Topic] = field(default_factory=dict)
    counts: dict[int, int] | None = None  # messages of each channel, by the statistics
    span: tuple[int, int] | None = None  # first and last log time [ns], by the statistics
    chunks: list[tuple[int, int, int]] = field(default_factory=list)  # first, last log time; offset
    data: tuple[int, int] | None = None  # where the data section ends, and its checksum
    extras: list[tuple[int, bytes]] | None = None  # attachments and metadata, where they are wanted

    def define(self, opcode: int, content: bytes) -> None:
        """Take in a record that is no message."""
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
        if self.channels.setdefault(identity, found) != found:
            raise Damage(f"channel {identity} is defined twice, differently")

    def _statistics(self, content: bytes) -> None:
        first, last, length = struct.unpack_from("<QQI", content, 26)
        self.span = (first, last)
        self.counts = dict(struct.iter_unpack("<HQ", content[46 : 46 + length]))


class McapFile:
    """A file, opened; what is wrong with it is said in one LogError, or with `accept_cut` read up to there."""

    def __init__(self, path: Path, accept_cut: bool = False) -> None:
        self.path = path
        self._accept_cut = accept_cut
        self.unchecked = 0  # messages that no checksum covers
        self._complete = self._look()
        self._summary = self._read_summary() if self._complete else Known()

    def _look(self) -> bool:
        """Whether the file ends as a finished log does."""
        try:
            with self.path.open("rb") as file:
                head = file.read(len(records.MAGIC))
                size = file.seek(0, 2)
                file.seek(max(size - len(records.MAGIC), 0))
                tail = file.read()
        except FileNotFoundError as error:
            raise LogError(f"{self.path}: there is no such file") from error
        except OSError as error:
            raise LogError(f"{self.path}: cannot be read: {error.strerror}") from error
        if not head:
            raise LogError(f"{self.path}: the file is empty")
        if head != records.MAGIC:
            raise LogError(f"{self.path}: is no MCAP log")
        return size > 2 * len(records.MAGIC) and tail == records.MAGIC

    @property
    def complete(self) -> bool:
        """Whether the file has its end."""
        return self._complete

    @property
    def trouble(self) -> str | None:
        """That the end is missing, or that nothing guards the messages."""
        if not self._complete:
            return f"{self.path.name} is cut or damaged: only what is whole was read"
        if self.unchecked:
            return f"{self.path.name}: {self.unchecked} messages carry no checksum: damage to them would not be seen"
        return None

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns]; from the summary, else from the whole file."""
        return self._span

    @cached_property
    def _span(self) -> tuple[int, int] | None:
        if self._summary.span is not None:
            return self._summary.span
        first, last = [], []
        for _, messages in self.blocks(set(self.topics)):
            first.append(int(messages.logged.min()))
            last.append(int(messages.logged.max()))
        return (min(first), max(last)) if first else None

    @property
    def counts(self) -> Mapping[str, int] | None:
        """Messages by topic, where the summary says it."""
        counts, channels = self._summary.counts, self._summary.channels
        if counts is None:
            return None
        total: Counter[str] = Counter()
        for identity, topic in channels.items():
            total[topic.name] += counts.get(identity, 0)
        return total

    @cached_property
    def _definitions(self) -> Known:
        """Schemas and channels; from the summary, else from the whole file."""
        known = self._summary
        if known.channels and (known.counts is None or set(known.counts) <= set(known.channels)):
            return known
        known = Known()
        for _ in self._passed(known, None, None):
            pass
        return known

    @property
    def topics(self) -> Mapping[str, Topic]:
        """By name; from the summary, else from the whole file."""
        return self._topics

    @cached_property
    def _topics(self) -> Mapping[str, Topic]:
        found: dict[str, Topic] = {}
        for topic in self._definitions.channels.values():
            found.setdefault(topic.name, topic)
        return found

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Messages of the wanted topics in the order of the file, within [begin, end) of log time [ns]."""
        known = Known(dict(self._definitions.schemas), dict(self._definitions.channels))
        for block in self._passed(known, begin, end):
            yield from self._sorted_out(block, known, wanted, begin, end)

    def everything(self) -> Iterator[tuple[Known, Block]]:
        """Blocks of records as they are, and what has been defined up to there, attachments and metadata included."""
        known = Known(dict(self._summary.schemas), dict(self._summary.channels), extras=[])
        for block in self._passed(known, None, None):
            yield known, block

    def _sorted_out(
        self, block: Block, known: Known, wanted: Set[str], begin: int | None, end: int | None
    ) -> Iterator[tuple[str, Messages]]:
        every = Messages(block.buffer, block.offsets + records.HEAD, block.lengths, block.logged, block.published)
        for identity in np.flatnonzero(np.bincount(block.channel)).tolist():
            topic = known.channels.get(identity)
            if topic is None or topic.name not in wanted:
                continue
            messages = every[np.flatnonzero(block.channel == identity)]
            messages = _within(messages, begin, end)
            if topic.type != self.topics[topic.name].type:
                raise LogError(f"{self.path}: topic {topic.name} is recorded with two types, {topic.type} and another")
            if len(messages):
                yield topic.name, messages

    def _passed(self, known: Known, begin: int | None, end: int | None) -> Iterator[Block]:
        """Blocks of messages, up to the end or to the first damage."""
        reader = _Pass(self.path, known, self._summary, whole=begin is None and end is None and self._complete)
        chunks = self._summary.chunks
        try:
            if chunks and (begin is not None or end is not None):
                yield from reader.some([c[2] for c in chunks if _overlaps(c, begin, end)])
            else:
                yield from reader.all()
        except Damage as damage:
            if self._complete and not self._accept_cut:
                raise LogError(
                    f"{self.path}: the log is damaged: {damage}; accept_cut = true reads up to there"
                ) from damage
            self._complete = False
        finally:
            self.unchecked = reader.unchecked

    def _read_summary(self) -> Known:
        known = Known()
        try:
            with self.path.open("rb") as file:
                self._read_definitions(file, known)
        except Damage as damage:
            if not self._accept_cut:
                raise LogError(
                    f"{self.path}: the log's summary is damaged: {damage}; accept_cut = true ignores it"
                ) from (damage)
            self._complete = False
            return Known()
        return known

    def _read_definitions(self, file: IO[bytes], known: Known) -> None:
        size = file.seek(-37, 2) + 37
        footer = file.read(29)
        opcode, length, start, _, crc = struct.unpack("<BQQQI", footer)
        if (opcode, length) != (records.FOOTER, 20):
            raise Damage("it has no footer")
        if start > size:
            raise Damage(f"it is said to begin at {start}")
        known.data = _data_checksum(file, (start or size - 37) - 13)
        if start == 0:
            return
        if not len(records.MAGIC) < start <= size - 37 or size - start > records.LIMIT:
            raise Damage(f"it is said to begin at {start}")
        file.seek(start)
        content = file.read(size - 37 - start)
        if crc and zlib.crc32(content + footer[:25]) != crc:
            raise Damage("its checksum is wrong")
        messages, others, end = records.scan(content)
        if messages or end != len(content):
            raise Damage("its records do not fill it")
        for opcode, at, length in others:
            known.define(opcode, content[at : at + length])


def _data_checksum(file: IO[bytes], end: int) -> tuple[int, int] | None:
    """Where the data section ends and its checksum, where there is one."""
    if end < len(records.MAGIC):
        return None
    file.seek(end)
    opcode, length, crc = struct.unpack("<BQI", file.read(13))
    return (end, crc) if (opcode, length) == (records.DATA_END, 4) and crc else None


def _overlaps(chunk: tuple[int, int, int], begin: int | None, end: int | None) -> bool:
    return (begin is None or chunk[1] >= begin) and (end is None or chunk[0] < end)


def _within(messages: Messages, begin: int | None, end: int | None) -> Messages:
    rows: NDArray[np.bool_] = np.ones(len(messages), bool)
    if begin is not None:
        rows &= messages.logged >= begin
    if end is not None:
        rows &= messages.logged < end
    return messages if rows.all() else messages[rows]


class _Pass:
    """One way through the records of a file."""

    def __init__(self, path: Path, known: Known, summary: Known, whole: bool) -> None:
        self._path, self._known, self._summary, self._whole = path, known, summary, whole
        self._counts: Counter[int] = Counter()
        self._ended = False
        self.unchecked = 0

    def all(self) -> Iterator[Block]:
        """Every record of the data section; at the end, what was found is held against the summary."""
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            covered = self._whole and self._check_data(file)
            file.seek(len(records.MAGIC))
            yield from self._chunks(file, size)
            if covered:
                self.unchecked = 0
        if not self._ended:
            raise Damage("it ends before its data do")
        if self._whole and self._summary.counts is not None and self._counts != Counter(self._summary.counts):
            found, said = self._counts.total(), sum(self._summary.counts.values())
            raise Damage(f"it holds {found} messages where its statistics say {said}, or not the same ones")

    def _check_data(self, file: IO[bytes]) -> bool:
        """Whether a checksum covers all data, and is right; raises Damage where it is wrong."""
        if self._summary.data is None:
            return False
        left, expected = self._summary.data
        crc = 0
        file.seek(0)
        while left > 0 and (block := file.read(min(left, 1 << 20))):
            crc = zlib.crc32(block, crc)
            left -= len(block)
        if crc != expected:
            raise Damage("the checksum of its data is wrong")
        return True

    def some(self, offsets: list[int]) -> Iterator[Block]:
        """The chunks that begin at the offsets."""
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            for offset in offsets:
                if offset >= size:
                    raise Damage(f"its summary places a chunk at {offset}, beyond its end")
                file.seek(offset)
                yield from self._chunks(file, size, one=True)

    def _chunks(self, file: IO[bytes], size: int, one: bool = False) -> Iterator[Block]:
        chunk: records.Chunk | None = None
        index: list[Stamps] = []
        while True:
            try:
                opcode, length = self._head(file, size)
            except Damage:
                if chunk is not None:  # what came before the damage is whole
                    yield self._opened(chunk, index)
                raise
            if opcode == records.MESSAGE_INDEX and chunk is not None:
                index.append(_indexed(file.read(length)))
                continue
            if chunk is not None:
                yield self._opened(chunk, index)
                chunk, index = None, []
                if one:
                    return
            if opcode in (records.DATA_END, records.FOOTER):
                self._ended = True
                return
            if opcode == records.MESSAGE:
                file.seek(-9, 1)
                yield from self._loose(file, size)
            elif opcode == records.CHUNK:
                if length > records.LIMIT:
                    raise Damage(f"a chunk has {length} bytes, more than {records.LIMIT}")
                chunk = records.open_chunk(file.read(length))
            elif opcode in (records.SCHEMA, records.CHANNEL) and length <= records.LIMIT:
                self._known.define(opcode, file.read(length))
            elif opcode == 0:
                raise Damage("a record has the kind 0, which none has")
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

    def _opened(self, chunk: records.Chunk, index: list[Stamps]) -> Block:
        block, others = records.locate(chunk.data, index)
        for opcode, at, length in others:
            self._known.define(opcode, chunk.data[at : at + length])
        self._count(block)
        if not chunk.checked:
            self.unchecked += len(block.offsets)
        return block

    def _count(self, block: Block) -> None:
        if len(block.offsets):
            counts = np.bincount(block.channel)
            self._counts.update({int(i): int(counts[i]) for i in np.flatnonzero(counts)})

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
                yield block
            file.seek(begin + stop)
            if others or not len(offsets):
                return


def _indexed(content: bytes) -> Stamps:
    """Offsets in a message index; none where it is damaged, and the chunk is read record by record."""
    if len(content) < 6 or (len(content) - 6) % 16:
        return np.zeros(0, np.int64)
    entries = np.frombuffer(content[6:], "<u8").reshape(-1, 2)
    return entries[:, 1].astype(np.int64)
