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

from palpate_records.log_files import readable, regular
from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_damage import DamageReport
from palpate_records.mcap.mcap_definitions import Definitions
from palpate_records.mcap.mcap_pass import DATA_WRONG, Pass, check_data_sum
from palpate_records.mcap.mcap_records import Block, Damage
from palpate_records.mcap.mcap_salvage import Salvage
from palpate_records.mcap.mcap_search import chunks_from
from palpate_records.messages.topic_kinds import named_by_kind
from palpate_records.messages.topics import Messages, Topic

# Of the format (MCAP 1.0).
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, begin of the summary, begin of its offsets, checksum
_FOOTER_LENGTH = 20  # [bytes] of its content
_END_SIZE = _FOOTER.size + len(records.MAGIC)  # [bytes] of footer and magic at the end of a file
_DATA_END = struct.Struct("<BQI")  # opcode, length, checksum
_DATA_END_LENGTH = 4  # [bytes] of its content


class McapFile:
    """An open file; damage to it raises one LogError, and with `accept_cut` is skipped and reported."""

    def __init__(self, path: Path, accept_cut: bool = False) -> None:
        self.path = path
        self._accept_cut = accept_cut
        self.unchecked = 0  # messages that no checksum covers
        self._notes: list[str] = []  # on damage to the file as a whole
        self._report: DamageReport | None = None  # of the latest pass through a damaged file
        self._doubtful: list[str] = []
        self._complete = self._ended = self._has_end()
        self._summary = self._read_summary() if self._complete else Definitions()
        self._compare_checksum()

    def _has_end(self) -> bool:
        """Return True if the file ends as a finished log does; raises LogError for any other file than a log."""
        regular(self.path)
        with readable(self.path) as file:
            head = file.read(len(records.MAGIC))
            size = file.seek(0, 2)
            file.seek(max(size - len(records.MAGIC), 0))
            tail = file.read()
            if not head:
                raise LogError(f"{self.path}: the file is empty")
            if head != records.MAGIC:
                self._refuse_foreign(file, size)
        return size > 2 * len(records.MAGIC) and tail == records.MAGIC

    def _refuse_foreign(self, file: IO[bytes], size: int) -> None:
        """Raise LogError for a file without the first bytes of a log, unless it has chunks and damage is accepted."""
        if not self._accept_cut or next(chunks_from(file, 0, size), None) is None:
            raise LogError(f"{self.path}: is not an MCAP log")
        self._notes.append("its first bytes are wrong")

    def _compare_checksum(self) -> None:
        """Note a wrong checksum over all data; chunks are read then that have a right one of their own."""
        self._has_right_checksum: bool | None = None  # None without one
        if self._accept_cut and self._summary.data is not None:
            with readable(self.path) as file:
                self._has_right_checksum = check_data_sum(file, self._summary)
            if self._has_right_checksum is False:
                self._notes.append(DATA_WRONG)

    @property
    def complete(self) -> bool:
        """True if the file has its end, and no damage was found so far."""
        return self._complete and not self._notes

    @property
    def report(self) -> DamageReport | None:
        """The report on missing pieces, after a damaged file has been read."""
        return self._report

    @property
    def trouble(self) -> str | None:
        """A sentence on missing messages and places, or on messages without a checksum; None without either."""
        if not self.complete:
            details = "; ".join(self._notes) if self._report is None else self._report.words()
            suffix = f"; {details}" if details else ""
            return f"{self.path.name} is cut or damaged: only the undamaged part was read{suffix}"
        if self.unchecked:
            return f"{self.path.name}: {self.unchecked} messages carry no checksum: damage to them would not be seen"
        return None

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns]; from the summary, else from the whole file."""
        return self._span

    @cached_property
    def _span(self) -> tuple[int, int] | None:
        """The value of `span`, computed once."""
        if self._summary.span is not None:
            return self._summary.span
        first, last = [], []
        for _, messages in self.blocks(set(self.topics)):
            first.append(int(messages.logged.min()))
            last.append(int(messages.logged.max()))
        return (min(first), max(last)) if first else None

    @property
    def counts(self) -> Mapping[str, int] | None:
        """Messages by topic; None unless the summary states them."""
        counts = self._summary.counts
        if counts is None:
            return None
        topic_counts: Counter[str] = Counter()
        for identity, topic in self._summary.channels.items():
            topic_counts[topic.name] += counts.get(identity, 0)
        return topic_counts

    @cached_property
    def _definitions(self) -> Definitions:
        """Schemas and channels; from the summary, else from the whole file."""
        summary = self._summary
        if summary.channels and (summary.counts is None or set(summary.counts) <= set(summary.channels)):
            return summary
        definitions = Definitions()
        counts: Counter[int] = Counter()
        for block in self._blocks(definitions, None, None):
            counts.update({int(i): int(block.counts[i]) for i in np.flatnonzero(block.counts)})
        self._doubtful = definitions.settle(counts)
        return definitions

    @property
    def topics(self) -> Mapping[str, Topic]:
        """Topics by name; from the summary, else from the whole file."""
        return self._topics

    @cached_property
    def _topics(self) -> Mapping[str, Topic]:
        """The value of `topics`, computed once: of channels of one name the first counts."""
        topics: dict[str, Topic] = {}
        for topic in self._topic_of_channel.values():
            topics.setdefault(topic.name, topic)
        return topics

    @cached_property
    def _topic_of_channel(self) -> Mapping[int, Topic]:
        """The topic of each channel."""
        return named_by_kind(self._definitions.channels)

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Yield messages of the `wanted` topics in the order of the file, within [begin, end) of log time [ns]."""
        definitions = self._definitions.copy()
        for block in self._blocks(definitions, begin, end):
            yield from self._messages_of_block(block, definitions, wanted, begin, end)

    def everything(self) -> Iterator[tuple[Definitions, Block]]:
        """Yield the definitions up to each block of records, attachments and metadata included, and the block."""
        definitions = self._definitions.copy()
        definitions.extras = []
        for block in self._blocks(definitions, None, None):
            yield definitions, block

    def _messages_of_block(
        self, block: Block, definitions: Definitions, wanted: Set[str], begin: int | None, end: int | None
    ) -> Iterator[tuple[str, Messages]]:
        """Yield the messages of a block by topic; raises LogError for a channel that the summary leaves out."""
        for identity in np.flatnonzero(block.counts).tolist():
            topic = self._topic_of_channel.get(identity) or definitions.channels.get(identity)
            if topic is None or topic.name not in wanted:
                continue
            if identity not in self._topic_of_channel:
                raise LogError(f"{self.path}: the log's summary leaves out a channel of topic {topic.name}")
            messages = _within(block.of(identity), begin, end)
            if len(messages):
                yield topic.name, messages

    def _blocks(self, definitions: Definitions, begin: int | None, end: int | None) -> Iterator[Block]:
        """Yield blocks of messages: all, or those of a window and perhaps more; raises LogError for damage.

        The records of the file add to the `definitions`.
        """
        if self._accept_cut:
            yield from self._undamaged_blocks(definitions)
            return
        is_window = begin is not None or end is not None
        reader = Pass(self.path, definitions, self._summary, whole=not is_window and self._complete)
        chunks = self._summary.chunks
        try:
            # Of a window only the chunks are read whose times overlap it.
            if chunks and is_window:
                yield from reader.some([offset for first, last, offset in chunks if _overlaps(first, last, begin, end)])
            else:
                yield from reader.all()
        except Damage as damage:
            if self._complete:
                raise LogError(
                    f"{self.path}: the log is damaged: {damage}; accept_cut = true reads the undamaged part"
                ) from damage
        finally:
            self.unchecked = reader.unchecked

    def _undamaged_blocks(self, definitions: Definitions) -> Iterator[Block]:
        """Yield blocks of whole messages around damage, and report what is missing.

        A `Pass` reads up to the first damage, `Salvage` searches on behind it.
        """
        report = DamageReport(
            stated_counts=self._summary.counts, notes=self._notes, doubtful=self._doubtful, cut=not self._ended
        )
        # Up to the first damage, then chunk by chunk.
        reader = Pass(self.path, definitions, self._summary, whole=False)
        is_damaged = False
        try:
            for block in reader.all():
                yield self._note_block(report, block, definitions)
        except Damage:
            is_damaged = True
        report.counts = reader.counts
        self.unchecked = reader.unchecked
        if is_damaged:
            begin = 0 if reader.done == len(records.MAGIC) and self._notes else reader.done
            salvage = Salvage(self.path, definitions, reader)
            for block in salvage.blocks(begin):
                yield self._note_block(report, block, definitions)
            self.unchecked += salvage.unchecked
            report.losses = salvage.losses
            report.repeated = salvage.repeated
        # The checksum over all data, if it is right, covers messages without one of their own.
        if self._has_right_checksum:
            self.unchecked = 0
        report.unchecked = self.unchecked
        if is_damaged or self._notes or report.missing or report.nameless:
            self._complete = False
            self._report = report

    @staticmethod
    def _note_block(report: DamageReport, block: Block, definitions: Definitions) -> Block:
        """Add the times of a block, and its messages of unknown channels, to the report; return the block."""
        if len(block):
            logged = block.logged
            first = int(logged.min())
            report.first = first if report.first is None else min(first, report.first)
            report.last = max(int(logged.max()), report.last or 0)
            nameless = [i for i in np.flatnonzero(block.counts).tolist() if i not in definitions.channels]
            report.nameless += int(block.counts[nameless].sum())
        return block

    def _read_summary(self) -> Definitions:
        """Return the definitions in the summary; raises LogError for a damaged one, which `accept_cut` ignores."""
        definitions = Definitions()
        try:
            with readable(self.path) as file:
                self._read_definitions(file, definitions)
        except Damage as damage:
            if not self._accept_cut:
                raise LogError(
                    f"{self.path}: the log's summary is damaged: {damage}; accept_cut = true ignores it"
                ) from damage
            self._notes.append(f"its summary is damaged: {damage}")
            return Definitions()
        return definitions

    def _read_definitions(self, file: IO[bytes], definitions: Definitions) -> None:
        """Add the definitions in the summary at the end of the file, and the checksum of its data; raises Damage."""
        summary_end = file.seek(-_END_SIZE, 2)
        size = summary_end + _END_SIZE
        footer = file.read(_FOOTER.size)
        opcode, length, begin, _, crc = _FOOTER.unpack(footer)
        if (opcode, length) != (records.FOOTER, _FOOTER_LENGTH):
            raise Damage("it has no footer")
        if begin > size:
            raise Damage(f"it is declared to begin at {begin}")
        # The data end before the summary, or before the footer of a log without one (0).
        definitions.data = _data_checksum(file, (begin or summary_end) - _DATA_END.size)
        if begin == 0:
            return
        if not len(records.MAGIC) < begin <= summary_end or size - begin > records.LIMIT:
            raise Damage(f"it is declared to begin at {begin}")
        file.seek(begin)
        content = file.read(summary_end - begin)
        if crc and zlib.crc32(content + footer[:-4]) != crc:  # of summary and footer, without the checksum itself
            raise Damage("its checksum is wrong")
        messages, other_records, end = records.scan(content)
        if messages or end != len(content):
            raise Damage("its records do not fill it")
        for opcode, first, length in other_records:
            definitions.define(opcode, content[first : first + length])


def _data_checksum(file: IO[bytes], end: int) -> tuple[int, int] | None:
    """Return the end [bytes] of the data section and its checksum; None without one."""
    if end < len(records.MAGIC):
        return None
    file.seek(end)
    opcode, length, crc = _DATA_END.unpack(file.read(_DATA_END.size))
    return (end, crc) if (opcode, length) == (records.DATA_END, _DATA_END_LENGTH) and crc else None


def _overlaps(first: int, last: int, begin: int | None, end: int | None) -> bool:
    """Return True if log times from first to last may lie within [begin, end)."""
    return (begin is None or last >= begin) and (end is None or first < end)


def _within(messages: Messages, begin: int | None, end: int | None) -> Messages:
    """Return the messages within [begin, end) of log time [ns]."""
    rows: NDArray[np.bool_] = np.ones(len(messages), bool)
    if begin is not None:
        rows &= messages.logged >= begin
    if end is not None:
        rows &= messages.logged < end
    return messages if rows.all() else messages[rows]
