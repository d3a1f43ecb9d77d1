"""``palpate export``: a log as a table, for spreadsheets and other programs, by way of files beside the result."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats, LogError, OutputError, printable
from palpate.host import progress, progressed, recording_of

from palpate_devices.logs.scratch import scratch

_TEXTS = "\0"  # behind the name of a topic, for its texts
_WINDOW = 50_000  # rows of one topic that are put side by side at once


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
        rows = _part(self.stamps, begin, end), _part(self.values, begin, end)
        return TopicArrays(self.names, *rows, self.topic, self.words)

    @property
    def texts(self) -> dict[str, tuple[str, ...]]:
        """The words of each column of texts, by its full name."""
        return {f"{self.topic}:{name}": words for name, words in zip(self.names, self.words, strict=False)}


def export(
    log: Annotated[Path, typer.Argument(help="The log: .mcap, .db3, a bag folder, .csv.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="x.csv, x.npz, x.mat or x.parquet; must not exist.")],
    topics: Annotated[
        list[str] | None, typer.Option("--topic", help="Only this topic; can be repeated. [default: all]")
    ] = None,
) -> None:
    """Write numbers and texts of a log as one table (.csv, .parquet) or one array for each field (.npz, .mat)."""
    write = _WRITERS.get(out.suffix)
    if write is None:
        raise ConfigurationError(f"--out {out}: the name must end in one of {', '.join(_WRITERS)}")
    if out.exists():
        raise OutputError(f"{out}: is there already, and nothing is ever overwritten")
    try:
        with scratch(out.parent) as folder, progress(f"export of {log.name}", "messages"):
            numbers = _numbers(log, topics, folder)
            write(out, numbers)
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    rows = {topic: len(numbers[topic].stamps) for topic in sorted(numbers, reverse=True)}  # numbers after texts
    counts = {topic.rstrip(_TEXTS): count for topic, count in rows.items()}
    typer.echo(f"{sum(counts.values())} messages of {len(counts)} topics are in {out}")


def _numbers(log: Path, topics: list[str] | None, folder: Path) -> dict[str, TopicArrays]:
    """The log's topics, in files of the folder."""
    names: dict[str, tuple[str, ...]] = {}
    files: dict[str, tuple[IO[bytes], IO[bytes]]] = {}
    count = 0
    with ExitStack() as stack:
        for topic, columns, batch in recording_of(log).tables(log):
            count += len(batch.time)
            progressed(count)
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
    missing = [topic for topic in topics or () if topic not in files and topic + _TEXTS not in texts]
    if missing:
        there = printable(", ".join(names))
        raise LogError(f"{log}: --topic {missing[0]}: holds no numbers and no texts (there are: {there})")
    if not files and not texts:
        raise LogError(f"{log}: holds no numbers and no texts")
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
        topic + _TEXTS: _mapped(folder, f"{i}t", names[topic], topic, tuple(tuple(known) for known in places[topic]))
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
    windows = [(begin, min(begin + _WINDOW, count)) for begin in range(0, count, _WINDOW)]
    if all((np.diff(_part(stamps, max(begin - 1, 0), end)) >= 0).all() for begin, end in windows):
        return TopicArrays(names, stamps, values, topic, words)
    order = np.argsort(stamps, kind="stable")  # this, and the stamps, are held: 16 bytes a message
    stamps[:] = stamps[order]
    stamps.flush()
    path = folder / f"{number}.ordered"
    with path.open("wb") as file:
        for begin, end in windows:
            file.write(np.ascontiguousarray(values[order[begin:end]]).data)
    return TopicArrays(names, stamps, np.memmap(path, np.float64, "r", shape=shape), topic, words)


def _part(array: NDArray[Any], begin: int, end: int) -> NDArray[Any]:
    """Some rows, read: pages of a file that is mapped would all stay in memory."""
    if not isinstance(array, np.memmap):
        return array[begin:end]
    width = int(np.prod(array.shape[1:]))
    flat = np.fromfile(str(array.filename), array.dtype, (end - begin) * width, offset=begin * width * array.itemsize)
    return flat.reshape(-1, *array.shape[1:])


def _windows(numbers: Mapping[str, TopicArrays]) -> Iterator[tuple[NDArray[np.int64], dict[str, Floats]]]:
    """The rows of one table, some ten thousand at a time."""
    at = dict.fromkeys(numbers, 0)
    whole = sum(len(entry.stamps) for entry in numbers.values())
    while True:
        progressed(sum(at.values()), whole)
        ahead = {t: _part(n.stamps, at[t], min(at[t] + _WINDOW + 1, len(n.stamps))) for t, n in numbers.items()}
        edge = min((int(stamps[_WINDOW]) for stamps in ahead.values() if len(stamps) > _WINDOW), default=None)
        if edge is None:
            until = {topic: len(entry.stamps) for topic, entry in numbers.items()}
        elif all(not len(stamps) or stamps[0] >= edge for stamps in ahead.values()):
            edge += 1  # more messages of one instant than fit
            until = {topic: int(np.searchsorted(entry.stamps, edge)) for topic, entry in numbers.items()}
        else:  # looked for in what is read: a search through a mapped file would leave all of it in memory
            until = {topic: at[topic] + int(np.searchsorted(stamps, edge)) for topic, stamps in ahead.items()}
        yield _rows({topic: entry.part(at[topic], until[topic]) for topic, entry in numbers.items()})
        at = until
        if edge is None:
            return


