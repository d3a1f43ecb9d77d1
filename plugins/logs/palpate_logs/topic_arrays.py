"""The topics of a log as arrays in files, for logs that are larger than the memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError, printable
from palpate_kit.logs.draft_pipeline import recording_of
from palpate_kit.terminal.progress import report_progress

TEXTS = "\0"  # behind the name of a topic: the key of its texts
_SORTED_ROWS = 50_000  # in memory at once, a choice: memory against calls
_STAMP_BYTES = 8  # of an int64
_NUMBER_BYTES = 8  # of a float64


@dataclass(frozen=True)
class TopicArrays:
    """Rows of one topic, in memory."""

    topic: str
    names: tuple[str, ...]  # of the columns
    stamps: NDArray[np.int64]  # (n,) [ns]
    values: Floats  # (n, k) as recorded; codes of texts


@dataclass(frozen=True)
class TopicFiles:
    """One topic in two files next to each other, which are open only while they are read: a log may have thousands.

    ``BASE.stamps`` holds the time-stamps, 8 bytes each; ``BASE.values`` the rows, 8 bytes for each column.
    """

    topic: str
    names: tuple[str, ...]  # of the columns
    base: Path
    texts: tuple[tuple[str, ...], ...] = ()  # of a topic of texts: those of each column, whose codes are the values

    def __len__(self) -> int:
        return self._file("stamps").stat().st_size // _STAMP_BYTES

    def _file(self, content: str) -> Path:
        """Return the path of the file of "stamps" or "values"."""
        return self.base.with_name(f"{self.base.name}.{content}")

    def append(self, stamps: NDArray[np.int64], values: Floats) -> None:
        """Add rows at the end: time-stamps (n,) [ns] and values (n, k)."""
        for content, array in (("stamps", stamps), ("values", values)):
            with self._file(content).open("ab") as file:
                file.write(np.ascontiguousarray(array).data)

    def stamps(self, begin: int = 0, end: int | None = None) -> NDArray[np.int64]:
        """Return the time-stamps (n,) [ns] of the rows from `begin` up to `end`."""
        row_count = -1 if end is None else end - begin  # -1: all to the end of the file
        return np.fromfile(self._file("stamps"), np.int64, row_count, offset=_STAMP_BYTES * begin)

    def rows(self, begin: int, end: int) -> TopicArrays:
        """Return the rows from `begin` up to `end`, read: pages of a file that is mapped would all stay in memory."""
        width = len(self.names)
        count = (end - begin) * width
        numbers = np.fromfile(self._file("values"), np.float64, count, offset=_NUMBER_BYTES * begin * width)
        return TopicArrays(self.topic, self.names, self.stamps(begin, end), numbers.reshape(end - begin, width))

    def column(self, k: int) -> Floats:
        """Return column k of all rows (n,)."""
        shape = len(self), len(self.names)
        if not shape[0]:  # an empty file cannot be mapped
            return np.zeros(0)
        return np.array(np.memmap(self._file("values"), np.float64, "r", shape=shape)[:, k])

    def sort(self) -> None:
        """Bring the rows into the order of time; time-stamps and their order, 16 bytes a message, are in memory."""
        stamps = self.stamps()
        if (stamps[1:] >= stamps[:-1]).all():
            return
        order = np.argsort(stamps, kind="stable")
        stamps[order].tofile(self._file("stamps"))
        if not self.names:
            return
        values = np.memmap(self._file("values"), np.float64, "r", shape=(len(stamps), len(self.names)))
        with self._file("sorted").open("wb") as file:
            for first_row in range(0, len(order), _SORTED_ROWS):
                rows = order[first_row : first_row + _SORTED_ROWS]
                file.write(np.ascontiguousarray(values[rows]).data)
        self._file("sorted").rename(self._file("values"))


def topics_of(log: Path, topics: list[str] | None, folder: Path, notes: list[str]) -> dict[str, TopicFiles]:
    """Return the topics of a log by their keys, in files of a folder, each in the order of time.

    The key of a topic of numbers is its name, that of its texts ends in `TEXTS`. `topics` are those to read; None or
    empty: all. Sentences on what is left out are added to `notes`. Raises LogError for a topic without numbers and
    texts.
    """
    number_files, names = _number_files(log, topics, folder, notes)
    text_files = _text_files(log, topics, folder)
    reason = f"; {printable(notes[0])}" if notes else ""
    for topic in topics or ():
        if topic not in number_files and topic + TEXTS not in text_files:
            names_text = printable(", ".join(names))
            raise LogError(
                f"{log}: --topic {topic}: contains no numbers and no texts (there are: {names_text}){reason}"
            )
    topic_files = number_files | text_files
    if not topic_files:
        raise LogError(f"{log}: contains no numbers and no texts{reason}")
    for files in topic_files.values():
        files.sort()
    return topic_files


def _number_files(
    log: Path, topics: list[str] | None, folder: Path, notes: list[str]
) -> tuple[dict[str, TopicFiles], list[str]]:
    """Return the files of the topics of numbers that are to be read, and the names of all topics of numbers."""
    names: dict[str, None] = {}  # in the order of the log
    topic_files: dict[str, TopicFiles] = {}
    message_count = 0
    for topic, columns, batch in recording_of(log).tables(log, notes):
        message_count += len(batch.time)
        report_progress(message_count)
        names[topic] = None
        if topics and topic not in topics:
            continue
        if topic not in topic_files:
            topic_files[topic] = TopicFiles(topic, columns, folder / f"{len(topic_files)}")
        topic_files[topic].append(batch.time, batch.values)
    return topic_files, [*names]


def _text_files(log: Path, topics: list[str] | None, folder: Path) -> dict[str, TopicFiles]:
    """Return the files of the topics of texts that are to be read, by their keys.

    In a file is the code of each text: its index among the different texts of its column, in their order in the log.
    """
    topic_files: dict[str, TopicFiles] = {}
    codes_by_topic: dict[str, list[dict[str, int]]] = {}  # for each column: the code of each text
    for topic, columns, stamps, rows in recording_of(log).texts(log):
        if topics and topic not in topics:
            continue
        if topic not in topic_files:
            topic_files[topic] = TopicFiles(topic, columns, folder / f"{len(topic_files)}t")
            codes_by_topic[topic] = [{} for _ in columns]
        topic_files[topic].append(stamps, _encode_texts(rows, codes_by_topic[topic]))
    return {
        topic + TEXTS: replace(files, texts=tuple(tuple(codes) for codes in codes_by_topic[topic]))
        for topic, files in topic_files.items()
    }


def _encode_texts(rows: Sequence[Sequence[str]], codes_by_column: Sequence[dict[str, int]]) -> Floats:
    """Return the codes (n, k) of rows of k texts; a text that is new in its column gets the next code there."""
    codes = [[codes.setdefault(text, len(codes)) for codes, text in zip(codes_by_column, row)] for row in rows]
    return np.array(codes, np.float64)
