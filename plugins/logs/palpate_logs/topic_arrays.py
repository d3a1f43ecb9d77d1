"""The topics of a log as arrays in files, for logs that are larger than the memory."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError, printable
from palpate_kit.logs.draft_pipeline import recording_of
from palpate_kit.terminal.progress import report_progress

TEXTS = "\0"  # behind the name of a topic, for its texts
WINDOW = 50_000  # rows of one topic that are put side by side at once


@dataclass(frozen=True)
class TopicArrays:
    """One topic as arrays; they lie in files, so that a log may be larger than the memory."""

    names: tuple[str, ...]
    stamps: NDArray[np.int64]  # (n,) [ns]
    values: Floats  # (n, k) as recorded; of texts their places in `words`
    topic: str = ""
    words: tuple[tuple[str, ...], ...] = ()  # of each column of texts, those that there are

    def part(self, begin: int, end: int) -> TopicArrays:
        """Some rows, in memory."""
        rows = part_of(self.stamps, begin, end), part_of(self.values, begin, end)
        return TopicArrays(self.names, *rows, self.topic, self.words)

    @property
    def texts(self) -> dict[str, tuple[str, ...]]:
        """The words of each column of texts, by its full name."""
        return {f"{self.topic}:{name}": words for name, words in zip(self.names, self.words, strict=False)}


def topics_of(log: Path, topics: list[str] | None, folder: Path) -> dict[str, TopicArrays]:
    """The log's topics, in files of the folder."""
    names: dict[str, tuple[str, ...]] = {}
    files: dict[str, tuple[IO[bytes], IO[bytes]]] = {}
    count = 0
    with ExitStack() as stack:
        for topic, columns, batch in recording_of(log).tables(log):
            count += len(batch.time)
            report_progress(count)
            names[topic] = columns
            if topics and topic not in topics:
                continue
            if topic not in files:
                paths = (folder / f"{len(files)}.{kind}" for kind in ("stamps", "values"))
                stamps, values = (stack.enter_context(path.open("wb")) for path in paths)
                files[topic] = stamps, values
            files[topic][0].write(np.ascontiguousarray(batch.time).data)
            files[topic][1].write(np.ascontiguousarray(batch.values).data)
    texts = _texts(log, topics, folder)
    missing = [topic for topic in topics or () if topic not in files and topic + TEXTS not in texts]
    if missing:
        there = printable(", ".join(names))
        raise LogError(f"{log}: --topic {missing[0]}: contains no numbers and no texts (there are: {there})")
    if not files and not texts:
        raise LogError(f"{log}: contains no numbers and no texts")
    return {topic: _mapped(folder, str(i), names[topic], topic) for i, topic in enumerate(files)} | texts


def _texts(log: Path, topics: list[str] | None, folder: Path) -> dict[str, TopicArrays]:
    """The log's topics of texts: each text by its place among those that there are."""
    names: dict[str, tuple[str, ...]] = {}
    places: dict[str, list[dict[str, int]]] = {}
    files: dict[str, tuple[IO[bytes], IO[bytes]]] = {}
    with ExitStack() as stack:
        for topic, columns, stamps, rows in recording_of(log).texts(log):
            if topics and topic not in topics:
                continue
            if topic not in files:
                paths = (folder / f"{len(files)}t.{kind}" for kind in ("stamps", "values"))
                one, other = (stack.enter_context(path.open("wb")) for path in paths)
                files[topic], names[topic], places[topic] = (one, other), columns, [{} for _ in columns]
            known = places[topic]
            codes = [[known[k].setdefault(text, len(known[k])) for k, text in enumerate(row)] for row in rows]
            files[topic][0].write(np.ascontiguousarray(stamps).data)
            files[topic][1].write(np.array(codes, np.float64).data)
    return {
        topic + TEXTS: _mapped(folder, f"{i}t", names[topic], topic, tuple(tuple(known) for known in places[topic]))
        for i, topic in enumerate(files)
    }


def _mapped(
    folder: Path, number: str, names: tuple[str, ...], topic: str, words: tuple[tuple[str, ...], ...] = ()
) -> TopicArrays:
    """A topic's arrays, in the order of time."""
    count = (folder / f"{number}.stamps").stat().st_size // 8
    shape = count, len(names)
    if not count * len(names):
        return TopicArrays(names, np.fromfile(folder / f"{number}.stamps", np.int64), np.zeros(shape), topic, words)
    stamps = np.memmap(folder / f"{number}.stamps", np.int64, "r+", shape=(count,))
    values = np.memmap(folder / f"{number}.values", np.float64, "r+", shape=shape)
    windows = [(begin, min(begin + WINDOW, count)) for begin in range(0, count, WINDOW)]
    if all((np.diff(part_of(stamps, max(begin - 1, 0), end)) >= 0).all() for begin, end in windows):
        return TopicArrays(names, stamps, values, topic, words)
    order = np.argsort(stamps, kind="stable")  # this, and the stamps, are held: 16 bytes a message
    stamps[:] = stamps[order]
    stamps.flush()
    path = folder / f"{number}.ordered"
    with path.open("wb") as file:
        for begin, end in windows:
            file.write(np.ascontiguousarray(values[order[begin:end]]).data)
    return TopicArrays(names, stamps, np.memmap(path, np.float64, "r", shape=shape), topic, words)


def part_of(array: NDArray[Any], begin: int, end: int) -> NDArray[Any]:
    """Some rows, read: pages of a file that is mapped would all stay in memory."""
    if not isinstance(array, np.memmap):
        return array[begin:end]
    width = int(np.prod(array.shape[1:]))
    flat = np.fromfile(str(array.filename), array.dtype, (end - begin) * width, offset=begin * width * array.itemsize)
    return flat.reshape(-1, *array.shape[1:])