def _rows(numbers: Mapping[str, TopicArrays]) -> tuple[NDArray[np.int64], dict[str, Floats]]:
    """Rows of a table: one for each time-stamp of any topic [ns], NaN where a topic has no message at it."""
    keys = {topic: np.stack([entry.stamps, _occurrence(entry.stamps)]) for topic, entry in numbers.items()}
    every, places = np.unique(np.concatenate(list(keys.values()), axis=1), axis=1, return_inverse=True)
    places = places.ravel()
    columns: dict[str, Floats] = {}
    begin = 0
    for entry in numbers.values():
        rows = places[begin : begin + len(entry.stamps)]
        begin += len(entry.stamps)
        for k, name in enumerate(entry.names):
            column = np.full(every.shape[1], np.nan)
            column[rows] = entry.values[:, k]
            columns[f"{entry.topic}:{name}"] = column
    return every[0], columns


def _occurrence(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) how many equal time-stamps came before each one: messages of one instant stay apart."""
    order = np.argsort(stamps, kind="stable")
    ordered = stamps[order]
    begins = np.concatenate([[True], ordered[1:] != ordered[:-1]]) if len(ordered) else np.zeros(0, bool)
    index = np.arange(len(ordered))
    found = np.zeros(len(stamps), np.int64)
    found[order] = index - np.maximum.accumulate(np.where(begins, index, 0))
    return found


def _csv(out: Path, numbers: Mapping[str, TopicArrays]) -> None:
    first = min(int(entry.stamps[0]) for entry in numbers.values() if len(entry.stamps))
    with out.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = (f"{entry.topic}:{name}" for entry in numbers.values() for name in entry.names)
        writer.writerow(["stamp_ns", "time_s", *names])
        texts = _all_texts(numbers)
        for stamps, columns in _windows(numbers):
            lists = [_spoken(column, texts[n]) if n in texts else column.tolist() for n, column in columns.items()]
            seconds = (stamps - first) / 1e9
            for row in zip(stamps.tolist(), seconds.tolist(), *lists, strict=True):
                writer.writerow(["" if value != value else value for value in row])


def _all_texts(numbers: Mapping[str, TopicArrays]) -> dict[str, tuple[str, ...]]:
    return {name: words for entry in numbers.values() for name, words in entry.texts.items()}


def _spoken(places: Floats, words: tuple[str, ...]) -> list[str]:
    """The texts that a column stands for; none where there is no message."""
    return ["" if place != place else words[int(place)] for place in places.tolist()]


def _columns(entry: TopicArrays) -> Iterator[tuple[str, Any]]:
    """Each field with its array, of numbers or of texts."""
    for k, name in enumerate(entry.names):
        column = entry.values[:, k]
        yield name, np.array(_spoken(column, entry.words[k]), str) if entry.words else column


def _arrays(numbers: Mapping[str, TopicArrays]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for entry in numbers.values():
        found[f"{entry.topic}:stamp_ns"] = entry.stamps
        found |= {f"{entry.topic}:{name}": array for name, array in _columns(entry)}
    return found


def _npz(out: Path, numbers: Mapping[str, TopicArrays]) -> None:
    with out.open("xb") as file:
        np.savez_compressed(file, **{name.strip("/").replace("/", "."): a for name, a in _arrays(numbers).items()})


def _mat(out: Path, numbers: Mapping[str, TopicArrays]) -> None:
    """A struct for each topic, named by what MATLAB allows."""
    from scipy.io import savemat

    structs: dict[str, Any] = {}
    for entry in numbers.values():
        fields = structs.setdefault(_word(entry.topic), {})
        fields["stamp_ns"] = entry.stamps
        fields |= {_word(name): array for name, array in _columns(entry)}
    with out.open("xb") as file:
        savemat(file, structs, long_field_names=True, do_compression=True)


def _word(name: str) -> str:
    word = re.sub(r"\W+", "_", name).strip("_")[:63]
    return word if word[:1].isalpha() else f"x{word}"[:63]


def _parquet(out: Path, numbers: Mapping[str, TopicArrays]) -> None:
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import pyarrow.parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError as error:
        raise ConfigurationError("parquet needs a library that is not here: pip install pyarrow") from error
    names = [f"{entry.topic}:{name}" for entry in numbers.values() for name in entry.names]
    texts = _all_texts(numbers)
    kinds = ((name, pyarrow.string() if name in texts else pyarrow.float64()) for name in names)
    fields = [("stamp_ns", pyarrow.int64()), *kinds]
    with pyarrow.parquet.ParquetWriter(out, pyarrow.schema(fields)) as writer:
        for stamps, columns in _windows(numbers):
            spoken = {n: _spoken(columns[n], words) for n, words in texts.items()}
            writer.write_table(pyarrow.table({"stamp_ns": stamps, **columns, **spoken}))


_WRITERS: Mapping[str, Callable[[Path, Mapping[str, TopicArrays]], None]] = {
    ".csv": _csv,
    ".npz": _npz,
    ".mat": _mat,
    ".parquet": _parquet,
}
