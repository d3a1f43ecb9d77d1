"""The rows of a table of all topics of a log, side by side by their time-stamps, in windows that fit into memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import count, islice

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.terminal.progress import report_progress

from palpate_logs.topic_arrays import TopicArrays, TopicFiles

_MAX_WINDOW_ROWS = 50_000  # of one topic in memory at once, a choice: memory against calls
_MAX_WINDOW_CELLS = 1 << 23  # of a table in memory at once, a choice: 64 MB of numbers

Stamps = NDArray[np.int64]


def table_windows(topic_files: Mapping[str, TopicFiles]) -> Iterator[tuple[Stamps, dict[str, Floats]]]:
    """Yield time-stamps (n,) [ns] and columns (n,) of a table of all topics, in windows that fit into memory.

    A window ends before a time-stamp that is an edge to all topics, so that messages of one instant are in one window.
    """
    lengths = {topic: len(files) for topic, files in topic_files.items()}
    next_rows = dict.fromkeys(topic_files, 0)
    window_rows = _window_rows(topic_files)
    is_last = False
    while not is_last:
        report_progress(sum(next_rows.values()), sum(lengths.values()))
        end_rows = _window_end(topic_files, next_rows, window_rows)
        is_last = end_rows is None
        if end_rows is None:
            end_rows = lengths
        yield _table_rows(
            {topic: files.rows(next_rows[topic], end_rows[topic]) for topic, files in topic_files.items()}
        )
        next_rows = end_rows


def _window_end(
    topic_files: Mapping[str, TopicFiles], next_rows: Mapping[str, int], window_rows: int
) -> dict[str, int] | None:
    """Return the row of each topic behind a window from the next rows on; None if all that remains is one window."""
    # The stamps of a window of each topic, and the one behind it: the first of these is the edge.
    stamps_ahead: dict[str, Stamps] = {}
    for topic, files in topic_files.items():
        end_row = min(next_rows[topic] + window_rows + 1, len(files))
        stamps_ahead[topic] = files.stamps(next_rows[topic], end_row)
    stamps_behind = [int(stamps[window_rows]) for stamps in stamps_ahead.values() if len(stamps) > window_rows]
    if not stamps_behind:
        return None
    edge = min(stamps_behind)
    if all(not len(stamps) or stamps[0] >= edge for stamps in stamps_ahead.values()):
        # More messages of one instant than a window holds: all of them are one window.
        return {topic: int(np.searchsorted(files.stamps(), edge + 1)) for topic, files in topic_files.items()}
    return {topic: next_rows[topic] + int(np.searchsorted(stamps, edge)) for topic, stamps in stamps_ahead.items()}


def _window_rows(topic_files: Mapping[str, TopicFiles]) -> int:
    """Return the number of rows of each topic in a window.

    In the worst case no time-stamp is common to two topics: the table has the rows of all and the columns of all.
    """
    column_count = sum(len(files.names) for files in topic_files.values())
    return max(min(_MAX_WINDOW_ROWS, _MAX_WINDOW_CELLS // max(column_count * len(topic_files), 1)), 1)


def _table_rows(topics: Mapping[str, TopicArrays]) -> tuple[Stamps, dict[str, Floats]]:
    """Return the time-stamps (n,) [ns] and columns (n,) of a table, NaN where a topic has no message.

    It has a row for each time-stamp of any topic, and as many rows of one as any topic has messages of that instant.
    """
    # The key of a row is its time-stamp, and how many equal ones the topic has before it.
    keys = [np.stack([topic.stamps, _occurrence(topic.stamps)]) for topic in topics.values()]
    row_keys, rows = np.unique(np.concatenate(keys, axis=1), axis=1, return_inverse=True)
    rows = rows.ravel()
    row_count = row_keys.shape[1]
    names = column_names(topics)
    columns: dict[str, Floats] = {}
    first_message = 0  # of the topic, among the messages of all
    for key, topic in topics.items():
        topic_rows = rows[first_message : first_message + len(topic.stamps)]
        first_message += len(topic.stamps)
        for k, name in enumerate(names[key]):
            column = np.full(row_count, np.nan)
            column[topic_rows] = topic.values[:, k]
            columns[name] = column
    return row_keys[0], columns


def _occurrence(stamps: Stamps) -> Stamps:
    """Return for each time-stamp (n,) the number of equal ones before it: messages of one instant stay apart."""
    order = np.argsort(stamps, kind="stable")
    ordered = stamps[order]
    is_first = np.concatenate([[True], ordered[1:] != ordered[:-1]]) if len(ordered) else np.zeros(0, bool)
    index = np.arange(len(ordered))
    # Each ordered index minus that of the first equal time-stamp.
    occurrence = np.zeros(len(stamps), np.int64)
    occurrence[order] = index - np.maximum.accumulate(np.where(is_first, index, 0))
    return occurrence


def column_names(topics: Mapping[str, TopicArrays] | Mapping[str, TopicFiles]) -> dict[str, tuple[str, ...]]:
    """Return the names of the columns of a table by the key of their topic, as "/wrench:wrench.force.z"."""
    names = unique_names(f"{topic.topic}:{name}" for topic in topics.values() for name in topic.names)
    return {key: tuple(islice(names, len(topic.names))) for key, topic in topics.items()}


def unique_names(names: Iterable[str], max_length: int | None = None) -> Iterator[str]:
    """Yield names of at most `max_length` characters; one that came before gets the next number that is free.

    >>> list(unique_names(["ft_raw", "ft_raw", "ft_raw_2"]))
    ['ft_raw', 'ft_raw_3', 'ft_raw_2']
    """
    cut_names = [name[:max_length] for name in names]
    used: set[str] = set()
    for name in cut_names:
        candidate = name
        for number in count(2):
            if candidate not in used and (candidate == name or candidate not in cut_names):
                break
            suffix = f"_{number}"
            stem = name if max_length is None else name[: max_length - len(suffix)]
            candidate = f"{stem}{suffix}"
        used.add(candidate)
        yield candidate
