"""A survey of a log: what its topics hold, how regular they are, and how late."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from palpate import LogError, Survey, TopicSurvey

from palpate_devices.logs.decoders import decoder_of
from palpate_devices.logs.readings import SECOND, Decoder
from palpate_devices.logs.topics import Container, Messages, Stamps, Topic

_PAUSE = 10.0  # usual intervals that make a gap
_SHOWN = 40  # fields of one topic


@dataclass
class _Seen:
    """What has been seen of one topic."""

    topic: Topic
    decoder: Decoder | None
    note: str = ""
    fields: dict[str, int | None] = field(default_factory=dict)
    logged: list[Stamps] = field(default_factory=list)
    late: list[Stamps] = field(default_factory=list)

    def add(self, messages: Messages) -> None:
        """Take in a block."""
        first = not self.logged
        self.logged.append(messages.logged)
        if self.decoder is None:
            return
        try:
            if first:
                self.fields = dict(self.decoder.fields(messages.payload(0)))
            table = self.decoder.read(messages, ())
        except LogError as error:
            self.decoder, self.note = None, str(error)
            return
        if table.stamps is not None:
            self.late.append(messages.logged[table.rows] - table.stamps)

    def survey(self) -> TopicSurvey:
        """All of it in numbers."""
        logged = np.concatenate(self.logged) if self.logged else np.zeros(0, np.int64)
        names = tuple(path if count is None else f"{path}[{count}]" for path, count in self.fields.items())
        note = self.note
        late = np.concatenate(self.late) / SECOND if self.late else None
        if late is not None and len(late) > 10 and np.ptp(logged - late * SECOND) == 0:
            note = "its stamps do not move"
        steps = np.diff(np.sort(logged)).astype(np.float64) / SECOND
        usual = float(np.median(steps)) if len(steps) else 0.0
        interval = None if not len(steps) else tuple(float(p) for p in np.percentile(steps, (1, 50, 99)))
        return TopicSurvey(
            self.topic.name,
            self.topic.type,
            self.topic.encoding,
            len(logged),
            int(logged.min()) if len(logged) else 0,
            int(logged.max()) if len(logged) else 0,
            (interval[0], interval[1], interval[2]) if interval else None,
            int(np.count_nonzero(steps > _PAUSE * usual)) if usual else 0,
            float(steps.max()) if len(steps) else 0.0,
            (float(np.median(late)), float(np.percentile(late, 99))) if late is not None and len(late) else None,
            names[:_SHOWN],
            note,
        )


def survey_of(container: Container, path: Path, kind: str) -> Survey:
    """Read a log once and say what it holds; topics that cannot be decoded are listed with the reason."""
    seen: dict[str, _Seen] = {}
    for name, topic in container.topics.items():
        try:
            seen[name] = _Seen(topic, decoder_of(topic))
        except LogError as error:
            seen[name] = _Seen(topic, None, str(error))
    for name, messages in container.blocks(set(seen)):
        seen[name].add(messages)
    topics = tuple(entry.survey() for _, entry in sorted(seen.items()))
    return Survey(path, kind, topics, tuple(note for note in (container.trouble,) if note))


def columns_of(fields: Mapping[str, int | None]) -> Iterator[str]:
    """Every number of a message by its own name, array elements counted from 0."""
    for path, count in fields.items():
        if count is None:
            yield path
        else:
            yield from (f"{path}[{i}]" for i in range(min(count, _SHOWN)))
