"""The topics of a log as arrays in files, for logs that are larger than the memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError, printable
from palpate_kit.logs.draft_pipeline import recording_of
from palpate_kit.terminal.progress import report_progress

TEXTS = "\0"  # behind the name of a topic, for its texts
_WINDOW = 50_000  # rows that are sorted at once


@dataclass(frozen=True)
class TopicArrays:
    """Rows of one topic, in memory."""

    topic: str
    names: tuple[str, ...]
    stamps: NDArray[np.int64]  # (n,) [ns]
    values: Floats  # (n, k) as recorded; of texts their places in the words


@dataclass(frozen=True)
class TopicFiles:
    """One topic in two files, which are open only while they are read: a log may have thousands of topics."""

    topic: str
    names: tuple[str, ...]
    base: Path
    words: tuple[tuple[str, ...], ...] = ()  # of each column of texts, those that there are

    def __len__(self) -> int:
        return self._file("stamps").stat().st_size // 8

    def _file(self, kind: str) -> Path:
        return self.base.with_name(f"{self.base.name}.{kind}")

    def append(self, stamps: NDArray[np.int64], values: Floats) -> None:
        """Write more rows, at the end."""
        for kind, array in (("stamps", stamps), ("values", values)):
            with self._file(kind).open("ab") as file:
                file.write(np.ascontiguousarray(array).data)

    def stamps(self, begin: int = 0, end: int | None = None) -> NDArray[np.int64]:
        """Time-stamps of some rows (n,) [ns], read."""
        return np.fromfile(self._file("stamps"), np.int64, -1 if end is None else end - begin, offset=8 * begin)

    def rows(self, begin: int, end: int) -> TopicArrays:
        """Some rows, read: pages of a file that is mapped would all stay in memory."""
        k = len(self.names)
        values = np.fromfile(self._file("values"), np.float64, (end - begin) * k, offset=8 * begin * k)
        return TopicArrays(self.topic, self.names, self.stamps(begin, end), values.reshape(end - begin, k))

    def column(self, k: int) -> Floats:
        """One column of all rows (n,)."""
        shape = len(self), len(self.names)
        return (
            np.array(np.memmap(self._file("values"), np.float64, "r", shape=shape)[:, k]) if shape[0] else np.zeros(0)
        )

    def sort(self) -> None:
        """Bring the rows into the order of time."""
        stamps = self.stamps()  # these, and their order, are held: 16 bytes a message
        if (stamps[1:] >= stamps[:-1]).all():
            return
        order = np.argsort(stamps, kind="stable")
        stamps[order].tofile(self._file("stamps"))
        if self.names:
            values = np.memmap(self._file("values"), np.float64, "r", shape=(len(stamps), len(self.names)))
            with self._file("sorted").open("wb") as file:
                for begin in range(0, len(order), _WINDOW):
                    file.write(np.ascontiguousarray(values[order[begin : begin + _WINDOW]]).data)
            self._file("sorted").rename(self._file("values"))


def topics_of(log: Path, topics: list[str] | None, folder: Path, notes: list[str]) -> dict[str, TopicFiles]:
    """Return the log's topics, in files of the folder; what is left out, and why, is added to the notes."""
    names: dict[str, None] = {}
    files: dict[str, TopicFiles] = {}
    count = 0
    for topic, columns, batch in recording_of(log).tables(log, notes):
        count += len(batch.time)
        report_progress(count)
        names[topic] = None
        if topics and topic not in topics:
            continue
        if topic not in files:
            files[topic] = TopicFiles(topic, columns, folder / f"{len(files)}")
        files[topic].append(batch.time, batch.values)
    texts = _texts(log, topics, folder)
    missing = [topic for topic in topics or () if topic not in files and topic + TEXTS not in texts]
    why = f"; {printable(notes[0])}" if notes else ""
    if missing:
        there = printable(", ".join(names))
        raise LogError(f"{log}: --topic {missing[0]}: contains no numbers and no texts (there are: {there}){why}")
    if not files and not texts:
        raise LogError(f"{log}: contains no numbers and no texts{why}")
    found = files | texts
    for one in found.values():
        one.sort()
    return found


def _texts(log: Path, topics: list[str] | None, folder: Path) -> dict[str, TopicFiles]:
    """Return the log's topics of texts: each text by its place among those that there are."""
    files: dict[str, TopicFiles] = {}
    places: dict[str, list[dict[str, int]]] = {}
    for topic, columns, stamps, rows in recording_of(log).texts(log):
        if topics and topic not in topics:
            continue
        if topic not in files:
            files[topic] = TopicFiles(topic, columns, folder / f"{len(files)}t")
            places[topic] = [{} for _ in columns]
        known = places[topic]
        codes = [[known[k].setdefault(text, len(known[k])) for k, text in enumerate(row)] for row in rows]
        files[topic].append(stamps, np.array(codes, np.float64))
    return {
        topic + TEXTS: TopicFiles(topic, file.names, file.base, tuple(tuple(known) for known in places[topic]))
        for topic, file in files.items()
    }
