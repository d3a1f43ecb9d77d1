"""Topics as files that other programs read: one table (.csv, .parquet), or one array for each field (.npz, .mat)."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, count, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats
from palpate_kit.terminal.progress import report_progress

from palpate_logs.topic_arrays import TopicArrays, TopicFiles

_ROWS = 50_000  # of one topic that are put side by side at once
_LONGEST = 63  # characters of a name in MATLAB
_CELLS = 1 << 23  # of a table that are held at once


def _windows(numbers: Mapping[str, TopicFiles]) -> Iterator[tuple[NDArray[np.int64], dict[str, Floats]]]:
    """Yield the rows of one table, some ten thousand at a time, or fewer that are long."""
    at = dict.fromkeys(numbers, 0)
    lengths = {topic: len(entry) for topic, entry in numbers.items()}
    window = _window(numbers)
    while True:
        report_progress(sum(at.values()), sum(lengths.values()))
        ahead = {t: entry.stamps(at[t], min(at[t] + window + 1, lengths[t])) for t, entry in numbers.items()}
        edge = min((int(stamps[window]) for stamps in ahead.values() if len(stamps) > window), default=None)
        if edge is None:
            until = dict(lengths)
        elif all(not len(stamps) or stamps[0] >= edge for stamps in ahead.values()):
            edge += 1  # more messages of one instant than fit
            until = {topic: int(np.searchsorted(entry.stamps(), edge)) for topic, entry in numbers.items()}
        else:  # looked for in what is read: a search through a mapped file would leave all of it in memory
            until = {topic: at[topic] + int(np.searchsorted(stamps, edge)) for topic, stamps in ahead.items()}
        yield _rows({topic: entry.rows(at[topic], until[topic]) for topic, entry in numbers.items()})
        at = until
        if edge is None:
            return


def _window(numbers: Mapping[str, TopicFiles]) -> int:
    """Rows of each topic that are put side by side at once; in the worst case no time-stamp is common to two topics."""
    columns = sum(len(entry.names) for entry in numbers.values())
    return max(min(_ROWS, _CELLS // max(columns * len(numbers), 1)), 1)


def _rows(numbers: Mapping[str, TopicArrays]) -> tuple[NDArray[np.int64], dict[str, Floats]]:
    """Rows of a table: one for each time-stamp of any topic [ns], NaN where a topic has no message at it."""
    keys = {topic: np.stack([entry.stamps, _occurrence(entry.stamps)]) for topic, entry in numbers.items()}
    every, places = np.unique(np.concatenate(list(keys.values()), axis=1), axis=1, return_inverse=True)
    places = places.ravel()
    columns: dict[str, Floats] = {}
    names = _column_names(numbers)
    begin = 0
    for topic, entry in numbers.items():
        rows = places[begin : begin + len(entry.stamps)]
        begin += len(entry.stamps)
        for k, name in enumerate(names[topic]):
            column = np.full(every.shape[1], np.nan)
            column[rows] = entry.values[:, k]
            columns[name] = column
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


def _column_names(numbers: Mapping[str, TopicArrays] | Mapping[str, TopicFiles]) -> dict[str, tuple[str, ...]]:
    """Return the columns of a table by the key of their topic."""
    names = names_apart(f"{entry.topic}:{name}" for entry in numbers.values() for name in entry.names)
    return {topic: tuple(islice(names, len(entry.names))) for topic, entry in numbers.items()}


def names_apart(names: Iterable[str], longest: int | None = None) -> Iterator[str]:
    """The names, of `longest` characters at most; one that came before gets the next number that no other name has.

    >>> list(names_apart(["ft_raw", "ft_raw", "ft_raw_2"]))
    ['ft_raw', 'ft_raw_3', 'ft_raw_2']
    """
    every = [name[:longest] for name in names]
    taken: set[str] = set()
    for name in every:
        free = name
        for number in count(2):
            if free not in taken and (free == name or free not in every):
                break
            end = f"_{number}"
            free = f"{name[: None if longest is None else longest - len(end)]}{end}"
        taken.add(free)
        yield free


def _csv(out: Path, numbers: Mapping[str, TopicFiles]) -> dict[str, str]:
    first = min(int(entry.stamps(0, 1)[0]) for entry in numbers.values() if len(entry))
    with out.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = _column_names(numbers)
        writer.writerow(["stamp_ns", "time_s", *chain.from_iterable(names.values())])
        texts = _all_texts(numbers)
        for stamps, columns in _windows(numbers):
            lists = [_spoken(column, texts[n]) if n in texts else column.tolist() for n, column in columns.items()]
            seconds = (stamps - first) / 1e9
            for row in zip(stamps.tolist(), seconds.tolist(), *lists, strict=True):
                writer.writerow(["" if value != value else value for value in row])
    return {}


def _all_texts(numbers: Mapping[str, TopicFiles]) -> dict[str, tuple[str, ...]]:
    """Return the words of each column of texts, by its name."""
    names = _column_names(numbers)
    return {n: words for key, entry in numbers.items() for n, words in zip(names[key], entry.words, strict=False)}


def _spoken(places: Floats, words: tuple[str, ...]) -> list[str]:
    """Return the texts that a column stands for; none without a message."""
    return ["" if place != place else words[int(place)] for place in places.tolist()]


def _fields(entries: Sequence[TopicFiles]) -> Iterator[tuple[str, Any]]:
    """Yield each field of a topic with its array, of numbers or of texts, whose time-stamps may be others."""
    first = entries[0].stamps()
    for place, entry in enumerate(entries):
        if not place or not np.array_equal(entry.stamps(), first):
            yield "stamp_ns", entry.stamps()
        for k, name in enumerate(entry.names):
            column = entry.column(k)
            yield name, np.array(_spoken(column, entry.words[k]), str) if entry.words else column


def _by_topic(
    numbers: Mapping[str, TopicFiles], word: Callable[[str], str], longest: int | None = None
) -> dict[str, tuple[str, dict[str, Any]]]:
    """Of each topic its name in a file that does not allow all names, and the arrays of its fields by theirs."""
    entries: dict[str, list[TopicFiles]] = {}
    for entry in numbers.values():
        entries.setdefault(entry.topic, []).append(entry)
    found = {}
    for topic, name in zip(entries, names_apart(map(word, entries), longest), strict=True):
        fields, arrays = zip(*_fields(entries[topic]), strict=True)
        found[topic] = name, dict(zip(names_apart(map(word, fields), longest), arrays, strict=True))
    return found


def _npz(out: Path, numbers: Mapping[str, TopicFiles]) -> dict[str, str]:
    topics = _by_topic(numbers, _dotted)
    arrays = [(f"{name}:{field}", array) for name, fields in topics.values() for field, array in fields.items()]
    with out.open("xb") as file:
        names = names_apart(name for name, _ in arrays)
        np.savez_compressed(file, **{name: array for name, (_, array) in zip(names, arrays, strict=True)})
    return {topic: name for topic, (name, _) in topics.items() if name != _dotted(topic)}


def _dotted(name: str) -> str:
    return name.strip("/").replace("/", ".")


def _mat(out: Path, numbers: Mapping[str, TopicFiles]) -> dict[str, str]:
    """Return a struct for each topic, named by what MATLAB allows."""
    from scipy.io import savemat

    topics = _by_topic(numbers, _word, _LONGEST)
    with out.open("xb") as file:
        savemat(file, dict(topics.values()), long_field_names=True, do_compression=True)
    return {topic: name for topic, (name, _) in topics.items() if name != _word(topic)[:_LONGEST]}


def _word(name: str) -> str:
    word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    return word if word[:1].isalpha() else f"x{word}"


def _parquet(out: Path, numbers: Mapping[str, TopicFiles]) -> dict[str, str]:
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import pyarrow.parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError as error:
        raise ConfigurationError("parquet needs a library that is not installed: pip install pyarrow") from error
    names = chain.from_iterable(_column_names(numbers).values())
    texts = _all_texts(numbers)
    kinds = ((name, pyarrow.string() if name in texts else pyarrow.float64()) for name in names)
    fields = [("stamp_ns", pyarrow.int64()), *kinds]
    with pyarrow.parquet.ParquetWriter(out, pyarrow.schema(fields), write_page_checksum=True) as writer:
        for stamps, columns in _windows(numbers):
            spoken = {n: _spoken(columns[n], words) for n, words in texts.items()}
            writer.write_table(pyarrow.table({"stamp_ns": stamps, **columns, **spoken}))
    return {}


# Each returns the names of topics that would have had the name of another one.
WRITERS: Mapping[str, Callable[[Path, Mapping[str, TopicFiles]], dict[str, str]]] = {
    ".csv": _csv,
    ".npz": _npz,
    ".mat": _mat,
    ".parquet": _parquet,
}
