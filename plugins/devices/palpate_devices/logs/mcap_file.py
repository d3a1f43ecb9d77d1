"""An MCAP file as a container of topics."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Set
from functools import cached_property
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray
from palpate import LogError

from palpate_devices.logs import mcap_records as records
from palpate_devices.logs.mcap_definitions import Known
from palpate_devices.logs.mcap_pass import Pass
from palpate_devices.logs.mcap_records import Block, Damage
from palpate_devices.logs.topics import Messages, Topic


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
        for identity in np.flatnonzero(block.counts).tolist():
            topic = known.channels.get(identity)
            if topic is None or topic.name not in wanted:
                continue
            messages = _within(block.of(identity), begin, end)
            if topic.type != self.topics[topic.name].type:
                raise LogError(f"{self.path}: topic {topic.name} is recorded with two types, {topic.type} and another")
            if len(messages):
                yield topic.name, messages

    def _passed(self, known: Known, begin: int | None, end: int | None) -> Iterator[Block]:
        """Blocks of messages, up to the end or to the first damage."""
        reader = Pass(self.path, known, self._summary, whole=begin is None and end is None and self._complete)
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
