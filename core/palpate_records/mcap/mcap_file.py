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


class McapFile:
    """A file, opened; errors in it raise one LogError, or with `accept_cut` are skipped."""

    def __init__(self, path: Path, accept_cut: bool = False) -> None:
        self.path = path
        self._accept_cut = accept_cut
        self.unchecked = 0  # messages that no checksum covers
        self._notes: list[str] = []  # what is wrong with the file as a whole
        self._report: DamageReport | None = None  # of the latest way through a damaged file
        self._doubtful: list[str] = []
        self._complete = self._ended = self._look()
        self._summary = self._read_summary() if self._complete else Definitions()
        self._compare_data()

    def _look(self) -> bool:
        """Return True if the file ends as a finished log does."""
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
        """A file without the first bytes of a log counts as one if it contains chunks, and is read only on request."""
        if not self._accept_cut or next(chunks_from(file, 0, size), None) is None:
            raise LogError(f"{self.path}: is not an MCAP log")
        self._notes.append("its first bytes are wrong")

    def _compare_data(self) -> None:
        """Say where the checksum over all data is wrong; what is read then is what each chunk's own confirms."""
        self._data_right: bool | None = None
        if self._accept_cut and self._summary.data is not None:
            with readable(self.path) as file:
                self._data_right = check_data_sum(file, self._summary)
            if self._data_right is False:
                self._notes.append(DATA_WRONG)

    @property
    def complete(self) -> bool:
        """True if the file has its end, and nothing in it was found to be damaged."""
        return self._complete and not self._notes

    @property
    def report(self) -> DamageReport | None:
        """What is missing, once a damaged file has been read."""
        return self._report

    @property
    def trouble(self) -> str | None:
        """That something is missing, how much and where, or that nothing guards the messages."""
        if not self.complete:
            words = "; ".join(self._notes) if self._report is None else self._report.words()
            return (
                f"{self.path.name} is cut or damaged: only the undamaged part was read{f'; {words}' if words else ''}"
            )
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
        """Messages by topic, where the summary states it."""
        counts, channels = self._summary.counts, self._summary.channels
        if counts is None:
            return None
        total: Counter[str] = Counter()
        for identity, topic in channels.items():
            total[topic.name] += counts.get(identity, 0)
        return total

    @cached_property
    def _definitions(self) -> Definitions:
        """Schemas and channels; from the summary, else from the whole file."""
        known = self._summary
        if known.channels and (known.counts is None or set(known.counts) <= set(known.channels)):
            return known
        known = Definitions()
        seen: Counter[int] = Counter()
        for block in self._passed(known, None, None):
            seen.update({int(i): int(block.counts[i]) for i in np.flatnonzero(block.counts)})
        self._doubtful = known.settle(seen)
        return known

    @property
    def topics(self) -> Mapping[str, Topic]:
        """By name; from the summary, else from the whole file."""
        return self._topics

    @cached_property
    def _topics(self) -> Mapping[str, Topic]:
        found: dict[str, Topic] = {}
        for topic in self._named.values():
            found.setdefault(topic.name, topic)
        return found

    @cached_property
    def _named(self) -> Mapping[int, Topic]:
        """The topic of each channel."""
        return named_by_kind(self._definitions.channels)

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Messages of the requested topics in the order of the file, within [begin, end) of log time [ns]."""
        known = self._definitions.copy()
        for block in self._passed(known, begin, end):
            yield from self._sorted_out(block, known, wanted, begin, end)

    def everything(self) -> Iterator[tuple[Definitions, Block]]:
        """Blocks of records as they are, and what has been defined up to there, attachments and metadata included."""
        known = self._definitions.copy()
        known.extras = []
        for block in self._passed(known, None, None):
            yield known, block

    def _sorted_out(
        self, block: Block, known: Definitions, wanted: Set[str], begin: int | None, end: int | None
    ) -> Iterator[tuple[str, Messages]]:
        for identity in np.flatnonzero(block.counts).tolist():
            topic = self._named.get(identity) or known.channels.get(identity)
            if topic is None or topic.name not in wanted:
                continue
            if identity not in self._named:
                raise LogError(f"{self.path}: the log's summary leaves out a channel of topic {topic.name}")
            messages = _within(block.of(identity), begin, end)
            if len(messages):
                yield topic.name, messages

    def _passed(self, known: Definitions, begin: int | None, end: int | None) -> Iterator[Block]:
        """Blocks of messages: all, or those of a window and maybe more; raises LogError where they are damaged."""
        if self._accept_cut:
            yield from self._around(known)
            return
        windowed = begin is not None or end is not None
        reader = Pass(self.path, known, self._summary, whole=not windowed and self._complete)
        chunks = self._summary.chunks
        try:
            if chunks and windowed:
                yield from reader.some([c[2] for c in chunks if _overlaps(c, begin, end)])
            else:
                yield from reader.all()
        except Damage as damage:
            if self._complete:
                raise LogError(
                    f"{self.path}: the log is damaged: {damage}; accept_cut = true reads the undamaged part"
                ) from damage
        finally:
            self.unchecked = reader.unchecked

    def _around(self, known: Definitions) -> Iterator[Block]:
        """Blocks of messages that are whole, around what is damaged; what is missing is reported."""
        report = DamageReport(
            said=self._summary.counts, notes=self._notes, doubtful=self._doubtful, cut=not self._ended
        )
        reader = Pass(self.path, known, self._summary, whole=False)
        problem = None
        try:
            for block in reader.all():
                yield self._seen(report, block, known)
        except Damage as damage:
            problem = str(damage)
        report.counts = reader.counts
        self.unchecked = reader.unchecked
        if problem is not None:
            begin = 0 if reader.done == len(records.MAGIC) and self._notes else reader.done
            salvage = Salvage(self.path, known, reader)
            for block in salvage.blocks(begin):
                yield self._seen(report, block, known)
            self.unchecked += salvage.unchecked
            report.losses, report.repeated = salvage.losses, salvage.repeated
        self.unchecked = report.unchecked = 0 if self._data_right else self.unchecked
        if problem is not None or self._notes or report.missing or report.nameless:
            self._complete, self._report = False, report

    @staticmethod
    def _seen(report: DamageReport, block: Block, known: Definitions) -> Block:
        if len(block):
            logged = block.logged
            low = int(logged.min())
            report.first = low if report.first is None else min(low, report.first)
            report.last = max(int(logged.max()), report.last or 0)
            nameless = [i for i in np.flatnonzero(block.counts).tolist() if i not in known.channels]
            report.nameless += int(block.counts[nameless].sum())
        return block

    def _read_summary(self) -> Definitions:
        known = Definitions()
        try:
            with readable(self.path) as file:
                self._read_definitions(file, known)
        except Damage as damage:
            if not self._accept_cut:
                raise LogError(
                    f"{self.path}: the log's summary is damaged: {damage}; accept_cut = true ignores it"
                ) from damage
            self._notes.append(f"its summary is damaged: {damage}")
            return Definitions()
        return known

    def _read_definitions(self, file: IO[bytes], known: Definitions) -> None:
        size = file.seek(-37, 2) + 37
        footer = file.read(29)
        opcode, length, start, _, crc = struct.unpack("<BQQQI", footer)
        if (opcode, length) != (records.FOOTER, 20):
            raise Damage("it has no footer")
        if start > size:
            raise Damage(f"it is declared to begin at {start}")
        known.data = _data_checksum(file, (start or size - 37) - 13)
        if start == 0:
            return
        if not len(records.MAGIC) < start <= size - 37 or size - start > records.LIMIT:
            raise Damage(f"it is declared to begin at {start}")
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
