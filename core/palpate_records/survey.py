"""A survey of a log: the contents of its topics, their regularity, and their delay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from palpate import Floats, LogError, printable

from palpate_records.field_statistics import FieldStatistics
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.definitions import short_name
from palpate_records.messages.readable_messages import ReadableMessages
from palpate_records.messages.readings import SECOND, FieldReading, MessageDecoder, TopicTable
from palpate_records.messages.topics import Container, Messages, Stamps, Topic
from palpate_records.progress import Progress, silent
from palpate_records.recording import Survey, TopicSurvey

# Choices.
_GAP_INTERVALS = 10.0  # usual intervals that make a gap
_MAX_HELD = 200_000  # intervals of a topic that are held at once
_MAX_SHOWN = 40  # fields of one topic, and frames
_PROBE_MESSAGES = 200  # of a block, in which frames are searched
_MIN_STAMPS = 10  # beyond which equal stamps are a finding


class SampleOfRow:
    """An even sample of the values of a long row: all values of a short one."""

    def __init__(self) -> None:
        self._parts: list[Floats] = []
        self._count = 0  # values of the parts
        self._stride = 1  # of the values that are held
        self._offset = 0  # of the next value to hold, in the next block

    def add(self, values: Floats) -> bool:
        """Add values; return True if every other value was dropped."""
        part = values[self._offset :: self._stride].copy()  # a view would hold all values
        self._offset = (self._offset - len(values)) % self._stride
        self._parts.append(part)
        self._count += len(part)
        if self._count <= _MAX_HELD:
            return False
        self._parts = [np.concatenate(self._parts)[::2]]
        self._count = len(self._parts[0])
        self._stride *= 2
        self._offset = 0
        return True

    @property
    def values(self) -> Floats:
        """The values that are held."""
        return np.concatenate(self._parts) if self._parts else np.zeros(0)


class _TopicStatistics:
    """Statistics of one topic, in memory that does not grow."""

    def __init__(self, topic: Topic, decoder: MessageDecoder | None, note: str = "") -> None:
        """Begin without messages; a topic without a decoder has a note on the reason."""
        self.topic = topic
        self.decoder = decoder
        self.note = note
        self.fields: dict[str, int | None] = {}
        self._count = 0
        self._first = 0  # [ns] log time
        self._last = 0
        self._intervals = SampleOfRow()  # [s]
        self._lateness = SampleOfRow()  # [s]
        self._gaps = 0  # counted by the usual interval, once not all intervals are held
        self._usual_interval = 0.0  # [s]; 0 as long as all are held
        self._longest = 0.0  # [s]
        self._stamps: tuple[int, int] | None = None  # [ns] the first and the last
        self._readable = ReadableMessages(topic.name)
        self._statistics: FieldStatistics | None = None
        self._frames: set[str] = set()

    def add(self, messages: Messages) -> None:
        """Add a block of messages."""
        self._add_times(np.sort(messages.logged))
        if self.decoder is None:
            return
        for piece, (statistics, table) in self._readable.results(messages, partial(self._read, self.decoder)):
            statistics.add(table.values)
            if table.stamps is not None and len(table.stamps):
                first, last = int(table.stamps.min()), int(table.stamps.max())
                first_before, last_before = self._stamps or (first, last)
                self._stamps = min(first, first_before), max(last, last_before)
                self._lateness.add((piece.logged[table.rows] - table.stamps) / SECOND)

    def _read(self, decoder: MessageDecoder, messages: Messages) -> tuple[FieldStatistics, TopicTable]:
        """Return the statistics of the topic and the numbers of messages; raises LogError."""
        if self._statistics is None:
            self.fields = dict(decoder.fields(messages.payload(0)))
            self._statistics = FieldStatistics(list(islice(columns_of(self.fields), _MAX_SHOWN)))
        if len(self._frames) < _MAX_SHOWN and short_name(self.topic.type) == "tf2_msgs/TFMessage":
            for row in range(min(len(messages), _PROBE_MESSAGES)):
                self._frames.update(decoder.names(messages.payload(row)))
        names = self._statistics.names
        return self._statistics, decoder.read(messages, [FieldReading.parse(name) for name in names])

    def _add_times(self, logged: Stamps) -> None:
        """Add log times (n,) [ns] in their order; of a block that begins before the last one, magnitudes count."""
        last_before = [self._last] if self._count else []
        self._first = min(self._first, int(logged[0])) if self._count else int(logged[0])
        times = np.concatenate([np.array(last_before, np.int64), logged])
        intervals = np.abs(np.diff(times)).astype(np.float64) / SECOND
        self._last = max(int(logged[-1]), self._last) if self._count else int(logged[-1])
        self._count += len(logged)
        if not len(intervals):
            return
        self._longest = max(self._longest, float(intervals.max()))
        if self._usual_interval:
            self._gaps += int(np.count_nonzero(intervals > _GAP_INTERVALS * self._usual_interval))
        held = None if self._usual_interval else self._intervals.values
        # When intervals are dropped for the first time, gaps are counted among all so far.
        if self._intervals.add(intervals) and held is not None:
            all_intervals = np.concatenate([held, intervals])
            self._usual_interval = float(np.median(all_intervals))
            self._gaps = _count_gaps(all_intervals, self._usual_interval)

    @property
    def _frames_note(self) -> str:
        """A sentence on the child frames of transforms, whose numbers alternate; empty for other topics."""
        names = printable(", ".join(sorted(self._frames)))
        return f"its transforms are of {names}: select = NAME chooses one" if self._frames else ""

    def survey(self) -> TopicSurvey:
        """Return the statistics of the topic.

        Of the intervals [s] between messages the percentiles 1, 50 and 99; of the lateness [s], the time from stamp to
        log, the median and the percentile 99.
        """
        names = tuple(path if count is None else f"{path}[{count}]" for path, count in self.fields.items())
        stands_still = self._stamps is not None and self._count > _MIN_STAMPS and self._stamps[0] == self._stamps[1]
        note = self.note or self._readable.note or self._frames_note
        intervals = self._intervals.values
        lateness = self._lateness.values
        # As long as all intervals are held, gaps are counted here, by the usual interval of the whole record.
        percentiles, gaps = None, self._gaps
        if len(intervals):
            low, median, high = (float(x) for x in np.percentile(intervals, (1, 50, 99)))
            percentiles = (low, median, high)
            if not self._usual_interval:
                gaps = _count_gaps(intervals, float(np.median(intervals)))
        return TopicSurvey(
            name=self.topic.name,
            type=self.topic.type,
            encoding=self.topic.encoding,
            messages=self._count,
            first=self._first,
            last=self._last,
            interval=percentiles,
            gaps=gaps,
            longest=self._longest,
            lateness=(float(np.median(lateness)), float(np.percentile(lateness, 99))) if len(lateness) else None,
            fields=names[:_MAX_SHOWN],
            numbers=self._statistics.surveys() if self._statistics else (),
            note="its stamps do not move" if stands_still else note,
        )


def _count_gaps(intervals: Floats, usual_interval: float) -> int:
    """Return the number of gaps among intervals (n,) [s]; 0 if the usual one is 0."""
    return int(np.count_nonzero(intervals > _GAP_INTERVALS * usual_interval)) if usual_interval else 0


def survey_of(container: Container, path: Path, log_format: str, progress: Progress = silent) -> Survey:
    """Read a log once and list its topics, with statistics of their times and numbers.

    `container` is the log, with its topics and their messages; `progress` is called with the number of messages so far.
    Topics that cannot be decoded are listed with the reason.
    """
    statistics: dict[str, _TopicStatistics] = {}
    count = 0
    for name, topic in container.topics.items():
        try:
            statistics[name] = _TopicStatistics(topic, decoder_of(topic))
        except LogError as error:
            statistics[name] = _TopicStatistics(topic, None, str(error))
    for name, messages in container.blocks(set(statistics)):
        statistics[name].add(messages)
        count += len(messages)
        progress(count)
    topics = tuple(topic_statistics.survey() for _, topic_statistics in sorted(statistics.items()))
    return Survey(path, log_format, topics, tuple(note for note in (container.trouble,) if note))


def columns_of(fields: Mapping[str, int | None], max_elements: int = _MAX_SHOWN) -> Iterator[str]:
    """Yield the name of every number of a message; of an array only the first elements, counted from 0."""
    for path, count in fields.items():
        if count is None:
            yield path
        else:
            yield from (f"{path}[{i}]" for i in range(min(count, max_elements)))
