"""A survey of a log: what its topics contain, how regular they are, and their delay."""

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

_PAUSE = 10.0  # usual intervals that make a gap
_KEPT = 200_000  # intervals of a topic that are held at once
_SHOWN = 40  # fields of one topic
_LOOKED = 200  # messages of a block in which frames are looked for


class SampleOfRow:
    """Some of the values of a long row, evenly: all of them as long as they are few."""

    def __init__(self) -> None:
        self._kept: list[Floats] = []
        self._held, self._every, self._phase = 0, 1, 0

    def add(self, values: Floats) -> bool:
        """Take in values; whether every other one had to go."""
        some = values[self._phase :: self._every].copy()  # a view would hold all of them
        self._phase = (self._phase - len(values)) % self._every
        self._kept.append(some)
        self._held += len(some)
        if self._held <= _KEPT:
            return False
        self._kept = [np.concatenate(self._kept)[::2]]
        self._held, self._every = len(self._kept[0]), 2 * self._every
        self._phase = 0
        return True

    @property
    def values(self) -> Floats:
        """What was kept."""
        return np.concatenate(self._kept) if self._kept else np.zeros(0)


class _TopicCounts:
    """What has been seen of one topic, in memory that does not grow."""

    def __init__(self, topic: Topic, decoder: MessageDecoder | None, note: str = "") -> None:
        self.topic, self.decoder, self.note = topic, decoder, note
        self.fields: dict[str, int | None] = {}
        self._count = 0
        self._first, self._last = 0, 0
        self._steps, self._late = SampleOfRow(), SampleOfRow()
        self._pauses, self._usual = 0, 0.0  # counted by the usual step, once not all steps are kept
        self._longest = 0.0
        self._stamps: tuple[int, int] | None = None  # the least and the greatest
        self._readable = ReadableMessages(topic.name)
        self._gathered: FieldStatistics | None = None
        self._frames: set[str] = set()

    def add(self, messages: Messages) -> None:
        self._time(np.sort(messages.logged))
        if self.decoder is None:
            return
        for some, (gathered, table) in self._readable.results(messages, partial(self._read, self.decoder)):
            gathered.add(table.values)
            if table.stamps is not None and len(table.stamps):
                low, high = int(table.stamps.min()), int(table.stamps.max())
                known = self._stamps or (low, high)
                self._stamps = min(low, known[0]), max(high, known[1])
                self._late.add((some.logged[table.rows] - table.stamps) / SECOND)

    def _read(self, decoder: MessageDecoder, messages: Messages) -> tuple[FieldStatistics, TopicTable]:
        if self._gathered is None:
            self.fields = dict(decoder.fields(messages.payload(0)))
            self._gathered = FieldStatistics(list(islice(columns_of(self.fields), _SHOWN)))
        if len(self._frames) < _SHOWN and short_name(self.topic.type) == "tf2_msgs/TFMessage":
            rows = range(min(len(messages), _LOOKED))
            self._frames.update(name for row in rows for name in decoder.names(messages.payload(row)))
        names = self._gathered.names
        return self._gathered, decoder.read(messages, [FieldReading.parse(name) for name in names])

    def _time(self, logged: Stamps) -> None:
        before = [self._last] if self._count else []
        self._first = min(self._first, int(logged[0])) if self._count else int(logged[0])
        steps = np.abs(np.diff(np.concatenate([np.array(before, np.int64), logged]))).astype(np.float64) / SECOND
        self._last = max(int(logged[-1]), self._last) if self._count else int(logged[-1])
        self._count += len(logged)
        if not len(steps):
            return
        self._longest = max(self._longest, float(steps.max()))
        if self._usual:
            self._pauses += int(np.count_nonzero(steps > _PAUSE * self._usual))
        held = self._steps.values if not self._usual else None
        if self._steps.add(steps) and held is not None:
            every = np.concatenate([held, steps])
            self._usual = float(np.median(every))
            self._pauses = int(np.count_nonzero(every > _PAUSE * self._usual)) if self._usual else 0

    @property
    def _frames_note(self) -> str:
        """The child frames of transforms, which its numbers are of in turn; empty for other topics."""
        names = printable(", ".join(sorted(self._frames)))
        return f"its transforms are of {names}: select = NAME chooses one" if self._frames else ""

    def survey(self) -> TopicSurvey:
        """Return all of it in numbers."""
        names = tuple(path if count is None else f"{path}[{count}]" for path, count in self.fields.items())
        still = self._stamps is not None and self._count > 10 and self._stamps[0] == self._stamps[1]
        steps, late = self._steps.values, self._late.values
        usual = float(np.median(steps)) if len(steps) else 0.0
        low, middle, high = (float(p) for p in np.percentile(steps, (1, 50, 99))) if len(steps) else (0.0, 0.0, 0.0)
        pauses = self._pauses if self._usual else int(np.count_nonzero(steps > _PAUSE * usual)) if usual else 0
        return TopicSurvey(
            name=self.topic.name,
            type=self.topic.type,
            encoding=self.topic.encoding,
            messages=self._count,
            first=self._first,
            last=self._last,
            interval=(low, middle, high) if len(steps) else None,
            gaps=pauses,
            longest=self._longest,
            lateness=(float(np.median(late)), float(np.percentile(late, 99))) if len(late) else None,
            fields=names[:_SHOWN],
            numbers=self._gathered.surveys() if self._gathered else (),
            note="its stamps do not move" if still else self.note or self._readable.note or self._frames_note,
        )


def survey_of(container: Container, path: Path, kind: str, progress: Progress = silent) -> Survey:
    """Read a log once and list its contents; topics that cannot be decoded are listed with the reason."""
    seen: dict[str, _TopicCounts] = {}
    count = 0
    for name, topic in container.topics.items():
        try:
            seen[name] = _TopicCounts(topic, decoder_of(topic))
        except LogError as error:
            seen[name] = _TopicCounts(topic, None, str(error))
    for name, messages in container.blocks(set(seen)):
        seen[name].add(messages)
        count += len(messages)
        progress(count)
    topics = tuple(entry.survey() for _, entry in sorted(seen.items()))
    return Survey(path, kind, topics, tuple(note for note in (container.trouble,) if note))


def columns_of(fields: Mapping[str, int | None], most: int = _SHOWN) -> Iterator[str]:
    """Yield every number of a message by its own name, array elements counted from 0, at most so many of each array."""
    for path, count in fields.items():
        if count is None:
            yield path
        else:
            yield from (f"{path}[{i}]" for i in range(min(count, most)))
